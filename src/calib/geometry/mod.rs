//! Rigid frames and their alignment.

pub(crate) mod pose;
