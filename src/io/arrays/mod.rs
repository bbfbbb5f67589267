//! Arrays for numpy: `.npy` and `.npz`.
//!
//! `npy` has headers and elements, `archive` the zip file of an `.npz`, `writer` arrays that grow,
//! `recording` the arrays of a recording.

pub(super) mod archive;
pub(super) mod npy;
pub(super) mod read;
pub(super) mod recording;
pub(super) mod writer;
