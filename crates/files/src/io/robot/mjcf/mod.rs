//! Robots of `MuJoCo` (MJCF): bodies, joints and geoms, with default classes, included files and frames.
//!
//! A body with several joints becomes as many links: those before the last are named `BODY/JOINT`. The first link is
//! `world`. `model` reads the elements; the kinematics follow `mj_kinematics`.
//!
//! A geom is seen if its group is 0 to 2, and collides if `contype` or `conaffinity` is not 0. On a body
//! that has geoms to be seen that do not collide, only those are seen. Planes and height fields are no shapes.

mod model;

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use crate::io::error::Result;
use crate::io::file::Source;
use crate::io::robot::mjcf::model::{Model, View};
use crate::mesh::TriMesh;
use crate::robot::{Geometry, Joint, JointKind, Mimic, Robot, Role, Shape};
use crate::skin::{Link, LinkId};

/// Elements that make bodies which are not in the file.
const MACROS: [&str; 3] = ["replicate", "attach", "composite"];
const EXPAND: &str =
    "a model without it: `spec = mujoco.MjSpec.from_file(IN)`, `spec.compile()`, `spec.to_xml()` expand it";

/// A mesh of `<asset>`: its shape before the pose of the geom, or why it cannot be read.
type Mesh = std::result::Result<(Geometry, DAffine3), String>;

/// A body to be read.
struct Body<'m> {
    view: View<'m>,
    parent: Option<LinkId>,
    /// The frame around it.
    frame: DAffine3,
}

/// Reads the robot of a file whose first element is `<mujoco>`.
pub(super) fn robot_of(source: &Source) -> Result<Robot> {
    let model = Model::read(source)?;
    let mut reader = MjcfReader {
        meshes: BTreeMap::new(),
        model: &model,
        robot: Robot::default(),
        names: HashSet::new(),
        references: Vec::new(),
    };
    reader.robot.name = model.root().attribute("model").unwrap_or_default().to_owned();
    for asset in model.sections("asset") {
        for mesh in asset.children().filter(|view| view.tag() == "mesh") {
            reader.add_mesh(&mesh)?;
        }
    }
    let worlds: Vec<View<'_>> = model.sections("worldbody").collect();
    let Some(first) = worlds.first() else {
        return Err(model.root().invalid("no <worldbody>", "a model with bodies"));
    };
    reader.push_link("world".to_owned(), None, DAffine3::IDENTITY);
    let mut open = Vec::new();
    for world in worlds.iter().rev() {
        open.extend(reader.add_members(world, LinkId::new(0))?.into_iter().rev());
    }
    while let Some(body) = open.pop() {
        let link = reader.add_body(&body)?;
        open.extend(reader.add_members(&body.view, link)?.into_iter().rev());
    }
    if reader.robot.links.len() == 1 && reader.robot.shapes.is_empty() {
        return Err(first.invalid("no <body>", "a model with bodies"));
    }
    for equality in model.sections("equality") {
        for view in equality.children().filter(|view| view.tag() == "joint") {
            reader.couple(&view)?;
        }
    }
    Ok(reader.robot)
}

struct MjcfReader<'m> {
    model: &'m Model,
    meshes: BTreeMap<String, Mesh>,
    robot: Robot,
    /// Names of links and, after a slash, of joints.
    names: HashSet<String>,
    /// The value of each joint in the pose of the file.
    references: Vec<f64>,
}

impl<'m> MjcfReader<'m> {
    /// A name that no other has, and that is not empty.
    fn unique(&mut self, prefix: &str, name: String) -> String {
        let mut unique = name.clone();
        for k in 2.. {
            if !unique.is_empty() && self.names.insert(format!("{prefix}{unique}")) {
                break;
            }
            unique = format!("{name}.{k}");
        }
        unique
    }

    fn push_link(&mut self, name: String, parent: Option<LinkId>, pose: DAffine3) -> LinkId {
        let name = self.unique("", name);
        self.robot.links.push(Link { name, parent, pose });
        LinkId::new(self.robot.links.len() - 1)
    }

