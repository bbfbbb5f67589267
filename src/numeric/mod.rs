//! Small matrices, distributions and sets: numbers that know no mesh and no taxel.

mod chi_square;
mod morton;
mod symmetric_eigen;

pub(crate) use chi_square::{chi_square_tail, quantile};
pub(crate) use morton::morton;
pub(crate) use symmetric_eigen::symmetric_eigen;
