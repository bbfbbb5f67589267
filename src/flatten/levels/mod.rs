//! From the map of a coarse level to that of the next finer one.

pub(super) mod insertion;
pub(super) mod refine;
