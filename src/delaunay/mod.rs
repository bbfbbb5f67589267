//! Planar triangulations: point sets, and the star of one point. The door to `spade`.

mod error;
mod star;
mod triangulate;

pub use error::DelaunayError;
pub use star::Star;
pub use triangulate::triangulate;
