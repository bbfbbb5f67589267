//! Images of maps: OpenEXR.

pub(super) mod exr;
