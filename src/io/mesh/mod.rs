//! Skins and flat meshes in the formats of other programs; `formats.rs` lists what each keeps.

pub(super) mod formats;
mod icub;
mod obj;
mod off;
mod ply;
mod robotskin;
pub(super) mod skin_csv;
mod stl;
