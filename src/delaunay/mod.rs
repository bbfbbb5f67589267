//! Planar triangulations of point sets and regions: the only module that uses spade.
//!
//! Natural neighbours on a map are found in it (`image`), and the holes of a map are filled with it
//! (`flatten`). The points on the skin around each taxel
//! are triangulated by `skin::triangulate` itself, whose tests compare with this module.

mod error;
mod region;
mod triangulate;

pub(crate) use error::DelaunayError;
pub(crate) use region::triangulate_region;
pub(crate) use triangulate::triangulate;
