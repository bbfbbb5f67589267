use std::path::Path;

use crate::{
    io::{
        IoError,
        file::{extension::kind, source::Source},
        gltf,
        mesh::{icub, obj, ply, robotskin, skin_csv, stl},
    },
    skin::Draft,
};

/// Extensions that [`read_draft`] knows.
const KNOWN: &str = "glb, gltf, json, obj, ply, stl, csv, txt";

/// Reads a skin or a mesh as it was written, by the extension of its file:
///
/// | extension | what | keeps |
/// |---|---|---|
/// | `glb`, `gltf` | glTF 2.0: every mesh of the default scene is a sheet | all, rounded to 32 bits |
/// | `json` | robotskinlib, version 2 | ids, normals, link frame |
/// | `obj` | Wavefront OBJ: every `o` or `g` is a sheet | normals |
/// | `ply` | PLY, text or binary | ids, normals, areas, densities, presence |
/// | `stl` | STL, text or binary: every solid is a sheet | positions of 32 bits |
/// | `csv` | tables of taxels (`skin.csv`) and triangles (`skin.triangles.csv`), or of taxels alone | all but the frames of links |
/// | `txt` | positions of iCub taxels, without triangles | ids, normals, presence, modules |
///
/// Every number of the draft is finite and every corner exists; nothing else has been judged.
///
/// # Errors
/// If the file cannot be read, is longer than 4 GiB or of an unknown kind, or breaks a rule of its format.
pub fn read_draft(path: &Path) -> Result<Draft, IoError> {
    let read = match kind(path).as_str() {
        "glb" | "gltf" => return gltf::read_gltf(path),
        "json" => robotskin::read,
        "obj" => obj::read,
        "ply" => ply::read,
        "stl" => stl::read,
        "csv" => skin_csv::read,
        "txt" => icub::read,
        _ => return Err(IoError::UnknownKind { path: path.into(), known: KNOWN }),
    };
    read(&Source::open(path)?)
}
