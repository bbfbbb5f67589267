//! Why a map cannot be searched, or a query not be answered.

use crate::id::{FaceId, VertexId};
use crate::map::MapError;
use crate::pyramid::LevelId;
use crate::skin::{LinkId, PatchId};

/// Why a map cannot be searched, or a contact not be answered.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
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
    NotFinite {
        /// Its index in the batch, from 0; 0 for a single contact.
        contact: usize,
        /// Its coordinates, in m.
        point: [f64; 3],
    },
    /// A patch without triangles.
    #[error("patch {patch:?} has no triangle; contacts need a triangle")]
    NoFaces {
        /// Name of the patch.
        patch: String,
    },
    /// A map position that is not finite or too large.
    #[error("the map position {uv:?} is not finite and within 1e12 m")]
    NotOnPlane {
        /// The given position, in m.
        uv: [f64; 2],
    },
    /// A contact names a link that the map does not have.
    #[error("contact {contact} is on link {link}, but the map has {count} links")]
    UnknownLink {
        /// Its index in the batch, from 0; 0 for a single contact.
        contact: usize,
        /// The link it names.
        link: LinkId,
        /// Number of links.
        count: usize,
    },
    /// The only link that is searched for a contact carries no skin.
    #[error(
        "contact {contact} is on link {name:?}, which carries no patch; leave its link empty to search all"
    )]
    BareLink {
        /// Its index in the batch, from 0; 0 for a single contact.
        contact: usize,
        /// Name of the link.
        name: String,
    },
    /// The pose of a link scales, shears, mirrors, is not finite or farther than 1e12 m.
    #[error(
        "the pose of link {name:?} is not rigid or too far; a rotation and a translation of at most 1e12 m are needed"
    )]
    NotRigid {
        /// Name of the link.
        name: String,
    },
    /// A query that needs data which the index was made without.
    #[error("the index was made without {what}; `IndexOptions` adds them")]
    NotIndexed {
        /// `levels` or `fields`.
        what: &'static str,
    },
    /// A distance or a radius that is negative or not a number.
    #[error("a distance or radius is a length of at least 0, not {distance}")]
    NoDistance {
        /// The given distance, in m.
        distance: f64,
    },
    /// A ray without a direction.
    #[error("a ray needs finite numbers, a direction with a length and an end in front of its origin")]
    NoRay,
    /// A patch or a level that the map does not have.
    #[error("the map has no level {level} of patch {patch}")]
    NoMap {
        /// The requested patch.
        patch: PatchId,
        /// The requested level.
        level: LevelId,
    },
    /// A vertex that follows no link, or links that do not exist.
    #[error(
        "vertex {vertex} of patch {patch} follows {joints:?}; up to four of the {links} links are needed, \
         with weights of at least 0 and sum 1"
    )]
    Joints {
        /// The patch.
        patch: PatchId,
        /// The vertex.
        vertex: VertexId,
        /// The links given, and their weights.
        joints: [(LinkId, f64); 4],
        /// Number of links.
        links: usize,
    },
    /// A vertex is too far from the origin.
    #[error("patch {patch:?}: vertex {vertex} is at {position:?}; coordinates within 1e12 m are needed")]
    TooLarge {
        /// Name of the patch.
        patch: String,
        /// The vertex.
        vertex: VertexId,
        /// Its coordinates, in m.
        position: [f64; 3],
    },
    /// A patch with more faces than an index can count.
    #[error("patch {patch:?} has {faces} faces, the last being {last}; fewer than 2^28 are needed")]
    TooManyFaces {
        /// Name of the patch.
        patch: String,
        /// Number of faces.
        faces: usize,
        /// The last face that can be counted.
        last: FaceId,
    },
}
