//! What stands in the elements of a robot description: joints, shapes and tactile sensors.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use roxmltree::Node;

use crate::io::error::Result;
use crate::io::file::excerpt;
use crate::io::file::xml::{Named, Xml, child, children};
use crate::robot::{Geometry, JointKind, Mimic, Robot, Role, Shape, taxel_sheet};
use crate::skin::{LinkId, Sheet, TaxelId};

/// A joint whose links and leader are indices in the file.
pub(super) struct RawJoint {
    pub(super) parent: usize,
    pub(super) child: usize,
    pub(super) pose: DAffine3,
    pub(super) kind: JointKind,
    pub(super) axis: DVec3,
    pub(super) limits: Option<[f64; 2]>,
    pub(super) mimic: Option<Mimic>,
    /// Its elements that are not read.
    pub(super) passed_over: Vec<String>,
}

pub(super) fn read_joint<'i>(
    xml: &Xml<'i>,
    node: Node<'_, 'i>,
    links: &Named<'_, '_>,
    joints: &Named<'_, '_>,
) -> Result<RawJoint> {
    let link = |end: &str| {
        let node = xml.need_child(node, end)?;
        let name = xml.need(node, "link")?;
        links.find(name).ok_or_else(|| xml.invalid(node, "no <link> of that name", "the name of a link"))
    };
    let kind = xml.need(node, "type")?;
    let kind = kind.parse::<JointKind>().map_err(|_| {
        let needed = "fixed, revolute, continuous, prismatic, floating, ball (or spherical) or planar";
        xml.invalid(node, format!("type={}", excerpt(kind)), needed)
    })?;
    let mimic = child(node, "mimic").map(|mimic| read_mimic(xml, mimic, joints)).transpose()?;
    let mut passed_over = Vec::new();
    let lost = |leader| format!("it follows a joint {leader:?} that is not there; it has a value of its own");
    let mimic = mimic.and_then(|mimic| mimic.map_err(|leader| passed_over.push(lost(leader))).ok());
    let limits = limits(xml, node, kind).unwrap_or_else(|e| {
        passed_over.push(format!("its limits are left out: {e}"));
        None
    });
    Ok(RawJoint {
        parent: link("parent")?,
        child: link("child")?,
        pose: origin(xml, node)?,
        kind,
        axis: axis(xml, node, kind)?,
        limits,
        mimic,
        passed_over,
    })
}

/// The axis of a joint; one that needs none has x.
fn axis<'i>(xml: &Xml<'i>, joint: Node<'_, 'i>, kind: JointKind) -> Result<DVec3> {
    let Some(node) = child(joint, "axis").filter(|_| kind.has_value() || kind == JointKind::Planar) else {
        return Ok(DVec3::X);
    };
    let axis = xml.numbers(node, "xyz")?.map_or(DVec3::X, DVec3::from_array);
    axis.try_normalize().ok_or_else(|| xml.invalid(node, format!("the direction {axis}"), "a direction"))
}

/// The limits of a joint, where both numbers are there or one and the other is 0.
fn limits<'i>(xml: &Xml<'i>, joint: Node<'_, 'i>, kind: JointKind) -> Result<Option<[f64; 2]>> {
    let has_limits = matches!(kind, JointKind::Revolute | JointKind::Prismatic);
    let Some(node) = child(joint, "limit").filter(|_| has_limits) else { return Ok(None) };
    let (lower, upper) = (xml.number(node, "lower")?, xml.number(node, "upper")?);
    if lower.is_none() && upper.is_none() {
        return Ok(None);
    }
    let [lower, upper] = [lower, upper].map(Option::unwrap_or_default);
    if lower > upper {
        return Err(xml.invalid(
            node,
            format!("lower {lower}, upper {upper}"),
            "lower limits below upper ones",
        ));
    }
    Ok(Some([lower, upper]))
}

