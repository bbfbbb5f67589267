//! Planar triangulations of point sets and regions. The only crate of dermatome that uses spade.
//!
//! Natural neighbours on a map are found in it (`image`), and the holes of a map are filled with it
//! (`flatten`). The points on the skin around each taxel are triangulated by `skin::triangulate`
//! itself, whose tests compare with this crate.
//!
//! A crate of its own, so that an edit elsewhere does not compile spade's generic code again.

mod error;
mod region;
mod triangulate;

pub use error::DelaunayError;
pub use region::triangulate_region;
pub use triangulate::triangulate;
