//! Robot descriptions (URDF, and MJCF in `mjcf`): links, joints, shapes and tactile sensors.
//!
//! [`read_robot`] reads the description alone, `draft` the meshes that it names; `elements` reads what stands in
//! a link or a joint, `packages` finds files.
//!
//! The reader passes over what it has no use for: inertias, materials, transmissions, plugins of simulators.
//! What it reads must be right: links and joints have names of their own, and make one tree.

mod draft;
mod elements;
mod mjcf;
mod packages;

use std::path::Path;

use glam::{DAffine3, DVec3};
use roxmltree::Node;

use crate::io::error::Result;
use crate::io::file::Source;
use crate::io::file::xml::{Named, Xml, children};
use crate::io::robot::elements::{RawJoint, read_joint, read_sensor, read_shapes};
use crate::robot::{Joint, Mimic, Robot};
use crate::skin::{Link, LinkId, Remark, RemarkKind};

pub(in crate::io) use draft::draft_of;
pub use draft::{RobotSurface, robot_draft};
pub use packages::Packages;

/// What turns a file of macros into a robot description.
const EXPAND: &str = "a robot description without macros: `xacrodoc -d FOLDER_OF_PACKAGES FILE -o robot.urdf` expands them (`pip install xacrodoc`)";

/// Reads a robot description: a `.urdf` file, or a `.xml` of `MuJoCo`. Its mesh files are not opened.
///
/// ```
/// use dermatome::io::read_robot;
///
/// let path = std::env::temp_dir().join("dermatome-arm.urdf");
/// let text = r#"<robot name="arm">
///   <link name="base"/>
///   <link name="tip"><visual><geometry><sphere radius="0.02"/></geometry></visual></link>
///   <joint name="elbow" type="revolute">
///     <parent link="base"/><child link="tip"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
///     <limit lower="-1" upper="1"/>
///   </joint>
/// </robot>"#;
/// std::fs::write(&path, text)?;
/// let robot = read_robot(&path)?;
/// assert_eq!((robot.links.len(), robot.shapes.len()), (2, 1));
/// assert_eq!(robot.joints[0].limits, Some([-1.0, 1.0]));
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the file cannot be read, is no robot description or one with macros, or its links and joints are not one
/// tree.
pub fn read_robot(path: &Path) -> Result<Robot> {
    robot_of(&Source::open(path)?)
}

/// Reads the robot description of a source.
pub(super) fn robot_of(source: &Source) -> Result<Robot> {
    let xml = Xml::parse(source)?;
    let root = xml.root();
    match root.tag_name().name() {
        "robot" => {}
        "mujoco" | "mujocoinclude" => return mjcf::robot_of(source),
        _ => {
            let needed = "a robot description, whose first element is <robot> or <mujoco>";
            return Err(xml.invalid(root, "another kind of XML", needed));
        }
    }
    let unused = refuse_macros(&xml)?;
    let links = Named::read(&xml, children(root, "link"))?;
    if links.nodes.is_empty() {
        return Err(xml.invalid(root, "no <link>", "a robot description with links"));
    }
    let joints = Named::read(&xml, children(root, "joint"))?;
    let raw: Vec<RawJoint> =
        joints.nodes.iter().map(|&node| read_joint(&xml, node, &links, &joints)).collect::<Result<_>>()?;
    let order = tree(&xml, &links, &joints, &raw)?;
    let mut robot = Robot { name: root.attribute("name").unwrap_or_default().to_owned(), ..Robot::default() };
    let mut ids = vec![LinkId::default(); links.nodes.len()];
    let mut places = vec![usize::MAX; raw.len()];
    for (k, &Hung { link, joint }) in order.iter().enumerate() {
        ids[link] = LinkId::new(k);
        let (mut parent, mut pose) = (None, DAffine3::IDENTITY);
        if let Some(joint) = joint {
            places[joint] = robot.joints.len();
            let raw = &raw[joint];
            (parent, pose) = (Some(ids[raw.parent]), raw.pose);
            robot.joints.push(Joint {
                name: joints.names[joint].to_owned(),
                link: ids[link],
                kind: raw.kind,
                axis: raw.axis,
                anchor: DVec3::ZERO,
                limits: raw.limits,
                mimic: None,
            });
            robot.remarks.extend(raw.passed_over.iter().map(|what| {
                let kind = RemarkKind::PassedOver { what: what.clone() };
                Remark { patch: joints.names[joint].to_owned(), kind }
            }));
        }
        robot.links.push(Link { name: links.names[link].to_owned(), parent, pose });
    }
    add_mimics(&xml, &joints, &raw, &places, &mut robot.joints)?;
    for (&node, &link) in links.nodes.iter().zip(&ids) {
        read_shapes(&xml, node, link, &mut robot)?;
    }
    if unused > 0 {
        let patch = if robot.name.is_empty() { source.stem() } else { robot.name.clone() };
        let what = match unused {
            1 => "1 definition of xacro is not used by anything, and not read".to_owned(),
            n => format!("{n} definitions of xacro are not used by anything, and not read"),
        };
        robot.remarks.push(Remark { patch, kind: RemarkKind::PassedOver { what } });
    }
    let mut taxels = 0;
    for node in children(root, "sensor") {
        let sheet = read_sensor(&xml, node, |name| Some(ids[links.find(name)?]), taxels)?;
        taxels += sheet.as_ref().map_or(0, |sheet| sheet.positions.len());
        robot.sensors.extend(sheet);
    }
    Ok(robot)
}

