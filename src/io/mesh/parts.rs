//! Which parts of a file are read beyond what a skin needs, and the faces of a whole skin.

use crate::skin::Skin;

/// The corners of the triangles of all patches, numbered through the vertices of all.
pub(super) fn all_triangles(skin: &Skin) -> impl Iterator<Item = [usize; 3]> + '_ {
    let before = skin.patches.iter().scan(0, |sum, patch| {
        let before = *sum;
        *sum += patch.mesh.positions.len();
        Some(before)
    });
    skin.patches.iter().zip(before).flat_map(|(patch, before)| {
        patch.mesh.triangles.iter().map(move |corners| corners.map(|v| before + v.index()))
    })
}

/// What of a file a skin has no use for, but a choice of faces or seams may have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ReadParts {
    /// [`Sheet::texture`](crate::skin::Sheet::texture), of OBJ and glTF.
    pub texture: bool,
    /// [`Sheet::materials`](crate::skin::Sheet::materials), of OBJ and glTF.
    pub materials: bool,
}
