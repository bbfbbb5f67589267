//! Flattening: a disk-like mesh with holes to the plane, with a free boundary and no flips.

mod bijective;
mod distortion;
mod domain;
mod energy;
mod error;
mod flatten;
mod jacobian;
mod levels;
mod options;
mod placement;
mod start;

pub use distortion::{Distortion, distortion};
pub use error::FlattenError;
pub use flatten::{flatten, flatten_pyramid};
pub use options::{Energy, FlattenOptions, Method, Overlap};
