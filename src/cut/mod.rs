//! Cutting: a short seam that makes any orientable surface a disk with holes, where that is needed
//! or worth it.
//!
//! A closed patch or one with handles has no map at all, and a patch that bends round a limb has
//! only a poor one: a sleeve becomes a flat ring. Cut open along a line it is unrolled without
//! distortion. The mesh, its pyramid, fields and lookups stay those of the uncut patch; only the
//! map has the taxels of the seam at several places.
//!
//! # The seam
//!
//! Every boundary loop is closed by a point whose spokes cost nothing, so that a loop counts as one
//! point of a closed surface. On it
//!
//! 1. **handles are opened** along the tree-cotree loops: the edges in neither the shortest-path tree
//!    of one vertex nor a spanning tree of the faces (`(erickson2004)`); a closed surface without
//!    handles is cut along the path between two far points;
//! 2. **loops are joined** to it, always the nearest by a shortest path (`(takahashi1980)`);
//! 3. **it is shortened**: each path between two branch vertices is replaced by the shortest one that
//!    opens the same;
//! 4. **slits** lead from peaks of distortion or curvature to it;
//! 5. or loops are joined **pair by pair** through what is curved between them, where the map would
//!    overlap itself otherwise.
//!
//! Paths through dense taxels count as longer. Each step takes `O(n log n)`, and the result depends on
//! neither the number of threads nor the pose of the surface.
//!
//! # The rule
//!
//! What must be cut is cut. Loops are joined and slits added only where trial maps show that it
//! pays (`decide`), on a plain disk only where a limit of the area ratio asks for it. The trials are
//! made on a level of a few thousand faces, each slit from the map before it; what they decide, a
//! recipe, is then done on the skin itself.
//!
//! # Files, in reading order
//!
//! - `error`: why a surface cannot be cut; `cut_mesh`: a mesh cut open
//! - `seam_graph`: the closed surface and its shortest paths; `handles`, `shorten`: steps 1 to 3
//! - `trial`: a seam with its map; `slits`, `pairs`: steps 4 and 5; `recipe`: all steps; `decide`: the
//!   rule
//! - `given`: seams from a user

mod cut_mesh;
mod decide;
mod error;
mod given;
mod handles;
mod pairs;
mod recipe;
mod seam_graph;
mod shorten;
mod slits;
mod trial;

pub use cut_mesh::{CutMesh, PlaceId};
pub(crate) use cut_mesh::{is_plain_disk, seam_length};
pub(crate) use decide::{AreaLimit, TrialMaps, decide};
pub use error::CutError;
pub(crate) use given::{cut_along, pairs_by_patch};

use crate::skin::TaxelId;

/// How to cut patches before they are mapped.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Cut {
    /// Closed patches and handles are cut; patches with several loops where it makes their map much
    /// better; a plain disk never.
    #[default]
    Auto,
    /// As [`Cut::Auto`], and slits are added, into a plain disk too, until no face of the map is larger
    /// or smaller than on the skin by more than this ratio (see
    /// [`Distortion::area_max`](crate::flatten::Distortion)). Where slits do not suffice, those that
    /// lower the ratio most are added.
    AreaRatio(f64),
    /// Nothing is cut; closed patches and handles have no map then.
    None,
    /// Closed patches and handles are cut, and all loops are joined.
    All,
    /// Exactly these edges are cut, given by the ids of their taxels. Patches without any of them
    /// are cut as by [`Cut::Auto`].
    Along(Vec<[TaxelId; 2]>),
}
