//! PLY: text or binary of either byte order in, binary little endian out.

use std::{borrow::Cow, io::Write, path::Path};

use glam::DVec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{Source, excerpt, unfit, write_to};
use crate::io::mesh::parts::{all_triangles, is_not_finite, not_finite};
use crate::io::mesh::polygon::{CROSSED, POLYGON_NEEDED, Polygons};
use crate::skin::{Draft, Presence, Remark, Sheet, Skin, TaxelId};

/// Properties of a vertex, by their index in the numbers of a [`PlyRow`].
const VERTEX_PROPERTIES: [&str; 10] =
    ["x", "y", "z", "nx", "ny", "nz", "taxel_id", "area", "density", "present"];

/// Indices in [`VERTEX_PROPERTIES`] of what follows the position and the normal.
const ID: usize = 6;
const AREA: usize = 7;
const DENSITY: usize = 8;
const PRESENT: usize = 9;

/// What is kept of one element. One type for every element: the parser is compiled once a type.
#[derive(Default)]
struct PlyRow {
    /// Of a vertex. Every scalar type of the format fits into `f64` exactly.
    numbers: Box<[f64]>,
    /// Of a face or strip, [`NEGATIVE`] where one of them is negative; `None` without a list.
    corners: Option<Vec<u32>>,
}

/// The index of a vertex property, under any of its names.
fn vertex_slot(property: &str) -> Option<usize> {
    let property = if property == "id" { "taxel_id" } else { property };
    VERTEX_PROPERTIES.iter().position(|&name| name == property)
}

/// What ends the header.
const END: &[u8] = b"\nend_header";

/// A negative corner: a strip starts again after it.
const NEGATIVE: u32 = u32::MAX;

fn is_corner_list(property: &str) -> bool {
    matches!(property, "vertex_indices" | "vertex_index")
}

impl PropertyAccess for PlyRow {
    fn new() -> Self {
        Self::default()
    }

    // Its callers in the parser are a dozen.
    #[inline(never)]
    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let number = match property {
            Property::Char(x) => x.into(),
            Property::UChar(x) => x.into(),
            Property::Short(x) => x.into(),
            Property::UShort(x) => x.into(),
            Property::Int(x) => x.into(),
            Property::UInt(x) => x.into(),
            Property::Float(x) => x.into(),
            Property::Double(x) => x,
            list if is_corner_list(name) => {
                let corner = |x: i64| u32::try_from(x).unwrap_or(NEGATIVE);
                self.corners = match &list {
                    Property::ListChar(all) => Some(all.iter().map(|&x| corner(x.into())).collect()),
                    Property::ListShort(all) => Some(all.iter().map(|&x| corner(x.into())).collect()),
                    Property::ListInt(all) => Some(all.iter().map(|&x| corner(x.into())).collect()),
                    other => other.to_u32_list(),
                };
                return PropertyAccessResult::Set;
            }
            _ => return PropertyAccessResult::Ignored,
        };
        let Some(slot) = vertex_slot(name) else { return PropertyAccessResult::Ignored };
        if self.numbers.is_empty() {
            self.numbers = Box::new([0.0; VERTEX_PROPERTIES.len()]);
        }
        self.numbers[slot] = number;
        PropertyAccessResult::Set
    }
}

/// Reads a PLY file as one sheet named after it; polygons and `tristrips` become triangles.
///
/// Vertex properties: `x y z`, and where there are such `nx ny nz`, `taxel_id` (or `id`; -1
/// becomes the placeholder [`u32::MAX`]), `area`, `density`, `present` (0 absent, 1 present, 2
/// thermal pad, 3 other).
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let broken = |e: ParseError| parse_error(source, &e);
    let mut bytes = Cow::Borrowed(source.bytes());
    // Some programs write `PLY`.
    if bytes.starts_with(b"PLY") {
        bytes.to_mut()[..3].make_ascii_lowercase();
    }
    // The crate takes UTF-8 alone; comments may be in other encodings.
    let header_end = bytes.windows(END.len()).position(|at| at == END).unwrap_or(0);
    if std::str::from_utf8(&bytes[..header_end]).is_err() {
        bytes.to_mut()[..header_end].iter_mut().filter(|byte| !byte.is_ascii()).for_each(|byte| *byte = b'?');
    }
    let mut reader = Reader::new(&*bytes);
    let header = Parser::<PlyRow>::new().read_header(&mut reader).map_err(broken)?;
    let header_len = source.bytes().len() - reader.get_ref().len();
    check_header(source, &header, header_len)?;
    let whole;
    if header.encoding == Encoding::Ascii {
        whole = with_digits(&bytes, header_len);
        reader = Reader::new(&*whole);
        Parser::<PlyRow>::new().read_header(&mut reader).map_err(broken)?;
    }
    let mut sheet = Sheet { name: source.stem(), ..Sheet::default() };
    let (mut corners, mut strips) = (Vec::new(), Vec::new());
    for element in header.elements.values() {
        let rows = Parser::<PlyRow>::new().read_payload_for_element(&mut reader, element, &header);
        let rows = rows.map_err(broken)?;
        match element.name.as_str() {
            "vertex" => read_vertices(source, element, &rows, &mut sheet)?,
            "face" => corners = rows,
            "tristrips" => strips = rows,
            _ => {}
        }
    }
    let mut polygons = Polygons::default();
    for (k, row) in corners.iter().enumerate() {
        read_face(source, k, row, &mut sheet, &mut polygons)?;
    }
    for (k, row) in strips.iter().enumerate() {
        read_strips(source, k, row, &mut sheet)?;
    }
    let warped = polygons.remark(source.stem());
    let remarks = warped.into_iter().chain(clear_normals(&mut sheet)).collect();
    Ok(Draft { sheets: vec![sheet], remarks, ..Draft::default() })
}

