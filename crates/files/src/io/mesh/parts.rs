//! Which parts of a file are read beyond what a skin needs, and the faces of a whole skin.

use crate::skin::{Remark, RemarkKind, Skin};

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

/// Whether numbers separated by white space are numbers, of which not all are finite.
pub(super) fn is_not_finite(text: &str) -> bool {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    numbers.is_some_and(|all| !all.iter().all(|x| x.is_finite()))
}

/// Says how many normals are not finite: they count as none, and those of the faces are taken.
pub(super) fn not_finite(patch: String, normals: usize) -> Remark {
    let what = match normals {
        1 => "1 normal is not a finite number, and is not read".into(),
        n => format!("{n} normals are not finite numbers, and are not read"),
    };
    Remark { patch, kind: RemarkKind::PassedOver { what } }
}
