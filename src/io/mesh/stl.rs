//! STL, text or binary: bare triangles of `f32` corners.

use std::{collections::HashMap, io::Cursor, path::Path};

use glam::DVec3;
use stl_io::{Normal, Triangle, Vertex};

use crate::{
    id::VertexId,
    io::{
        IoError,
        file::{
            replace::replace_file,
            source::{Source, excerpt, invalid},
        },
    },
    skin::{Draft, Patch, Sheet, Skin},
};

/// Bytes before the triangles of a binary file: a comment and their number.
const HEADER: usize = 84;
/// Bytes of a triangle of a binary file.
const FACET: usize = 50;

/// Reads an STL file: every solid becomes a sheet.
///
/// The format shares no corners, so those at exactly the same place are one vertex. Facet normals are left out: the order
/// of the corners says the same.
///
/// # Errors
/// The first broken facet. The count of a binary file is compared with its length before anything is read.
pub(crate) fn read(source: &Source) -> Result<Draft, IoError> {
    let sheets = if is_text(source.bytes()) { read_text(source)? } else { vec![read_binary(source)?] };
    Ok(Draft { sheets, ..Draft::default() })
}

/// Triangles that the header of a binary file tells of.
fn told_count(bytes: &[u8]) -> Option<u32> {
    let count = bytes.get(HEADER - 4..HEADER)?;
    Some(u32::from_le_bytes(count.try_into().ok()?))
}

fn binary_len(count: u32) -> u64 {
    HEADER as u64 + FACET as u64 * u64::from(count)
}

/// Text starts with `solid`; so does the comment of many a binary file, whose length gives it away.
fn is_text(bytes: &[u8]) -> bool {
    let solid = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    solid && told_count(bytes).is_none_or(|n| binary_len(n) != bytes.len() as u64)
}

fn read_binary(source: &Source) -> Result<Sheet, IoError> {
    let bytes = source.bytes();
    let Some(count) = told_count(bytes) else {
        let found = format!("{} bytes", bytes.len());
        return Err(source.invalid(
            "header",
            found,
            format!("at least {HEADER}, or text that starts with `solid`"),
        ));
    };
    if binary_len(count) != bytes.len() as u64 {
        let found = format!("{count} triangles in {} bytes", bytes.len());
        return Err(source.invalid("header", found, format!("{HEADER} bytes and {FACET} for each triangle")));
    }
    // The crate takes every file whose comment starts with `solid` for text: without a comment it cannot.
    let mut plain = vec![0; HEADER - 4];
    plain.extend_from_slice(&bytes[HEADER - 4..]);
    weld(source, source.stem(), &plain, |k| format!("triangle {k}"))
}

/// Reads the solids one by one, since the crate stops after the first.
fn read_text(source: &Source) -> Result<Vec<Sheet>, IoError> {
    let mut lines = source.text()?.lines().map(str::trim).zip(1..).filter(|(line, _)| !line.is_empty());
    let mut sheets = Vec::new();
    while let Some((line, number)) = lines.next() {
        if !starts_with_word(line, "solid") {
            return Err(source.invalid(format!("line {number}"), excerpt(line), "`solid` and a name"));
        }
        let name = line.split_once(char::is_whitespace).map_or("", |(_, name)| name.trim());
        let name = if name.is_empty() { source.stem() } else { name.into() };
        // The crate wants a name, and small letters.
        let mut solid = String::from("solid -\n");
        for (line, _) in lines.by_ref() {
            solid.extend(line.chars().map(|c| c.to_ascii_lowercase()).chain(['\n']));
            if starts_with_word(line, "endsolid") {
                break;
            }
        }
        let place = |k| format!("solid {}, which starts on line {number}, facet {k}", excerpt(&name));
        sheets.push(weld(source, name.clone(), solid.as_bytes(), place)?);
    }
    Ok(sheets)
}

fn starts_with_word(line: &str, word: &str) -> bool {
    line.split_whitespace().next().is_some_and(|first| first.eq_ignore_ascii_case(word))
}

/// Reads the triangles of `solid` and joins corners at the same place; `place` names the k-th triangle.
fn weld(
    source: &Source,
    name: String,
    solid: &[u8],
    place: impl Fn(usize) -> String,
) -> Result<Sheet, IoError> {
    let mut sheet = Sheet { name, ..Sheet::default() };
    let mut vertices = HashMap::new();
    let mut solid = Cursor::new(solid);
    let facets = stl_io::create_stl_reader(&mut solid)
        .map_err(|e| source.invalid(place(0), e.to_string(), "a triangle"))?;
    for (k, facet) in facets.enumerate() {
        let facet = facet.map_err(|e| source.invalid(place(k), e.to_string(), "a triangle"))?;
        let mut corners = [0; 3];
        for (corner, vertex) in corners.iter_mut().zip(facet.vertices) {
            let position = DVec3::from(vertex.0.map(f64::from));
            if !position.is_finite() {
                return Err(source.invalid(place(k), position.to_string(), "finite coordinates"));
            }
            // Adding zero makes -0 and 0 the same place.
            let bits = vertex.0.map(|x| (x + 0.0).to_bits());
            *corner = *vertices.entry(bits).or_insert_with(|| {
                sheet.positions.push(position);
                VertexId::new(sheet.positions.len() - 1).raw()
            });
        }
        sheet.triangles.push(corners);
    }
    Ok(sheet)
}

/// Writes a binary STL file of all patches, positions in the world, rounded to `f32`.
///
/// # Errors
/// If the file cannot be written, or a coordinate or the number of triangles is too large for the format.
pub(crate) fn write(path: &Path, skin: &Skin) -> Result<(), IoError> {
    let mut facets = Vec::new();
    for patch in &skin.patches {
        add_facets(path, &skin.in_world(patch), &mut facets)?;
    }
    if u32::try_from(facets.len()).is_err() {
        return Err(invalid(
            path,
            "skin",
            format!("{} triangles", facets.len()),
            format!("at most {}", u32::MAX),
        ));
    }
    replace_file(path, |file| {
        stl_io::write_stl(file, facets.iter()).map_err(|source| IoError::Write { path: path.into(), source })
    })
}

fn add_facets(path: &Path, patch: &Patch, facets: &mut Vec<Triangle>) -> Result<(), IoError> {
    for face in patch.mesh.triangles.ids() {
        let corners = patch.mesh.corners(face).map(narrow);
        if !corners.iter().flatten().all(|x| x.is_finite()) {
            let element = format!("patch {:?}, face {face}", patch.name);
            let found = format!("{:?}", patch.mesh.corners(face));
            return Err(invalid(path, element, found, "coordinates within the range of f32"));
        }
        let normal = patch.mesh.face_cross(face).normalize_or_zero();
        facets.push(Triangle { normal: Normal::new(narrow(normal)), vertices: corners.map(Vertex::new) });
    }
    Ok(())
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "the format stores f32; what does not fit becomes infinite"
)]
fn narrow(x: DVec3) -> [f32; 3] {
    x.to_array().map(|x| x as f32)
}
