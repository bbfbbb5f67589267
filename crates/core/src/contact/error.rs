//! Why a map cannot be searched, or a query not be answered.

use crate::id::{FaceId, VertexId};
use crate::map::MapError;
use crate::pyramid::LevelId;
use crate::skin::{LinkId, PatchId};

/// Why a map cannot be searched, or a contact not be answered.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum ContactError {
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] crate::run::Cancelled),
    /// The map breaks a rule.
    #[error(transparent)]
    Map(#[from] MapError),
    /// The map has no triangle at all.
    #[error("the map has no triangle; contacts need a triangle")]
    NoSkin,
    /// A contact whose coordinates are not finite or too large.
    #[error("contact {contact} is at {point:?}; finite coordinates within 1e12 m are needed")]
    NotFinite { contact: usize, point: [f64; 3] },
    /// A patch without triangles.
    #[error("patch {patch:?} has no triangle; contacts need a triangle")]
    NoFaces { patch: String },
    /// A map position that is not finite or too large.
    #[error("the map position {uv:?} is not finite and within 1e12 m")]
    NotOnPlane { uv: [f64; 2] },
    /// A contact names a link that the map does not have.
    #[error("contact {contact} is on link {link}, but the map has {count} links")]
    UnknownLink { contact: usize, link: LinkId, count: usize },
    /// The only link that is searched for a contact carries no skin.
    #[error(
        "contact {contact} is on link {name:?}, which carries no patch; leave its link empty to search all"
    )]
    BareLink { contact: usize, name: String },
    /// The pose of a link scales, shears, mirrors, is not finite or farther than 1e12 m.
    #[error(
        "the pose of link {name:?} is not rigid or too far; a rotation and a translation of at most 1e12 m are needed"
    )]
    NotRigid { name: String },
    /// A query that needs data which the index was made without.
    #[error("the index was made without {what}; `IndexOptions` adds them")]
    NotIndexed { what: &'static str },
    /// A distance or a radius that is negative or not a number.
    #[error("a distance or radius is a length of at least 0, not {distance}")]
    NoDistance { distance: f64 },
    /// A ray without a direction.
    #[error("a ray needs finite numbers, a direction with a length and an end in front of its origin")]
    NoRay,
    /// A patch or a level that the map does not have.
    #[error("the map has no level {level} of patch {patch}")]
    NoMap { patch: PatchId, level: LevelId },
    /// A vertex that follows no link, or links that do not exist.
    #[error(
        "vertex {vertex} of patch {patch} follows {joints:?}; up to four of the {links} links are needed, \
         with weights of at least 0 and sum 1"
    )]
    Joints { patch: PatchId, vertex: VertexId, joints: [(LinkId, f64); 4], links: usize },
    /// A vertex is too far from the origin.
    #[error("patch {patch:?}: vertex {vertex} is at {position:?}; coordinates within 1e12 m are needed")]
    TooLarge { patch: String, vertex: VertexId, position: [f64; 3] },
    /// A patch with more faces than an index can count.
    #[error("patch {patch:?} has {faces} faces, the last being {last}; fewer than 2^28 are needed")]
    TooManyFaces { patch: String, faces: usize, last: FaceId },
}
