//! The surfaces of a robot, as a draft of its skin.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::io::error::Result;
use crate::io::file::{Source, cannot_read, excerpt, file_kind, invalid};
use crate::io::mesh::reader_of;
use crate::io::robot::Packages;
use crate::io::{IoError, ReadParts};
use crate::numeric::bits;
use crate::robot::{Geometry, Robot, Role, Shape, triangles_of};
use crate::skin::{Draft, LinkId, Remark, RemarkKind, Sheet, world_pose};

/// What of a robot is its skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RobotSurface {
    /// The taxels of its tactile sensors, or if it has none what is seen of it, or what collides.
    #[default]
    Auto,
    /// What is seen: the shape of the robot as it was designed.
    Visual,
    /// What collides: simpler shapes around it, as simulators use them.
    Collision,
    /// The taxels of its tactile sensors.
    Sensors,
}

/// Largest file of a mesh, in bytes: 20 million triangles of STL.
const MOST_BYTES: u64 = 1 << 30;

/// Most triangles of all shapes, each mesh as often as it is used.
const MAX_TRIANGLES: usize = 20_000_000;

/// Kinds of meshes that are read.
const KINDS: &str = "stl, obj, dae, ply, off, 3mf, glb, gltf";

/// The skin of a robot that was read from the file `path`: a sheet for each shape of each link, with the vertices
/// at one position as one. Shapes are called as their link, or, where it has several, with their number after it.
///
/// Coordinates of meshes are taken as they are, whatever direction a file calls up; a factor of scale that is
/// negative turns the triangles over, so that they stay outside.
///
/// A mesh that cannot be found or read is left out with a remark.
///
/// # Errors
/// If there is nothing to make a skin of.
pub fn robot_draft(path: &Path, robot: &Robot, surface: RobotSurface, packages: &Packages) -> Result<Draft> {
    draft_of(path, robot, surface, Some(packages))
}

/// [`robot_draft`]; without packages no other file is opened.
pub(in crate::io) fn draft_of(
    path: &Path,
    robot: &Robot,
    surface: RobotSurface,
    packages: Option<&Packages>,
) -> Result<Draft> {
    let mut draft = Draft { links: robot.rest(), remarks: robot.remarks.clone(), ..Draft::default() };
    let has = |role| robot.shapes.iter().any(|shape| shape.role == role);
    let role = match surface {
        RobotSurface::Auto if robot.sensors.is_empty() && has(Role::Visual) => Role::Visual,
        RobotSurface::Auto if robot.sensors.is_empty() => Role::Collision,
        RobotSurface::Auto | RobotSurface::Sensors => {
            draft.sheets.clone_from(&robot.sensors);
            return if draft.sheets.is_empty() {
                Err(bare(path, "<sensor> with <tactile>"))
            } else {
                Ok(draft)
            };
        }
        RobotSurface::Visual => Role::Visual,
        RobotSurface::Collision => Role::Collision,
    };
    let shapes: Vec<&Shape> = robot.shapes.iter().filter(|shape| shape.role == role).collect();
    if shapes.is_empty() {
        let what = match (surface, role) {
            (RobotSurface::Auto, _) => "<visual>, <collision> or <sensor>",
            (_, Role::Visual) => "<visual>",
            (_, Role::Collision) => "<collision>",
        };
        return Err(bare(path, what));
    }
    let mut meshes = BTreeMap::new();
    let mut absent: BTreeMap<String, IoError> = BTreeMap::new();
    for (url, mesh) in read_meshes(path, &shapes, packages) {
        match mesh {
            Ok(mut mesh) => {
                draft.files.append(&mut mesh.files);
                meshes.insert(url, mesh);
            }
            Err(error) => {
                absent.insert(url, error);
            }
        }
    }
    let mut of_link: HashMap<LinkId, usize> = HashMap::new();
    shapes.iter().for_each(|shape| *of_link.entry(shape.link).or_default() += 1);
    let mut numbers: HashMap<LinkId, usize> = HashMap::new();
    check_size(path, &shapes, &meshes)?;
    for shape in shapes {
        let number = numbers.entry(shape.link).or_default();
        *number += 1;
        let name = &robot.links[shape.link].name;
        let name = if of_link[&shape.link] > 1 { format!("{name}.{number}") } else { name.clone() };
        let mut sheet = Welded::of(shape, &meshes).sheet;
        (sheet.name, sheet.link) = (name, Some(shape.link));
        if let Some(p) = sheet.positions.iter().find(|p| !p.is_finite()) {
            let needed = "a shape of finite size, scale and pose";
            return Err(invalid(
                path,
                (shape.line, format!("a shape of {:?}", sheet.name)),
                format!("a vertex at {p}"),
                needed,
            ));
        }
        if sheet.triangles.is_empty() {
            let error = match &shape.geometry {
                Geometry::Mesh { url, .. } => absent.get(url),
                _ => None,
            };
            let what =
                error.map_or_else(|| "its mesh has no triangles".into(), |e| format!("it is left out: {e}"));
            draft.remarks.push(Remark { patch: sheet.name, kind: RemarkKind::PassedOver { what } });
        } else {
            draft.sheets.push(sheet);
        }
    }
    match absent.into_values().next() {
        Some(mut error) if draft.sheets.is_empty() => {
            if let IoError::MeshFile { has_collision, .. } = &mut error {
                *has_collision = role == Role::Visual && has_collision_shapes(path, robot, packages);
            }
            Err(error)
        }
        _ => Ok(draft),
    }
}

