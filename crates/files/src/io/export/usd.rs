//! USD as text: a transform for each link, and below it a mesh for each of its patches.
//!
//! Texture coordinates are those of the corners of faces, so that a map which is cut is right.

use std::fmt::{Display, Formatter};
use std::io::{self, Write};

use glam::{DAffine3, DVec3};

use crate::io::error::Result;
use crate::io::export::part::{ExportPart, by_link, distinct, narrowed};
use crate::io::file::{OutPath, write_file};
use crate::numeric::narrow;

pub(super) fn write(path: &OutPath, parts: &[ExportPart<'_>]) -> Result<()> {
    let links = by_link(parts);
    let xforms = distinct(links.values().map(|of_link| identifier(&of_link[0].link)));
    write_file(path, |out| {
        writeln!(
            out,
            "#usda 1.0\n(\n    defaultPrim = \"skin\"\n    metersPerUnit = 1\n    upAxis = \"Z\"\n)\n\ndef Xform \"skin\"\n{{"
        )?;
        for (of_link, xform) in links.values().zip(xforms) {
            let ExportPart { link, pose, .. } = of_link[0];
            writeln!(
                out,
                "    def Xform \"{xform}\" (\n        displayName = {}\n    )\n    {{",
                Quoted(link)
            )?;
            writeln!(out, "        matrix4d xformOp:transform = {}", matrix(*pose))?;
            writeln!(out, "        uniform token[] xformOpOrder = [\"xformOp:transform\"]")?;
            let name = |part: &&ExportPart<'_>| identifier(&format!("{}_L{}", part.patch.name, part.level));
            for (part, name) in of_link.iter().zip(distinct(of_link.iter().map(name))) {
                write_mesh(out, part, &name)?;
            }
            writeln!(out, "    }}")?;
        }
        writeln!(out, "}}")
    })
}

fn write_mesh(out: &mut dyn Write, part: &ExportPart<'_>, name: &str) -> io::Result<()> {
    let frame = part.at.frame;
    // Texture coordinates run upwards here, as the map does.
    let st = part.at.uv.iter().map(|&at| ((at - frame.origin) / frame.size).to_array().map(narrow));
    let faces = part.faces();
    let corners = || faces.ids().flat_map(|face| part.at.places(face));
    let points = || part.vertices().map(|v| v.position);
    let low = narrowed(points().fold(DVec3::INFINITY, DVec3::min));
    let high = narrowed(points().fold(DVec3::NEG_INFINITY, DVec3::max));
    writeln!(out, "\n        def Mesh \"{name}\" (\n            displayName = {}", Quoted(&part.patch.name))?;
    writeln!(out, "        )\n        {{")?;
    writeln!(out, "            uniform token subdivisionScheme = \"none\"")?;
    writeln!(out, "            uniform bool doubleSided = 1")?;
    array(out, "float3[] extent", [low, high].map(tuple), "")?;
    array(out, "point3f[] points", points().map(|p| tuple(narrowed(p))), "")?;
    array(out, "int[] faceVertexCounts", faces.iter().map(|_| 3), "")?;
    array(out, "int[] faceVertexIndices", faces.iter().flatten().map(|v| v.raw()), "")?;
    array(out, "normal3f[] normals", part.vertices().map(|v| tuple(narrowed(v.normal))), "vertex")?;
    array(out, "texCoord2f[] primvars:st", st.map(tuple), "faceVarying")?;
    array(out, "int[] primvars:st:indices", corners().map(|place| place.raw()), "")?;
    array(out, "uint[] primvars:taxel_id", part.vertices().map(|v| v.id.0), "vertex")?;
    array(out, "float[] primvars:area", part.vertices().map(|v| Number(narrow(v.area))), "vertex")?;
    writeln!(out, "        }}")
}

/// Writes an attribute, with its interpolation if `interpolation` is not empty.
fn array<T: Display>(
    out: &mut dyn Write,
    name: &str,
    values: impl IntoIterator<Item = T>,
    interpolation: &str,
) -> io::Result<()> {
    write!(out, "            {name} = [")?;
    for (k, value) in values.into_iter().enumerate() {
        write!(out, "{}{value}", if k == 0 { "" } else { ", " })?;
    }
    match interpolation {
        "" => writeln!(out, "]"),
        _ => writeln!(out, "] (\n                interpolation = \"{interpolation}\"\n            )"),
    }
}

/// A number in its shortest digits.
struct Number(f32);

impl Display for Number {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?}", self.0)
    }
}

fn tuple<const N: usize>(numbers: [f32; N]) -> String {
    format!("({})", numbers.map(|x| format!("{x:?}")).join(", "))
}

/// A pose as USD writes matrices: row by row, the translation in the last row.
fn matrix(pose: DAffine3) -> String {
    let row = |v: DVec3, w: u8| format!("({:?}, {:?}, {:?}, {w})", v.x, v.y, v.z);
    let [x, y, z] = [pose.matrix3.x_axis, pose.matrix3.y_axis, pose.matrix3.z_axis];
    format!("( {}, {}, {}, {} )", row(x, 0), row(y, 0), row(z, 0), row(pose.translation, 1))
}

/// A name as names of prims are: ASCII letters, digits and underscores, and no digit first.
fn identifier(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let first = if plain.starts_with(|c: char| c.is_ascii_digit()) { "_" } else { "" };
    format!("{first}{plain}")
}

/// A text between quotes.
struct Quoted<'a>(&'a str);

impl Display for Quoted<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "\"")?;
        for c in self.0.chars() {
            match c {
                '"' | '\\' => write!(f, "\\{c}")?,
                c if c.is_ascii_control() => write!(f, "\\x{:02x}", u32::from(c))?,
                c => write!(f, "{c}")?,
            }
        }
        write!(f, "\"")
    }
}
