//! One level, and from one level to the next finer one.

pub(super) mod insertion;
pub(super) mod refine;
pub(super) mod relax;
