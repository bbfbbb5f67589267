/// Why data is no map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// An array has the wrong length.
    #[error("{patch}/{level}: {what} has {found} entries, {needed} are needed")]
    Length {
        /// Name of the patch.
        patch: String,
        /// Level, as `L0`.
        level: String,
        /// Which array.
        what: &'static str,
        /// Entries found.
        found: usize,
        /// Entries needed.
        needed: usize,
    },
    /// An index out of range.
    #[error("{patch}/{level}: {what} names element {found}, but there are {count}")]
    OutOfRange {
        /// Name of the patch.
        patch: String,
        /// Level, as `L0`.
        level: String,
        /// Which array.
        what: &'static str,
        /// The index found.
        found: usize,
        /// Number of elements.
        count: usize,
    },
    /// A row of weights that is no convex combination.
    #[error(
        "{patch}/{level}: row {row} of {what} has weights {weights:?}; they must be non-negative with sum 1"
    )]
    Weights {
        /// Name of the patch.
        patch: String,
        /// Level, as `L0`.
        level: String,
        /// Which array.
        what: &'static str,
        /// The row.
        row: usize,
        /// The weights.
        weights: [f64; 3],
    },
    /// A triangle index, coordinate or map position that cannot be used.
    #[error("{patch}/{level}: {source}")]
    Mesh {
        /// Name of the patch.
        patch: String,
        /// Level, as `L0`.
        level: String,
        /// What is wrong with it.
        source: crate::mesh::MeshError,
    },
}
