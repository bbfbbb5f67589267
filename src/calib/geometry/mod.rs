//! Rigid frames, their tangent spaces, and their alignment.

pub(super) mod align;
pub(super) mod pose;
