//! Findings: what is wrong with a draft, how severe it is and where, as data; and the input of every check,
//! one sheet and the findings about it.

use std::fmt;

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::skin::sentence::{coincident, count};
use crate::skin::weld::welded_mesh::WeldedMesh;
use crate::skin::weld::winding::Winding;
use crate::skin::{LinkId, Sheet, SkinError};

/// One thing that is wrong with a draft; `Display` makes a sentence of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Name of the sheet; empty if it concerns the whole draft.
    pub patch: String,
    /// What is wrong.
    pub kind: FindingKind,
    /// The elements concerned, numbered as in the sheet.
    pub elements: Elements,
}

/// The elements that a finding is about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Elements {
    /// The whole sheet or draft.
    Whole,
    /// Some vertices.
    Vertices(Vec<VertexId>),
    /// Some faces.
    Faces(Vec<FaceId>),
    /// Some edges, by the vertices at their ends.
    Edges(Vec<[VertexId; 2]>),
    /// Some links.
    Links(Vec<LinkId>),
}

/// How severe a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum Severity {
    /// [`crate::skin::assemble`] refuses the draft.
    Error,
    /// The draft can be assembled, but the result is probably not what was meant.
    Warning,
    /// Nothing is wrong.
    Note,
}

macro_rules! finding_kinds {
    ($n:ident; $($(#[$doc:meta])* $severity:ident $variant:ident $({ $($field:ident: $type:ty),* })? => $text:literal $(, $argument:expr)*;)*) => {
        /// Kinds of findings. `Display` gives the name in words and in JSON, like `non-manifold-edge`.
        #[derive(Debug, Clone, PartialEq, strum::Display)]
        #[strum(serialize_all = "kebab-case")]
        #[non_exhaustive]
        #[expect(missing_docs, reason = "the messages say what the fields are")]
        pub enum FindingKind {
            $($(#[$doc])* $variant $({ $($field: $type),* })?,)*
        }

        impl FindingKind {
            /// How severe it is.
            pub const fn severity(&self) -> Severity {
                match self {
                    $(Self::$variant $({ $($field: _),* })? => Severity::$severity,)*
                }
            }

            /// The sentence about this number of elements.
            fn message(&self, $n: usize) -> String {
                match self {
                    $(Self::$variant $({ $($field),* })? => format!($text $(, $argument)*),)*
                }
            }
        }
    };
}

finding_kinds! { n;
    /// Neither triangles nor taxels.
    Error NoTriangles => "{}", SkinError::NoTriangles;
    /// Taxels without triangles, which assembling joins.
    Note Bare => "its taxels have no triangles: reading it as a skin joins them";
    /// The reason why assembling refuses it, if no other finding is an error.
    Error NoSkin { reason: SkinError } => "{reason}";
    /// Taxels without triangles make several pieces when they are joined.
    Warning BarePieces { patches: Vec<String> } =>
        "when joined, its taxels form {} that share no edge", count(patches.len(), "piece", "pieces");
    /// Taxels without triangles that are left out when others are joined.
    Warning BareLeftOut => "{} left out, used by no triangle", count(n, "taxel is", "taxels are");
    /// A sheet of taxels without triangles that cannot be joined, among others that can.
    Warning BareSheetLeftOut { reason: SkinError } => "left out: {reason}";
    Error LinkOrder => "{}", count(n, "link comes before its parent", "links come before their parents");
    /// A sheet is attached to a link that does not exist.
    Error UnknownLink { link: LinkId, links: usize } =>
        "it is attached to link {link}, but there {}",
        if *links == 1 { "is 1 link".to_owned() } else { format!("are {links} links") };
    /// More vertices or faces than 32-bit numbers count.
    Error TooLarge => "it has more vertices or faces than 32-bit numbers count; nothing else was checked";
    /// A sheet so large that the file is probably not in metres.
    Warning DoubtfulUnit { extent: f64 } => "{}", crate::skin::RemarkKind::DoubtfulUnit { extent: *extent };
    Error ArrayLength { what: &'static str, found: usize, needed: usize } =>
        "the array of {what} has {} for {}; nothing else was checked",
        count(*found, "entry", "entries"), count(*needed, "vertex", "vertices");
    Error NotFinite => "{} a coordinate that is not a number within 1e12 m", count(n, "vertex has", "vertices have");
    /// A face names a vertex that does not exist.
    Error CornerOutOfRange { vertices: usize } =>
        "{} that do not exist; there are {vertices}", count(n, "face names vertices", "faces name vertices");
    Warning RepeatedCorner => "{} one taxel twice", count(n, "face uses", "faces use");
    Error DuplicateFace => "{} the same corners as an earlier face", count(n, "face has", "faces have");
    Warning ZeroAreaFace => "{} no area: {} corners lie on a line", count(n, "face has", "faces have"), its(n);
    /// A face more than fifty times longer than high.
    Warning SliverFace { aspect: f64 } =>
        "{} more than 50 times longer than high, the thinnest {aspect:.0} times", count(n, "face is", "faces are");
    Error NonManifoldEdge { most: usize } => "{} more than two faces, one has {most}; a sheet has one or two",
        count(n, "edge (pair of vertices) has", "edges (pairs of vertices) have");
    /// Several fans of faces touch in a vertex.
    Warning NonManifoldVertex =>
        "at {} several fans of faces touch in a point; the faces around a taxel must form one fan",
        count(n, "vertex", "vertices");
    Error NotOrientable => "a piece is one-sided: at {} its faces cannot be wound consistently",
        count(n, "edge (pair of vertices)", "edges (pairs of vertices)");
    /// Faces are wound against their neighbours.
    Warning InconsistentWinding { of: usize } =>
        "{n} of {} wound against most faces of {} piece", count(*of, "face is", &format!("faces {}", are(n))), its(n);
    /// Faces are wound against the taxels' normals.
    Warning WindingAgainstNormals { of: usize } =>
        "{n} of {} wound against the taxels' normals", count(*of, "face is", &format!("faces {}", are(n)));
    /// A sheet has several components, which share no edge.
    Warning SeveralComponents { least: usize, most: usize } =>
        "it has {n} pieces of {least} to {most} faces that share no edge; listed is the first face of each";
    /// A component without boundary: its map is cut open.
    Note ClosedPatch => "{} no boundary: {} map is cut open along a seam; listed is {}",
        count(n, "piece has", "pieces have"), its(n), first_face(n);
    /// A component with handles: its map is cut open.
    Note Handle { handles: usize } => "{} {}, as a cup has: {} map is cut open along a seam; listed is {}",
        count(n, "piece has", "pieces have"), count(*handles, "handle", "handles"), its(n), first_face(n);
    /// A pin-hole, see [`crate::mesh::FillHoles::PinHoles`].
    Warning PinHole { holes: usize } =>
        "{} in a smooth surface, of at most five edges: faces are missing there; listed are the vertices",
        count(*holes, "pin-hole", "pin-holes");
    /// Two boundaries so close that they look like an unjoined seam.
    Warning Gap { nearest: f64 } =>
        "{} within half the local spacing of a boundary {} not joined with, the nearest at {:.3} mm: a seam that \
          was not closed, or one piece over another",
        count(n, "boundary vertex lies", "boundary vertices lie"), if n == 1 { "it is" } else { "they are" }, 1e3 * nearest;
    Warning IsolatedTaxel { of: usize } =>
        "{n} of {} to no face", count(*of, "taxel belongs", if n == 1 { "taxels belongs" } else { "taxels belong" });
    /// Several taxels at one position.
    Warning DuplicatePosition { distance: f64 } => "{}", coincident(n, *distance);
    Warning DuplicateId { ids: usize } =>
        "{} share {}: readings cannot distinguish them", count(n, "taxel", "taxels"), count(*ids, "id", "ids");
    Warning PlaceholderId => "{} a placeholder id: 0 or {}", count(n, "taxel has", "taxels have"), u32::MAX;
    /// Modules whose taxels have other distances than those of most: no rigid or bent module lies as drawn.
    Warning ModulesNotCongruent { modules: usize, of: usize, most: f64 } =>
        "{modules} of {of} modules {} not congruent with the others: neighbouring taxels are up to {most:.0} % nearer or farther apart, \
          as if a lattice had been stretched over the surface",
        are(*modules);
    Warning NormalNotUnit => "{} a normal that is not a unit vector", count(n, "vertex has", "vertices have");
    Warning UnusableTangent => "{} a tangent that is not a unit vector or is parallel to the normal",
        count(n, "vertex has", "vertices have");
    Warning ConstantNormals => "the normals of {} are all the same although their piece is curved: placeholders",
        count(n, "taxel", "taxels");
    /// Normals that do not agree with the faces.
    Warning UnrelatedNormals => "{} not fit the faces around {}, inward or outward",
        count(n, "normal does", "normals do"), if n == 1 { "it" } else { "them" };
    Warning InwardNormal => "{} inwards, against most normals of {} piece",
        count(n, "normal points", "normals point"), its(n);
    Warning AreaNotPositive => "{} a receptive area that is not positive", count(n, "vertex has", "vertices have");
    Error DensityNotPositive => "{} a density that is not positive", count(n, "vertex has", "vertices have");
    Error WeightUnusable => "{} a weight that is negative or not a number", count(n, "vertex has", "vertices have");
}

/// The possessive of one thing or of several.
const fn its(n: usize) -> &'static str {
    if n == 1 { "its" } else { "their" }
}

const fn first_face(n: usize) -> &'static str {
    if n == 1 { "its first face" } else { "the first face of each" }
}

const fn are(n: usize) -> &'static str {
    if n == 1 { "is" } else { "are" }
}

impl Finding {
    pub(super) fn whole(sheet: &str, kind: FindingKind) -> Self {
        Self { patch: sheet.to_owned(), kind, elements: Elements::Whole }
    }

    /// How severe it is.
    pub const fn severity(&self) -> Severity {
        self.kind.severity()
    }

    /// The finding as a sentence.
    pub fn message(&self) -> String {
        self.kind.message(self.elements.len())
    }
}

impl Elements {
    /// The number of elements.
    pub const fn len(&self) -> usize {
        match self {
            Self::Whole => 0,
            Self::Vertices(vertices) => vertices.len(),
            Self::Faces(faces) => faces.len(),
            Self::Edges(edges) => edges.len(),
            Self::Links(links) => links.len(),
        }
    }

    /// Whether it is the whole sheet or draft.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their numbers, counted from 0; an edge has two, those of its vertices.
    pub fn numbers(&self) -> Vec<u32> {
        match self {
            Self::Whole => Vec::new(),
            Self::Vertices(vertices) => vertices.iter().map(|v| v.raw()).collect(),
            Self::Faces(faces) => faces.iter().map(|f| f.raw()).collect(),
            Self::Edges(edges) => edges.iter().flatten().map(|v| v.raw()).collect(),
            Self::Links(links) => links.iter().map(|link| link.raw()).collect(),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.patch.is_empty() {
            write!(f, "{}: ", self.patch)?;
        }
        write!(f, "{}: {}", self.kind, self.message())
    }
}

/// One sheet, with the data that the checks need.
pub(super) struct Subject<'a> {
    pub sheet: &'a Sheet,
    pub surface: WeldedMesh,
    pub winding: Winding,
    /// Unit normals of the taxels, zero where there is none; `None` without normals.
    pub normals: Option<IdVec<VertexId, DVec3>>,
}

/// The findings of one sheet, at most one of each kind.
pub(super) struct Report<'a> {
    patch: &'a str,
    pub findings: Vec<Finding>,
}

impl<'a> Report<'a> {
    pub(super) fn new(patch: &'a str) -> Self {
        Self { patch, findings: Vec::new() }
    }

    /// Adds a finding, unless its list of elements is empty.
    pub(super) fn add(&mut self, kind: FindingKind, elements: Elements) {
        if elements == Elements::Whole || !elements.is_empty() {
            self.findings.push(Finding { patch: self.patch.to_owned(), kind, elements });
        }
    }

    pub(super) fn add_vertices(&mut self, kind: FindingKind, vertices: impl IntoIterator<Item = VertexId>) {
        self.add(kind, Elements::Vertices(vertices.into_iter().collect()));
    }

    pub(super) fn add_faces(&mut self, kind: FindingKind, faces: impl IntoIterator<Item = FaceId>) {
        self.add(kind, Elements::Faces(faces.into_iter().collect()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_agree_with_the_number_of_elements() {
        let of = |kind: FindingKind, n: usize| {
            let elements = Elements::Vertices((0..n).map(VertexId::new).collect());
            Finding { patch: String::new(), kind, elements }.to_string()
        };
        for (kind, one, two) in [
            (FindingKind::RepeatedCorner, "1 face uses", "2 faces use"),
            (FindingKind::NonManifoldVertex, "at 1 vertex several", "at 2 vertices several"),
            (
                FindingKind::NotOrientable,
                "at 1 edge (pair of vertices) its",
                "at 2 edges (pairs of vertices) its",
            ),
            (FindingKind::InconsistentWinding { of: 3 }, "1 of 3 faces is wound", "2 of 3 faces are wound"),
            (FindingKind::ClosedPatch, "1 piece has no boundary: its", "2 pieces have no boundary: their"),
            (FindingKind::Gap { nearest: 0.0 }, "1 boundary vertex lies", "2 boundary vertices lie"),
            (FindingKind::InwardNormal, "1 normal points", "2 normals point"),
            (FindingKind::IsolatedTaxel { of: 9 }, "1 of 9 taxels belongs to", "2 of 9 taxels belong to"),
            (FindingKind::LinkOrder, "1 link comes before its", "2 links come before their"),
        ] {
            let found = [of(kind.clone(), 1), of(kind, 2)];
            assert!(found[0].contains(one) && found[1].contains(two), "{found:?}");
        }
    }
}
