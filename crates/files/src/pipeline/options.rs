//! What decides the maps of a skin.

use glam::DVec3;

use crate::cut::Cut;
use crate::flatten::FlattenOptions;
use crate::pyramid::CoarsenOptions;

/// Options of [`build`](crate::pipeline::build).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BuildOptions {
    /// Where to cut.
    pub cut: Cut,
    /// Seams prefer skin that faces this direction, for example the inside of limbs; in the frame of the skin
    /// at its bind pose. Not used with [`Cut::Along`].
    pub seam_side: Option<DVec3>,
    /// How to coarsen.
    pub coarsen: CoarsenOptions,
    /// How to flatten.
    pub flatten: FlattenOptions,
    /// Side of a pixel of the images, in m; `None`: 1 mm, or larger where that would make more
    /// pixels than the taxels need.
    pub pixel: Option<f64>,
    /// Which mean densities and acuities are relative to.
    pub magnify_over: MagnifyOver,
    /// Widest gap over which taxels of different patches are [linked](crate::body::gap_links), in m; `None`:
    /// 3.5 spacings, 0: none are.
    pub across: Option<f64>,
    /// Whether patches that cannot be mapped are left out, as long as one can; else they are an error.
    pub keep_going: bool,
}

/// Which mean the densities of [`Method::Intrinsic`](crate::flatten::Method::Intrinsic) and the acuities of
/// taxels are relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MagnifyOver {
    /// Over the skin: the map of a denser patch is larger, and all maps together are as large as the skin.
    #[default]
    Skin,
    /// Over each patch: its map is as large as its skin.
    Patch,
}

/// The numbers in which a map is measured and kept one to one.
#[derive(Debug, Clone, Copy)]
pub(super) enum Numbers {
    /// Those of a map file.
    F32,
    F64,
}
