//! Images of maps.

pub(super) mod exr;
mod exr_zip;
