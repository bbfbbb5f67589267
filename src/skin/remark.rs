//! Remarks: what reading, triangulating and assembling changed, assumed or doubts, as data.

use std::fmt;

use crate::{
    id::{FaceId, VertexId},
    skin::{
        SkinError,
        sentence::{across, coincident, count, edge_list, first_few, length},
    },
};

/// One change or doubt about a sheet or patch; `Display` makes a sentence of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Remark {
    /// Name of the sheet or patch.
    pub patch: String,
    /// What was changed, assumed or doubted.
    pub kind: RemarkKind,
}

/// Adds a remark about some elements, unless there are none.
pub(super) fn note<T>(remarks: &mut Vec<RemarkKind>, about: Vec<T>, kind: impl FnOnce(Vec<T>) -> RemarkKind) {
    if !about.is_empty() {
        remarks.push(kind(about));
    }
}

macro_rules! remark_kinds {
    ($($(#[$doc:meta])* $variant:ident { $($(#[$meaning:meta])* $field:ident: $type:ty,)* } => $text:literal $(, $argument:expr)*;)*) => {
        /// What a [`Remark`] says.
        ///
        /// Vertices and faces are numbered as in the sheet of the draft; after bare taxels were
        /// triangulated, faces are those of the new triangles.
        #[derive(Debug, Clone, PartialEq)]
        #[non_exhaustive]
        pub enum RemarkKind {
            $($(#[$doc])* $variant { $($(#[$meaning])* $field: $type,)* },)*
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
    /// Repair: vertices with equal positions became one taxel.
    Welded {
        /// Vertices of the file.
        vertices: usize,
        /// Taxels they became.
        taxels: usize,
    } => "{vertices} vertices were welded into {}", count(*taxels, "taxel", "taxels");
    /// The file cuts a surface open, and it stays so.
    CutKept {
        /// Edges of the cut.
        edges: usize,
    } => "the file cuts it open along {}; it stays cut, with the vertices of both sides", count(*edges, "edge", "edges");
    /// Repair: faces with the same corners as an earlier one were dropped.
    DuplicatesDropped {
        /// The faces.
        faces: Vec<FaceId>,
    } => "{} dropped, with the same corners as an earlier one: {}", count(faces.len(), "face was", "faces were"), first_few(faces);
    /// Repair: faces were dropped at edges shared by more than two, where the sheets cannot be separated.
    ExtraFacesDropped {
        /// The faces.
        faces: Vec<FaceId>,
    } => "{} dropped at edges shared by more than two faces, where the sheets cannot be separated: {}",
        count(faces.len(), "face was", "faces were"), first_few(faces);
    /// Repair: edges of more than two faces were split into sheets.
    EdgesParted {
        /// Their ends.
        edges: Vec<[VertexId; 2]>,
    } => "{} had more than two faces; those of one solid, or else the two that continue each other most smoothly, stay joined there: {}",
        count(edges.len(), "edge", "edges"), edge_list(edges);
    /// Repair: surfaces with one side only were cut open.
    OneSidedCut {
        /// The ends of the edges of the cuts.
        edges: Vec<[VertexId; 2]>,
    } => "cut open along {}, since it would have one side only: {}", count(edges.len(), "edge", "edges"), edge_list(edges);
    /// Repair: vertices where several fans of faces touched were split.
    FansSplit {
        /// The vertices.
        vertices: Vec<VertexId>,
    } => "at {} several fans of faces touched in a point; each fan has a taxel of its own now: {}",
        count(vertices.len(), "vertex", "vertices"), first_few(vertices);
    /// A patch that is not valid was left out, as was asked for.
    PatchLeftOut {
        /// What is wrong with it.
        reason: SkinError,
    } => "left out: {reason}";
    /// An animation that does more than move links rigidly was left out.
    AnimationLeftOut {
        /// What it does.
        reason: String,
    } => "left out: {reason}";
    /// Repair: taxels that no face uses were left out.
    LeftOut {
        /// The taxels.
        vertices: Vec<VertexId>,
    } => "{} left out, without a place in a triangle: {}", count(vertices.len(), "taxel was", "taxels were"), first_few(vertices);
    /// Repair: a sheet of bare taxels that cannot be triangulated was left out.
    SheetLeftOut {
        /// How many taxels it has.
        taxels: usize,
        /// Why it cannot be triangulated.
        reason: SkinError,
    } => "{} left out: {reason}", count(*taxels, "taxel was", "taxels were");
    /// Repair: faces that use a taxel twice were left out.
    RepeatedCorner {
        /// The faces.
        faces: Vec<FaceId>,
    } => "{} left out, with the same taxel twice: {}", count(faces.len(), "face was", "faces were"), first_few(faces);
    /// Repair: faces without area at the boundary were left out.
    ZeroAreaDropped {
        /// The faces.
        faces: Vec<FaceId>,
    } => "{} left out, without area at the boundary: {}", count(faces.len(), "face was", "faces were"), first_few(faces);
    /// Repair: faces without area inside the patch had their longest edge flipped.
    ZeroAreaFlipped {
        /// The faces.
        faces: Vec<FaceId>,
    } => "{} without area had the longest edge flipped: {}", count(faces.len(), "face", "faces"), first_few(faces);
    /// Warning: faces without area stayed, since dropping or flipping them would make things worse.
    ZeroAreaKept {
        /// The faces.
        faces: Vec<FaceId>,
    } => "{} kept without area, since a slit would open otherwise: {}", count(faces.len(), "face was", "faces were"), first_few(faces);
    /// Repair: faces were turned over.
    Turned {
        /// How many faces were turned over.
        faces: usize,
        /// How many faces the patch has.
        of: usize,
        /// What decided which side is outside.
        outside: OutsideFrom,
    } => "{}", turned(*faces, *of, *outside);
    /// Repair: a sheet became several patches, since its components share no edge.
    Components {
        /// Names of the patches.
        patches: Vec<String>,
    } => "falls into {} pieces that share no edge; they are now {}", patches.len(), first_few(patches);
    /// Repair: a patch got another name, since its own was taken.
    Renamed {
        /// The new name.
        name: String,
    } => "the name is taken; this patch is now {name}";
    /// Repair: normals of some taxels were replaced by those of the faces.
    NormalsReplaced {
        /// How many.
        taxels: usize,
    } => "{} not of unit length or not outwards; that of the faces is used instead", count(*taxels, "normal is", "normals are");
    /// Repair: all normals were replaced by those of the faces.
    NormalsIgnored {
        /// What is wrong with them.
        reason: UnreliableNormals,
    } => "{reason}; those of the faces replace them";
    /// Warning: some normals oppose those of their neighbours.
    NormalsOpposed {
        /// How many.
        opposed: usize,
        /// How many normals there are.
        of: usize,
    } => "{opposed} of {of} normals oppose those of their neighbours; the planes of the neighbourhoods were \
          used instead, and the outside of a component is where two thirds of its normals point";
    /// Repair: tangents of some taxels were replaced by those of their neighbours.
    TangentsReplaced {
        /// How many.
        taxels: usize,
    } => "{} not of unit length or along the normal; the direction of the neighbours is used instead",
        count(*taxels, "tangent is", "tangents are");
    /// Repair: no tangent was used.
    TangentsIgnored {} => "most tangents are not unit vectors or are parallel to the normal; none is used";
    /// Repair: areas that are not positive were replaced by those of the faces.
    AreasReplaced {
        /// The taxels.
        vertices: Vec<VertexId>,
    } => "{} not positive; those of the faces are used instead, at {} {}", count(vertices.len(), "area is", "areas are"),
        if vertices.len() == 1 { "vertex" } else { "vertices" }, first_few(vertices);
    /// Repair: bare taxels were joined by triangles.
    Triangulated {
        /// Taxels joined.
        taxels: usize,
        /// Triangles.
        triangles: usize,
        /// Longest edge allowed, over the spacing of the taxels.
        gap: f64,
        /// The same at the median spacing, in m.
        longest: f64,
    } => "{taxels} bare taxels were joined by {triangles} triangles; edges longer than {gap} times the \
          local spacing, {} at its median, are gaps", length(*longest);
    /// Repair: several taxels at one place became one.
    Merged {
        /// The taxels that were merged with an earlier one.
        vertices: Vec<VertexId>,
        /// The largest distance between merged taxels, in m; 0 where they coincide exactly.
        distance: f64,
    } => "{}; merged with it: {}", coincident(vertices.len(), *distance), first_few(vertices);
    /// Repair: slots without a taxel were left out.
    EmptySlots {
        /// How many.
        slots: usize,
    } => "{} left out", count(*slots, "empty slot was", "empty slots were");
    /// Repair: small holes were filled with triangles.
    HolesFilled {
        /// How many.
        holes: usize,
        /// Longest boundary loop that counts as a hole, in edges.
        max_edges: usize,
    } => "{} of at most {max_edges} edges", count(*holes, "hole was filled,", "holes were filled, each");
    /// Something in the file was ignored; the words are those of its reader.
    PassedOver {
        /// What was ignored.
        what: String,
    } => "{what}";
    /// Warning: no normals tell the outside; it was assumed to be away from the centre of the
    /// sheet.
    OutsideFromCentre {
        /// For how many components.
        components: usize,
    } => "no normals tell the outside; for {} it was assumed to be away from the \
          centre of the part", count(*components, "component", "components");
    /// Warning: neither normals nor curvature tell the outside; a side was chosen.
    OutsideFromAxis {
        /// For how many components.
        components: usize,
    } => "no normals tell the outside, and {} to neither side; of the two \
          sides the one that faces most towards +x, +y or +z was assumed",
        count(*components, "component bulges", "components bulge");
    /// Warning: the skin is so large that the file is probably not in metres.
    DoubtfulUnit {
        /// Longest side of the box around the taxels, without outliers, in m.
        extent: f64,
    } => "it is {} m across: is the file in millimetres? Lengths are read as metres, so divide them by 1000", across(*extent);
}

/// What decided which side of a patch is outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutsideFrom {
    /// The normals of the taxels.
    Normals,
    /// The sign of the enclosed volume.
    ClosedSurface,
    /// The winding of most faces in the file.
    MostFaces,
}

/// Why the normals of a file are not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnreliableNormals {
    /// Most are not unit vectors.
    NotUnit,
    /// All are the same although the surface is not flat, or not perpendicular to them: a
    /// placeholder.
    Constant,
    /// They do not fit the surface.
    Unrelated,
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.patch, self.kind)
    }
}

impl fmt::Display for OutsideFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Normals => "the taxels' normals",
            Self::ClosedSurface => "the closed surface",
            Self::MostFaces => "most of its faces",
        })
    }
}

impl fmt::Display for UnreliableNormals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotUnit => "most normals are not unit vectors",
            Self::Constant => "the normals are all the same although the surface does not face one way",
            Self::Unrelated => "the normals do not fit the surface",
        })
    }
}

/// The words for faces that were turned over.
fn turned(faces: usize, of: usize, outside: OutsideFrom) -> String {
    if faces == of {
        format!("all {of} faces were wound against {outside} and were turned over")
    } else {
        format!(
            "the winding was not consistent: {faces} of {of} faces were turned over; the outside follows {outside}"
        )
    }
}
