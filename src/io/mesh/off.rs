//! OFF, the Object File Format of Geomview: text of vertices and polygons.

use std::{io::Write, path::Path};

use glam::DVec3;

use crate::{
    io::{
        IoError,
        file::{
            lines::LineLocation,
            replace::replace_file,
            source::{Source, excerpt, invalid},
        },
    },
    skin::{Draft, Sheet, Skin},
};

/// Rows that hold something, without comments.
trait Rows<'a>: Iterator<Item = (LineLocation<'a>, &'a str)> {}

impl<'a, I: Iterator<Item = (LineLocation<'a>, &'a str)>> Rows<'a> for I {}

/// Reads an OFF file as one sheet: polygons become fans, normals of `NOFF` are kept, colours and
/// texture coordinates left out.
pub(crate) fn read(source: &Source) -> Result<Draft, IoError> {
    let mut rows = source.lines()?.map(without_comment).filter(|(_, text)| !text.is_empty());
    let [vertices, faces, has_normals] = header(source, &mut rows)?;
    let mut sheet = Sheet { name: source.stem(), ..Sheet::default() };
    let mut normals = Vec::new();
    for k in 0..vertices {
        let (at, text) = next(source, &mut rows, &format!("vertex {k} of {vertices}"))?;
        let mut words = text.split_whitespace();
        sheet.positions.push(vector(at, &mut words)?);
        if has_normals == 1 {
            normals.push(vector(at, &mut words)?);
        }
    }
    sheet.normals = (has_normals == 1).then_some(normals);
    for k in 0..faces {
        let (at, text) = next(source, &mut rows, &format!("face {k} of {faces}"))?;
        add_face(at, text, &mut sheet)?;
    }
    Ok(Draft { sheets: vec![sheet], ..Draft::default() })
}

fn without_comment<'a>((at, text): (LineLocation<'a>, &'a str)) -> (LineLocation<'a>, &'a str) {
    (at, text.split('#').next().unwrap_or_default().trim())
}

/// Numbers of vertices and faces, and 1 if vertices have normals. The word `OFF` may be missing.
fn header<'a>(source: &Source, rows: &mut impl Rows<'a>) -> Result<[usize; 3], IoError> {
    let (mut at, mut text) = next(source, rows, "the header")?;
    let mut has_normals = 0;
    if let Some((kind, rest)) = text.split_once("OFF") {
        if rest.contains("BINARY") || kind.contains(['4', 'n']) {
            return Err(source.unsupported(format!("line {}", at.line), excerpt(text)));
        }
        if !["", "C", "N", "CN", "ST", "STC", "STN", "STCN"].contains(&kind) {
            return Err(at.invalid(excerpt(text), "OFF, or COFF, NOFF, STOFF"));
        }
        has_normals = usize::from(kind.contains('N'));
        text = rest.trim();
        if text.is_empty() {
            (at, text) = next(source, rows, "the counts")?;
        }
    }
    let mut words = text.split_whitespace();
    let mut count = || words.next().and_then(|word| word.parse::<usize>().ok());
    let (Some(vertices), Some(faces)) = (count(), count()) else {
        return Err(at.invalid(excerpt(text), "OFF, then the numbers of vertices, faces and edges"));
    };
    Ok([vertices, faces, has_normals])
}

fn next<'a>(
    source: &Source,
    rows: &mut impl Rows<'a>,
    what: &str,
) -> Result<(LineLocation<'a>, &'a str), IoError> {
    rows.next().ok_or_else(|| {
        invalid(source.path(), what, "the end of the file", "as many rows as the header counts")
    })
}

fn vector<'a>(at: LineLocation<'_>, words: &mut impl Iterator<Item = &'a str>) -> Result<DVec3, IoError> {
    let mut number = || at.number(words.next().unwrap_or_default());
    Ok(DVec3::new(number()?, number()?, number()?))
}

fn add_face(at: LineLocation<'_>, text: &str, sheet: &mut Sheet) -> Result<(), IoError> {
    let vertices = sheet.positions.len();
    let mut words = text.split_whitespace();
    let corners = words.next().and_then(|word| word.parse::<usize>().ok()).filter(|&n| n >= 3);
    let corners = corners.ok_or_else(|| at.invalid(excerpt(text), "a number of corners of at least 3"))?;
    let mut corner = || {
        let word = words.next().unwrap_or_default();
        let index = word.parse::<u32>().ok().filter(|&v| (v as usize) < vertices);
        index.ok_or_else(|| {
            at.invalid(excerpt(word), format!("{corners} vertices from 0 to {}", vertices.saturating_sub(1)))
        })
    };
    let (first, mut last) = (corner()?, corner()?);
    for _ in 2..corners {
        let next = corner()?;
        sheet.triangles.push([first, last, next]);
        last = next;
    }
    Ok(())
}

/// Writes positions in the world and triangles, all patches together.
pub(crate) fn write(path: &Path, skin: &Skin) -> Result<(), IoError> {
    let patches: Vec<_> = skin.patches.iter().map(|patch| skin.in_world(patch)).collect();
    let meshes = || patches.iter().map(|patch| &patch.mesh);
    replace_file(path, |file| {
        let fail = |source| IoError::Write { path: path.into(), source };
        let vertices: usize = meshes().map(|mesh| mesh.positions.len()).sum();
        let faces: usize = meshes().map(|mesh| mesh.triangles.len()).sum();
        writeln!(file, "OFF\n{vertices} {faces} 0").map_err(fail)?;
        for p in meshes().flat_map(|mesh| &mesh.positions) {
            writeln!(file, "{:?} {:?} {:?}", p.x, p.y, p.z).map_err(fail)?;
        }
        let mut before = 0;
        for mesh in meshes() {
            for &corners in &mesh.triangles {
                let [a, b, c] = corners.map(|v| before + v.index());
                writeln!(file, "3 {a} {b} {c}").map_err(fail)?;
            }
            before += mesh.positions.len();
        }
        Ok(())
    })
}
