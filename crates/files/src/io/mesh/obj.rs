//! Wavefront OBJ: read and written here, without a crate.
//!
//! The usual reader, tobj, names no line in its errors, forgets vertices that no face uses (which
//! `check` has to report), and panics on an index like `1//6148914691236517206`, whose product with
//! three wraps around. What is needed of the format are four statements.

use std::{borrow::Cow, collections::HashMap, io::Write, ops::Range, path::Path};

use glam::{DVec2, DVec3};

use crate::io::error::Result;
use crate::io::file::{LineLocation, Source, excerpt, finite, write_to};
use crate::io::mesh::parts::ReadParts;
use crate::io::mesh::parts::{is_not_finite, not_finite};
use crate::io::mesh::polygon::{CROSSED, POLYGON_NEEDED, Polygons};
use crate::skin::{Draft, Sheet, Skin};

/// Stands for "none" in a [`Corner`].
const NONE: u32 = u32::MAX;

/// A corner of a face: position, texture point and normal, counted from 0 over the whole file.
#[derive(Clone, Copy)]
struct Corner {
    position: u32,
    texture: u32,
    normal: u32,
}

struct Group {
    name: String,
    triangles: Vec<[Corner; 3]>,
    /// The material of each triangle, where these are wanted.
    materials: Vec<u32>,
}

/// A face of more than three corners, as a fan in its group until all positions are known.
struct Polygon {
    group: usize,
    triangles: Range<usize>,
    line: usize,
}

#[derive(Default)]
struct ObjReader {
    /// What a group without a name is called.
    stem: String,
    /// Positions, and the group in which each was declared.
    positions: Vec<DVec3>,
    declared_in: Vec<usize>,
    normals: Vec<DVec3>,
    texture_points: usize,
    /// The texture points, if they are wanted.
    texture: Option<Vec<DVec2>>,
    /// The names of the materials, if they are wanted, and the one in use.
    materials: Option<Vec<String>>,
    material_ids: HashMap<String, u32>,
    material: u32,
    groups: Vec<Group>,
    polygons: Vec<Polygon>,
    /// How many normals are not finite.
    not_finite_normals: usize,
    /// Where each (object, group) is in `groups`; one that comes again goes on where it was.
    known: HashMap<(String, String), usize>,
    object: String,
    group: usize,
    /// Largest index of `v`, `vt` and `vn`, and its line: judged at the end, as it may refer forward.
    largest: [(u64, usize); 3],
}

/// Reads an OBJ file: every `o` or `g` becomes a sheet, polygons become triangles.
///
/// A normal belongs to a corner in the file and to a vertex in a sheet: where the corners of a
/// vertex disagree it is their mean, where a vertex has no corner it is zero. A sheet with a corner
/// without a normal has none. Colours, texture coordinates, materials, lines and points are left
/// out.
pub(crate) fn read(source: &Source, parts: ReadParts) -> Result<Draft> {
    let mut reader = ObjReader {
        stem: source.stem(),
        texture: parts.texture.then(Vec::new),
        materials: parts.materials.then(Vec::new),
        material_ids: HashMap::new(),
        material: NONE,
        groups: vec![Group { name: source.stem(), triangles: Vec::new(), materials: Vec::new() }],
        known: HashMap::from([(Default::default(), 0)]),
        ..ObjReader::default()
    };
    let mut lines = source.lines()?;
    while let Some((at, line)) = lines.next() {
        let mut line = Cow::Borrowed(line);
        while line.ends_with('\\') && !is_text(&line) {
            let whole = line.to_mut();
            whole.pop();
            whole.push(' ');
            whole.push_str(lines.next().map_or("", |(_, next)| next));
        }
        reader.statement(source, at, &line)?;
    }
    reader.check_indices(source)?;
    let warped = reader.cut_polygons(source)?.remark(source.stem());
    let sheets = reader.sheets();
    let no_normals =
        (reader.not_finite_normals > 0).then(|| not_finite(source.stem(), reader.not_finite_normals));
    let remarks = warped.into_iter().chain(no_normals).collect();
    Ok(Draft { sheets, remarks, materials: reader.materials.unwrap_or_default(), ..Draft::default() })
}