/// Whether a shape that collides needs no file, or has it.
fn has_collision_shapes(path: &Path, robot: &Robot, packages: Option<&Packages>) -> bool {
    let mut shapes = robot.shapes.iter().filter(|shape| shape.role == Role::Collision);
    shapes.any(|shape| match &shape.geometry {
        Geometry::Mesh { url, .. } => packages.is_some_and(|known| known.find(path, "<mesh>", url).is_ok()),
        _ => true,
    })
}

/// Triangles of a shape without a file, at most.
const MOST_OF_SHAPE: usize = 4000;

/// Refuses more triangles than any robot has: a mesh can be used many times, and a shape is a few words.
fn check_size(path: &Path, shapes: &[&Shape], meshes: &BTreeMap<String, Draft>) -> Result<()> {
    let mut triangles = 0;
    for shape in shapes {
        triangles += match &shape.geometry {
            Geometry::Mesh { url, .. } => {
                let sheets = meshes.get(url).map_or(&[][..], |draft| &draft.sheets);
                sheets.iter().map(|sheet| sheet.triangles.len()).sum()
            }
            Geometry::Triangles { mesh } => mesh.triangles.len(),
            _ => MOST_OF_SHAPE,
        };
        if triangles > MAX_TRIANGLES {
            let needed = format!("at most {MAX_TRIANGLES} triangles of all shapes");
            return Err(invalid(path, (shape.line, "a shape"), "more triangles", needed));
        }
    }
    Ok(())
}

fn bare(path: &Path, what: &str) -> IoError {
    let needed = "one to make a skin of: a shape that is seen or collides, or a tactile sensor";
    invalid(path, "the robot", format!("no {what} on these links"), needed)
}

/// The drafts of the mesh files of some shapes, by their URLs.
fn read_meshes(path: &Path, shapes: &[&Shape], packages: Option<&Packages>) -> Vec<(String, Result<Draft>)> {
    let mut elements: BTreeMap<&str, String> = BTreeMap::new();
    for shape in shapes {
        if let Geometry::Mesh { url, .. } = &shape.geometry {
            elements.entry(url).or_insert_with(|| format!("line {}, <mesh>", shape.line));
        }
    }
    let read = |(url, element): (&str, String)| {
        let find = || match packages {
            Some(packages) => packages.find(path, &element, url),
            None => {
                let needed = "shapes without files, since the robot is not in a file itself";
                Err(invalid(path, &*element, format!("the file {}", excerpt(url)), needed))
            }
        };
        let mesh = find().and_then(|file| {
            check(path, &element, &file)?;
            let mut mesh = reader_of(&file)?(Source::open(&file)?, ReadParts::default())?;
            mesh.files.push(file);
            Ok(mesh)
        });
        (url.to_owned(), mesh)
    };
    let elements: Vec<_> = elements.into_iter().collect();
    elements.into_par_iter().map(read).collect()
}

/// Refuses a mesh of an unknown kind, or one that is too large.
fn check(path: &Path, element: &str, file: &Path) -> Result<()> {
    let kind = file_kind(file);
    if !KINDS.split(", ").any(|known| known == kind) {
        let found = match kind.as_str() {
            "mesh" => format!("{}, a binary mesh of OGRE", file.display()),
            "msh" => format!("{}, an old binary mesh of MuJoCo or one of Gmsh", file.display()),
            _ => format!("{}, a mesh of another kind", file.display()),
        };
        return Err(invalid(path, element, found, format!("a mesh of one of: {KINDS}")));
    }
    let length = file.metadata().map_err(cannot_read(file))?.len();
    if length > MOST_BYTES {
        let found = format!("{}, {length} bytes", file.display());
        return Err(invalid(
            path,
            element,
            found,
            format!("a mesh of at most {MOST_BYTES} bytes: reduce it first"),
        ));
    }
    Ok(())
}

/// The triangles of a shape in the frame of its link; vertices at exactly the same position of its mesh are one.
#[derive(Default)]
struct Welded {
    sheet: Sheet,
    places: HashMap<[u64; 3], u32>,
}

impl Welded {
    fn of(shape: &Shape, meshes: &BTreeMap<String, Draft>) -> Self {
        let mut welded = Self::default();
        match (&shape.geometry, triangles_of(&shape.geometry)) {
            (_, Some(mesh)) => {
                let triangles = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v]));
                triangles.for_each(|t| welded.add(t, shape.pose, DVec3::ONE));
            }
            (Geometry::Mesh { url, scale }, None) => {
                if let Some(draft) = meshes.get(url) {
                    welded.add_draft(draft, shape.pose, *scale);
                }
            }
            _ => {}
        }
        welded
    }

    fn add_draft(&mut self, draft: &Draft, pose: DAffine3, scale: DVec3) {
        for sheet in &draft.sheets {
            // Links of a glTF file.
            let within = sheet.link.map_or(DAffine3::IDENTITY, |link| world_pose(&draft.links, link));
            let at =
                |v: u32| sheet.positions.get(v as usize).map_or(DVec3::ZERO, |&p| within.transform_point3(p));
            sheet.triangles.iter().for_each(|t| self.add(t.map(at), pose, scale));
        }
    }

    fn add(&mut self, [a, b, c]: [DVec3; 3], pose: DAffine3, scale: DVec3) {
        let is_mirrored = scale.x * scale.y * scale.z * pose.matrix3.determinant() < 0.0;
        let corners = if is_mirrored { [a, c, b] } else { [a, b, c] };
        let corners = corners.map(|p| {
            *self.places.entry(bits(p.to_array())).or_insert_with(|| {
                self.sheet.positions.push(pose.transform_point3(p * scale));
                u32::try_from(self.sheet.positions.len() - 1).unwrap_or(u32::MAX)
            })
        });
        self.sheet.triangles.push(corners);
    }
}
