//! Why a system cannot be solved.

/// Why a system cannot be solved.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SparseError {
    /// An entry is NaN or infinite.
    #[error("row {row} of the system holds an entry that is not finite")]
    NotFinite {
        /// The row of the [`crate::Pattern`].
        row: usize,
    },
    /// A pivot is zero or negative.
    #[error("the system is not positive definite: its pivot in row {row} is not positive")]
    NotPositiveDefinite {
        /// The row of the [`crate::Pattern`].
        row: usize,
    },
    /// No pivot was found, or the solution is not finite.
    #[error("the system of {rows} rows is singular")]
    Singular {
        /// Number of rows.
        rows: usize,
    },
    /// The factor does not fit into memory or 32-bit indices.
    #[error("the factor of a system of {rows} rows is too large for the memory")]
    TooLarge {
        /// Number of rows.
        rows: usize,
    },
}
