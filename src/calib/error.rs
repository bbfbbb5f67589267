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
pub enum CalibError {
    /// No taxel or no observation.
    #[error("there are {taxels} taxels and {observations} observations; at least one of each is needed")]
    Empty {
        /// Number of taxels.
        taxels: usize,
        /// Number of edges and contacts.
        observations: usize,
    },
    /// Two taxels have the same id.
    #[error("taxel {id} is declared twice")]
    DuplicateTaxel {
        /// The id.
        id: TaxelId,
    },
    /// An edge or contact names a taxel that does not exist.
    #[error("{observation} names vertex {vertex}, but there are {taxels} taxels")]
    Dangling {
        /// The edge or contact.
        observation: ObservationId,
        /// The vertex it names.
        vertex: VertexId,
        /// How many taxels there are.
        taxels: usize,
    },
    /// An edge joins a taxel to itself.
    #[error("edge {edge} joins taxel {id} to itself")]
    SelfEdge {
        /// The edge.
        edge: DisplacementId,
        /// The taxel.
        id: TaxelId,
    },
    /// A number of an edge is not finite, or its quaternion is not a rotation.
    #[error(
        "edge {edge} ({from} to {to}) holds a number that is not finite or a quaternion that is not of unit length"
    )]
    InvalidEdge {
        /// The edge.
        edge: DisplacementId,
        /// Its first taxel.
        from: TaxelId,
        /// Its second taxel.
        to: TaxelId,
    },
    /// The information matrix of an edge is not positive semi-definite.
    #[error(
        "the information matrix of edge {edge} ({from} to {to}) has the eigenvalue {eigenvalue:e}; none may be negative; \
         that of {count} of {of} edges is"
    )]
    IndefiniteEdge {
        /// The edge.
        edge: DisplacementId,
        /// Its first taxel.
        from: TaxelId,
        /// Its second taxel.
        to: TaxelId,
        /// The smallest eigenvalue.
        eigenvalue: f64,
        /// How many edges have such information.
        count: usize,
        /// How many edges there are.
        of: usize,
    },
    /// A contact holds a number that is not finite, a normal without direction, or indefinite
    /// information.
    #[error("contact {contact} of taxel {id} is not valid: {reason}")]
    InvalidContact {
        /// The contact.
        contact: ContactObservationId,
        /// The taxel.
        id: TaxelId,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// An edge or contact does not fit the model: rotations without poses, or the other way round.
    #[error("{observation} of taxel {id} does not fit the {model} model: {needed}")]
    WrongModel {
        /// The edge or contact.
        observation: ObservationId,
        /// The taxel.
        id: TaxelId,
        /// The model of the observations.
        model: Model,
        /// What is needed instead.
        needed: &'static str,
    },
    /// A taxel that no observation mentions.
    #[error("{} taxels are in no observation, first taxel {id}", others + 1)]
    Unobserved {
        /// The first such taxel.
        id: TaxelId,
        /// How many more there are.
        others: usize,
    },
    /// The observations do not determine the pose of a taxel.
    #[error(
        "the observations do not determine how taxel {id} lies, or their information differs by more than 13 digits"
    )]
    Undetermined {
        /// The taxel.
        id: TaxelId,
    },
    /// There is not one pose for every true one, or none.
    #[error("{found} poses are compared with {needed} true ones; needed: the same number, and at least one")]
    UnequalPoses {
        /// Poses given.
        found: usize,
        /// True poses.
        needed: usize,
    },
    /// There are no initial values to start from.
    #[error("taxel {id} has no initial value to start from")]
    NoInitialValue {
        /// The first taxel without.
        id: TaxelId,
    },
    /// A taxel is fixed, but has no pose.
    #[error("taxel {id} is fixed, but has no initial value to be fixed at")]
    FixedNowhere {
        /// The taxel.
        id: TaxelId,
    },
    /// An initial value is not a pose.
    #[error(
        "the initial value of taxel {id} holds a number that is not finite or a quaternion that is not of unit length"
    )]
    InvalidInitial {
        /// The taxel.
        id: TaxelId,
    },
    /// An option is out of its range.
    #[error("{option} is {}; needed: {needed}", plain(*.found))]
    BadOption {
        /// The option, with its unit.
        option: &'static str,
        /// What was given.
        found: f64,
        /// What is needed.
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
pub enum SheetDefect {
    /// There is no triangle.
    #[error("no three taxels are joined")]
    Empty,
    /// A triangle names a taxel that does not exist.
    #[error("a triangle names vertex {vertex} of {taxels} taxels")]
    Dangling {
        /// The vertex it names.
        vertex: VertexId,
        /// How many taxels there are.
        taxels: usize,
    },
    /// An edge of more than two triangles.
    #[error("more than two triangles meet at the edge between taxels {} and {}", .edge[0], .edge[1])]
    NonManifoldEdge {
        /// Its taxels.
        edge: [TaxelId; 2],
    },
    /// A surface with one side.
    #[error("the triangles around taxels {} and {} have only one side", .edge[0], .edge[1])]
    OneSided {
        /// The taxels of an edge on a path around it.
        edge: [TaxelId; 2],
    },
    /// Triangles of one taxel that share no edges.
    #[error("the triangles around taxel {id} do not form one fan")]
    SeveralFans {
        /// The taxel.
        id: TaxelId,
    },
    /// Edges that form a closed surface: which of the triangles is the boundary, they do not show.
    #[error("the triangles around taxel {id} close up")]
    Closed {
        /// One of its taxels.
        id: TaxelId,
    },
    /// Another reason.
    #[error(transparent)]
    Skin(Box<SkinError>),
}

/// A number with few digits: whole numbers as they are, very small and large ones with an exponent.
fn plain(x: f64) -> String {
    if x.fract() == 0.0 && x.abs() < 1e15 { format!("{x}") } else { format!("{x:?}") }
}
