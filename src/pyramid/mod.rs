//! The pyramid of receptive fields: one patch, coarsened level by level.
//!
//! Vertices are nested: the centre of every receptive field is a taxel. A level is made from the one below in three
//! steps: centres are chosen, evenly for the local spacing; every other vertex is removed and its star filled, star by
//! independent star; the taxels inside a star move into the filling. Two records stay: the [`RemovalLog`], so that
//! flattening can undo the removals on the map, and the [`Prolongation`], which carries values coarse to fine and whose
//! transpose carries amounts fine to coarse.

mod coarsen;
mod error;
mod independent_set;
mod level;
mod prolongation;
mod refill;
mod removal;
mod removal_log;
mod rings;
mod spacing;
mod surface;

pub use coarsen::{CoarsenOptions, coarsen};
pub use error::PyramidError;
pub(crate) use level::check_levels;
pub use level::{Level, LevelId, Pyramid};
pub use prolongation::Prolongation;
pub use removal_log::{Removal, RemovalLog};
