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
    /// More boxes than a tree can number.
    #[error("{count} boxes are too many for a tree; at most {most} are possible")]
    TooMany {
        /// How many there are.
        count: usize,
        /// How many are possible.
        most: usize,
    },
}
