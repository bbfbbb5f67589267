//! Whether a map overlaps itself, and the fillers that prevent it.

pub(super) mod crossings;
pub(super) mod fillers;
pub(super) mod orientation;
pub(super) mod overlap;
