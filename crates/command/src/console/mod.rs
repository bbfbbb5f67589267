//! What a user sees of a run: results on standard output; notes, errors and progress on standard error.

pub(crate) mod errors;
pub(crate) mod notes;
pub(crate) mod print;
pub(crate) mod progress;
