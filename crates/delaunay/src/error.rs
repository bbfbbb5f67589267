//! Errors of this crate.

/// Why points have no Delaunay triangulation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DelaunayError {
    /// A coordinate is NaN or out of range.
    #[error("point {point} lies at {position:?}; coordinates must be finite and below 1e60 m")]
    OutOfRange {
        /// Index of the point.
        point: usize,
        /// Where it lies.
        position: [f64; 2],
    },
    /// Two points at one place.
    #[error("points {first} and {second} both lie at {position:?}; points must differ")]
    Coincident {
        /// Index of the first point.
        first: usize,
        /// Index of the second point.
        second: usize,
        /// Where they lie.
        position: [f64; 2],
    },
    /// Edges of polygons cross or touch.
    #[error("the edge between points {} and {} meets another one; polygons must not touch", edge[0], edge[1])]
    Crossed {
        /// Indices of the ends of one of the edges.
        edge: [usize; 2],
    },
    /// The triangulation library refused the points for a reason of its own.
    #[error("the points cannot be triangulated: {reason}")]
    Refused {
        /// What it said.
        reason: String,
    },
}
