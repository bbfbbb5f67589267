//! STL, text or binary: bare triangles of `f32` corners.

use std::{collections::HashMap, io::Write, path::Path};

use glam::DVec3;

use crate::id::VertexId;
use crate::io::error::Result;
use crate::io::file::{Source, excerpt, unfit, write_to};
use crate::numeric::narrow;
use crate::skin::{Draft, Patch, Remark, RemarkKind, Sheet, Skin};

/// Bytes before the triangles of a binary file: a comment and their number.
const HEADER: usize = 84;
/// Bytes of a triangle of a binary file.
const FACET: usize = 50;

/// Reads an STL file: every solid becomes a sheet.
///
/// The format shares no corners, so those at exactly the same position are one vertex. Facet normals
/// are left out: the order of the corners defines them.
///
/// Bytes after the triangles of a binary file and a last solid without `endsolid` are noted.
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let mut remarks = Vec::new();
    let sheets = if is_text(source.bytes()) {
        read_text(source, &mut remarks)?
    } else {
        vec![read_binary(source, &mut remarks)?]
    };
    Ok(Draft { sheets, remarks, ..Draft::default() })
}

fn remark(patch: String, what: impl Into<String>) -> Remark {
    Remark { patch, kind: RemarkKind::PassedOver { what: what.into() } }
}

/// Number of triangles in the header of a binary file, and the length of a file of as many.
fn declared(bytes: &[u8]) -> Option<(u32, u64)> {
    let count = u32::from_le_bytes(bytes.get(HEADER - 4..HEADER)?.try_into().ok()?);
    Some((count, HEADER as u64 + FACET as u64 * u64::from(count)))
}

/// Text starts with `solid`; so does the comment of many a binary file, whose length or zeros give it away.
fn is_text(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    let solid = text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let is_binary = |(_, length)| length == bytes.len() as u64 || bytes[..HEADER].contains(&0);
    solid && !declared(bytes).is_some_and(is_binary)
}

fn read_binary(source: &Source, remarks: &mut Vec<Remark>) -> Result<Sheet> {
    let bytes = source.bytes();
    let refuse = |found: String, needed: String| Err(source.invalid("header", found, needed));
    let Some((count, length)) = declared(bytes) else {
        let needed = format!("at least {HEADER}, or text that starts with `solid`");
        return refuse(format!("{} bytes", bytes.len()), needed);
    };
    let Some(rest) = (bytes.len() as u64).checked_sub(length) else {
        let found = format!("{count} triangles in {} bytes", bytes.len());
        return refuse(found, format!("{HEADER} bytes and {FACET} for each triangle"));
    };
    if rest > 0 {
        remarks.push(remark(source.stem(), format!("{rest} bytes after its {count} triangles are not read")));
    }
    let bytes = &bytes[..bytes.len() - usize::try_from(rest).unwrap_or(0)];
    let mut solid = Solid::new(source.stem());
    for (k, facet) in bytes[HEADER..].chunks_exact(FACET).enumerate() {
        // Its first three numbers are the normal, its last two bytes mean nothing.
        let (numbers, _) = facet[12..48].as_chunks::<4>();
        let (corners, _) = numbers.as_chunks::<3>();
        for corner in corners {
            let corner = corner.map(f32::from_le_bytes);
            solid.add_corner(corner).ok_or_else(|| {
                source.invalid(format!("triangle {k}"), format!("{corner:?}"), "finite coordinates")
            })?;
        }
    }
    Ok(solid.finish())
}

