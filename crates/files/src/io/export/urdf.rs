//! A robot description with the skin as tactile sensors: every byte of the description is kept.

use std::collections::HashSet;
use std::io::{self, Write};
use std::path::Path;

use glam::{DMat3, DVec3};

use crate::io::error::Result;
use crate::io::export::part::{ExportPart, Vertex};
use crate::io::file::xml::{Xml, children};
use crate::io::file::{OutPath, Source, invalid, write_file, xml_attribute};
use crate::io::robot::robot_of;

/// Writes the robot that the file `robot` describes with a sensor for each part, in the form that the reader of robots
/// takes: frames of taxels in that of the link, with z the normal and x the tangent.
pub(super) fn write(path: &OutPath, robot: &Path, parts: &[ExportPart<'_>]) -> Result<()> {
    let source = Source::open(robot)?;
    let known = robot_of(&source)?;
    let links: HashSet<&str> = known.links.iter().map(|link| &*link.name).collect();
    if let Some(part) = parts.iter().find(|part| !links.contains(&*part.link)) {
        let element = format!("link {:?}", part.link);
        let needed = format!("that link, which carries patch {:?}", part.patch.name);
        return Err(invalid(robot, element, "no <link> of that name", needed));
    }
    let xml = Xml::parse(&source)?;
    let names: HashSet<&str> = parts.iter().map(|part| &*part.patch.name).collect();
    let is_taken = |name: Option<&str>| name.is_some_and(|name| names.contains(name));
    if let Some(sensor) = children(xml.root(), "sensor").find(|sensor| is_taken(sensor.attribute("name"))) {
        let needed = "another name, or no such sensor: that of the patch replaces it";
        return Err(xml.invalid(sensor, "the name of a patch", needed));
    }
    let sensors: Vec<(String, String)> = parts
        .iter()
        .map(|part| Ok((xml_attribute(path, &part.patch.name)?, xml_attribute(path, &part.link)?)))
        .collect::<Result<_>>()?;
    let bytes = source.bytes();
    if !bytes.ends_with(source.text()?.as_bytes()) {
        return Err(invalid(
            robot,
            "file",
            "text in another encoding",
            "a description in UTF-8, of which every byte is kept",
        ));
    }
    // Before the tag that ends <robot>. What precedes the elements may be shorter as XML, what follows them is the same.
    let bytes_of_text = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    let xml_text = source.xml_text()?;
    let end = xml.root().range().end;
    let tag = xml_text[..end].rfind("</").unwrap_or_default();
    let (before, after) = bytes.split_at(bytes_of_text - (xml_text.len() - tag));
    write_file(path, |out| {
        out.write_all(before)?;
        if !before.ends_with(b"\n") {
            writeln!(out)?;
        }
        for (part, (name, link)) in parts.iter().zip(&sensors) {
            writeln!(out, "  <sensor name=\"{name}\">\n    <parent link=\"{link}\"/>\n    <tactile>")?;
            part.vertices().try_for_each(|v| write_taxel(out, &v))?;
            writeln!(out, "    </tactile>\n  </sensor>")?;
        }
        out.write_all(after)
    })
}

fn write_taxel(out: &mut dyn Write, v: &Vertex) -> io::Result<()> {
    let DVec3 { x, y, z } = v.position;
    let [roll, pitch, yaw] = turns(v.normal, v.tangent);
    writeln!(
        out,
        "      <taxel idx=\"{}\" xyz=\"{x:?} {y:?} {z:?}\" rpy=\"{roll:?} {pitch:?} {yaw:?}\"/>",
        v.id
    )
}

/// The turns around the fixed axes x, y and z, one after the other, that take z to a normal and x to a tangent.
fn turns(normal: DVec3, tangent: DVec3) -> [f64; 3] {
    let z = normal.normalize();
    let x = tangent.reject_from_normalized(z).normalize();
    let yaw = x.y.atan2(x.x);
    // Without the yaw what is left is a pitch and a roll, however steep the pitch is.
    let left = DMat3::from_rotation_z(-yaw) * DMat3::from_cols(x, z.cross(x), z);
    let pitch = (-left.x_axis.z).atan2(left.x_axis.x);
    let roll = (-left.z_axis.y).atan2(left.y_axis.y);
    [roll, pitch, yaw]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Also where the tangent points along z, so that roll and yaw turn around one axis.
    #[test]
    fn turns_give_back_the_frame() {
        let axes =
            [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Z, DVec3::new(1e-9, 0.0, 1.0), DVec3::new(0.3, -0.5, 0.2)];
        for (normal, other) in axes.iter().flat_map(|n| axes.map(|t| (n.normalize(), t))) {
            let Some(tangent) = other.reject_from_normalized(normal).try_normalize() else { continue };
            // Two directions that nearly agree leave a tangent of few digits.
            let tangent = tangent.reject_from_normalized(normal).normalize();
            let [roll, pitch, yaw] = turns(normal, tangent);
            let turn =
                DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
            let is_close = turn.z_axis.abs_diff_eq(normal, 1e-12) && turn.x_axis.abs_diff_eq(tangent, 1e-12);
            assert!(is_close, "{normal} {tangent}: {turn}");
        }
    }
}
