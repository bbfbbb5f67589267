use std::path::Path;

use crate::{
    io::{
        IoError,
        file::{extension::kind, source::invalid},
        gltf,
        mesh::{obj, ply, robotskin, skin_csv, stl},
    },
    skin::Skin,
};

/// Extensions that [`write_skin`] knows.
const KNOWN: &str = "glb, gltf, json, obj, ply, stl, csv";

/// Writes a skin in the format that the extension names; see [`crate::io::read_draft`] for what each keeps.
///
/// OBJ, PLY, STL and CSV know no frames: positions are written in the world, and reading them gives one frame at the
/// origin. JSON has one frame, which it keeps if all patches share a link. Decimals are the shortest that read back as the
/// same `f64`; glTF rounds to `f32`.
///
/// # Errors
/// If the skin breaks a promise of its type, a number in it does not fit the format, or the file cannot be written; an
/// older file stays as it was.
pub fn write_skin(path: &Path, skin: &Skin) -> Result<(), IoError> {
    let write = match kind(path).as_str() {
        "glb" => gltf::write_skin_glb,
        "gltf" => gltf::write_skin_gltf,
        "json" => robotskin::write,
        "obj" => obj::write,
        "ply" => ply::write,
        "stl" => stl::write,
        "csv" => skin_csv::write,
        _ => return Err(IoError::UnknownKind { path: path.into(), known: KNOWN }),
    };
    skin.validate().map_err(|e| invalid(path, "skin to write", e.to_string(), "a valid one"))?;
    write(path, skin)
}
