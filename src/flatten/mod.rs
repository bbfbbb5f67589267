//! Flattening: a disk-like mesh with holes to the plane, with a free boundary and no flips.

mod barrier;
mod conformal;
mod crossings;
mod disk;
mod distortion;
mod energy;
mod error;
mod insertion;
mod jacobian;
mod linear;
mod magnification;
mod net;
mod newton;
mod options;
mod orientation;
mod overlap;
mod problem;
mod refine;
mod separate;
mod solve;
mod surface;
mod tutte;
mod untangle;

pub use distortion::{Distortion, distortion};
pub use error::FlattenError;
pub use options::{Energy, FlattenOptions, Method, Overlap};
pub use solve::{flatten, flatten_pyramid};
