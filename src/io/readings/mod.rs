//! Recordings and live streams of readings, frame by frame, in memory that does not depend on their
//! length.
//!
//! In reading order: `text` reads lines of numbers (CySkin's text and CSV, from a file or a pipe),
//! `header` says what their columns are; `npy` has headers and elements of numpy's arrays, `arrays`
//! reads recordings of them, stored alone (`.npy`) or in an `archive` (`.npz`); `reader` is the one
//! type for all of them. `whole` reads the arrays of meshes.

mod archive;
pub(super) mod arrays;
mod header;
mod npy;
pub(super) mod reader;
mod text;
pub(super) mod whole;
