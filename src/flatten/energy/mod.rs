//! The energy of a map and its minimisation by projected Newton.

pub(super) mod density;
pub(super) mod newton;
pub(super) mod objective;