/// Elements of xacro that define what others use.
const DEFINITIONS: [&str; 3] = ["property", "arg", "macro"];

/// Refuses a file of macros, in which names and numbers are still to be computed. Returns how many definitions it has that
/// nothing uses.
fn refuse_macros(xml: &Xml<'_>) -> Result<usize> {
    let (mut unused, mut open) = (0, vec![xml.root()]);
    while let Some(node) = open.pop() {
        let is_macro = node.tag_name().namespace().is_some_and(|space| space.contains("xacro"));
        if is_macro && DEFINITIONS.contains(&node.tag_name().name()) {
            unused += 1;
            continue;
        }
        let is_open = |value: &str| value.contains("${") || value.contains("$(");
        if is_macro || node.attributes().any(|attribute| is_open(attribute.value())) {
            return Err(xml.invalid(node, "a macro of xacro", EXPAND));
        }
        open.extend(node.children().filter(Node::is_element));
    }
    Ok(unused)
}

/// A link, and the joint that it hangs by.
struct Hung {
    link: usize,
    joint: Option<usize>,
}

/// More links are not named in an error.
const MOST_NAMES: usize = 5;

/// The links, each after its parent; those of one parent in the order of their joints.
fn tree(xml: &Xml<'_>, links: &Named<'_, '_>, joints: &Named<'_, '_>, raw: &[RawJoint]) -> Result<Vec<Hung>> {
    let mut above: Vec<Option<usize>> = vec![None; raw.len().max(links.nodes.len())];
    let mut below: Vec<Vec<usize>> = vec![Vec::new(); links.nodes.len()];
    for (joint, raw) in raw.iter().enumerate() {
        if let Some(other) = above[raw.child].replace(joint) {
            let found = format!(
                "link {:?}, which hangs by the joint {:?} of line {} too",
                links.names[raw.child],
                joints.names[other],
                xml.line(joints.nodes[other])
            );
            return Err(xml.invalid(joints.nodes[joint], found, "a tree: one joint above each link"));
        }
        below[raw.parent].push(joint);
    }
    let name = |link: usize| format!("{:?}", links.names[link]);
    let roots: Vec<usize> = (0..links.nodes.len()).filter(|&link| above[link].is_none()).collect();
    if let [_, second, ..] = roots[..] {
        let names: Vec<String> = roots.iter().take(MOST_NAMES).map(|&link| name(link)).collect();
        let found = format!("{} links that hang by no joint: {}", roots.len(), names.join(", "));
        let needed = "one such link, the root; a joint of type fixed hangs one from another";
        return Err(xml.invalid(links.nodes[second], found, needed));
    }
    let mut order = Vec::with_capacity(links.nodes.len());
    let mut open: Vec<Hung> = roots.iter().map(|&link| Hung { link, joint: None }).collect();
    let mut is_reached = vec![false; links.nodes.len()];
    while let Some(next) = open.pop() {
        is_reached[next.link] = true;
        open.extend(
            below[next.link].iter().rev().map(|&joint| Hung { link: raw[joint].child, joint: Some(joint) }),
        );
        order.push(next);
    }
    // Every link that is left hangs by one joint, from another such link.
    if let Some(mut link) = is_reached.iter().position(|&reached| !reached) {
        let up = |link: usize| above[link].map_or(link, |joint| raw[joint].parent);
        (0..links.nodes.len()).for_each(|_| link = up(link));
        let mut circle = vec![link];
        while up(circle[circle.len() - 1]) != link && circle.len() < MOST_NAMES {
            circle.push(up(circle[circle.len() - 1]));
        }
        let names: Vec<String> = circle.iter().map(|&link| name(link)).collect();
        let found = format!("a circle of links, each hanging from the next: {}", names.join(", "));
        return Err(xml.invalid(
            links.nodes[link],
            found,
            "a tree, which has one link that hangs by no joint",
        ));
    }
    Ok(order)
}

/// Gives the joints those that they follow.
fn add_mimics(
    xml: &Xml<'_>,
    named: &Named<'_, '_>,
    raw: &[RawJoint],
    places: &[usize],
    joints: &mut [Joint],
) -> Result<()> {
    // The joint from which each was reached first: one that is reached from itself again follows itself.
    let mut from = vec![usize::MAX; raw.len()];
    for (k, mimic) in raw.iter().enumerate().filter_map(|(k, raw)| Some((k, raw.mimic.as_ref()?))) {
        let mut at = Some(k);
        while let Some(joint) = at.filter(|&joint| from[joint] == usize::MAX) {
            from[joint] = k;
            at = raw[joint].mimic.as_ref().map(|mimic| mimic.joint);
        }
        if at.is_some_and(|joint| from[joint] == k) {
            return Err(xml.invalid(
                named.nodes[k],
                "a joint that follows itself",
                "<mimic> of another joint",
            ));
        }
        joints[places[k]].mimic = Some(Mimic { joint: places[mimic.joint], ..mimic.clone() });
    }
    Ok(())
}
