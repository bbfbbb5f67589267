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

use crate::skin::Skin;

/// The corners of the triangles of all patches, numbered through the vertices of all.
fn all_triangles(skin: &Skin) -> impl Iterator<Item = [usize; 3]> + '_ {
    let before = skin.patches.iter().scan(0, |sum, patch| {
        let before = *sum;
        *sum += patch.mesh.positions.len();
        Some(before)
    });
    skin.patches.iter().zip(before).flat_map(|(patch, before)| {
        patch.mesh.triangles.iter().map(move |corners| corners.map(|v| before + v.index()))
    })
}
