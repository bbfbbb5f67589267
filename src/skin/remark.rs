//! Remarks: what reading, triangulating and assembling changed, assumed or doubts, as data.

use std::fmt;

use crate::{
    id::{FaceId, VertexId},
    skin::SkinError,
};

/// One change or doubt about a sheet or patch; `Display` makes a sentence of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Remark {
    /// Name of the sheet or patch.
    pub patch: String,
    /// What was changed, assumed or doubted.
    pub kind: RemarkKind,
}

/// What a [`Remark`] says.
///
/// Vertices and faces are numbered as in the sheet of the draft; after bare taxels were
/// triangulated, faces are those of the new triangles.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum RemarkKind {
    /// Repair: vertices with equal positions became one taxel.
    Welded {
        /// Vertices of the file.
        vertices: usize,
        /// Taxels they became.
        taxels: usize,
    },
    /// Repair: taxels that no face uses were left out.
    LeftOut {
        /// The taxels.
        vertices: Vec<VertexId>,
    },
    /// Repair: a sheet of bare taxels that cannot be triangulated was left out.
    SheetLeftOut {
        /// How many taxels it has.
        taxels: usize,
        /// Why it cannot be triangulated.
        reason: SkinError,
    },
    /// Repair: faces that use a taxel twice were left out.
    RepeatedCorner {
        /// The faces.
        faces: Vec<FaceId>,
    },
    /// Repair: faces without area at the boundary were left out.
    ZeroAreaDropped {
        /// The faces.
        faces: Vec<FaceId>,
    },
    /// Repair: faces without area inside the patch had their longest edge flipped.
    ZeroAreaFlipped {
        /// The faces.
        faces: Vec<FaceId>,
    },
    /// Warning: faces without area stayed, since dropping or flipping them would make things worse.
    ZeroAreaKept {
        /// The faces.
        faces: Vec<FaceId>,
    },
    /// Repair: faces were turned over.
    Turned {
        /// How many faces were turned over.
        faces: usize,
        /// How many faces the patch has.
        of: usize,
        /// What decided which side is outside.
        outside: OutsideFrom,
    },
    /// Repair: a sheet became several patches, since its components share no edge.
    Components {
        /// Names of the patches.
        patches: Vec<String>,
    },
    /// Repair: a patch got another name, since its own was taken.
    Renamed {
        /// The new name.
        name: String,
    },
    /// Repair: normals of some taxels were replaced by those of the faces.
    NormalsReplaced {
        /// How many.
        taxels: usize,
    },
    /// Repair: all normals were replaced by those of the faces.
    NormalsIgnored {
        /// What is wrong with them.
        reason: UnreliableNormals,
    },
    /// Warning: some normals oppose those of their neighbours.
    NormalsOpposed {
        /// How many.
        opposed: usize,
        /// How many normals there are.
        of: usize,
    },
    /// Repair: areas that are not positive were replaced by those of the faces.
    AreasReplaced {
        /// The taxels.
        vertices: Vec<VertexId>,
    },
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
    },
    /// Repair: several taxels at one place became one.
    Merged {
        /// The taxels that were merged with an earlier one.
        vertices: Vec<VertexId>,
        /// The largest distance between merged taxels, in m; 0 where they coincide exactly.
        distance: f64,
    },
    /// Repair: slots without a taxel were left out.
    EmptySlots {
        /// How many.
        slots: usize,
    },
    /// Repair: small holes were filled with triangles.
    HolesFilled {
        /// How many.
        holes: usize,
        /// Longest boundary loop that counts as a hole, in edges.
        max_edges: usize,
    },
    /// Something in the file was ignored; the words are those of its reader.
    PassedOver {
        /// What was ignored.
        what: String,
    },
    /// Warning: no normals tell the outside; it was assumed to be away from the centre of the
    /// sheet.
    OutsideFromCentre {
        /// For how many components.
        components: usize,
    },
    /// Warning: neither normals nor curvature tell the outside; a side was chosen.
    OutsideFromAxis {
        /// For how many components.
        components: usize,
    },
    /// Warning: the skin is so large that the file is probably not in metres.
    DoubtfulUnit {
        /// Longest side of the box around the taxels, without outliers, in m.
        extent: f64,
    },
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

