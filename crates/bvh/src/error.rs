//! [`BvhError`].

/// Why there is no tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BvhError {
    /// A box with a coordinate that is not finite, or with a negative side.
    #[error("box {index} is not finite or has a negative side")]
    NotABox {
        /// Which box.
        index: usize,
    },
    /// A vertex that is too far away to be searched for, or not finite.
    #[error("vertex {vertex} is too far from the origin, or not finite")]
    TooFar {
        /// Which vertex.
        vertex: usize,
    },
    /// More elements than a tree can number, or none where there must be one.
    #[error("a tree over {count} elements is not possible; at most {most} are")]
    TooMany {
        /// How many there are.
        count: usize,
        /// How many are possible.
        most: usize,
    },
}
