//! Sparse symmetric systems: assemble, factor once, solve many. The only room that knows faer.
//!
//! A [`Pattern`] says which entries a matrix has; it is made once per mesh. A [`Matrix`] puts numbers, complex
//! numbers or 2 x 2 blocks on it. [`Cholesky`] orders and analyses a pattern once and factors any matrix on it;
//! [`conjugate_gradients`] does without a factor. A [`BlockSystem`] does the same for blocks of any size, and gives the
//! entries of the inverse that uncertainty asks for ([`SelectedInverse`]).

mod block_system;
mod cholesky;
mod conjugate_gradients;
mod dissection;
mod error;
mod matrix;
mod pattern;
mod selected_inverse;

pub use block_system::{BlockFactor, BlockMatrix, BlockSlot, BlockSystem};
pub use cholesky::{Cholesky, Factor, HermitianFactor, solve_unsymmetric};
pub use conjugate_gradients::{BlockJacobi, Preconditioner, Stop, Stopped, conjugate_gradients, dot};
pub use error::SparseError;
pub use matrix::{Entry, Matrix};
pub use pattern::Pattern;
pub use selected_inverse::SelectedInverse;
