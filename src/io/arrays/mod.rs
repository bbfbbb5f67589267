//! Arrays for numpy: `.npy` and `.npz`.
//!
//! `npy` has headers and elements, `archive` the zip file of an `.npz`, `writer` arrays that grow.

pub(super) mod archive;
pub(super) mod npy;
pub(super) mod writer;
