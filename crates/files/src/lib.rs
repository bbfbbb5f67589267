//! Files, pictures and pages of dermatome, and the whole flow from a file to its maps: the rooms above those that compute.
//! The crate `dermatome` passes on all of it and of the core, and has the tour.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

pub use dermatome_core::{
    atlas, body, calib, contact, cut, design, diff, flatten, id, image, least_squares, map, mesh, pyramid,
    registration, response, run, signal, skin, touches, unfold,
};
use dermatome_core::{delaunay, numeric, parallel, sparse};
#[cfg(feature = "robots")]
pub use dermatome_core::{remesh, robot};

pub mod io;
#[cfg(feature = "plot")]
pub mod plot;
#[cfg(feature = "plot")]
pub mod pattern;
pub mod report;
mod error;
pub mod recording;
#[cfg(feature = "plot")]
pub mod page;
pub mod pipeline;

pub use calib::{Calibration, Observations, calibrate};
pub use contact::{Cell, ContactIndex, Hit, Hits, MapIndex, Query};
pub use error::Error;
pub use io::{read_draft, read_map, write_map};
pub use map::SkinMap;
pub use pipeline::{BuildOptions, build, build_file};
pub use pyramid::LevelId;
pub use skin::{AssembleOptions, Draft, PatchId, Skin, assemble};
pub use sparse::SparseError;