/// The joint that a joint follows, or the name of one that is not there.
fn read_mimic<'i>(
    xml: &Xml<'i>,
    node: Node<'_, 'i>,
    joints: &Named<'_, '_>,
) -> Result<Result<Mimic, String>> {
    let name = xml.need(node, "joint")?;
    let Some(joint) = joints.find(name) else { return Ok(Err(name.to_owned())) };
    let multiplier = xml.number(node, "multiplier")?.unwrap_or(1.0);
    Ok(Ok(Mimic { joint, multiplier, offset: xml.number(node, "offset")?.unwrap_or(0.0) }))
}

/// The pose that the `<origin>` of an element gives.
fn origin<'i>(xml: &Xml<'i>, node: Node<'_, 'i>) -> Result<DAffine3> {
    child(node, "origin").map_or(Ok(DAffine3::IDENTITY), |node| pose(xml, node))
}

/// The pose of an element: `xyz` in m, `rpy` turns around the fixed axes x, y and z in rad.
fn pose<'i>(xml: &Xml<'i>, node: Node<'_, 'i>) -> Result<DAffine3> {
    let xyz = xml.numbers(node, "xyz")?.map_or(DVec3::ZERO, DVec3::from_array);
    let [roll, pitch, yaw] = xml.numbers(node, "rpy")?.unwrap_or_default();
    let turn = DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
    Ok(DAffine3::from_mat3_translation(turn, xyz))
}

/// Adds the shapes of a link. One that is not read is left out with a remark.
pub(super) fn read_shapes<'i>(
    xml: &Xml<'i>,
    link: Node<'_, 'i>,
    id: LinkId,
    robot: &mut Robot,
) -> Result<()> {
    for (name, role) in [("visual", Role::Visual), ("collision", Role::Collision)] {
        for node in children(link, name) {
            // Some writers leave elements empty.
            let Some(geometry) = child(node, "geometry") else { continue };
            let Some(kind) = geometry.children().find(Node::is_element) else { continue };
            let pose = origin(xml, node)?;
            match read_geometry(xml, kind) {
                Ok(geometry) => {
                    robot.shapes.push(Shape { link: id, role, pose, geometry, line: xml.line(kind) });
                }
                Err(e) => robot.pass_over(id, format!("a shape is left out: {e}")),
            }
        }
    }
    Ok(())
}

fn read_geometry<'i>(xml: &Xml<'i>, node: Node<'_, 'i>) -> Result<Geometry> {
    let length = |name: &str| {
        let length = xml.number(node, name)?.unwrap_or_default();
        let refuse = || xml.invalid(node, format!("{name} {length}"), "a length above 0, in m");
        if length > 0.0 { Ok(length) } else { Err(refuse()) }
    };
    Ok(match node.tag_name().name() {
        "mesh" => {
            Geometry::Mesh { url: xml.need(node, "filename")?.trim().to_owned(), scale: scale(xml, node)? }
        }
        "box" => {
            let size = xml.numbers(node, "size")?.map_or(DVec3::ZERO, DVec3::from_array);
            if size.min_element() <= 0.0 {
                return Err(xml.invalid(node, format!("size {size}"), "three lengths above 0, in m"));
            }
            Geometry::Box { size }
        }
        "cylinder" => Geometry::Cylinder { radius: length("radius")?, length: length("length")? },
        "sphere" => Geometry::Sphere { radius: length("radius")? },
        "capsule" => Geometry::Capsule { radius: length("radius")?, length: length("length")? },
        _ => return Err(xml.invalid(node, "an unknown shape", "mesh, box, cylinder, capsule or sphere")),
    })
}

/// What the coordinates of a mesh are multiplied by: one number or three.
fn scale<'i>(xml: &Xml<'i>, node: Node<'_, 'i>) -> Result<DVec3> {
    let Some(text) = node.attribute("scale") else { return Ok(DVec3::ONE) };
    let scale = match text.split_whitespace().count() {
        1 => xml.number(node, "scale")?.map(DVec3::splat),
        _ => xml.numbers(node, "scale")?.map(DVec3::from_array),
    };
    let scale = scale.unwrap_or(DVec3::ONE);
    if scale.to_array().contains(&0.0) {
        return Err(xml.invalid(node, format!("scale={}", excerpt(text)), "numbers other than 0"));
    }
    Ok(scale)
}

