//! Arrays that come from elsewhere: `npy` has headers and elements, `archive` the arrays of a file,
//! `whole` reads some of them as a whole.

pub(in crate::io) mod archive;
pub(in crate::io) mod npy;
pub(in crate::io) mod whole;