/// Whether a line is a comment or a name, in which a backslash is a letter: other statements go on in the next
/// line after one.
fn is_text(line: &str) -> bool {
    let word = line.split_whitespace().next().unwrap_or_default();
    word.starts_with('#') || ["usemtl", "mtllib", "o", "g", "usemap", "maplib"].contains(&word)
}

impl ObjReader {
    fn statement(&mut self, source: &Source, at: LineLocation<'_>, text: &str) -> Result<()> {
        let text = text.trim();
        let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        match word {
            "v" => {
                self.positions.push(vector(at, word, rest)?);
                self.declared_in.push(self.group);
            }
            // A normal that is no number is none.
            "vn" if is_not_finite(rest) => {
                self.not_finite_normals += 1;
                self.normals.push(DVec3::ZERO);
            }
            "vn" => self.normals.push(vector(at, word, rest)?),
            "vt" => {
                self.texture_points += 1;
                if let Some(texture) = &mut self.texture {
                    let mut numbers = rest.split_whitespace().map(|word| at.number(word));
                    let (u, v) = (numbers.next().transpose()?, numbers.next().transpose()?);
                    texture.push(DVec2::new(u.unwrap_or_default(), v.unwrap_or_default()));
                }
            }
            "f" => self.face(at, rest)?,
            "o" => {
                rest.trim().clone_into(&mut self.object);
                self.enter("");
            }
            "g" => self.enter(rest.trim()),
            "usemtl" => self.use_material(rest.trim()),
            "curv" | "curv2" | "surf" => {
                return Err(source.unsupported((at.line, ""), "a free-form curve or surface"));
            }
            // The format requires readers to skip unknown statements.
            _ => {}
        }
        Ok(())
    }

    /// Goes on in `group` of the current object.
    fn enter(&mut self, group: &str) {
        let key = (self.object.clone(), group.to_owned());
        let name = [group, &self.object].into_iter().find(|n| !n.is_empty());
        let name = name.map_or_else(|| self.stem.clone(), str::to_owned);
        let groups = &mut self.groups;
        self.group = *self.known.entry(key).or_insert_with(|| {
            groups.push(Group { name, triangles: Vec::new(), materials: Vec::new() });
            groups.len() - 1
        });
    }

    fn use_material(&mut self, name: &str) {
        let Some(materials) = &mut self.materials else { return };
        self.material = *self.material_ids.entry(name.to_owned()).or_insert_with(|| {
            materials.push(name.to_owned());
            u32::try_from(materials.len() - 1).unwrap_or(NONE)
        });
    }

    fn face(&mut self, at: LineLocation<'_>, rest: &str) -> Result<()> {
        let mut corners = rest.split_whitespace();
        let mut next = |reader: &mut Self| corners.next().map(|token| reader.corner(at, token)).transpose();
        let Some(first) = next(self)? else {
            return Err(at.invalid_part("`f`", "no corners", "corners"));
        };
        // A point or a line is a triangle with a corner twice, which is left out later with a note.
        let mut last = next(self)?.unwrap_or(first);
        let mut corner = next(self)?.unwrap_or(last);
        let before = self.groups[self.group].triangles.len();
        loop {
            let group = &mut self.groups[self.group];
            group.triangles.push([first, last, corner]);
            if self.materials.is_some() {
                group.materials.push(self.material);
            }
            last = corner;
            match next(self)? {
                Some(further) => corner = further,
                None => break,
            }
        }
        let triangles = before..self.groups[self.group].triangles.len();
        if triangles.len() > 1 {
            self.polygons.push(Polygon { group: self.group, triangles, line: at.line });
        }
        Ok(())
    }

