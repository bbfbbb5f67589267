//! Which parts of a file are read beyond what a skin needs, which of its faces are taken, and the faces of
//! a whole skin.

use std::path::Path;

use crate::io::IoError;
use crate::io::file::{Source, excerpt};
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

/// Reads a list of faces: a number on each line, counted from 0 through all triangles of a file; a
/// first line `face` may stand before them.
///
/// # Errors
/// If the file cannot be read, or a line is not such a number.
pub fn read_faces(path: &Path) -> Result<Vec<usize>, IoError> {
    let source = Source::open(path)?;
    let mut faces = Vec::new();
    for (at, line) in source.lines()? {
        let line = line.trim();
        if line.is_empty() || (faces.is_empty() && line.eq_ignore_ascii_case("face")) {
            continue;
        }
        let face = line.parse().map_err(|_| at.invalid(excerpt(line), "the number of a face, from 0"))?;
        faces.push(face);
    }
    Ok(faces)
}
