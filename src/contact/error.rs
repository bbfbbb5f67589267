//! Why a map cannot be searched, or a query not be answered.

use crate::{
    id::{FaceId, VertexId},
    mesh::MeshError,
    skin::LinkId,
};

/// Why a map cannot be searched, or a contact not be answered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ContactError {
    /// The map has no triangle at all.
    #[error("the map has no triangle; a contact needs skin to be on")]
    NoSkin,
    /// A contact that is nowhere.
    #[error("contact {contact} is at {point:?}; finite coordinates within 1e12 m are needed")]
    NotFinite {
        /// Its place in the batch, from 0; 0 for a single contact.
        contact: usize,
        /// Its coordinates, in m.
        point: [f64; 3],
    },
    /// A contact names a link that the map does not have.
    #[error("contact {contact} is on link {link}, but the map has {count} links")]
    UnknownLink {
        /// Its place in the batch, from 0; 0 for a single contact.
        contact: usize,
        /// The link it names.
        link: LinkId,
        /// Number of links.
        count: usize,
    },
    /// A contact is given in the frame of a link that carries no skin.
    #[error(
        "contact {contact} is on link {name:?}, which carries no patch; leave its link empty to search all"
    )]
    BareLink {
        /// Its place in the batch, from 0; 0 for a single contact.
        contact: usize,
        /// Name of the link.
        name: String,
    },
    /// A patch hangs on a link that does not exist, or has no level.
    #[error(
        "patch {patch:?} has {levels} levels and hangs on link {link} of {links}; it needs a level and a link"
    )]
    Homeless {
        /// Name of the patch.
        patch: String,
        /// Its number of levels.
        levels: usize,
        /// The link it names.
        link: LinkId,
        /// Number of links.
        links: usize,
    },
    /// A link hangs from a later link.
    #[error("link {name:?} does not come after its parent")]
    LinkOrder {
        /// Name of the link.
        name: String,
    },
    /// The pose of a link scales, shears, mirrors or is not finite.
    #[error(
        "the pose of link {name:?} is no rotation and translation; distances in its frame would not be metres"
    )]
    NotRigid {
        /// Name of the link.
        name: String,
    },
    /// Not one pose per link.
    #[error("there are {found} poses; {needed} are needed, one per link")]
    PoseCount {
        /// Poses given.
        found: usize,
        /// Links of the map.
        needed: usize,
    },
    /// A level's triangles cannot be used.
    #[error("{patch}/L{level}: {source}")]
    Mesh {
        /// Name of the patch.
        patch: String,
        /// The level.
        level: usize,
        /// What is wrong with it.
        source: MeshError,
    },
    /// A vertex lies too far from the origin to be measured from.
    #[error("patch {patch:?}: vertex {vertex} is at {position:?}; coordinates within 1e12 m are needed")]
    TooLarge {
        /// Name of the patch.
        patch: String,
        /// The vertex.
        vertex: VertexId,
        /// Its coordinates, in m.
        position: [f64; 3],
    },
    /// An array of a level has the wrong length.
    #[error("{patch}/L{level}: {what} has {found} entries, {needed} are needed")]
    Length {
        /// Name of the patch.
        patch: String,
        /// The level.
        level: usize,
        /// Which array.
        what: &'static str,
        /// Entries found.
        found: usize,
        /// Entries needed.
        needed: usize,
    },
    /// A row of a level's direct prolongation names no face of the level.
    #[error(
        "{patch}/L{level}: row {row} of direct has vertices {corners:?} with weights {weights:?}; the corners of one \
         face with non-negative weights are needed"
    )]
    NoFace {
        /// Name of the patch.
        patch: String,
        /// The level.
        level: usize,
        /// The row: a vertex of level 0.
        row: VertexId,
        /// What it names.
        corners: [VertexId; 3],
        /// With which weights.
        weights: [f64; 3],
    },
    /// A field whose centre is no vertex of level 0.
    #[error("{patch}/L{level}: field {field} has centre {origin}, but level 0 has {count} vertices")]
    NoOrigin {
        /// Name of the patch.
        patch: String,
        /// The level.
        level: usize,
        /// The field.
        field: VertexId,
        /// What its centre is said to be.
        origin: VertexId,
        /// Vertices of level 0.
        count: usize,
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
