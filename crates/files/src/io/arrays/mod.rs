//! Arrays of numpy: `.npy`, and `.npz`, a zip archive of them.
//!
//! `npy` has headers and elements; `read` takes arrays from elsewhere, whole or from the first element on, `rows` row by row;
//! `write` has arrays that grow frame by frame; `recording` writes those of a recording.

pub(super) mod npy;
pub(super) mod read;
pub(super) mod recording;
pub(super) mod rows;
pub(super) mod write;
