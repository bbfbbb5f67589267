//! Skins and flat meshes in all formats: [`read_draft`](crate::io::read_draft) and [`write_skin`] list what
//! each extension is read and written as, and what each format keeps.

#[cfg(feature = "robots")]
mod dae;
mod icub;
mod npz;
mod obj;
mod off;
pub(super) mod parts;
#[cfg(feature = "robots")]
mod ply;
mod polygon;
mod robotskin;
pub(super) mod skin_csv;
mod stl;
#[cfg(feature = "robots")]
mod threemf;

use std::{io::Write, path::Path};

use glam::{DAffine3, DVec2};

use crate::id::{IdVec, VertexId};
use crate::io::arrays::npy::Elements;
use crate::io::arrays::write::ArrayWriter;
use crate::io::file::{OutPath, Source, file_kind, replace_file, unfit, write_file};
use crate::io::mesh::parts::ReadParts;
use crate::io::{IoError, gltf};
use crate::mesh::TriMesh;
use crate::skin::{Draft, Skin, Taxels};

pub(super) type MeshReader = fn(Source, ReadParts) -> Result<Draft, IoError>;

/// The reader of the format that the extension of a file names.
pub(super) fn reader_of(path: &Path) -> Result<MeshReader, IoError> {
    Ok(match file_kind(path).as_str() {
        "glb" | "gltf" => gltf::read_gltf,
        "obj" => |source, parts| obj::read(&source, parts),
        "npz" => |source, _| npz::read(&source),
        "json" => |source, _| robotskin::read(&source),
        #[cfg(feature = "robots")]
        "dae" => |source, _| dae::read(&source),
        #[cfg(feature = "robots")]
        "3mf" => |source, _| threemf::read(&source),
        "off" => |source, _| off::read(&source),
        #[cfg(feature = "robots")]
        "ply" => |source, _| ply::read(&source),
        "stl" => |source, _| stl::read(&source),
        "csv" => |source, _| skin_csv::read(&source),
        "txt" => |source, _| icub::read(&source),
        _ => {
            let robots = "glb, gltf, json, obj, off, ply, stl, dae, 3mf, urdf, xml, csv, npz, txt, and exports of Tekscan, XSENSOR and novel";
            let known = if cfg!(feature = "robots") {
                robots
            } else {
                "glb, gltf, json, obj, off, stl, csv, npz, txt, and exports of Tekscan, XSENSOR and novel"
            };
            return Err(IoError::UnknownKind { path: path.into(), known });
        }
    })
}

/// Writes a skin in the format that the extension names; see [`crate::io::read_draft`] for what
/// each keeps.
///
/// OBJ, OFF, PLY, STL and CSV have no frames: positions are written in the world, and reading them gives
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
pub fn write_skin(path: impl Into<OutPath>, skin: &Skin) -> Result<(), IoError> {
    let path = &path.into();
    if file_kind(path) == "csv" {
        check(path, skin)?;
        return skin_csv::write(path, skin);
    }
    let write = writer_of(path)?;
    check(path, skin)?;
    replace_file(path, |file| write(file, path, skin))
}

/// The content of a file that [`write_skin`] writes, but for CSV, which is two files; its kind follows
/// from the extension of `name`.
///
/// # Errors
/// If the skin breaks a promise of its type, or a number in it does not fit the format.
pub fn skin_to_bytes(name: &Path, skin: &Skin) -> Result<Vec<u8>, IoError> {
    let write = writer_of(name)?;
    check(name, skin)?;
    let mut bytes = Vec::new();
    write(&mut bytes, name, skin)?;
    Ok(bytes)
}

/// What a skin loses in a file of the kind of `path`, a sentence each: frames and names, and what is known of its taxels
/// and links. `.glb` keeps everything.
pub fn lost_in(path: &Path, skin: &Skin) -> Vec<&'static str> {
    let kind = file_kind(path);
    let is_plain = matches!(kind.as_str(), "json" | "obj" | "off" | "ply" | "stl");
    let is_other = is_plain || kind == "csv";
    let has = |known: fn(&Taxels) -> bool| skin.patches.iter().any(|patch| known(&patch.taxels));
    let has_densities: fn(&Taxels) -> bool = |taxels| taxels.densities.is_some();
    let has_own_areas = || {
        skin.patches.iter().any(|patch| {
            let of_faces = patch.mesh.vertex_areas();
            patch
                .taxels
                .areas
                .iter()
                .zip(&of_faces)
                .any(|(own, other)| (own - other).abs() > 1e-6 * own.abs())
        })
    };
    let lost = [
        (is_plain && has(|taxels| taxels.tangents.is_some()), "the tangents of the taxels are lost"),
        (is_plain && kind != "ply" && has_own_areas(), "the receptive areas of the taxels are lost"),
        (
            is_plain
                && has(has_densities)
                && (kind != "ply" || !skin.patches.iter().all(|p| has_densities(&p.taxels))),
            "the densities of the taxels are lost",
        ),
        (is_plain && has(|taxels| taxels.covariances.is_some()), "the covariances of the taxels are lost"),
        (is_plain && has(|taxels| taxels.weights.is_some()), "the weights of the taxels are lost"),
        (is_plain && has(|taxels| taxels.regions.is_some()), "the regions of the taxels are lost"),
        (is_plain && has(|taxels| taxels.modalities.is_some()), "what the taxels sense is lost"),
        (is_other && has(|taxels| taxels.acuities.is_some()), "the acuities of the taxels are lost"),
        (is_other && has(|taxels| taxels.joints.is_some()), "which links the taxels follow is lost"),
        (is_other && !skin.animations.is_empty(), "the animations of the links are lost"),
    ];
    let lost = lost.into_iter().filter(|(is_lost, _)| *is_lost).map(|(_, what)| what);
    lost_frames(&kind, skin).into_iter().chain(lost).collect()
}