/// Most taxels of all arrays of a file, which does not grow with their number.
const MAX_TAXELS: f64 = 1e6;

/// The taxels of a sensor, if it is a tactile one.
///
/// Either a list: `<taxel idx xyz rpy>`, poses in the frame of the sensor, whose z axis is the normal and whose x
/// axis the tangent; or `<array rows cols order size spacing offset>`, a lattice in the plane of x (rows) and y
/// (columns), as `urdf_tactile` of the tactile toolbox has them. Ids are the indices in the message of the sensor.
pub(super) fn read_sensor<'i>(
    xml: &Xml<'i>,
    node: Node<'_, 'i>,
    link: impl Fn(&str) -> Option<LinkId>,
    earlier: usize,
) -> Result<Option<Sheet>> {
    let Some(tactile) = child(node, "tactile") else { return Ok(None) };
    let parent = xml.need_child(node, "parent")?;
    let unknown = || xml.invalid(parent, "no <link> of that name", "the name of a link");
    let link = link(xml.need(parent, "link")?).ok_or_else(unknown)?;
    let frame = origin(xml, node)?;
    let mut taxels: Vec<(TaxelId, DAffine3)> = Vec::new();
    for (k, taxel) in (0..).zip(children(tactile, "taxel")) {
        let id = taxel.attribute("idx").map_or(Ok(k), |text| {
            let refuse = |_| xml.invalid(taxel, format!("idx={}", excerpt(text)), "a number from 0");
            text.trim().parse().map_err(refuse)
        })?;
        taxels.push((TaxelId(id), frame * pose(xml, taxel)?));
    }
    if let Some(array) = child(tactile, "array") {
        let places = lattice(xml, array, MAX_TAXELS - earlier as f64)?;
        let pose = |at: DVec2| frame * DAffine3::from_translation(at.extend(0.0));
        taxels.extend((0..).zip(places).map(|(k, at)| (TaxelId(k), pose(at))));
    }
    if taxels.is_empty() {
        return Err(xml.invalid(tactile, "no taxels", "elements <taxel>, or an <array>"));
    }
    let name = node.attribute("name").unwrap_or_default().to_owned();
    Ok(Some(taxel_sheet(name, link, &taxels)))
}

/// The positions of the taxels of an array, `most` of them, in the order of the message.
fn lattice<'i>(xml: &Xml<'i>, node: Node<'_, 'i>, most: f64) -> Result<Vec<DVec2>> {
    let pair = |name: &str| Ok(xml.numbers(node, name)?.map(DVec2::from_array));
    let size = pair("size")?;
    let spacing =
        pair("spacing")?.or(size).ok_or_else(|| xml.invalid(node, "no spacing", "size or spacing, in m"))?;
    let offset = pair("offset")?.unwrap_or_default();
    let [rows, columns] =
        ["rows", "cols"].map(|name| node.attribute(name).and_then(|text| text.trim().parse::<u32>().ok()));
    let counts = rows
        .zip(columns)
        .filter(|&(rows, columns)| (1.0..=most).contains(&(f64::from(rows) * f64::from(columns))));
    let (rows, columns) = counts.ok_or_else(|| {
        xml.invalid(
            node,
            "other rows and cols",
            "numbers of rows and cols from 1, a million taxels in the file at most",
        )
    })?;
    let at = |row: u32, column: u32| DVec2::new(f64::from(row), f64::from(column)) * spacing - offset;
    match node.attribute("order").unwrap_or("row-major") {
        "row-major" => Ok((0..rows).flat_map(|r| (0..columns).map(move |c| at(r, c))).collect()),
        "col-major" | "column-major" => {
            Ok((0..columns).flat_map(|c| (0..rows).map(move |r| at(r, c))).collect())
        }
        other => Err(xml.invalid(node, format!("order={}", excerpt(other)), "row-major or col-major")),
    }
}
