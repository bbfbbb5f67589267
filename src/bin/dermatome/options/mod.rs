//! Options that several subcommands share, and what they mean to the library.

mod choice;
mod coarsen;
mod common;
mod flatten;
mod numbers;
mod patches;
mod read;

pub(crate) use choice::{Choice, one_of, word_of};
pub(crate) use coarsen::{AcuityArgs, CoarsenArgs};
pub(crate) use common::{ColorChoice, Common};
pub(crate) use flatten::FlattenArgs;
pub(crate) use numbers::{length, length_mm, side_mm};
pub(crate) use patches::{PatchArgs, pattern};
pub(crate) use read::{ReadArgs, Unit};
