//! Images of maps and of frames of readings: OpenEXR, and raw numbers.

pub(super) mod exr;
pub(super) mod frame;