impl fmt::Display for RemarkKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Welded { vertices, taxels } => {
                write!(f, "{vertices} vertices were welded into {taxels} taxels")
            }
            Self::LeftOut { vertices } => {
                let list = first_few(vertices);
                write!(f, "{} taxels found no place in a triangle and were left out: {list}", vertices.len())
            }
            Self::SheetLeftOut { taxels, reason } => write!(f, "{taxels} taxels were left out: {reason}"),
            Self::RepeatedCorner { faces } => {
                write!(f, "{} faces use a taxel twice and were left out: {}", faces.len(), first_few(faces))
            }
            Self::ZeroAreaDropped { faces } => {
                let list = first_few(faces);
                write!(f, "{} faces without area at the boundary were left out: {list}", faces.len())
            }
            Self::ZeroAreaFlipped { faces } => {
                let list = first_few(faces);
                write!(f, "{} faces without area had their longest edge flipped: {list}", faces.len())
            }
            Self::ZeroAreaKept { faces } => {
                let list = first_few(faces);
                write!(
                    f,
                    "{} faces without area were kept, since leaving them out would open a slit: {list}",
                    faces.len()
                )
            }
            Self::Turned { faces, of, outside } if faces == of => {
                write!(f, "all {of} faces were wound against {outside} and were turned over")
            }
            Self::Turned { faces, of, outside } => write!(
                f,
                "the winding was not consistent: {faces} of {of} faces were turned over; the outside follows {outside}"
            ),
            Self::Components { patches } => {
                let list = first_few(patches);
                write!(f, "falls into {} pieces that share no edge; they are now {list}", patches.len())
            }
            Self::Renamed { name } => write!(f, "the name is taken; this patch is now {name}"),
            Self::NormalsReplaced { taxels } => write!(
                f,
                "{taxels} normals are not unit vectors or point inwards; those of the faces replace them"
            ),
            Self::NormalsIgnored { reason } => write!(f, "{reason}; those of the faces replace them"),
            Self::NormalsOpposed { opposed, of } => write!(
                f,
                "{opposed} of {of} normals oppose those of their neighbours; the planes of the neighbourhoods were \
                 used instead, and the outside of a component is where two thirds of its normals point"
            ),
            Self::AreasReplaced { vertices } => {
                let list = first_few(vertices);
                write!(
                    f,
                    "{} areas are not positive; those of the faces replace them: vertices {list}",
                    vertices.len()
                )
            }
            Self::Triangulated { taxels, triangles, gap, longest } => write!(
                f,
                "{taxels} bare taxels were joined by {triangles} triangles; edges longer than {gap} times the \
                 spacing, here {}, are gaps",
                length(*longest)
            ),
            Self::Merged { vertices, distance } => {
                let list = first_few(vertices);
                write!(
                    f,
                    "{} and were merged with it: {list}",
                    Coincident { taxels: vertices.len(), distance: *distance }
                )
            }
            Self::EmptySlots { slots } => write!(f, "{slots} empty slots were left out"),
            Self::HolesFilled { holes, max_edges } => {
                write!(f, "{holes} holes of at most {max_edges} edges were filled")
            }
            Self::PassedOver { what } => f.write_str(what),
            Self::OutsideFromCentre { components } => write!(
                f,
                "no normals tell the outside; for {components} components it was assumed to be away from the \
                 centre of the part"
            ),
            Self::OutsideFromAxis { components } => write!(
                f,
                "no normals tell the outside, and {components} components bulge to neither side; of their two \
                 sides the one that faces most towards +x, +y or +z was assumed"
            ),
            Self::DoubtfulUnit { extent } => {
                // CAD and scanners write such files in millimetres.
                let size = if *extent < 1e5 { format!("{extent:.0}") } else { format!("{extent:.0e}") };
                write!(
                    f,
                    "it is {size} m across: is the file in millimetres? Lengths are read as metres, so divide them by 1000"
                )
            }
        }
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

/// The words for taxels at one place, as a remark and as a finding.
pub(super) struct Coincident {
    pub taxels: usize,
    /// Largest distance, in m.
    pub distance: f64,
}

impl fmt::Display for Coincident {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { taxels, distance } = self;
        write!(f, "{taxels} taxels lie where another one lies")?;
        if *distance > 0.0 { write!(f, " (up to {distance:.1e} m beside it)") } else { Ok(()) }
    }
}

/// A length in m, in mm where that is readable.
fn length(metres: f64) -> String {
    if (1e-6..1e3).contains(&metres) { format!("{:.3} mm", 1e3 * metres) } else { format!("{metres:.3e} m") }
}

/// `1, 5, 9 and 4 more`: the first few of a list, for a sentence.
fn first_few<T: fmt::Display>(items: &[T]) -> String {
    /// Enough to find the place in the file; a terminal line holds no more.
    const SHOWN: usize = 8;
    let shown: Vec<String> = items.iter().take(SHOWN).map(ToString::to_string).collect();
    let rest = items.len() - shown.len();
    if rest == 0 { shown.join(", ") } else { format!("{} and {rest} more", shown.join(", ")) }
}
