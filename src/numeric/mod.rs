//! Small matrices, distributions and sets: independent of meshes and taxels.

mod chi_square;
mod covariance;
mod disjoint_sets;
mod matrix6;
mod morton;
mod random;
mod symmetric_eigen;

pub(crate) use chi_square::{chi_square_tail, median, nth_smallest, quantile};
pub use covariance::Covariance;
pub(crate) use disjoint_sets::{DisjointSets, Relation};
pub(crate) use matrix6::{Matrix6, Twist, dot};
pub(crate) use morton::morton;
pub(crate) use random::Random;
pub(crate) use symmetric_eigen::symmetric_eigen;
