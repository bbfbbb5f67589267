//! OFF, the Object File Format of Geomview: text of vertices and polygons.

use std::{io::Write, path::Path};

use glam::DVec3;

use crate::io::IoError;
use crate::io::file::lines::LineLocation;
use crate::io::file::outputs::write_to;
use crate::io::file::{Source, excerpt, invalid};
use crate::io::mesh::parts::all_triangles;
use crate::io::mesh::polygon::{CROSSED, POLYGON_NEEDED, Polygons};
use crate::skin::{Draft, Sheet, Skin};

/// Reads an OFF file as one sheet: polygons become triangles, normals of `NOFF` are kept, colours and
/// texture coordinates left out. A vertex or a face may go on in the next line.
pub(crate) fn read(source: &Source) -> Result<Draft, IoError> {
    let mut words =
        Words { rows: source.lines()?, at: LineLocation { path: source.path(), line: 1 }, row: "" };
    let [vertices, faces, has_normals] = header(source, &mut words)?;
    let mut sheet = Sheet { name: source.stem(), ..Sheet::default() };
    let mut normals = Vec::new();
    for k in 0..vertices {
        let what = || format!("vertex {k} of {vertices}");
        words.start_row(&what)?;
        sheet.positions.push(words.vector(&what)?);
        if has_normals == 1 {
            normals.push(words.vector(&what)?);
        }
    }
    sheet.normals = (has_normals == 1).then_some(normals);
    let mut polygons = Polygons::default();
    for k in 0..faces {
        let what = || format!("face {k} of {faces}");
        words.start_row(&what)?;
        words.add_face(&what, &mut sheet, &mut polygons)?;
    }
    let remarks = polygons.remark(source.stem()).into_iter().collect();
    Ok(Draft { sheets: vec![sheet], remarks, ..Draft::default() })
}

/// The words of a file, without comments.
struct Words<'a, I> {
    rows: I,
    at: LineLocation<'a>,
    row: &'a str,
}

/// The error where the file ends in an element.
type What<'w> = &'w dyn Fn() -> String;

impl<'a, I: Iterator<Item = (LineLocation<'a>, &'a str)>> Words<'a, I> {
    /// Goes to the next row that is not empty.
    fn start_row(&mut self, what: What<'_>) -> Result<&'a str, IoError> {
        loop {
            let Some((at, row)) = self.rows.next() else {
                let (found, needed) = ("the end of the file", "as many rows as the header counts");
                return Err(invalid(self.at.path, what(), found, needed));
            };
            (self.at, self.row) = (at, row.split('#').next().unwrap_or_default().trim());
            if !self.row.is_empty() {
                return Ok(self.row);
            }
        }
    }

    /// The next word, of this row or of the next one.
    fn next(&mut self, what: What<'_>) -> Result<&'a str, IoError> {
        if self.row.is_empty() {
            self.start_row(what)?;
        }
        let (word, rest) = self.row.split_once(char::is_whitespace).unwrap_or((self.row, ""));
        self.row = rest.trim_start();
        Ok(word)
    }

    fn vector(&mut self, what: What<'_>) -> Result<DVec3, IoError> {
        let mut numbers = [0.0; 3];
        for number in &mut numbers {
            let word = self.next(what)?;
            *number = self.at.number(word)?;
        }
        Ok(DVec3::from_array(numbers))
    }

    fn add_face(
        &mut self,
        what: What<'_>,
        sheet: &mut Sheet,
        polygons: &mut Polygons,
    ) -> Result<(), IoError> {
        let vertices = sheet.positions.len();
        let word = self.next(what)?;
        let corners = word.parse::<usize>().ok().filter(|&n| n > 0);
        let needed = "a number of corners above 0";
        let corners = corners.ok_or_else(|| self.at.invalid(excerpt(word), needed))?;
        let mut corner = || {
            let word = self.next(what)?;
            let index = word.parse::<u32>().ok().filter(|&v| (v as usize) < vertices);
            index.ok_or_else(|| {
                let needed = format!("{corners} vertices from 0 to {}", vertices.saturating_sub(1));
                self.at.invalid(excerpt(word), needed)
            })
        };
        let corners = (0..corners).map(|_| corner()).collect::<Result<Vec<u32>, _>>()?;
        let outline: Vec<DVec3> = corners.iter().map(|&v| sheet.positions[v as usize]).collect();
        let crossed = || self.at.invalid_part(what(), CROSSED, POLYGON_NEEDED);
        let triangles = polygons.cut(&outline, &[]).ok_or_else(crossed)?;
        sheet.triangles.extend(triangles.into_iter().map(|t| t.map(|k| corners[k])));
        Ok(())
    }
}

/// Numbers of vertices and faces, and 1 if vertices have normals. The word `OFF` may be missing.
fn header<'a>(
    source: &Source,
    words: &mut Words<'a, impl Iterator<Item = (LineLocation<'a>, &'a str)>>,
) -> Result<[usize; 3], IoError> {
    let mut text = words.start_row(&|| "the header".into())?;
    let mut has_normals = 0;
    if let Some((kind, rest)) = text.split_once("OFF") {
        if rest.contains("BINARY") || kind.contains(['4', 'n']) {
            return Err(source.unsupported((words.at.line, ""), excerpt(text).as_str()));
        }
        if !["", "C", "N", "CN", "ST", "STC", "STN", "STCN"].contains(&kind) {
            return Err(words.at.invalid(excerpt(text), "OFF, or COFF, NOFF, STOFF"));
        }
        has_normals = usize::from(kind.contains('N'));
        text = rest.trim();
        if text.is_empty() {
            text = words.start_row(&|| "the counts".into())?;
        }
    }
    let mut counts = text.split_whitespace();
    let mut count = || counts.next().and_then(|word| word.parse::<usize>().ok());
    let (Some(vertices), Some(faces)) = (count(), count()) else {
        return Err(words.at.invalid(excerpt(text), "OFF, then the numbers of vertices, faces and edges"));
    };
    Ok([vertices, faces, has_normals])
}

/// Writes positions in the world and triangles, all patches together.
pub(crate) fn write(output: &mut dyn Write, path: &Path, skin: &Skin) -> Result<(), IoError> {
    let patches: Vec<_> = skin.patches.iter().map(|patch| skin.in_world(patch)).collect();
    let meshes = || patches.iter().map(|patch| &patch.mesh);
    write_to(output, path, |file| {
        let vertices: usize = meshes().map(|mesh| mesh.positions.len()).sum();
        let faces: usize = meshes().map(|mesh| mesh.triangles.len()).sum();
        writeln!(file, "OFF\n{vertices} {faces} 0")?;
        for p in meshes().flat_map(|mesh| &mesh.positions) {
            writeln!(file, "{:?} {:?} {:?}", p.x, p.y, p.z)?;
        }
        for [a, b, c] in all_triangles(skin) {
            writeln!(file, "3 {a} {b} {c}")?;
        }
        Ok(())
    })
}
