//! Flat meshes: meshes with a position on the map for each vertex.

use std::{io::Write, path::Path};

use glam::DVec2;

use crate::{
    id::{IdVec, VertexId},
    io::{
        IoError,
        arrays::write::{npy::Elements, writer::ArrayWriter},
        file::{file_kind, unfit, write_file},
    },
    mesh::TriMesh,
};

/// Writes a mesh with its map: `uv` in m, `v` up, one per vertex.
///
/// | extension | positions | map |
/// |---|---|---|
/// | `npz` | `V` (n x 3, `f64`), with `F` (m x 3, `i64`) | `UV` (n x 2, `f64`), in m |
/// | `obj` | `v`, shortest decimals | `vt`, in m, upwards |
///
/// # Errors
/// If the mesh is broken, the map does not fit it, or the file cannot be written.
pub fn write_flat(path: &Path, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<(), IoError> {
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

fn write_obj(path: &Path, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<(), IoError> {
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
