//! Why a draft or skin is refused.

use crate::id::{FaceId, VertexId};
use crate::mesh::MeshError;
use crate::skin::sentence::{count, first_few};
use crate::skin::{LinkId, TaxelError};

/// Why a draft is not a valid skin. Vertices and faces are numbered as the sheet of the draft, or
/// the patch of the skin, numbers them.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum SkinError {
    #[error("{link} moves to a pose that is not rigid, or at a time that is not finite")]
    Pose { link: LinkId },
    #[error("{link} turns by {found} rad between two rows; needed: at most {most}")]
    Turn { link: LinkId, found: f64, most: f64 },
    #[error("patch {patch:?}: {source}")]
    Mesh { patch: String, source: MeshError },
    #[error("patch {patch:?}: {source}")]
    Taxels { patch: String, source: TaxelError },
    #[error(
        "patch {patch:?}: {} more than two faces, the first joins vertices {} and {}; \
         a skin is a sheet, with one or two faces at each edge",
        count(edges.len(), "edge has", "edges have"),
        ends(edges)[0], ends(edges)[1]
    )]
    NonManifoldEdges { patch: String, edges: Vec<[VertexId; 2]> },
    #[error("patch {patch:?}: {} the same corners as an earlier face: {}", count(faces.len(), "face has", "faces have"), first_few(faces))]
    DuplicateFaces { patch: String, faces: Vec<FaceId> },
    #[error(
        "patch {patch:?} cannot be wound consistently: the closed strip of the faces {} contradicts itself at the edge \
         between vertices {} and {}", first_few(faces), edge[0], edge[1]
    )]
    NotOrientable {
        patch: String,
        edge: [VertexId; 2],
        /// The faces of the shortest strip through it that reverses its winding once around, in order.
        faces: Vec<FaceId>,
    },
    #[error(
        "patch {patch:?}: {faces} of its {of} faces, most of its area, are 100,000 times as long as wide or more: no map has room \
         for them"
    )]
    Needles { patch: String, faces: usize, of: usize },
    #[error("patch {patch:?}: its count of faces that fill holes is {found}, but it has {faces} faces")]
    Filled { patch: String, found: usize, faces: usize },
    #[error("two patches are named {patch:?}; names must differ")]
    DuplicateName { patch: String },
    #[error("patch {patch:?} has {found} components; a patch must have one")]
    Components {
        patch: String,
        /// Number of pieces; zero for a patch without faces.
        found: usize,
    },
    #[error("patch {patch:?} is attached to link {link}, which does not exist")]
    UnknownLink { patch: String, link: LinkId },
    #[error("link {link} does not come after its parent")]
    LinkOrder { link: LinkId },
    #[error(
        "the pose of link {link} is not rigid or too far; a rotation and a translation of at most 1e12 m are needed"
    )]
    LinkPose { link: LinkId },
    #[error("patch {patch:?} has no triangles, and taxels at {found} positions; 3 are needed to join them")]
    TooFewPlaces { patch: String, found: usize },
    #[error(
        "patch {patch:?} has no triangles, and its taxels do not lie on a surface: a typical neighbourhood is {thickness:.2} \
         times as thick as wide (variances); at most 0.25 is needed to join them"
    )]
    NoSurface {
        patch: String,
        /// Median of smallest over middle variance of a neighbourhood.
        thickness: f64,
    },
    #[error(
        "patch {patch:?} has no triangles, and no three of its {places} taxels form one within the gap: they lie on \
         lines, or in pairs"
    )]
    NoFace { patch: String, places: usize },
    #[error("the gap is {found}; a number from 1 to 20, in units of the spacing, is needed")]
    Gap { found: f64 },
    #[error("{} patches are not valid: {}", errors.len(), joined(errors))]
    Several { errors: Vec<SkinError>, valid: usize },
    #[error(
        "{} no area: corners coincide or lie on a line; a skin needs positions that differ",
        if *faces == 1 { "its only triangle has".to_owned() } else { format!("its {faces} triangles have") }
    )]
    NoArea { faces: usize },
    #[error("there is no triangle in it: a skin needs taxels joined by triangles")]
    NoTriangles,
}

/// The ends of the first edge.
fn ends(edges: &[[VertexId; 2]]) -> [VertexId; 2] {
    edges.first().copied().unwrap_or_default()
}

fn joined(errors: &[SkinError]) -> String {
    errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}
