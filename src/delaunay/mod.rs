//! Planar triangulations: point sets. The door to `spade`.

mod error;
mod triangulate;

pub use error::DelaunayError;
pub use triangulate::triangulate;
