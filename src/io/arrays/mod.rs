//! Arrays of numpy: `.npy`, and `.npz`, a zip archive of them.
//!
//! `read` takes arrays from elsewhere, whole or from the first element on; `write` has arrays that
//! grow frame by frame; `recording` writes those of a recording.

pub(super) mod read;
pub(super) mod recording;
pub(super) mod write;
