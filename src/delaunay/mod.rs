//! Planar triangulations of point sets: the only module that uses spade.
//!
//! Natural neighbours on a map are found in it (`image`). The points on the skin around each taxel
//! are triangulated by `skin::triangulate` itself, whose tests compare with this module.

mod error;
mod triangulate;

pub(crate) use error::DelaunayError;
pub(crate) use triangulate::triangulate;
