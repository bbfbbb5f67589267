//! Small matrices, distributions, sets and compressed lists: independent of meshes and taxels.

mod assignment;
mod chi_square;
mod covariance;
mod csr;
mod dense_cholesky;
mod disjoint_sets;
mod linear_system;
mod matrix6;
mod order;
mod random;
mod shortest_paths;
mod symmetric_eigen;

pub(crate) use assignment::assign;
pub(crate) use chi_square::{chi_square_tail, f_tail, quantile};
pub use covariance::Covariance;
pub use csr::Csr;
pub(crate) use dense_cholesky::{dense_cholesky, solve_dense};
pub(crate) use disjoint_sets::{DisjointSets, Labels, Relation};
pub(crate) use linear_system::solve_system;
pub(crate) use matrix6::{Matrix6, Twist, dot};
pub(crate) use order::{along_curve, argsort, chains, median, morton, nth_smallest};
pub use order::{median_of, order_by};
pub use random::hash;
pub(crate) use random::{Random, place_hash};
pub(crate) use shortest_paths::{distances_from, each_by_distance, nearest_sources};
pub(crate) use symmetric_eigen::symmetric_eigen;

/// The standard deviation of normal numbers over the median of their sizes.
pub(crate) const DEVIATION_OF_MEDIAN: f64 = 1.482_602;

/// The median length of three normal numbers over their standard deviation (of the distribution of Maxwell).
pub(crate) const MEDIAN_OF_MAXWELL: f64 = 1.538_172;

/// A number as files and images store it.
#[expect(clippy::cast_possible_truncation, reason = "files and images store f32")]
#[doc(hidden)]
pub fn narrow(x: f64) -> f32 {
    x as f32
}

/// A number that files and images can store, else NaN.
#[inline]
pub(crate) fn storable(x: f64) -> f64 {
    if x.abs() <= f64::from(f32::MAX) { x } else { f64::NAN }
}

/// Numbers as a key: equal where they are, as 0 and -0.
#[doc(hidden)]
pub fn bits<const N: usize>(numbers: [f64; N]) -> [u64; N] {
    // Adding 0 makes -0 the same.
    numbers.map(|x| (x + 0.0).to_bits())
}

/// The place value of the second digit of a positive `x`: 10 for 347, 1 for 34.
#[doc(hidden)]
pub fn second_digit(x: f64) -> f64 {
    10_f64.powf(x.log10().floor() - 1.0)
}
