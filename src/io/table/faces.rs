//! Lists of faces.

use std::path::Path;

use crate::io::{
    IoError,
    file::{Source, excerpt},
};

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
