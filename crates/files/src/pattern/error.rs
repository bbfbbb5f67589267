//! Why a pattern cannot be drawn.

use crate::map::MapError;

/// Why a pattern cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum PatternError {
    #[error("there is no patch: there is nothing to draw")]
    Empty,
    #[error("there is no patch {patch:?}; the patches are {}", known.join(", "))]
    UnknownPatch { patch: String, known: Vec<String> },
    #[error(
        "the map of patch {patch:?} has no area: its sides are {width_mm} and {height_mm} mm; both must be above 0"
    )]
    NoArea { patch: String, width_mm: f64, height_mm: f64 },
    #[error(
        "sheets of {} x {} mm cannot be used: with margins of {margin} mm their sides must be {least} to {most} mm",
        size[0], size[1]
    )]
    Sheet { size: [f64; 2], margin: f64, least: f64, most: f64 },
    #[error("the pattern of {} x {} mm needs {needed} sheets; at most {most} are possible", size[0], size[1])]
    TooManySheets { size: [f64; 2], needed: f64, most: usize },
    #[error(transparent)]
    Map(#[from] MapError),
}