    /// Replaces the fans of polygons by their triangles.
    fn cut_polygons(&mut self, source: &Source) -> Result<Polygons> {
        let mut polygons = Polygons::default();
        // Of each group, the triangles and materials up to the last polygon.
        let mut cut_groups = vec![(Vec::new(), Vec::new(), 0); self.groups.len()];
        for Polygon { group: number, triangles, line } in std::mem::take(&mut self.polygons) {
            let group = &self.groups[number];
            let fan = &group.triangles[triangles.clone()];
            let corners: Vec<Corner> = fan[0][..2].iter().copied().chain(fan.iter().map(|t| t[2])).collect();
            let outline: Vec<DVec3> = corners.iter().map(|c| self.positions[c.position as usize]).collect();
            let cut = polygons
                .cut(&outline, &[])
                .ok_or_else(|| source.invalid((line, "`f`"), CROSSED, POLYGON_NEEDED))?;
            let (kept, materials, until) = &mut cut_groups[number];
            kept.extend_from_slice(&group.triangles[*until..triangles.start]);
            if self.materials.is_some() {
                materials.extend_from_slice(&group.materials[*until..triangles.start]);
                materials.extend(std::iter::repeat_n(group.materials[triangles.start], cut.len()));
            }
            kept.extend(cut.into_iter().map(|t| t.map(|k| corners[k])));
            *until = triangles.end;
        }
        for (group, (mut kept, mut materials, until)) in self.groups.iter_mut().zip(cut_groups) {
            if until > 0 {
                kept.extend_from_slice(&group.triangles[until..]);
                group.triangles = kept;
                if self.materials.is_some() {
                    materials.extend_from_slice(&group.materials[until..]);
                    group.materials = materials;
                }
            }
        }
        Ok(polygons)
    }

    /// A corner `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&mut self, at: LineLocation<'_>, token: &str) -> Result<Corner> {
        let counts = [self.positions.len(), self.texture_points, self.normals.len()];
        let broken = || {
            let needed = "v, v/vt, v//vn or v/vt/vn, each counted from 1, or backwards from -1";
            at.invalid_part("corner of `f`", excerpt(token), needed)
        };
        let mut indices = [None; 3];
        for (k, part) in token.split('/').enumerate() {
            let slot = indices.get_mut(k).ok_or_else(broken)?;
            if part.is_empty() && k > 0 {
                continue;
            }
            let index = part.parse::<i64>().map_err(|_| broken())?;
            // Both kinds of index, counted from 1.
            let index = if index < 0 { counts[k] as i64 + 1 + index } else { index };
            *slot = Some(u64::try_from(index).ok().filter(|&i| i > 0).ok_or_else(broken)?);
        }
        let [Some(position), texture, normal] = indices else { return Err(broken()) };
        for (largest, index) in self.largest.iter_mut().zip(indices) {
            *largest = index.filter(|&i| i > largest.0).map_or(*largest, |index| (index, at.line));
        }
        // An index that does not fit is past the end, which `check_indices` refuses.
        let narrow = |index: u64| u32::try_from(index - 1).unwrap_or(NONE);
        let or_none = |index: Option<u64>| index.map_or(NONE, narrow);
        Ok(Corner { position: narrow(position), texture: or_none(texture), normal: or_none(normal) })
    }

    fn check_indices(&self, source: &Source) -> Result<()> {
        let counts = [self.positions.len(), self.texture_points, self.normals.len()];
        let words = ["v", "vt", "vn"];
        let is_read = [true, self.texture.is_some(), true];
        for (((&(index, line), count), word), is_read) in
            self.largest.iter().zip(counts).zip(words).zip(is_read)
        {
            if is_read && index > count as u64 {
                let needed = format!("at most {count}, as many as the file has");
                let element = (line, "corner of `f`");
                return Err(source.invalid(element, format!("`{word}` number {index}"), needed));
            }
        }
        Ok(())
    }

    /// The groups that are not empty; a vertex that no face uses stays where it was declared.
    fn sheets(&self) -> Vec<Sheet> {
        let mut used = vec![false; self.positions.len()];
        for corner in self.groups.iter().flat_map(|g| g.triangles.iter().flatten()) {
            used[corner.position as usize] = true;
        }
        let mut members: Vec<Vec<u32>> = vec![Vec::new(); self.groups.len()];
        for ((v, &group), _) in (0..).zip(&self.declared_in).zip(&used).filter(|(_, used)| !**used) {
            members[group].push(v);
        }
        // Index of each vertex in the current sheet; overwritten for every vertex a sheet uses.
        let mut places = vec![0; self.positions.len()];
        let mut sheets = Vec::new();
        for (group, mut members) in self.groups.iter().zip(members) {
            members.extend(group.triangles.iter().flatten().map(|c| c.position));
            members.sort_unstable();
            members.dedup();
            if members.is_empty() {
                continue;
            }
            for (place, &v) in (0..).zip(&members) {
                places[v as usize] = place;
            }
            sheets.push(Sheet {
                name: group.name.clone(),
                numbers: Some(members.iter().map(|&v| v.saturating_add(1)).collect()),
                positions: members.iter().map(|&v| self.positions[v as usize]).collect(),
                triangles: group.triangles.iter().map(|t| t.map(|c| places[c.position as usize])).collect(),
                texture: self.corner_texture(group),
                materials: self.materials.as_ref().map(|_| group.materials.clone()),
                normals: self.vertex_normals(group, &places, members.len()),
                ..Sheet::default()
            });
        }
        sheets
    }

    /// The texture coordinates of all corners, if they are wanted and every corner has them.
    fn corner_texture(&self, group: &Group) -> Option<Vec<[DVec2; 3]>> {
        let texture = self.texture.as_ref()?;
        let of = |c: Corner| texture.get(c.texture as usize).copied();
        let of_face = |&[a, b, c]: &[Corner; 3]| {
            if is_line([a, b, c]) { Some([DVec2::ZERO; 3]) } else { Some([of(a)?, of(b)?, of(c)?]) }
        };
        group.triangles.iter().map(of_face).collect()
    }

    fn vertex_normals(&self, group: &Group, places: &[u32], count: usize) -> Option<Vec<DVec3>> {
        let mut first: Vec<Option<DVec3>> = vec![None; count];
        let mut sums = vec![DVec3::ZERO; count];
        let mut differ = vec![false; count];
        for corner in group.triangles.iter().filter(|corners| !is_line(**corners)).flatten() {
            let place = places[corner.position as usize] as usize;
            let normal = *self.normals.get(corner.normal as usize)?;
            differ[place] |= *first[place].get_or_insert(normal) != normal;
            sums[place] += normal;
        }
        if group.triangles.is_empty() {
            return None;
        }
        let mean = first.iter().zip(&sums).zip(&differ).map(|((first, sum), &differ)| {
            if differ { sum.normalize_or_zero() } else { first.unwrap_or(DVec3::ZERO) }
        });
        Some(mean.collect())
    }
}

