//! Arrays that are written: `npy` has headers and elements, `archive` the zip file of an `.npz`, `writer`
//! arrays that grow.

mod archive;
pub(in crate::io) mod npy;
pub(in crate::io) mod writer;
