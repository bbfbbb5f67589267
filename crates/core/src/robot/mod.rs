//! Robots: links connected by joints, and the shapes and sensors on them that can carry skin.
//!
//! A [`Robot`] is the content of a robot description (URDF, MJCF), before any of its mesh files is opened:
//! see `io::read_robot` and `io::robot_draft`, which makes the
//! [`Draft`](crate::skin::Draft) of its skin. [`Robot::poses`] and [`Robot::motion`] compute the poses of its
//! links, [`Robot::add_taxels`] makes taxels of some of them; `primitive` makes the meshes of boxes,
//! cylinders and spheres.

mod poses;
mod primitive;

use glam::{DAffine3, DVec3};

use crate::id::IdVec;
use crate::mesh::TriMesh;
use crate::skin::{Link, LinkId, Remark, Sheet};

pub use poses::taxel_sheet;
pub use primitive::triangles_of;

/// A robot, as its description gives it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Robot {
    /// Its name; may be empty.
    pub name: String,
    /// The links, each after its parent; the pose of a link is the one where all joints are at 0.
    pub links: IdVec<LinkId, Link>,
    /// The joints, in the order of their links: every link but the first has one.
    pub joints: Vec<Joint>,
    /// The visual and collision shapes of the links, in the order of the file.
    pub shapes: Vec<Shape>,
    /// The taxels of its tactile sensors: a sheet without triangles for each sensor.
    pub sensors: Vec<Sheet>,
    /// Elements of its description that are ignored.
    pub remarks: Vec<Remark>,
}

/// The connection of a link to its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name, unique in the robot.
    pub name: String,
    /// The link that it moves.
    pub link: LinkId,
    /// How it moves.
    pub kind: JointKind,
    /// The direction that it turns around or moves along, of unit length, in the frame of its link.
    pub axis: DVec3,
    /// A point of the axis that it turns around, in the frame of its link, in m.
    pub anchor: DVec3,
    /// Its least and greatest value, in rad or m.
    pub limits: Option<[f64; 2]>,
    /// The joint that it follows.
    pub mimic: Option<Mimic>,
}

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr, strum::EnumString)]
#[strum(serialize_all = "lowercase")]
pub enum JointKind {
    /// It does not.
    Fixed,
    /// It turns, within limits.
    Revolute,
    /// It turns without limits.
    Continuous,
    /// It slides.
    Prismatic,
    /// It moves freely in all six directions; its value is a pose, which joint values do not give.
    Floating,
    /// It turns freely around its anchor; its value is a rotation, which joint values do not give.
    // Bullet has another name for it.
    #[strum(to_string = "ball", serialize = "spherical")]
    Ball,
    /// It slides in the plane across its axis; its value is a pose, which joint values do not give.
    Planar,
}

impl JointKind {
    /// Its name in robot descriptions.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Whether its value is one number.
    pub const fn has_value(self) -> bool {
        matches!(self, Self::Revolute | Self::Continuous | Self::Prismatic)
    }
}

/// A joint that follows another: its value is `multiplier` times that of the other, plus `offset`.
#[derive(Debug, Clone, PartialEq)]
pub struct Mimic {
    /// Index of the other in [`Robot::joints`].
    pub joint: usize,
    /// The factor of its value.
    pub multiplier: f64,
    /// The offset, in rad or m.
    pub offset: f64,
}

/// A shape of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// The link.
    pub link: LinkId,
    /// Whether it is seen or collides.
    pub role: Role,
    /// Its pose in the frame of the link, in m.
    pub pose: DAffine3,
    /// Its geometry.
    pub geometry: Geometry,
    /// Its line in the file, counted from 1.
    pub line: usize,
}

/// The purpose of a shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// For display.
    Visual,
    /// For collisions.
    Collision,
}

/// The geometry of a shape. Lengths are in m; shapes without a mesh have their centre at the origin.
#[derive(Debug, Clone, PartialEq)]
pub enum Geometry {
    /// A file of triangles.
    Mesh {
        /// The file, as the description names it: `package://NAME/PATH`, `file:///PATH` or a path.
        url: String,
        /// The factors of its coordinates; an odd number of negative ones mirrors it.
        scale: DVec3,
    },
    /// A box.
    Box {
        /// Its sides.
        size: DVec3,
    },
    /// A closed cylinder along z.
    Cylinder {
        /// Its radius.
        radius: f64,
        /// Its length.
        length: f64,
    },
    /// A cylinder along z with half a sphere at either end.
    Capsule {
        /// Its radius.
        radius: f64,
        /// Its length without the ends.
        length: f64,
    },
    /// An ellipsoid.
    Ellipsoid {
        /// Half its extent along x, y and z.
        radii: DVec3,
    },
    /// Triangles of the description itself.
    Triangles {
        /// The mesh; a mirroring pose turns it over.
        mesh: TriMesh,
    },
    /// A sphere.
    Sphere {
        /// Its radius.
        radius: f64,
    },
}
