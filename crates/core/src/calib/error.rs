//! Why observations cannot be used or do not give a skin.

use crate::calib::{ContactObservationId, DisplacementId, Model, ObservationId};
use crate::id::VertexId;
use crate::skin::{SkinError, TaxelId};
use crate::sparse::SparseError;

/// Why observations cannot be used or do not give a skin.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum CalibError {
    #[error(transparent)]
    Cancelled(#[from] crate::run::Cancelled),
    #[error("there are {taxels} taxels and {observations} observations; at least one of each is needed")]
    Empty { taxels: usize, observations: usize },
    #[error("taxel {id} is declared twice")]
    DuplicateTaxel { id: TaxelId },
    #[error("{observation} names vertex {vertex}, but there are {taxels} taxels")]
    Dangling { observation: ObservationId, vertex: VertexId, taxels: usize },
    #[error("edge {edge} joins taxel {id} to itself")]
    SelfEdge { edge: DisplacementId, id: TaxelId },
    #[error(
        "edge {edge} ({from} to {to}) contains a number that is not finite, a length above 1e12 m or a quaternion that is not of unit length"
    )]
    InvalidEdge { edge: DisplacementId, from: TaxelId, to: TaxelId },
    #[error(
        "the information matrix of edge {edge} ({from} to {to}) has the eigenvalue {eigenvalue:e}; none may be negative; \
         that of {count} of {of} edges is"
    )]
    IndefiniteEdge {
        edge: DisplacementId,
        from: TaxelId,
        to: TaxelId,
        eigenvalue: f64,
        count: usize,
        of: usize,
    },
    #[error("the information matrix of edge {edge} ({from} to {to}) is not symmetric")]
    AsymmetricEdge { edge: DisplacementId, from: TaxelId, to: TaxelId },
    /// A contact has a number that is not finite, a normal without direction, or information that is indefinite or
    /// not symmetric.
    #[error("contact {contact} of taxel {id} is not valid: {reason}")]
    InvalidContact { contact: ContactObservationId, id: TaxelId, reason: &'static str },
    #[error("there are {found} touches of {needed} contacts; needed: one for each, or none")]
    UnequalTouches { found: usize, needed: usize },
    #[error(
        "observations of poses cannot be followed touch by touch; needed: displacements or contacts of positions"
    )]
    FollowedPoses,
    #[error(
        "the stated noise of the touches and the tolerances of the bodies differ by more than 13 digits; needed: a larger noise, or smaller tolerances"
    )]
    UnlikeTolerances,
    #[error(
        "the drawing has patches on several links; needed: the skin of one link, in whose frame the touches are"
    )]
    CadOnSeveralLinks,
    #[error(
        "patch {patch} of the drawing has no ids of taxels; needed: ids, by which touches name the taxels that feel them"
    )]
    CadWithoutIds { patch: String },
    #[error("taxel {id} of the drawing has no module; needed: one for each taxel")]
    NoModule { id: TaxelId },
    #[error("the modules of the drawing are its pieces, but {0}")]
    CadPieces(Box<SkinError>),
    #[error("the drawing has no taxel; needed: at least one")]
    EmptyCad,
    #[error(
        "taxel {id} of the drawing contains a number that is not finite, a length above 1e12 m or a normal that is not of unit length"
    )]
    InvalidCadTaxel { id: TaxelId },
    #[error("taxel {id}, vertex {vertex} of the drawing, is on a module or patch that does not exist")]
    UnknownModule { id: TaxelId, vertex: VertexId },
    #[error("module {name} of the drawing has no taxel")]
    EmptyModule { name: String },
    #[error("row {} of the contacts is of taxel {id}, which the drawing does not have", contact.index() + 1)]
    NotInCad { contact: ContactObservationId, id: TaxelId },
    #[error(
        "row {} of the contacts, of taxel {id}, has no orientation of the probe (qx,qy,qz,qw), without which its offset cannot be fitted",
        contact.index() + 1
    )]
    NoProbeOrientation { contact: ContactObservationId, id: TaxelId },
    #[error(
        "row {} of the contacts, of taxel {id}, does not say how the touch moves with each joint (dx:NAME,dy:NAME,dz:NAME), without which offsets of joints cannot be fitted",
        contact.index() + 1
    )]
    NoJointColumns { contact: ContactObservationId, id: TaxelId },
    #[error(
        "rows {} and {} of the contacts are of one touch, but repeat different contacts",
        first.index() + 1,
        contact.index() + 1
    )]
    TouchInTwoContacts { contact: ContactObservationId, first: ContactObservationId },
    #[error(
        "rows {} and following of the contacts are of one touch, and row {} has its taxel {id} once more; needed: another number for \
         each touch, also in a further log",
        first.index() + 1,
        contact.index() + 1
    )]
    TaxelTwiceInTouch { contact: ContactObservationId, first: ContactObservationId, id: TaxelId },
    #[error(
        "row {} of the contacts has the centre of a body without its radius, as {count} touches, and others have several radii; needed: \
         the radius of each",
        contact.index() + 1
    )]
    NoRadius { contact: ContactObservationId, count: usize },
    /// An edge or contact does not fit the model: rotations without poses, or poses without rotations.
    #[error("{observation} of taxel {id} does not fit the {model} model: {needed}")]
    WrongModel { observation: ObservationId, id: TaxelId, model: Model, needed: &'static str },
    #[error("{} taxels are in no observation, first taxel {id}", others + 1)]
    Unobserved { id: TaxelId, others: usize },
    #[error(
        "the observations do not determine the pose of taxel {id}, or their information differs by more than 13 digits"
    )]
    Undetermined { id: TaxelId },
    #[error("{found} poses are compared with {needed} true ones; needed: the same number, and at least one")]
    UnequalPoses { found: usize, needed: usize },
    #[error("taxel {id} has no initial value to start from")]
    NoInitialValue { id: TaxelId },
    #[error("taxel {id} is fixed, but has no initial value to be fixed at")]
    FixedNowhere { id: TaxelId },
    #[error(
        "the initial value of taxel {id} contains a number that is not finite, a length above 1e12 m or a quaternion that is not of unit length"
    )]
    InvalidInitial { id: TaxelId },
    #[error("{option} is {}; needed: {needed}", plain(*.found))]
    BadOption {
        /// The option, with its unit.
        option: &'static str,
        found: f64,
        needed: &'static str,
    },
    #[error("the triangles are not an oriented surface: {0}")]
    BadTriangles(SheetDefect),
    #[error("{0}: the edges are not those of a triangulated sheet")]
    NoTriangulation(SheetDefect),
    /// The linear system cannot be solved, for another reason than an undetermined taxel.
    #[error(transparent)]
    Sparse(SparseError),
}

/// Why triangles between taxels are not a sheet.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum SheetDefect {
    #[error("no three taxels are joined")]
    Empty,
    #[error("a triangle names vertex {vertex} of {taxels} taxels")]
    Dangling { vertex: VertexId, taxels: usize },
    #[error("more than two triangles meet at the edge between taxels {} and {}", .edge[0], .edge[1])]
    NonManifoldEdge { edge: [TaxelId; 2] },
    #[error("the triangles around taxels {} and {} have only one side", .edge[0], .edge[1])]
    OneSided { edge: [TaxelId; 2] },
    #[error("the triangles around taxel {id} do not form one fan")]
    SeveralFans { id: TaxelId },
    /// Edges that form a closed surface: they do not determine which of the triangles is the boundary.
    #[error("the triangles around taxel {id} close up")]
    Closed { id: TaxelId },
    #[error(transparent)]
    Skin(Box<SkinError>),
}

/// A number with few digits: integers without a point, very small and large numbers with an exponent.
fn plain(x: f64) -> String {
    if x.fract() == 0.0 && x.abs() < 1e15 { format!("{x}") } else { format!("{x:?}") }
}
