//! Remarks: changes, assumptions and doubts of reading, triangulating and assembling, as data.

use std::fmt;

use crate::id::{FaceId, VertexId};
use crate::skin::SkinError;
use crate::skin::sentence::{coincident, count, doubtful_unit, edge_list, first_few, length};

/// One change or doubt about a sheet or patch; `Display` makes a sentence of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Remark {
    /// Name of the sheet or patch.
    pub patch: String,
    /// The change, assumption or doubt.
    pub kind: RemarkKind,
}

/// Adds a remark about some elements, unless there are none.
pub(super) fn note<T>(remarks: &mut Vec<RemarkKind>, about: Vec<T>, kind: impl FnOnce(Vec<T>) -> RemarkKind) {
    if !about.is_empty() {
        remarks.push(kind(about));
    }
}

macro_rules! remark_kinds {
    ($($(#[$doc:meta])* $variant:ident { $($field:ident: $type:ty),* } => $text:literal $(, $argument:expr)*;)*) => {
        /// The kinds of [`Remark`].
        ///
        /// Vertices and faces are numbered as in the sheet of the draft; after bare taxels were
        /// triangulated, faces are those of the new triangles.
        #[derive(Debug, Clone, PartialEq)]
        #[non_exhaustive]
        #[expect(missing_docs, reason = "the messages say what the fields are")]
        pub enum RemarkKind {
            $($(#[$doc])* #[doc = $text] $variant { $($field: $type),* },)*
        }

        impl fmt::Display for RemarkKind {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$variant { $($field),* } => write!(f, $text $(, $argument)*),)*
                }
            }
        }
    };
}

remark_kinds! {
    Welded { vertices: usize, taxels: usize } =>
        "{vertices} vertices were welded into {}", count(*taxels, "taxel", "taxels");
    CutKept { edges: usize } =>
        "the file cuts it open along {}; it stays cut, with the vertices of both sides",
        count(*edges, "edge", "edges");
    DuplicatesDropped { faces: Vec<FaceId> } =>
        "{} dropped, with the same corners as an earlier one: {}",
        count(faces.len(), "face was", "faces were"), first_few(faces);
    EdgesParted { edges: Vec<[VertexId; 2]> } =>
        "{} had more than two faces; those of one solid, or else the two that continue each other most smoothly, are still joined: {}",
        count(edges.len(), "edge", "edges"), edge_list(edges);
    EdgesDivided { edges: Vec<[VertexId; 2]> } =>
        "{} got a taxel in the middle, since sheets that part there are connected around both ends: {}",
        count(edges.len(), "edge", "edges"), edge_list(edges);
    OneSidedCut { edges: Vec<[VertexId; 2]> } =>
        "cut open along {}, since it would be one-sided: {}",
        count(edges.len(), "edge", "edges"), edge_list(edges);
    FansSplit { vertices: Vec<VertexId> } =>
        "at {} several fans of faces touched in a point; each fan has a taxel of its own now: {}",
        count(vertices.len(), "vertex", "vertices"), first_few(vertices);
    /// A patch that is not valid was left out, as requested.
    PatchLeftOut { reason: SkinError } => "left out: {reason}";
    /// An animation that is not rigid motion of links was left out.
    AnimationLeftOut { reason: String } => "left out: {reason}";
    LeftOut { vertices: Vec<VertexId> } =>
        "{} left out, used by no triangle: {}",
        count(vertices.len(), "taxel was", "taxels were"), first_few(vertices);
    /// Repair: a sheet of bare taxels that cannot be triangulated was left out.
    SheetLeftOut { taxels: usize, reason: SkinError } =>
        "{} left out: {reason}", count(*taxels, "taxel was", "taxels were");
    RepeatedCorner { faces: Vec<FaceId> } =>
        "{} left out, with the same taxel twice: {}", count(faces.len(), "face was", "faces were"), first_few(faces);
    ZeroAreaDropped { faces: Vec<FaceId> } =>
        "{} left out, without area at the boundary: {}",
        count(faces.len(), "face was", "faces were"), first_few(faces);
    ZeroAreaFlipped { faces: Vec<FaceId> } =>
        "{} without area had the longest edge flipped: {}", count(faces.len(), "face", "faces"), first_few(faces);
    ZeroAreaKept { faces: Vec<FaceId> } =>
        "{} kept without area, since a slit would open otherwise: {}",
        count(faces.len(), "face was", "faces were"), first_few(faces);
    /// Repair: faces were turned over.
    Turned { faces: usize, of: usize, outside: OutsideFrom } => "{}", turned(*faces, *of, *outside);
    Components { patches: Vec<String> } =>
        "has {} pieces that share no edge; they are now {}", patches.len(), first_few(patches);
    /// Columns of its table are not used.
    ColumnsNotRead { columns: Vec<String> } =>
        "{} not used: {}", count(columns.len(), "column is", "columns are"), first_few(columns);
    Renamed { name: String } => "the name is taken; this patch is now {name}";
    NormalsReplaced { taxels: usize } =>
        "{} not of unit length or not outwards; that of the faces is used instead",
        count(*taxels, "normal is", "normals are");
    NormalsIgnored { reason: UnreliableNormals } => "{reason}; those of the faces replace them";
    NormalsOpposed { opposed: usize, of: usize } =>
        "{opposed} of {of} normals oppose those of their neighbours; the planes of the neighbourhoods were \
          used instead, and the outside of a component is where two thirds of its normals point";
    TangentsReplaced { taxels: usize } =>
        "{} not of unit length or along the normal; the direction of the neighbours is used instead",
        count(*taxels, "tangent is", "tangents are");
    TangentsIgnored {} => "most tangents are not unit vectors or are parallel to the normal; none is used";
    AreasReplaced { vertices: Vec<VertexId> } =>
        "{} not positive; those of the faces are used instead, at {} {}",
        count(vertices.len(), "area is", "areas are"),
        if vertices.len() == 1 { "vertex" } else { "vertices" }, first_few(vertices);
    Triangulated { taxels: usize, triangles: usize, gap: f64, longest: f64 } =>
        "{taxels} bare taxels were joined by {triangles} triangles; edges longer than {gap} times the \
          local spacing, {} at its median, are gaps", length(*longest);
    Merged { vertices: Vec<VertexId>, distance: f64 } =>
        "{}; merged with it: {}", coincident(vertices.len(), *distance), first_few(vertices);
    /// Repair: slots without a taxel were left out.
    EmptySlots { slots: usize } => "{} left out", count(*slots, "empty slot was", "empty slots were");
    HolesFilled { holes: usize, max_edges: usize } =>
        "{} of at most {max_edges} edges", count(*holes, "hole was filled,", "holes were filled, each");
    /// Something in the file was ignored; `what` is the sentence of its reader.
    PassedOver { what: String } => "{what}";
    OutsideFromCentre { components: usize } =>
        "no normals determine the outside; for {} it was assumed to be away from the \
          centre", count(*components, "component", "components");
    OutsideFromAxis { components: usize } => "no normals determine the outside, and {} to neither side; of the two \
          sides the one that faces most towards +x, +y or +z was assumed",
        count(*components, "component bulges", "components bulge");
    DoubtfulUnit { extent: f64 } => "{}", doubtful_unit(*extent);
}

/// The data that determined which side of a patch is outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
pub enum OutsideFrom {
    /// The normals of the taxels.
    #[strum(to_string = "the taxels' normals")]
    Normals,
    /// The sign of the enclosed volume.
    #[strum(to_string = "the closed surface")]
    ClosedSurface,
    /// The winding of most faces in the file.
    #[strum(to_string = "most of its faces")]
    MostFaces,
}

/// Why the normals of a file are not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
pub enum UnreliableNormals {
    /// Most are not unit vectors.
    #[strum(to_string = "most normals are not unit vectors")]
    NotUnit,
    /// All are the same although the surface is not flat, or not perpendicular to them: a
    /// placeholder.
    #[strum(to_string = "the normals are all the same, but the surface faces other directions")]
    Constant,
    /// They do not fit the surface.
    #[strum(to_string = "the normals do not fit the surface")]
    Unrelated,
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.patch, self.kind)
    }
}

fn turned(faces: usize, of: usize, outside: OutsideFrom) -> String {
    if faces == of {
        format!("all {of} faces were wound against {outside} and were turned over")
    } else {
        format!(
            "the winding was not consistent: {faces} of {of} faces were turned over; the outside follows {outside}"
        )
    }
}
