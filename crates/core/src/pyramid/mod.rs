//! The pyramid of receptive fields: one patch, coarsened level by level.
//!
//! Vertices are nested: the centre of every receptive field is a taxel. A level is made from the
//! next finer one in three steps:
//!
//! 1. **Centres** are chosen: a maximal independent set of the vertices, where `i` and `j` conflict if
//!    `|x_i - x_j| <= alpha (h_i + h_j) / 2` with the local spacing `h` (1.35 for `alpha` leaves about a
//!    quarter), and a path of such vertices joins them. Corners come first, then the boundary, then the
//!    inside; of each, live taxels before absent ones and thermal pads. Each boundary loop keeps at least
//!    three vertices.
//! 2. **Every other vertex is removed**, in rounds of stars that share no triangle. A star is flattened by
//!    `z^a` `(lee1998)` and filled: with a fan if its smallest angle is nearly as large as that of the best
//!    filling, else with the triangulation whose smallest angle is largest `(klincsek1980)`. Fillings that
//!    would fold the surface, or turn it by more than 60 (then 78) degrees, are refused.
//! 3. **The taxels inside** a star move into its filling, at their positions in the flattened star. Their
//!    barycentric weights `w` there are the rows of a [`Prolongation`] `P`.
//!
//! `P` carries values from a level to the finer one, `x_fine = P x_coarse`. Amounts of the taxels
//! (forces, areas) are collected by the fields of a level straight from level 0, `f = Q' f_0`, with `Q`
//! the level's [`Level::to_finest`]; rows sum to 1, so the total is kept. The [`RemovalLog`] lets
//! flattening undo the removals on the map.
//!
//! A patch that is mapped cut open has the same seam on every level: its vertices
//! are chosen like those of a boundary, and a star on the seam is filled on either side of it.
//!
//! All steps number the vertices along a Morton curve: neighbours in space are near in memory, and only level
//! 0 depends on the order of a file.
//!
//! Guaranteed: every level is an oriented manifold with the Euler characteristic and the boundary loops of
//! the patch; no level folds where the patch does not; the result does not depend on the number of threads.
//! Not guaranteed: that only centres are left; a vertex whose removal the rules forbid stays.
//!
//! The files in reading order: `level`, `prolongation`, `field`, `removal_log` (the results), `coarsen`
//! (the steps), `centres` (step 1), and in `removal` `remover`, `queue`, `star`,
//! `retriangulation` (step 2) and `taxel_locations` (step 3).

mod coarsen;
mod error;
mod field;
mod centres;
mod level;
mod level_id;
mod prolongation;
mod removal;
mod removal_log;

pub(crate) use centres::cells;
pub use coarsen::{CoarsenOptions, CutPyramid, coarsen, coarsen_cut};
pub use error::PyramidError;
pub use field::Field;
pub(crate) use level::check_levels;
pub use level::{Level, Pyramid};
pub use level_id::LevelId;
pub use prolongation::Prolongation;
pub use removal_log::{Removal, RemovalLog};
