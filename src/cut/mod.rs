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
//! 1. **handles are opened** by what is left over between a tree of shortest ways from one vertex
//!    and a spanning tree of the faces (`(erickson2004)`); a closed surface without handles by the
//!    way between two far points;
//! 2. **loops are joined** to it, always the nearest by a shortest way (`(takahashi1980)`);
//! 3. **it is shortened**: each part between two knots gives way to the shortest one that does the
//!    same;
//! 4. **slits** lead from peaks of distortion or curvature to it;
//! 5. or loops are joined **pair by pair** through what is curved between them, where the map would
//!    overlap itself otherwise.
//!
//! Ways through dense taxels count as longer. All of it is `O(n log n)` a step and depends on
//! neither the number of threads nor how the surface lies in space.
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
//! - `options`, `error`: what is asked for, and why it may fail; `cut_mesh`: a mesh cut open
//! - `seam_graph`: the closed surface and its shortest ways; `handles`, `shorten`: steps 1 to 3
//! - `trial`: a seam with its map; `slits`, `pairs`: steps 4 and 5; `recipe`: all steps; `decide`: the
//!   rule
//! - `given`: seams from a user

mod cut_mesh;
mod decide;
mod error;
mod given;
mod handles;
mod options;
mod pairs;
mod recipe;
mod seam_graph;
mod shorten;
mod slits;
mod trial;

pub use cut_mesh::CutMesh;
pub(crate) use cut_mesh::{is_plain_disk, seam_length};
pub(crate) use decide::{AreaLimit, TrialMaps, decide};
pub use error::CutError;
pub(crate) use given::{cut_along, pairs_by_patch};
pub use options::Cut;
