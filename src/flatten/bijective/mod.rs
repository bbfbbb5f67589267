//! Whether a map overlaps itself, and the barrier that prevents it.

pub(super) mod barrier;
pub(super) mod crossings;
pub(super) mod overlap;
