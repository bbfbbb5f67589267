//! Why observations cannot be used, or give no skin.

use crate::{
    calib::{ContactObservationId, DisplacementId, Model, ObservationId},
    id::VertexId,
    skin::{SkinError, TaxelId},
    sparse::SparseError,
};

/// Why observations cannot be used, or give no skin.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum CalibError {
    /// No taxel or no observation.
    #[error("there are {taxels} taxels and {observations} observations; at least one of each is needed")]
    Empty { taxels: usize, observations: usize },
    /// Two taxels have the same id.
    #[error("taxel {id} is declared twice")]
    DuplicateTaxel { id: TaxelId },
    /// An edge or contact names a taxel that does not exist.
    #[error("{observation} names vertex {vertex}, but there are {taxels} taxels")]
    Dangling { observation: ObservationId, vertex: VertexId, taxels: usize },
    /// An edge joins a taxel to itself.
    #[error("edge {edge} joins taxel {id} to itself")]
    SelfEdge { edge: DisplacementId, id: TaxelId },
    /// A number of an edge is not finite, or its quaternion is not a rotation.
    #[error(
        "edge {edge} ({from} to {to}) holds a number that is not finite or a quaternion that is not of unit length"
    )]
    InvalidEdge { edge: DisplacementId, from: TaxelId, to: TaxelId },
    /// The information matrix of an edge is not positive semi-definite.
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
    /// A contact holds a number that is not finite, a normal without direction, or indefinite
    /// information.
    #[error("contact {contact} of taxel {id} is not valid: {reason}")]
    InvalidContact { contact: ContactObservationId, id: TaxelId, reason: &'static str },
    /// An edge or contact does not fit the model: rotations without poses, or the other way round.
    #[error("{observation} of taxel {id} does not fit the {model} model: {needed}")]
    WrongModel { observation: ObservationId, id: TaxelId, model: Model, needed: &'static str },
    /// A taxel that no observation mentions.
    #[error("{} taxels are in no observation, first taxel {id}", others + 1)]
    Unobserved { id: TaxelId, others: usize },
    /// The observations do not determine the pose of a taxel.
    #[error(
        "the observations do not determine how taxel {id} lies, or their information differs by more than 13 digits"
    )]
    Undetermined { id: TaxelId },
    /// There is not one pose for every true one, or none.
    #[error("{found} poses are compared with {needed} true ones; needed: the same number, and at least one")]
    UnequalPoses { found: usize, needed: usize },
    /// There are no initial values to start from.
    #[error("taxel {id} has no initial value to start from")]
    NoInitialValue { id: TaxelId },
    /// A taxel is fixed, but has no pose.
    #[error("taxel {id} is fixed, but has no initial value to be fixed at")]
    FixedNowhere { id: TaxelId },
    /// An initial value is not a pose.
    #[error(
        "the initial value of taxel {id} holds a number that is not finite or a quaternion that is not of unit length"
    )]
    InvalidInitial { id: TaxelId },
    /// An option is out of its range.
    #[error("{option} is {}; needed: {needed}", plain(*.found))]
    BadOption {
        /// The option, with its unit.
        option: &'static str,
        found: f64,
        needed: &'static str,
    },
    /// The given triangles are not a surface.
    #[error("the triangles are not an oriented surface: {0}")]
    BadTriangles(SheetDefect),
    /// The edges between the taxels are not those of a triangulation, and no triangles were given.
    #[error("{0}: the edges are not those of a triangulated sheet")]
    NoTriangulation(SheetDefect),
    /// The linear system cannot be solved, for another reason than an undetermined taxel.
    #[error(transparent)]
    Sparse(SparseError),
}

/// What keeps triangles between taxels from being a sheet.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum SheetDefect {
    /// There is no triangle.
    #[error("no three taxels are joined")]
    Empty,
    /// A triangle names a taxel that does not exist.
    #[error("a triangle names vertex {vertex} of {taxels} taxels")]
    Dangling { vertex: VertexId, taxels: usize },
    /// An edge of more than two triangles.
    #[error("more than two triangles meet at the edge between taxels {} and {}", .edge[0], .edge[1])]
    NonManifoldEdge { edge: [TaxelId; 2] },
    /// A surface with one side.
    #[error("the triangles around taxels {} and {} have only one side", .edge[0], .edge[1])]
    OneSided { edge: [TaxelId; 2] },
    /// Triangles of one taxel that share no edges.
    #[error("the triangles around taxel {id} do not form one fan")]
    SeveralFans { id: TaxelId },
    /// Edges that form a closed surface: which of the triangles is the boundary, they do not show.
    #[error("the triangles around taxel {id} close up")]
    Closed { id: TaxelId },
    /// Another reason.
    #[error(transparent)]
    Skin(Box<SkinError>),
}

/// A number with few digits: whole numbers as they are, very small and large ones with an exponent.
fn plain(x: f64) -> String {
    if x.fract() == 0.0 && x.abs() < 1e15 { format!("{x}") } else { format!("{x:?}") }
}