    /// Adds a body with its joints; returns the link that carries its geoms.
    fn add_body(&mut self, body: &Body<'m>) -> Result<LinkId> {
        let number = self.robot.links.len();
        let name = body.view.attribute("name").map_or_else(|| format!("body{number}"), str::to_owned);
        let members = self.model.members(&body.view)?;
        let is_joint = |(view, _): &&(View<'m>, DAffine3)| matches!(view.tag(), "joint" | "freejoint");
        let joints: Vec<_> = members.iter().filter(is_joint).collect();
        let (mut parent, mut pose) = (body.parent, body.frame * self.model.pose(&body.view)?);
        for (k, (view, frame)) in joints.iter().enumerate() {
            let (mut joint, reference) = self.joint(view, *frame)?;
            let back = if joint.kind.has_value() { joint.moved(-reference) } else { DAffine3::IDENTITY };
            let own = view.attribute("name").map_or_else(|| format!("{name}.joint{}", k + 1), str::to_owned);
            joint.name = self.unique("/", own);
            let link = if k + 1 < joints.len() { format!("{name}/{}", joint.name) } else { name.clone() };
            joint.link = self.push_link(link, parent, pose * back);
            (parent, pose) = (Some(joint.link), DAffine3::IDENTITY);
            if joint.limits.is_some_and(|[low, high]| low > high) {
                joint.limits = None;
                self.robot.pass_over(
                    joint.link,
                    format!("the range of the joint {} is reversed: it has no limits here", joint.name),
                );
            }
            self.robot.joints.push(joint);
            self.references.push(reference);
        }
        if let (false, Some(link)) = (joints.is_empty(), parent) {
            return Ok(link);
        }
        let link = self.push_link(name.clone(), parent, pose);
        let name = self.unique("/", format!("{name}.fixed"));
        let (kind, axis, anchor) = (JointKind::Fixed, DVec3::X, DVec3::ZERO);
        self.robot.joints.push(Joint { name, link, kind, axis, anchor, limits: None, mimic: None });
        self.references.push(0.0);
        Ok(link)
    }

    /// A joint, and its value in the pose of the file.
    fn joint(&self, view: &View<'m>, frame: DAffine3) -> Result<(Joint, f64)> {
        let kind = match (view.tag(), view.get("type").unwrap_or("hinge")) {
            ("freejoint", _) | (_, "free") => JointKind::Floating,
            (_, "ball") => JointKind::Ball,
            (_, "slide") => JointKind::Prismatic,
            (_, "hinge") => JointKind::Continuous,
            (_, other) => return Err(view.invalid(other, "a joint of type hinge, slide, ball or free")),
        };
        let vector = |name, other| Ok(view.numbers(name)?.map_or(other, DVec3::from_array));
        let anchor = frame.transform_point3(vector("pos", DVec3::ZERO)?);
        let axis = frame.transform_vector3(vector("axis", DVec3::Z)?).try_normalize();
        let axis = axis.ok_or_else(|| view.invalid("the axis 0 0 0", "a direction"))?;
        let mut joint = Joint {
            name: String::new(),
            link: LinkId::default(),
            kind,
            axis,
            anchor,
            limits: None,
            mimic: None,
        };
        if !kind.has_value() {
            return Ok((joint, 0.0));
        }
        let unit = if kind == JointKind::Prismatic { 1.0 } else { self.model.angle };
        let range = view.numbers::<2>("range")?.map(|range| range.map(|x| x * unit));
        let is_limited = match view.get("limited").unwrap_or("auto") {
            "true" => true,
            "auto" => self.model.has_auto_limits,
            _ => false,
        };
        joint.limits = range.filter(|&[low, high]| is_limited && (low != 0.0 || high != 0.0));
        if kind == JointKind::Continuous && joint.limits.is_some() {
            joint.kind = JointKind::Revolute;
        }
        Ok((joint, view.number("ref")?.unwrap_or(0.0) * unit))
    }

    /// Lets a joint follow another as an equality says: `y - y0` is a polynomial of `x - x0`, with values in the pose of the file
    /// `y0` and `x0`. One that is not linear is not followed, with a remark.
    fn couple(&mut self, view: &View<'m>) -> Result<()> {
        if view.attribute("active") == Some("false") {
            return Ok(());
        }
        let find = |name: &str| {
            let named =
                view.attribute(name).map(|name| self.robot.joints.iter().position(|j| j.name == name));
            let unknown = || view.invalid(format!("{name} of no joint"), "the name of a joint");
            named.map(|joint| joint.ok_or_else(unknown)).transpose()
        };
        let unnamed = || view.invalid("no joint1", "the name of a joint");
        let (joint, leader) = (find("joint1")?.ok_or_else(unnamed)?, find("joint2")?);
        let mut polynomial = [0.0, 1.0, 0.0, 0.0, 0.0];
        for (own, x) in polynomial.iter_mut().zip(view.list("polycoef")?) {
            *own = x;
        }
        let [start, multiplier, rest @ ..] = polynomial;
        let why = match leader {
            None => Some("it keeps one value"),
            Some(_) if rest != [0.0; 3] => Some("it is not linear"),
            Some(_) if self.robot.joints[joint].mimic.is_some() => Some("it follows another joint already"),
            Some(leader) if self.leads(joint, leader) => Some("it would follow itself"),
            Some(leader) => {
                let offset = self.references[joint] + start - multiplier * self.references[leader];
                self.robot.joints[joint].mimic = Some(Mimic { joint: leader, multiplier, offset });
                None
            }
        };
        if let Some(why) = why {
            let (name, link) = (self.robot.joints[joint].name.clone(), self.robot.joints[joint].link);
            let line = view.line();
            let what = format!("the <equality> of line {line} of the joint {name} is not followed: {why}");
            self.robot.pass_over(link, what);
        }
        Ok(())
    }

    /// Whether a joint follows another, or is that one.
    fn leads(&self, leader: usize, mut joint: usize) -> bool {
        while joint != leader {
            match &self.robot.joints[joint].mimic {
                Some(mimic) => joint = mimic.joint,
                None => return false,
            }
        }
        true
    }

    /// Adds the geoms of a body; returns the bodies in it.
    fn add_members(&mut self, body: &View<'m>, link: LinkId) -> Result<Vec<Body<'m>>> {
        let (mut bodies, mut geoms) = (Vec::new(), Vec::new());
        for (view, frame) in self.model.members(body)? {
            match view.tag() {
                "body" => bodies.push(Body { view, parent: Some(link), frame }),
                "geom" if matches!(view.get("type"), Some("plane" | "hfield")) => {}
                "geom" => {
                    let number = |name, other| Ok(view.number(name)?.unwrap_or(other));
                    let does_collide = number("contype", 1.0)? != 0.0 || number("conaffinity", 1.0)? != 0.0;
                    let is_seen = number("group", 0.0)? <= 2.0;
                    let line = view.line();
                    match self.geom(&view)? {
                        Ok((geometry, pose)) => {
                            let pose = frame * pose;
                            let shape = Shape { link, role: Role::Visual, pose, geometry, line };
                            geoms.push((shape, is_seen, does_collide));
                        }
                        Err(why) => {
                            self.robot.pass_over(link, format!("the geom of line {line} is left out: {why}"))
                        }
                    }
                }
                "flexcomp" => {
                    let what = format!("its <flexcomp> of line {} is soft: it is left out", view.line());
                    self.robot.pass_over(link, what);
                }
                tag if MACROS.contains(&tag) => {
                    return Err(view.invalid("an element that makes bodies", EXPAND));
                }
                _ => {}
            }
        }
        let has_purely_seen = geoms.iter().any(|(_, is_seen, does_collide)| *is_seen && !does_collide);
        for (shape, is_seen, does_collide) in geoms {
            if does_collide {
                self.robot.shapes.push(Shape { role: Role::Collision, ..shape.clone() });
            }
            if is_seen && !(does_collide && has_purely_seen) {
                self.robot.shapes.push(shape);
            }
        }
        Ok(bodies)
    }

    /// The shape of a geom and its pose on the body, or why it cannot carry skin.
    fn geom(&self, view: &View<'m>) -> Result<Mesh> {
        let kind = view.get("type").unwrap_or("sphere");
        let mut pose = self.model.pose(view)?;
        if let Some(name) = view.get("mesh") {
            let mesh = self.meshes.get(name).cloned();
            let unknown = || view.invalid(format!("no <mesh> {name:?} in <asset>"), "the name of a mesh");
            return Ok(mesh.ok_or_else(unknown)?.map(|(geometry, inner)| (geometry, pose * inner)));
        }
        let mut size = [0.0; 3];
        for (own, x) in size.iter_mut().zip(view.list("size")?) {
            *own = x;
        }
        if let Some(ends) = view.numbers::<6>("fromto")? {
            let [from, to] = [0, 3].map(|k| DVec3::from_slice(&ends[k..]));
            pose = DAffine3::from_mat3_translation(model::arc(from - to), 0.5 * (from + to));
            let half = 0.5 * from.distance(to);
            let is_flat = matches!(kind, "box" | "ellipsoid");
            size = if is_flat { [size[0], size[0], half] } else { [size[0], half, 0.0] };
        }
        let [radius, half, _] = size;
        let (geometry, used) = match kind {
            "sphere" => (Geometry::Sphere { radius }, 1),
            "capsule" => (Geometry::Capsule { radius, length: 2.0 * half }, 2),
            "cylinder" => (Geometry::Cylinder { radius, length: 2.0 * half }, 2),
            "ellipsoid" => (Geometry::Ellipsoid { radii: size.into() }, 3),
            "box" => (Geometry::Box { size: 2.0 * DVec3::from(size) }, 3),
            _ => return Ok(Err(format!("the shape {kind:?} is not read"))),
        };
        let is_solid = size[..used].iter().all(|&x| x > 0.0);
        Ok(if is_solid { Ok((geometry, pose)) } else { Err("its size is not above 0".to_owned()) })
    }

    /// Adds a mesh of `<asset>`. Its vertices are moved by `refpos`, turned back by `refquat`, then scaled.
    fn add_mesh(&mut self, view: &View<'m>) -> Result<()> {
        let file = view.get("file");
        let stem = || Path::new(file?).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let Some(name) = view.attribute("name").map(str::to_owned).or_else(stem) else { return Ok(()) };
        let vector = |name, other| Ok(view.numbers(name)?.map_or(other, DVec3::from_array));
        let scale = vector("scale", DVec3::ONE)?;
        if scale.to_array().contains(&0.0) {
            return Err(view.invalid(format!("scale {scale}"), "numbers other than 0"));
        }
        let turn = view.numbers("refquat")?.map_or(DMat3::IDENTITY, model::quaternion).transpose();
        let origin = DAffine3::from_translation(-vector("refpos", DVec3::ZERO)?);
        let factor = DAffine3::from_scale(scale);
        let inner = factor * DAffine3::from_mat3(turn) * origin * DAffine3::from_scale(scale.recip());
        let mesh = match (file, view.get("vertex")) {
            (Some(file), _) => Ok((Geometry::Mesh { url: self.model.mesh_file(file), scale }, inner)),
            (None, Some(_)) if view.get("face").is_some() => {
                Ok((Geometry::Triangles { mesh: inline(view)? }, inner * factor))
            }
            (None, Some(_)) => Err(format!("the mesh {name:?} has no faces (MuJoCo takes its hull)")),
            (None, None) => Err(format!("the mesh {name:?} is made by MuJoCo itself")),
        };
        self.meshes.insert(name, mesh);
        Ok(())
    }
}

/// The mesh of the attributes `vertex` and `face`.
fn inline(view: &View<'_>) -> Result<TriMesh> {
    let (vertices, faces) = (view.list("vertex")?, view.list("face")?);
    let positions: Vec<DVec3> = vertices.chunks_exact(3).map(DVec3::from_slice).collect();
    let known = positions.len() as f64;
    let index = |&x: &f64| (x >= 0.0 && x < known && x.fract() == 0.0).then(|| as_index(x));
    let corners: Option<Vec<u32>> = faces.iter().map(index).collect();
    match corners {
        Some(corners) if vertices.len() % 3 == 0 && corners.len() % 3 == 0 => {
            let triangles: Vec<[u32; 3]> = corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
            Ok(TriMesh::from_arrays(positions, &triangles))
        }
        _ => Err(view.invalid(
            "other numbers in vertex or face",
            "three for each vertex, three vertices for each face",
        )),
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a whole number below a count of vertices"
)]
fn as_index(x: f64) -> u32 {
    x as u32
}