/// Whether a triangle stands for a point or a line, which is left out later.
fn is_line([_, b, c]: [Corner; 3]) -> bool {
    b.position == c.position
}

/// Three coordinates. A position may be followed by a weight of 1, or by a colour of three or four numbers, with a
/// weight before it or not, which is not read.
fn vector(at: LineLocation<'_>, word: &str, rest: &str) -> Result<DVec3> {
    let count = rest.split_whitespace().count();
    if !(count == 3 || (word == "v" && matches!(count, 4 | 6 | 7))) {
        return Err(at.invalid_part(format!("`{word}`"), format!("{count} numbers"), "3 numbers"));
    }
    let mut numbers = [1.0; 4];
    let read = if count == 4 { 4 } else { 3 };
    for (k, (slot, token)) in numbers.iter_mut().zip(rest.split_whitespace()).take(read).enumerate() {
        let part = || format!("number {} of `{word}`", k + 1);
        *slot = finite(token).ok_or_else(|| at.invalid_part(part(), excerpt(token), "a finite number"))?;
    }
    if numbers[3] != 1.0 {
        return Err(at.invalid_part("weight of `v`", numbers[3].to_string(), "1, or no weight at all"));
    }
    Ok(DVec3::new(numbers[0], numbers[1], numbers[2]))
}

/// Writes one `o` per patch, positions in the world, and normals. Ids, areas and links are lost.
pub(crate) fn write(output: &mut dyn Write, path: &Path, skin: &Skin) -> Result<()> {
    write_to(output, path, |file| {
        let mut before = 0;
        for patch in &skin.patches {
            let patch = skin.in_world(patch);
            // A name ends with its line.
            writeln!(file, "o {}", patch.name.replace(char::is_control, " "))?;
            for p in &patch.mesh.positions {
                writeln!(file, "v {:?} {:?} {:?}", p.x, p.y, p.z)?;
            }
            for n in &patch.taxels.normals {
                writeln!(file, "vn {:?} {:?} {:?}", n.x, n.y, n.z)?;
            }
            for &corners in &patch.mesh.triangles {
                let [a, b, c] = corners.map(|v| before + v.index() + 1);
                writeln!(file, "f {a}//{a} {b}//{b} {c}//{c}")?;
            }
            before += patch.mesh.positions.len();
        }
        Ok(())
    })
}
