//! Skins in all formats: which extension is read and written by which file; and flat meshes, each a
//! mesh with a position on the map for each vertex.

use std::{io::Write, path::Path};

use glam::DVec2;

use crate::{
    id::{IdVec, VertexId},
    io::{
        IoError,
        arrays::{npy::Elements, writer::ArrayWriter},
        file::{Source, kind, unfit, write_file},
        gltf,
        mesh::{icub, obj, off, ply, robotskin, skin_csv, stl},
    },
    mesh::TriMesh,
    skin::{Draft, Skin},
};

/// Reads a skin or a mesh as it was written, by the extension of its file:
///
/// | extension | what | keeps |
/// |---|---|---|
/// | `glb`, `gltf` | glTF 2.0: every mesh of the default scene is a sheet | all, as 32 bits |
/// | `json` | robotskinlib, version 2 | ids, normals, link frame |
/// | `obj` | Wavefront OBJ: every `o` or `g` is a sheet | normals |
/// | `off` | OFF of Geomview, as text: one sheet | normals |
/// | `ply` | PLY, text or binary | ids, normals, areas, densities, presence |
/// | `stl` | STL, text or binary: every solid is a sheet | positions of 32 bits |
/// | `csv` | taxels, and if there triangles (`skin.triangles.csv`) | all but the frames of links |
/// | `txt` | positions of iCub taxels, without triangles | ids, normals, presence, modules |
///
/// Every number of the draft is finite and every corner exists; nothing else has been judged.
///
/// ```
/// use dermatome::io::read_draft;
///
/// let path = std::env::temp_dir().join("dermatome-read-draft.obj");
/// std::fs::write(&path, "o palm\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
/// let draft = read_draft(&path)?;
/// assert_eq!(draft.sheets[0].name, "palm");
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the file cannot be read, is longer than 4 GiB or of an unknown kind, or breaks a rule of its
/// format.
pub fn read_draft(path: &Path) -> Result<Draft, IoError> {
    read_draft_with(path, ReadParts::default())
}

/// What of a file a skin has no use for, but a choice of faces or seams may have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ReadParts {
    /// [`Sheet::texture`](crate::skin::Sheet::texture), of OBJ and glTF.
    pub texture: bool,
    /// [`Sheet::materials`](crate::skin::Sheet::materials), of OBJ and glTF.
    pub materials: bool,
}

/// The same as [`read_draft`], with more parts of the file.
///
/// # Errors
/// As [`read_draft`], or if texture coordinates are not finite numbers.
pub fn read_draft_with(path: &Path, parts: ReadParts) -> Result<Draft, IoError> {
    let read = match kind(path).as_str() {
        "glb" | "gltf" => return gltf::read_gltf(Source::open(path)?, parts),
        "obj" => return obj::read(&Source::open(path)?, parts),
        "json" => robotskin::read,
        "off" => off::read,
        "ply" => ply::read,
        "stl" => stl::read,
        "csv" => skin_csv::read,
        "txt" => icub::read,
        _ => {
            let known = "glb, gltf, json, obj, off, ply, stl, csv, txt";
            return Err(IoError::UnknownKind { path: path.into(), known });
        }
    };
    read(&Source::open(path)?)
}

/// Writes a skin in the format that the extension names; see [`crate::io::read_draft`] for what
/// each keeps.
///
/// OBJ, OFF, PLY, STL and CSV know no frames: positions are written in the world, and reading them gives
/// one frame at the origin. JSON has one frame, which it keeps if all patches share a link.
/// Decimals are the shortest that read back as the same `f64`; glTF rounds to `f32`.
///
/// ```
/// use dermatome::{io::{read_draft, write_skin}, mesh::shapes, skin::Skin};
///
/// let mesh = shapes::lattice(5, 4, 0.01);
/// let count = mesh.positions.len();
/// let skin = Skin::from_mesh("palm", mesh);
/// let path = std::env::temp_dir().join("dermatome-write-skin.ply");
/// write_skin(&path, &skin)?;
/// assert_eq!(read_draft(&path)?.sheets[0].positions.len(), count);
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the skin breaks a promise of its type, a number in it does not fit the format, or the file
/// cannot be written; an older file stays as it was.
pub fn write_skin(path: &Path, skin: &Skin) -> Result<(), IoError> {
    let write = match kind(path).as_str() {
        "glb" | "gltf" => gltf::write_skin,
        "json" => robotskin::write,
        "obj" => obj::write,
        "off" => off::write,
        "ply" => ply::write,
        "stl" => stl::write,
        "csv" => skin_csv::write,
        _ => {
            let known = "glb, gltf, json, obj, off, ply, stl, csv";
            return Err(IoError::UnknownKind { path: path.into(), known });
        }
    };
    skin.validate().map_err(|e| unfit(path, "skin to write", e.to_string(), "a valid one"))?;
    write(path, skin)
}

/// Writes a mesh with its map at full precision: `uv` in m, `v` up, one per vertex.
///
/// `.npz` holds `V` (n x 3, `f64`), `F` (m x 3, `i64`) and `UV` (n x 2, `f64`), stored without
/// compression. `.obj` holds the same as `v`, `f` and `vt`, in the shortest decimals that read back
/// as the same `f64`; its `vt` point up as map positions do, so nothing is flipped.
///
/// # Errors
/// If the mesh is broken, the map does not fit it, or the file cannot be written.
pub fn write_flat(path: &Path, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<(), IoError> {
    let kind = kind(path);
    if !["obj", "npz"].contains(&kind.as_str()) {
        return Err(IoError::UnknownKind { path: path.into(), known: "obj, npz" });
    }
    mesh.validate().map_err(|e| unfit(path, "mesh to write", e.to_string(), "a valid one"))?;
    if uv.len() != mesh.positions.len() {
        let needed = format!("{}, one per vertex", mesh.positions.len());
        return Err(unfit(path, "map to write", format!("{} positions", uv.len()), needed));
    }
    if kind == "npz" {
        return write_npz(path, mesh, uv);
    }
    write_file(path, |file| {
        for p in &mesh.positions {
            writeln!(file, "v {:?} {:?} {:?}", p.x, p.y, p.z)?;
        }
        for p in uv {
            writeln!(file, "vt {:?} {:?}", p.x, p.y)?;
        }
        for &corners in &mesh.triangles {
            let [a, b, c] = corners.map(|v| v.index() + 1);
            writeln!(file, "f {a}/{a} {b}/{b} {c}/{c}")?;
        }
        Ok(())
    })
}

fn write_npz(path: &Path, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<(), IoError> {
    let positions: Vec<f64> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
    let corners: Vec<i64> = mesh.triangles.iter().flatten().map(|v| i64::from(v.raw())).collect();
    let map: Vec<f64> = uv.iter().flat_map(|p| p.to_array()).collect();
    let mut file = ArrayWriter::create(path)?;
    file.constant("V", &[mesh.positions.len(), 3], Elements::F64(&positions))?;
    file.constant("F", &[mesh.triangles.len(), 3], Elements::I64(&corners))?;
    file.constant("UV", &[uv.len(), 2], Elements::F64(&map))?;
    file.finish()
}
