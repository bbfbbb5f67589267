//! MJCF: the tactile sensors of `MuJoCo`.
//!
//! A sensor needs a mesh with a frame at each vertex, a geom of that mesh, and a geom that collides on the same body:
//! it feels what touches that one. The hull of the skin replaces the body, which the map does not contain.

use std::io::{self, Write};

use glam::{DQuat, DVec3};

use crate::io::error::Result;
use crate::io::export::part::{ExportPart, by_link, distinct, narrowed};
use crate::io::file::{OutPath, unfit, write_file, xml_attribute};

/// `MuJoCo` refuses meshes of fewer.
const LEAST_VERTICES: usize = 4;

/// What `MuJoCo` calls the frame above all bodies; no body may have that name.
const WORLD: &str = "world";

/// How far the hull of a flat patch reaches inwards, in m: it must enclose a volume.
const DEPTH: f64 = 1e-3;

const NOTE: &str = "
  The skin of a robot, in m: a mesh, a geom and a tactile sensor for each patch. A sensor of n vertices gives 3n
  numbers: the depth of what touches (m) at each vertex, then its slip (m/s) along the tangent at each, then along
  normal x tangent. Vertices are in the order of the taxels of the map, above level 0 of its fields.
  A sensor feels what touches a colliding geom of its body. Here that is the hull of the patch; in a robot put the
  first geom of each patch into the body of the robot and leave out its hull.
";

pub(super) fn write(path: &OutPath, parts: &[ExportPart<'_>]) -> Result<()> {
    for part in parts {
        let count = part.vertices().len();
        if count < LEAST_VERTICES {
            let element = format!("patch {:?}, level {}", part.patch.name, part.level);
            let needed = format!("at least {LEAST_VERTICES}, as MuJoCo needs");
            return Err(unfit(path, element, format!("{count} vertices"), needed));
        }
    }
    let names = parts.iter().map(|part| part.patch.name.clone());
    let names = distinct(names.clone().chain(names.map(|name| format!("{name} hull"))));
    let names: Vec<String> = names.iter().map(|name| xml_attribute(path, name)).collect::<Result<_>>()?;
    let (names, hulls) = names.split_at(parts.len());
    let of_links = by_link(parts);
    let links = of_links.values().map(|of_link| of_link[0].link.clone());
    let links = distinct([WORLD.to_owned()].into_iter().chain(links));
    let links: Vec<String> =
        links[1..].iter().map(|link| xml_attribute(path, link)).collect::<Result<_>>()?;
    write_file(path, |out| {
        writeln!(out, "<mujoco model=\"skin\">\n  <!--{NOTE}  -->\n  <asset>")?;
        for ((part, name), hull) in parts.iter().zip(names).zip(hulls) {
            write_mesh(out, part, name)?;
            write_hull(out, part, hull)?;
        }
        writeln!(out, "  </asset>\n  <worldbody>")?;
        for (of_link, link) in of_links.values().zip(&links) {
            let pose = of_link[0].pose;
            let [x, y, z] = pose.translation.to_array();
            let q = DQuat::from_mat3(&pose.matrix3);
            writeln!(
                out,
                "    <body name=\"{link}\" pos=\"{x:?} {y:?} {z:?}\" quat=\"{:?} {:?} {:?} {:?}\">",
                q.w, q.x, q.y, q.z
            )?;
            for part in of_link {
                let (name, hull) = (&names[part.id.index()], &hulls[part.id.index()]);
                let felt = "mass=\"0\" contype=\"0\" conaffinity=\"0\" group=\"2\"";
                writeln!(out, "      <geom name=\"{name}\" type=\"mesh\" mesh=\"{name}\" {felt}/>")?;
                writeln!(out, "      <geom type=\"mesh\" mesh=\"{hull}\" mass=\"0\" group=\"3\"/>")?;
            }
            writeln!(out, "    </body>")?;
        }
        writeln!(out, "  </worldbody>\n  <sensor>")?;
        for name in names {
            writeln!(out, "    <tactile name=\"{name}\" geom=\"{name}\" mesh=\"{name}\"/>")?;
        }
        writeln!(out, "  </sensor>\n</mujoco>")
    })
}

/// The mesh of a sensor. Robots set a scale for all meshes that have none of their own.
fn write_mesh(out: &mut dyn Write, part: &ExportPart<'_>, name: &str) -> io::Result<()> {
    write!(out, "    <mesh name=\"{name}\" scale=\"1 1 1\" inertia=\"shell\" vertex=\"")?;
    rows(out, part.vertices().map(|v| narrowed(v.position)))?;
    write!(out, "\" normal=\"")?;
    rows(
        out,
        part.vertices().map(|v| {
            let axes = [v.normal, v.tangent, v.normal.cross(v.tangent)];
            axes.map(narrowed).concat()
        }),
    )?;
    write!(out, "\" face=\"")?;
    rows(out, part.faces().iter().map(|corners| corners.map(|v| v.raw())))?;
    writeln!(out, "\"/>")
}

/// The convex hull of the vertices, and of a point below their middle: those of a flat patch have none.
fn write_hull(out: &mut dyn Write, part: &ExportPart<'_>, name: &str) -> io::Result<()> {
    let count = part.vertices().len() as f64;
    let middle = part.vertices().map(|v| v.position).sum::<DVec3>() / count;
    let inwards = -part.vertices().map(|v| v.normal).sum::<DVec3>().normalize_or_zero();
    write!(out, "    <mesh name=\"{name}\" scale=\"1 1 1\" inertia=\"shell\" vertex=\"")?;
    rows(out, part.vertices().map(|v| v.position).chain([middle + DEPTH * inwards]).map(narrowed))?;
    writeln!(out, "\"/>")
}

/// Writes numbers, those of a vertex or a face on one line.
fn rows<R: IntoIterator<Item: std::fmt::Debug>>(
    out: &mut dyn Write,
    rows: impl Iterator<Item = R>,
) -> io::Result<()> {
    for row in rows {
        for (k, number) in row.into_iter().enumerate() {
            write!(out, "{}{number:?}", if k == 0 { "\n" } else { " " })?;
        }
    }
    Ok(())
}
