//! Flat maps: a mesh with a position on the map for each vertex.

use std::{
    fs::File,
    io::{self, BufWriter, Cursor, Write},
    path::Path,
};

use glam::DVec2;
use npyz::WriterBuilder;
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

use crate::{
    id::{IdVec, VertexId},
    io::{
        IoError,
        file::{
            replace::replace_file,
            source::{kind, unfit},
        },
    },
    mesh::TriMesh,
};

/// Extensions that [`write_flat`] knows.
const KNOWN: &str = "obj, npz";

/// Arrays of more bytes than this need the long form of a zip entry.
const LARGE_ENTRY: usize = 1 << 31;

/// Writes a mesh with its map at full precision: `uv` in m, `v` up, one per vertex.
///
/// `.npz` holds `V` (n x 3, `f64`), `F` (m x 3, `i64`) and `UV` (n x 2, `f64`), stored without
/// compression. `.obj` holds the same as `v`, `f` and `vt`, in the shortest decimals that read back
/// as the same `f64`; its `vt` point up as map positions do, so nothing is flipped.
///
/// # Errors
/// If the mesh is broken, the map does not fit it, or the file cannot be written.
pub fn write_flat(path: &Path, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Result<(), IoError> {
    let write = match kind(path).as_str() {
        "obj" => write_obj,
        "npz" => write_npz,
        _ => return Err(IoError::UnknownKind { path: path.into(), known: KNOWN }),
    };
    mesh.validate().map_err(|e| unfit(path, "mesh to write", e.to_string(), "a valid one"))?;
    if uv.len() != mesh.positions.len() {
        let needed = format!("{}, one per vertex", mesh.positions.len());
        return Err(unfit(path, "map to write", format!("{} positions", uv.len()), needed));
    }
    replace_file(path, |file| {
        write(file, mesh, uv).map_err(|source| IoError::Write { path: path.into(), source })
    })
}

fn write_obj(file: &mut BufWriter<&File>, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> io::Result<()> {
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
}

fn write_npz(file: &mut BufWriter<&File>, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> io::Result<()> {
    // In memory first: an archive that cannot be finished complains on standard error when it is
    // dropped.
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    array(&mut archive, "V", mesh.positions.iter().map(|p| p.to_array()))?;
    array(&mut archive, "F", mesh.triangles.iter().map(|t| t.map(|v| i64::from(v.raw()))))?;
    array(&mut archive, "UV", uv.iter().map(|p| p.to_array()))?;
    file.write_all(archive.finish()?.get_ref())
}

/// Adds an array with one row for each of `rows`.
fn array<T: npyz::AutoSerialize, const N: usize>(
    archive: &mut ZipWriter<Cursor<Vec<u8>>>,
    name: &str,
    rows: impl ExactSizeIterator<Item = [T; N]>,
) -> io::Result<()> {
    // Without a time of day, so that the same map gives the same bytes.
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default())
        .large_file(rows.len() * size_of::<[T; N]>() >= LARGE_ENTRY);
    archive.start_file(npyz::npz::file_name_from_array_name(name), options)?;
    let shape = [rows.len() as u64, N as u64];
    let mut array = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(archive).begin_nd()?;
    array.extend(rows.flatten())?;
    array.finish()
}
