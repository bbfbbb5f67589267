//! Findings: kinds, names and what their numbers count.

use std::fmt;

/// Kinds of findings, in the order of the report. `Display` gives the name in words and in JSON, like
/// `non-manifold-edge`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum FindingKind {
    /// Neither triangles nor taxels.
    NoTriangles,
    /// Taxels without triangles, which are meshed when they are read; nothing wrong.
    Bare,
    /// Taxels without triangles that cannot be meshed.
    NoSkin,
    /// Taxels without triangles that fall into pieces, or are left out, when they are meshed.
    BarePieces,
    /// A link comes before its parent.
    LinkOrder,
    /// A sheet hangs on a link that does not exist.
    UnknownLink,
    /// More than 32-bit numbers count.
    TooLarge,
    /// A sheet so large that the file is hardly in metres.
    DoubtfulUnit,
    /// An array has not one entry per vertex.
    ArrayLength,
    /// A position is NaN or infinite.
    NotFinite,
    /// A face names a vertex that does not exist.
    CornerOutOfRange,
    /// A face uses one taxel twice.
    RepeatedCorner,
    /// Several faces have the same three corners.
    DuplicateFace,
    /// A face whose corners lie on a line.
    ZeroAreaFace,
    /// A face more than fifty times longer than high.
    SliverFace,
    /// More than two faces meet at an edge.
    NonManifoldEdge,
    /// Several fans of faces touch in a vertex.
    NonManifoldVertex,
    /// A piece has one side only.
    NotOrientable,
    /// Faces are wound against their neighbours.
    InconsistentWinding,
    /// Faces are wound against the taxels' normals.
    WindingAgainstNormals,
    /// A sheet has several components, which share no edge.
    SeveralComponents,
    /// A piece without boundary: it must be cut before it can be flattened.
    ClosedPatch,
    /// A piece with handles: it must be cut before it can be flattened.
    Handle,
    /// A hole of three or four edges.
    PinHole,
    /// Two boundaries so close that they look like an unjoined seam.
    Gap,
    /// A taxel without a face.
    IsolatedTaxel,
    /// Several taxels at one place.
    DuplicatePosition,
    /// Several taxels with one id.
    DuplicateId,
    /// Several taxels with a placeholder id.
    PlaceholderId,
    /// A normal that is not a unit vector.
    NormalNotUnit,
    /// A tangent that is not a unit vector, or is parallel to the normal.
    UnusableTangent,
    /// Normals that are all the same on a curved piece.
    ConstantNormals,
    /// Normals that have nothing to do with the faces.
    UnrelatedNormals,
    /// A normal that points to the inside.
    InwardNormal,
    /// A receptive area that is not positive.
    AreaNotPositive,
    /// A density that is not positive.
    DensityNotPositive,
    /// A weight that is negative or not a number, or weights that are all zero.
    WeightUnusable,
}

impl FindingKind {
    /// What [`Finding::elements`] counts: `vertices`, `faces`, `edges` (two numbers each, their
    /// vertices) or `links`; empty if the finding is about the whole sheet.
    #[must_use]
    pub const fn elements(self) -> &'static str {
        match self {
            Self::NoTriangles
            | Self::Bare
            | Self::NoSkin
            | Self::BarePieces
            | Self::UnknownLink
            | Self::TooLarge
            | Self::DoubtfulUnit
            | Self::ArrayLength => "",
            Self::LinkOrder => "links",
            Self::NonManifoldEdge | Self::NotOrientable => "edges",
            Self::CornerOutOfRange
            | Self::RepeatedCorner
            | Self::DuplicateFace
            | Self::ZeroAreaFace
            | Self::SliverFace
            | Self::InconsistentWinding
            | Self::WindingAgainstNormals
            | Self::SeveralComponents
            | Self::ClosedPatch
            | Self::Handle => "faces",
            _ => "vertices",
        }
    }
}

/// The name of the variant with hyphens between its words.
impl fmt::Display for FindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut name = String::new();
        for c in format!("{self:?}").chars() {
            if c.is_ascii_uppercase() && !name.is_empty() {
                name.push('-');
            }
            name.push(c.to_ascii_lowercase());
        }
        f.write_str(&name)
    }
}

/// One thing that is wrong with a draft.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// What kind of thing.
    pub kind: FindingKind,
    /// Name of the sheet; empty if it concerns the whole draft.
    pub patch: String,
    /// The elements concerned, as the file numbers them from 0; [`FindingKind::elements`] says what
    /// they count.
    pub elements: Vec<u64>,
    /// A sentence that says what was found.
    pub message: String,
}

impl Finding {
    pub(super) fn of_sheet(kind: FindingKind, sheet: &str, message: String) -> Self {
        Self { kind, patch: sheet.to_owned(), elements: Vec::new(), message }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, patch, message, .. } = self;
        if patch.is_empty() {
            write!(f, "{kind}: {message}")
        } else {
            write!(f, "{patch}: {kind}: {message}")
        }
    }
}