/// A text whose numbers have digits on both sides of their point and no plus, as the crate needs them: `.5`, `1.` and `+1`
/// are numbers, too. What is no number, `nan`, is infinite.
fn with_digits(text: &[u8], header_len: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len() + text.len() / 8);
    out.extend_from_slice(&text[..header_len]);
    let is_digit = |k: usize| text.get(k).is_some_and(u8::is_ascii_digit);
    let mut skipped = header_len;
    for (k, &byte) in text.iter().enumerate().skip(header_len) {
        let starts = text[k - 1].is_ascii_whitespace();
        match byte {
            _ if k < skipped => {}
            b'+' if starts => {}
            b'.' => {
                out.extend_from_slice(if is_digit(k - 1) { b"." } else { b"0." });
                if !is_digit(k + 1) {
                    out.push(b'0');
                }
            }
            b'-' | b'n' | b'N' | b'i' | b'I'
                if starts && text.get(k + 1).is_some_and(u8::is_ascii_alphabetic) =>
            {
                let word = text[k..].split(u8::is_ascii_whitespace).next().unwrap_or_default();
                let is_infinite = std::str::from_utf8(word).is_ok_and(is_not_finite);
                if is_infinite {
                    out.extend_from_slice(b"1e999");
                    skipped = k + word.len();
                } else {
                    out.push(byte);
                }
            }
            _ => out.push(byte),
        }
    }
    out
}

fn parse_error(source: &Source, error: &ParseError) -> IoError {
    // The message of the crate is its first line, which may begin with the number of the line,
    // then quotes the text; what follows are the insides of its parser.
    let text = error.to_string();
    let (wrong, rest) = text.split_once('\n').unwrap_or((&text, ""));
    let wrong = match wrong.split_once(": ") {
        Some((place, wrong)) if place.starts_with("Line ") => wrong,
        _ => wrong,
    };
    let quoted = rest.lines().find_map(|line| line.trim().strip_prefix("String: '"));
    let quoted = quoted.map(|text| excerpt(text.trim_end_matches('\'').trim()) + ": ").unwrap_or_default();
    let found = quoted + &wrong.trim_end_matches('.').chars().take(200).collect::<String>();
    let element = error.line().map_or("header".into(), |line| format!("line or record {line}"));
    source.invalid(element, found, "PLY as its header describes it")
}

/// Checks what the crate leaves to its caller: that names differ (it would read the first with the
/// type of the last), that vertices have positions, and that the counts fit into the file (elements
/// without a byte could be counted for ever).
fn check_header(source: &Source, header: &Header, header_len: usize) -> Result<()> {
    let head = String::from_utf8_lossy(&source.bytes()[..header_len]);
    let count = |word: &str| head.lines().filter(|l| l.split_whitespace().next() == Some(word)).count();
    let properties: usize = header.elements.values().map(|e| e.properties.len()).sum();
    if count("element") != header.elements.len() || count("property") != properties {
        return Err(source.invalid("header", "a name twice", "elements and properties of different names"));
    }
    let vertex = header.elements.get("vertex");
    let has = |name: &&str| vertex.is_some_and(|e| e.properties.contains_key(*name));
    let mut lists = vertex.into_iter().flat_map(|e| &e.properties).filter(|(name, property)| {
        vertex_slot(name).is_some() && matches!(property.data_type, PropertyType::List(..))
    });
    if let Some((name, _)) = lists.next() {
        let found = format!("a list as property `{name}`");
        return Err(source.invalid("header, element \"vertex\"", found, "a number"));
    }
    if let Some(name) = ["x", "y", "z"].into_iter().find(|name| !has(name)) {
        let found = format!("no property `{name}`");
        return Err(source.invalid("header, element \"vertex\"", found, "properties x, y and z"));
    }
    let mut left = source.bytes().len() - header_len;
    for element in header.elements.values() {
        let least = least_bytes(element, header.encoding).max(1).saturating_mul(element.count);
        // The last line of a text need not end.
        let slack = usize::from(header.encoding == Encoding::Ascii);
        if least > left + slack || (element.properties.is_empty() && element.count > 0) {
            return Err(source.invalid(
                format!("header, element {}", excerpt(&element.name)),
                format!("{} of them, at least {least} bytes", element.count),
                format!("as many as the {left} bytes that are left in the file can encode"),
            ));
        }
        left = (left + slack).saturating_sub(least);
    }
    Ok(())
}

