//! Sparse symmetric systems: assemble, factor once, solve many. The only crate of dermatome that
//! uses faer.
//!
//! A [`Pattern`] lists the entries of a matrix; it is made once per mesh. A [`Matrix`] assigns them numbers,
//! complex numbers or 2 x 2 blocks. [`Cholesky`] orders and analyses a pattern once and factors any matrix on
//! it; [`conjugate_gradients()`] needs no factor. A [`BlockSystem`] factors matrices of blocks of any size,
//! and computes the entries of the inverse that covariances need ([`SelectedInverse`]). [`solve_unsymmetric`]
//! is for complex matrices that are not Hermitian.
//!
//! A crate of its own, so that an edit elsewhere does not compile it and faer's generic code again.
//! Results do not depend on the number of threads.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

mod block_system;
mod cholesky;
mod conjugate_gradients;
mod lower;
mod lu;
mod matrix;
mod ordering;
mod pattern;
mod selected_inverse;

pub use block_system::{BlockFactor, BlockMatrix, BlockSlot, BlockSystem};
pub use cholesky::{Cholesky, Factor};
pub use conjugate_gradients::{Block, CgOptions, CgReport, conjugate_gradients, dot};
pub use lu::solve_unsymmetric;
pub use matrix::{Entry, Matrix};
pub use pattern::Pattern;
pub use selected_inverse::SelectedInverse;

/// Why a system cannot be solved.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum SparseError {
    #[error("row {row} of the system has an entry that is not finite")]
    NotFinite { row: usize },
    #[error("the system is not positive definite: its pivot in row {row} is not positive")]
    NotPositiveDefinite { row: usize },
    /// No pivot was found, or the solution is not finite.
    #[error("the system of {rows} rows is singular")]
    Singular { rows: usize },
    /// The factor does not fit into memory or 32-bit indices.
    #[error("the factor of a system of {rows} rows is too large for the memory")]
    TooLarge { rows: usize },
}
