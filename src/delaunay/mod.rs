//! Planar triangulations of point sets: the only module that uses spade.
//!
//! The library triangulates points on the skin around each taxel by itself (`skin::triangulate`),
//! and this module is what its tests compare with; it is compiled for them alone. A first caller in
//! the library makes it a plain `pub(crate) mod`, and spade a dependency instead of a
//! dev-dependency.

mod error;
mod triangulate;

pub(crate) use error::DelaunayError;
pub(crate) use triangulate::triangulate;