fn lost_frames(kind: &str, skin: &Skin) -> Option<&'static str> {
    let is_one_body = skin.patches.iter().all(|patch| patch.link == skin.patches[0.into()].link);
    let is_bare = skin.links.len() <= 1
        && skin.links.iter().all(|l| l.name.is_empty() && l.pose.abs_diff_eq(DAffine3::IDENTITY, 0.0));
    match kind {
        "json" if !is_one_body => Some("robotskinlib has one link: positions are in the world"),
        "json" if skin.patches.len() > 1 => Some("robotskinlib has one patch: its pieces lose their names"),
        "obj" => Some("OBJ keeps no taxel ids and no link frames: positions are in the world"),
        "off" => Some("OFF keeps positions and triangles alone, in the world"),
        "ply" if !is_bare || skin.patches.len() > 1 => {
            Some("PLY keeps no names and no link frames: positions are in the world")
        }
        "stl" => Some("STL keeps positions alone, in the world and rounded to f32"),
        "csv" if !is_bare => Some("tables keep no link frames: positions are in the world"),
        _ => None,
    }
}

type Writer = fn(&mut dyn Write, &Path, &Skin) -> Result<(), IoError>;

fn writer_of(path: &Path) -> Result<Writer, IoError> {
    Ok(match file_kind(path).as_str() {
        "glb" | "gltf" => gltf::write_skin,
        "json" => robotskin::write,
        "obj" => obj::write,
        "off" => off::write,
        #[cfg(feature = "robots")]
        "ply" => ply::write,
        "stl" => stl::write,
        _ => {
            let known = "glb, gltf, json, obj, off, ply, stl, csv";
            return Err(IoError::UnknownKind { path: path.into(), known });
        }
    })
}

fn check(path: &Path, skin: &Skin) -> Result<(), IoError> {
    skin.validate().map_err(|e| unfit(path, "skin to write", e.to_string(), "a valid one"))
}

/// Writes a mesh with its map: `uv` in m, `v` up, one per vertex.
///
/// | extension | positions | map |
/// |---|---|---|
/// | `npz` | `V` (n x 3, `f64`), with `F` (m x 3, `i64`) | `UV` (n x 2, `f64`), in m |
/// | `obj` | `v`, shortest decimals | `vt`, in m, upwards |
///
/// # Errors
/// If the mesh is broken, the map does not fit it, or the file cannot be written.
pub fn write_flat(
    path: impl Into<OutPath>,
    mesh: &TriMesh,
    uv: &IdVec<VertexId, DVec2>,
) -> Result<(), IoError> {
    let path = &path.into();
    let write = match file_kind(path).as_str() {
        "npz" => write_npz,
        "obj" => write_obj,
        _ => return Err(IoError::UnknownKind { path: path.into(), known: "obj, npz" }),
    };
    mesh.validate().map_err(|e| unfit(path, "mesh to write", e.to_string(), "a valid one"))?;
    if uv.len() != mesh.positions.len() {
        let needed = format!("{}, one per vertex", mesh.positions.len());
        return Err(unfit(path, "map to write", format!("{} positions", uv.len()), needed));
    }
    write(path, mesh, uv)
}

fn write_obj(path: &OutPath, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<(), IoError> {
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

fn write_npz(path: &OutPath, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<(), IoError> {
    let positions: Vec<f64> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
    let corners: Vec<i64> = mesh.triangles.iter().flatten().map(|v| i64::from(v.raw())).collect();
    let map: Vec<f64> = uv.iter().flat_map(|p| p.to_array()).collect();
    let mut file = ArrayWriter::create(path)?;
    file.constant("V", &[mesh.positions.len(), 3], Elements::F64(&positions))?;
    file.constant("F", &[mesh.triangles.len(), 3], Elements::I64(&corners))?;
    file.constant("UV", &[uv.len(), 2], Elements::F64(&map))?;
    file.finish()
}
