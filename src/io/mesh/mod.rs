//! Skins and flat meshes in the formats of other programs.

pub(super) mod flat;
mod icub;
mod obj;
mod ply;
pub(super) mod read;
mod robotskin;
mod skin_csv;
mod stl;
pub(super) mod write;
