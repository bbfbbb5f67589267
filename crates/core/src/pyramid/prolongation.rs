//! Carries values coarse to fine, and amounts fine to coarse by its transpose.

use std::ops::{Add, Mul};

use crate::id::{IdVec, VertexId};
use crate::pyramid::PyramidError;

/// Tolerance of the sum of a row's weights, which is 1: rounding, also of weights that were stored as `f32`.
const SUM_TOLERANCE: f64 = 1e-6;

/// Rows of files whose sum differs from 1 by at most this are scaled: other programs may round more coarsely.
const RESCALED_ERROR: f64 = 1e-5;

/// Coarse to fine: every fine vertex as a convex combination of at most three coarse ones.
///
/// A sparse matrix `P` (fine x coarse) with exactly three slots a row; unused slots have weight 0. In a
/// pyramid the three indices of a row are always the corners of one coarse face, so a row is also a point of
/// the coarse mesh.
///
/// A product of two prolongations is not of this form (rows would grow), so a pyramid locates every taxel on
/// every level instead: see [`crate::pyramid::Level::to_finest`].
#[derive(Debug, Clone, PartialEq)]
pub struct Prolongation {
    /// Coarse vertices of each fine vertex.
    pub indices: IdVec<VertexId, [VertexId; 3]>,
    /// Their weights: non-negative, sum 1.
    pub weights: IdVec<VertexId, [f64; 3]>,
    /// Number of coarse vertices.
    pub coarse_len: usize,
}

impl Prolongation {
    /// Checks that rows name coarse vertices and are convex combinations of them.
    ///
    /// # Errors
    /// The first row that breaks a rule.
    pub(crate) fn validate(&self) -> Result<(), PyramidError> {
        let (found, needed) = (self.weights.len(), self.indices.len());
        if found != needed {
            return Err(PyramidError::Length { what: "weights", found, needed });
        }
        for ((row, indices), &weights) in self.indices.enumerate().zip(&self.weights) {
            if let Some(&found) = indices.iter().find(|v| v.index() >= self.coarse_len) {
                return Err(PyramidError::OutOfRange { row, found, count: self.coarse_len });
            }
            // Not the negation: a NaN must fail.
            if !(weights.iter().all(|w| *w >= 0.0) && sums_to_one(&weights, SUM_TOLERANCE)) {
                return Err(PyramidError::Weights { row, weights });
            }
        }
        Ok(())
    }

    /// Scales every row of a file whose sum is 1 up to rounding to the sum 1 in `f64`; leaves others to
    /// [`Self::validate`].
    #[doc(hidden)]
    pub fn rescale(&mut self) {
        for weights in self.weights.iter_mut().filter(|weights| sums_to_one(weights, RESCALED_ERROR)) {
            let sum: f64 = weights.iter().sum();
            *weights = weights.map(|w| w / sum);
        }
    }

    /// Coarse vertices and weights of the fine vertex `row`, without the unused slots.
    pub fn row(&self, row: VertexId) -> impl Iterator<Item = (VertexId, f64)> + Clone {
        self.indices[row].into_iter().zip(self.weights[row]).filter(|(_, w)| *w > 0.0)
    }

    /// `P x`: an intensive quantity (a position, a pressure) of the coarse vertices on the fine ones.
    ///
    /// # Panics
    /// If `coarse` does not have one entry per coarse vertex.
    #[must_use]
    pub fn apply<T>(&self, coarse: &IdVec<VertexId, T>) -> IdVec<VertexId, T>
    where
        T: Copy + Add<Output = T> + Mul<f64, Output = T>,
    {
        assert_eq!(coarse.len(), self.coarse_len, "one value per coarse vertex");
        let blend = |(&[a, b, c], &[wa, wb, wc]): (&[VertexId; 3], &[f64; 3])| {
            coarse[a] * wa + coarse[b] * wb + coarse[c] * wc
        };
        self.indices.iter().zip(&self.weights).map(blend).collect()
    }

    /// `P' x`: an amount (a force, an area) of the fine vertices, collected on the coarse ones; the
    /// total is kept.
    ///
    /// # Panics
    /// If `fine` does not have one entry per fine vertex.
    #[must_use]
    pub fn restrict<T>(&self, fine: &IdVec<VertexId, T>) -> IdVec<VertexId, T>
    where
        T: Copy + Default + Add<Output = T> + Mul<f64, Output = T>,
    {
        assert_eq!(fine.len(), self.indices.len(), "one value per fine vertex");
        let mut coarse = IdVec::filled(T::default(), self.coarse_len);
        for ((indices, weights), &x) in self.indices.iter().zip(&self.weights).zip(fine) {
            for (&v, &w) in indices.iter().zip(weights) {
                coarse[v] = coarse[v] + x * w;
            }
        }
        coarse
    }
}

/// Whether a row's weights have the sum 1 within `tolerance`.
fn sums_to_one(weights: &[f64; 3], tolerance: f64) -> bool {
    (weights.iter().sum::<f64>() - 1.0).abs() <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounded_rows_of_files_are_scaled_and_others_left() {
        let weights = vec![[1.0 + 5e-6, 0.0, 0.0], [0.5, 0.5, 0.5]].into();
        let mut p =
            Prolongation { indices: IdVec::filled([0, 1, 2].map(VertexId::new), 2), weights, coarse_len: 3 };
        p.rescale();
        assert_eq!(p.weights.as_slice(), [[1.0, 0.0, 0.0], [0.5, 0.5, 0.5]]);
    }
}
