//! Skins and flat meshes in the formats of other programs; `formats.rs` lists what each keeps. `flat.rs` writes
//! flattened meshes.

pub(super) mod flat;
pub(super) mod formats;
mod icub;
mod npz;
mod obj;
mod off;
pub(super) mod parts;
mod ply;
mod robotskin;
pub(super) mod skin_csv;
mod stl;