/// Reads the solids of a text: `solid`, facets of three vertices each, `endsolid`.
fn read_text(source: &Source, remarks: &mut Vec<Remark>) -> Result<Vec<Sheet>> {
    let mut lines = source.lines()?.filter(|(_, line)| !line.trim().is_empty());
    let mut sheets = Vec::new();
    while let Some((at, line)) = lines.next() {
        if !starts_with(line, "solid") {
            return Err(at.invalid(excerpt(line), "`solid` and a name"));
        }
        let name = line.trim().split_once(char::is_whitespace).map_or("", |(_, name)| name.trim());
        let name = if name.is_empty() { source.stem() } else { name.into() };
        let mut solid = Solid::new(name.clone());
        for k in 0.. {
            let element = || format!("solid {}, which starts on line {}, facet {k}", excerpt(&name), at.line);
            let refuse = |found: String| source.invalid(element(), found, "a triangle, or `endsolid`");
            let mut next = || lines.next().map(|(_, line)| line).ok_or_else(|| refuse("the end".into()));
            let first = next();
            if first.is_err() && k > 0 {
                remarks.push(remark(name.clone(), "the file ends after a triangle, without `endsolid`"));
                break;
            }
            let mut line = first?;
            if starts_with(line, "endsolid") {
                break;
            }
            for (j, words) in FACET_LINES.iter().enumerate() {
                if j > 0 {
                    line = next()?;
                }
                let fits =
                    starts_with(line, words) && (*words != "vertex" || solid.add_vertex(line).is_some());
                if !fits {
                    return Err(refuse(excerpt(line)));
                }
            }
        }
        sheets.push(solid.finish());
    }
    Ok(sheets)
}

const FACET_LINES: [&str; 7] =
    ["facet normal", "outer loop", "vertex", "vertex", "vertex", "endloop", "endfacet"];

fn starts_with(line: &str, words: &str) -> bool {
    let mut found = line.split_whitespace();
    words.split(' ').all(|word| found.next().is_some_and(|found| found.eq_ignore_ascii_case(word)))
}

/// A sheet in the making: corners at the same position become one vertex.
struct Solid {
    sheet: Sheet,
    vertices: HashMap<[u32; 3], u32>,
    corners: Vec<u32>,
}

impl Solid {
    fn new(name: String) -> Self {
        let sheet = Sheet { name, ..Sheet::default() };
        Self { sheet, vertices: HashMap::new(), corners: Vec::new() }
    }

    /// Adds the next corner of a triangle; `None` if it is not finite.
    fn add_corner(&mut self, corner: [f32; 3]) -> Option<()> {
        let position = DVec3::from(corner.map(f64::from));
        let positions = &mut self.sheet.positions;
        // Adding zero makes -0 and 0 equal.
        let bits = corner.map(|x| (x + 0.0).to_bits());
        self.corners.push(*self.vertices.entry(bits).or_insert_with(|| {
            positions.push(position);
            VertexId::new(positions.len() - 1).raw()
        }));
        position.is_finite().then_some(())
    }

    /// Adds the corner of a line `vertex x y z`; `None` if it has other numbers.
    fn add_vertex(&mut self, line: &str) -> Option<()> {
        let numbers: Vec<f32> = line.split_whitespace().skip(1).map_while(|word| word.parse().ok()).collect();
        self.add_corner(numbers.try_into().ok()?)
    }

    fn finish(mut self) -> Sheet {
        self.sheet.triangles = self.corners.as_chunks::<3>().0.to_vec();
        self.sheet
    }
}

/// Writes a binary STL file of all patches, positions in the world, rounded to `f32`.
pub(crate) fn write(output: &mut dyn Write, path: &Path, skin: &Skin) -> Result<()> {
    let count: usize = skin.patches.iter().map(|patch| patch.mesh.triangles.len()).sum();
    let Ok(count) = u32::try_from(count) else {
        return Err(unfit(path, "skin", format!("{count} triangles"), format!("at most {}", u32::MAX)));
    };
    let mut bytes = vec![0; HEADER - 4];
    bytes.extend(count.to_le_bytes());
    for patch in &skin.patches {
        add_facets(path, &skin.in_world(patch), &mut bytes)?;
    }
    write_to(output, path, |file| file.write_all(&bytes))
}

fn add_facets(path: &Path, patch: &Patch, bytes: &mut Vec<u8>) -> Result<()> {
    for face in patch.mesh.triangles.ids() {
        let corners = patch.mesh.corners(face).map(rounded);
        if !corners.iter().flatten().all(|x| x.is_finite()) {
            let element = format!("patch {:?}, face {face}", patch.name);
            let found = format!("{:?}", patch.mesh.corners(face));
            return Err(unfit(path, element, found, "coordinates within the range of f32"));
        }
        let normal = rounded(patch.mesh.face_cross(face).normalize_or_zero());
        bytes.extend([normal].iter().chain(&corners).flatten().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    Ok(())
}

fn rounded(x: DVec3) -> [f32; 3] {
    x.to_array().map(narrow)
}
