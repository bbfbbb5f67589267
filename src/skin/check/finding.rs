//! Findings: kinds, names and what their numbers count.

use std::fmt;

macro_rules! kinds {
    ($($(#[$doc:meta])* $variant:ident $name:literal $element:ident,)*) => {
        /// Kinds of findings, in the order of the report.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[non_exhaustive]
        pub enum FindingKind {
            $($(#[$doc])* $variant,)*
        }

        impl FindingKind {
            /// Every kind.
            pub const ALL: &[Self] = &[$(Self::$variant),*];

            /// Its name in words and in JSON, like `non-manifold-edge`.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// Whether it only tells something, and nothing is wrong.
            #[must_use]
            pub const fn is_informational(self) -> bool {
                matches!(self, Self::Bare)
            }

            /// What [`Finding::elements`] counts.
            #[must_use]
            pub const fn element(self) -> Element {
                match self { $(Self::$variant => Element::$element,)* }
            }
        }
    };
}

kinds! {
    /// Neither triangles nor taxels.
    NoTriangles "no-triangles" Sheet,
    /// Taxels without triangles, which are meshed when they are read; nothing wrong.
    Bare "bare" Sheet,
    /// Taxels without triangles that cannot be meshed.
    NoSkin "no-skin" Sheet,
    /// Taxels without triangles that fall into pieces, or are left out, when they are meshed.
    BarePieces "bare-pieces" Sheet,
    /// A link comes before its parent.
    LinkOrder "link-order" Link,
    /// A sheet hangs on a link that does not exist.
    UnknownLink "unknown-link" Sheet,
    /// More than 32-bit numbers count.
    TooLarge "too-large" Sheet,
    /// A sheet so large that the file is hardly in metres.
    DoubtfulUnit "doubtful-unit" Sheet,
    /// An array has not one entry per vertex.
    ArrayLength "array-length" Sheet,
    /// A position is NaN or infinite.
    NotFinite "not-finite" Vertex,
    /// A face names a vertex that does not exist.
    CornerOutOfRange "corner-out-of-range" Face,
    /// A face uses one taxel twice.
    RepeatedCorner "repeated-corner" Face,
    /// Several faces have the same three corners.
    DuplicateFace "duplicate-face" Face,
    /// A face whose corners lie on a line.
    ZeroAreaFace "zero-area-face" Face,
    /// A face more than fifty times longer than high.
    SliverFace "sliver-face" Face,
    /// More than two faces meet at an edge.
    NonManifoldEdge "non-manifold-edge" Edge,
    /// Several fans of faces touch in a vertex.
    NonManifoldVertex "non-manifold-vertex" Vertex,
    /// A piece has one side only.
    NotOrientable "not-orientable" Edge,
    /// Faces are wound against their neighbours.
    InconsistentWinding "inconsistent-winding" Face,
    /// Faces are wound against the taxels' normals.
    WindingAgainstNormals "winding-against-normals" Face,
    /// A sheet has several components, which share no edge.
    SeveralComponents "several-components" Face,
    /// A piece without boundary: it must be cut before it can be flattened.
    ClosedPatch "closed-patch" Face,
    /// A piece with handles: it must be cut before it can be flattened.
    Handle "handle" Face,
    /// A hole of three or four edges.
    PinHole "pin-hole" Vertex,
    /// Two boundaries so close that they look like an unjoined seam.
    Gap "gap" Vertex,
    /// A taxel without a face.
    IsolatedTaxel "isolated-taxel" Vertex,
    /// Several taxels at one place.
    DuplicatePosition "duplicate-position" Vertex,
    /// Several taxels with one id.
    DuplicateId "duplicate-id" Vertex,
    /// Several taxels with a placeholder id.
    PlaceholderId "placeholder-id" Vertex,
    /// A normal that is not a unit vector.
    NormalNotUnit "normal-not-unit" Vertex,
    /// Normals that are all the same on a curved piece.
    ConstantNormals "constant-normals" Vertex,
    /// Normals that have nothing to do with the faces.
    UnrelatedNormals "unrelated-normals" Vertex,
    /// A normal that points to the inside.
    InwardNormal "inward-normal" Vertex,
    /// A receptive area that is not positive.
    AreaNotPositive "area-not-positive" Vertex,
    /// A density that is not positive.
    DensityNotPositive "density-not-positive" Vertex,
}

impl fmt::Display for FindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What the numbers of a [`Finding`] count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Element {
    /// Nothing: the finding is about the whole sheet.
    Sheet,
    /// Links.
    Link,
    /// Vertices.
    Vertex,
    /// Faces.
    Face,
    /// Edges; two numbers each, their vertices.
    Edge,
}

/// One thing that is wrong with a draft.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// What kind of thing.
    pub kind: FindingKind,
    /// Name of the sheet; empty if it concerns the whole draft.
    pub patch: String,
    /// The elements concerned, as the file numbers them from 0; [`FindingKind::element`] says what
    /// they count.
    pub elements: Vec<u64>,
    /// A sentence that says what was found.
    pub message: String,
}

impl Finding {
    /// About a whole sheet.
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