/// Bytes that one element takes at the least.
fn least_bytes(element: &ElementDef, encoding: Encoding) -> usize {
    let scalar = |t: &ScalarType| match (encoding, t) {
        // A digit, and a blank or the end of the line.
        (Encoding::Ascii, _) => 2,
        (_, ScalarType::Char | ScalarType::UChar) => 1,
        (_, ScalarType::Short | ScalarType::UShort) => 2,
        (_, ScalarType::Int | ScalarType::UInt | ScalarType::Float) => 4,
        (_, ScalarType::Double) => 8,
    };
    let property = |t: &PropertyType| match t {
        PropertyType::Scalar(t) | PropertyType::List(t, _) => scalar(t),
    };
    element.properties.values().map(|p| property(&p.data_type)).sum()
}

fn read_vertices(source: &Source, element: &ElementDef, rows: &[PlyRow], sheet: &mut Sheet) -> Result<()> {
    for (k, row) in rows.iter().enumerate() {
        let is_wrong = |(slot, x): (usize, &f64)| !x.is_finite() && !(3..ID).contains(&slot);
        if let Some(slot) = row.numbers.iter().enumerate().position(is_wrong) {
            let element = format!("vertex {k}, property `{}`", VERTEX_PROPERTIES[slot]);
            return Err(source.invalid(element, row.numbers[slot].to_string(), "a finite number"));
        }
    }
    let slots: Vec<usize> = element.properties.keys().filter_map(|name| vertex_slot(name)).collect();
    let column = |slot: usize| slots.contains(&slot).then(|| rows.iter().map(move |row| row.numbers[slot]));
    let vector = |at: usize| rows.iter().map(move |row| DVec3::from_slice(&row.numbers[at..]));
    sheet.positions = vector(0).collect();
    sheet.normals = (3..6).all(|slot| slots.contains(&slot)).then(|| vector(3).collect());
    sheet.areas = column(AREA).map(Iterator::collect);
    sheet.densities = column(DENSITY).map(Iterator::collect);
    let id = |(k, x): (usize, f64)| taxel_id(source, k, x);
    sheet.ids = column(ID).map(|ids| ids.enumerate().map(id).collect()).transpose()?;
    let presence = |(k, x): (usize, f64)| {
        let element = || format!("vertex {k}, property `present`");
        let refuse =
            || source.invalid(element(), x.to_string(), "0 absent, 1 present, 2 thermal pad or 3 other");
        Presence::from_code(x).ok_or_else(refuse)
    };
    sheet.presence = column(PRESENT).map(|codes| codes.enumerate().map(presence).collect()).transpose()?;
    Ok(())
}

