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
//!    of one vertex nor a spanning tree of the faces (`(erickson2004)`);
//! 2. **loops are joined** to it, always the nearest by a shortest path (`(takahashi1980)`);
//! 3. **cones are reached**: the conformal factor shows where the skin must stretch most, and a shortest
//!    path leads from there to the seam, again and again (`(benchen2008)`); a closed surface without
//!    handles is cut between its first two cones;
//! 4. **it is shortened**: each path between two branch vertices is replaced by the shortest one that
//!    opens the same.
//!
//! Paths through dense taxels and taxels of high weight count as longer. Each step takes `O(n log n)`,
//! and the result depends on neither the number of threads nor the pose of the surface.
//!
//! # The rule
//!
//! What must be cut is cut. How many cones it reaches, and whether loops are joined, is what a trial map
//! shows to pay (`decide`); a plain disk is cut where its map is poor without, as that of a fingertip, or where a
//! limit of the area ratio requires it. The trials are made on a level of a few thousand faces; the seam found there is then followed on the skin
//! itself and shortened again (`recipe`).

mod cones;
mod cut_mesh;
mod decide;
mod error;
mod given;
mod handles;
mod recipe;
mod seam_graph;
mod shorten;
mod trial;

pub use cut_mesh::is_plain_disk;
pub(crate) use cut_mesh::seam_length;
pub use cut_mesh::{CutMesh, PlaceId};
pub use decide::{decide, may_be_poor, with_falling_ratios};
pub use error::CutError;
pub use given::{cut_along, pairs_by_patch};
pub use recipe::Recipe;
pub use seam_graph::seam_costs;

use crate::id::{IdVec, VertexId};
use crate::skin::{PatchId, TaxelId};

/// How to cut patches before they are mapped.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Cut {
    /// Closed patches and handles are cut; patches with several loops where it makes their map much better; any
    /// patch, a plain disk too, where its map is poor and a short seam halves the excess of its energy. Where no
    /// map is found then, all loops are joined.
    #[default]
    Auto,
    /// As [`Cut::Auto`], and the seam reaches more cones, of a plain disk too, until no face of the map is
    /// larger or smaller than on the skin by more than this ratio (see
    /// [`Distortion::area_max`](crate::flatten::Distortion)). Where no number of cones suffices, that of
    /// the lowest ratio is taken; a lower limit never gives a larger ratio.
    AreaRatio(f64),
    /// Nothing is cut; closed patches and handles have no map then.
    None,
    /// Closed patches and handles are cut, and all loops are joined.
    All,
    /// Exactly these edges are cut, given by the ids of their taxels. Patches without any of them
    /// are cut as by [`Cut::Auto`].
    Along(Vec<[TaxelId; 2]>),
    /// As [`Cut::Along`], with the edges of each patch given by its vertices, whose ids other patches may have, too.
    Edges(IdVec<PatchId, Vec<[VertexId; 2]>>),
}

impl Cut {
    /// Checks that an area ratio is above 1.
    ///
    /// # Errors
    /// [`CutError::AreaRatio`].
    #[doc(hidden)]
    pub fn validate(&self) -> Result<(), CutError> {
        match *self {
            Self::AreaRatio(found) if !(found.is_finite() && found > 1.0) => {
                Err(CutError::AreaRatio { found })
            }
            _ => Ok(()),
        }
    }
}
