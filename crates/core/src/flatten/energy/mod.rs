//! The energy of a map and its minimisation by projected Newton.

pub(super) mod assembly;
pub(super) mod elements;
pub(super) mod face_energy;
pub(super) mod newton;
pub(super) mod objective;