/// Normals that are not finite are none.
fn clear_normals(sheet: &mut Sheet) -> Option<Remark> {
    let wrong = |normal: &&mut DVec3| !normal.is_finite();
    let cleared =
        sheet.normals.iter_mut().flatten().filter(wrong).map(|normal| *normal = DVec3::ZERO).count();
    (cleared > 0).then(|| not_finite(sheet.name.clone(), cleared))
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be a whole u32")]
fn taxel_id(source: &Source, k: usize, value: f64) -> Result<TaxelId> {
    if value == -1.0 {
        return Ok(TaxelId(u32::MAX));
    }
    if value.fract() != 0.0 || !(0.0..=f64::from(u32::MAX)).contains(&value) {
        let needed = format!("a whole number, 0 to {}, or -1 where there is none", u32::MAX);
        return Err(source.invalid(format!("vertex {k}, taxel id"), value.to_string(), needed));
    }
    Ok(TaxelId(value as u32))
}

fn read_face(
    source: &Source,
    k: usize,
    row: &PlyRow,
    sheet: &mut Sheet,
    polygons: &mut Polygons,
) -> Result<()> {
    let broken = |found: String, needed: &str| source.invalid(format!("face {k}"), found, needed);
    let Some(corners) = row.corners.as_ref().filter(|corners| !corners.contains(&NEGATIVE)) else {
        return Err(broken("no list `vertex_indices` of whole numbers from 0".into(), "one"));
    };
    if let Some(corner) = corners.iter().find(|&&v| v as usize >= sheet.positions.len()) {
        let needed = format!("one of {} vertices, counted from 0", sheet.positions.len());
        return Err(broken(format!("vertex {corner}"), &needed));
    }
    if corners.is_empty() {
        return Err(broken("no corners".into(), "corners"));
    }
    let outline: Vec<DVec3> = corners.iter().map(|&v| sheet.positions[v as usize]).collect();
    let crossed = || broken(CROSSED.into(), POLYGON_NEEDED);
    let triangles = polygons.cut(&outline, &[]).ok_or_else(crossed)?;
    sheet.triangles.extend(triangles.into_iter().map(|t| t.map(|k| corners[k])));
    Ok(())
}

/// Strips of triangles, of which every second one is turned; a negative number ends a strip.
fn read_strips(source: &Source, k: usize, row: &PlyRow, sheet: &mut Sheet) -> Result<()> {
    let broken = |found: String, needed: &str| source.invalid(format!("tristrips {k}"), found, needed);
    let Some(corners) = &row.corners else {
        return Err(broken("no list `vertex_indices` of whole numbers".into(), "one"));
    };
    let vertices = sheet.positions.len();
    if let Some(corner) = corners.iter().find(|&&v| v != NEGATIVE && v as usize >= vertices) {
        let needed = format!("one of {vertices} vertices, counted from 0, or -1");
        return Err(broken(format!("vertex {corner}"), &needed));
    }
    let is_proper = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    for strip in corners.split(|&v| v == NEGATIVE) {
        let turned =
            |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
        sheet.triangles.extend(strip.windows(3).enumerate().map(turned).filter(is_proper));
    }
    Ok(())
}

/// Writes a PLY file, binary little endian, positions in the world, all else as [`read`] reads it.
/// Patch and link names are lost, and densities too unless every patch has them.
pub(crate) fn write(output: &mut dyn Write, path: &Path, skin: &Skin) -> Result<()> {
    let patches: Vec<_> = skin.patches.iter().map(|patch| skin.in_world(patch)).collect();
    let vertices: usize = patches.iter().map(|p| p.mesh.positions.len()).sum();
    let faces: usize = patches.iter().map(|p| p.mesh.triangles.len()).sum();
    if u32::try_from(vertices).is_err() {
        return Err(unfit(path, "skin", format!("{vertices} vertices"), format!("at most {}", u32::MAX)));
    }
    let has_density = patches.iter().all(|p| p.taxels.densities.is_some());
    let has_presence = patches.iter().flat_map(|p| &p.taxels.presence).any(|&p| p != Presence::Present);
    write_to(output, path, |file| {
        writeln!(file, "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}")?;
        for name in VERTEX_PROPERTIES {
            let kind = match name {
                "density" if !has_density => continue,
                "present" if !has_presence => continue,
                "present" => "uchar",
                "taxel_id" => "uint",
                _ => "double",
            };
            writeln!(file, "property {kind} {name}")?;
        }
        writeln!(file, "element face {faces}\nproperty list uchar uint vertex_indices\nend_header")?;
        for patch in &patches {
            for (v, position) in patch.mesh.positions.enumerate() {
                for x in position.to_array().into_iter().chain(patch.taxels.normals[v].to_array()) {
                    file.write_all(&x.to_le_bytes())?;
                }
                file.write_all(&patch.taxels.ids[v].0.to_le_bytes())?;
                file.write_all(&patch.taxels.areas[v].to_le_bytes())?;
                if let Some(densities) = patch.taxels.densities.as_ref().filter(|_| has_density) {
                    file.write_all(&densities[v].to_le_bytes())?;
                }
                if has_presence {
                    file.write_all(&[patch.taxels.presence[v].code()])?;
                }
            }
        }
        for corners in all_triangles(skin) {
            file.write_all(&[3])?;
            for corner in corners {
                #[expect(clippy::cast_possible_truncation, reason = "vertices fit into 32 bits")]
                let corner = corner as u32;
                file.write_all(&corner.to_le_bytes())?;
            }
        }
        Ok(())
    })
}
