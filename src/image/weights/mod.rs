//! Pixels in terms of vertices: which values a pixel is the weighted sum of.
//!
//! In reading order: `face_weights`, one plane for each face; `runs` and `points`, the pixels of large
//! and of small faces; `natural`, neighbours where values are missing; `surface`, all of a chart.

pub(super) mod face_weights;
pub(super) mod natural;
pub(super) mod points;
pub(super) mod runs;
pub(super) mod surface;
