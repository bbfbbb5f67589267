//! Why no skin can be designed.

use crate::bvh::BvhError;
use crate::run::Cancelled;

/// Why no skin can be designed.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum DesignError {
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The drawing of the module is not one.
    #[error("the module has {found}; needed: {needed}")]
    Module { found: String, needed: &'static str },
    /// An option that is not positive and finite.
    #[error("{what} is {found}; a finite number above 0 is needed")]
    Option { what: &'static str, found: f64 },
    /// The module cannot lie on the surface.
    #[error(
        "the module is {module_mm:.1} mm long and {module_cm2:.1} cm2, the patch {patch_mm:.1} mm and {patch_cm2:.1} cm2; \
         one that fits the patch is needed"
    )]
    TooLarge { module_mm: f64, module_cm2: f64, patch_mm: f64, patch_cm2: f64 },
    /// The module may lie anywhere.
    #[error(
        "the tolerance is {tolerance_mm} mm, and the module {module_mm:.1} mm long; needed: a tolerance below that length"
    )]
    TooLoose { tolerance_mm: f64, module_mm: f64 },
    /// The module is tiny for the surface.
    #[error("some {modules:.0} modules would fit; at most {most} are placed")]
    TooMany { modules: f64, most: usize },
    /// No module found a place.
    #[error(
        "no module fits: the nearest to the surface of those tried is up to {gap_mm:.2} mm from it, and {tolerance_mm} mm \
         is the tolerance; sides of {side_mm:.1} mm would fit on half of the area"
    )]
    NothingFits { gap_mm: f64, tolerance_mm: f64, side_mm: f64 },
    /// The surface has no triangle, or is too far from the origin to be searched.
    #[error("its surface cannot be searched: {0}")]
    Surface(#[from] BvhError),
}
