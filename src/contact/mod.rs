//! Contacts: from a point near the skin to the nearest map cell, on every level.
//!
//! A [`ContactIndex`] holds one tree of triangles per patch, in the frame of the patch's link, so posing the
//! robot never rebuilds a tree. [`ContactIndex::locate`] finds the nearest point of the skin ([`Hit`]);
//! [`ContactIndex::cell`] says in constant time where that is on the map of any level ([`Cell`]).
//!
//! Answers are exact: boxes and triangles are searched in `f32` with a bound on the rounding, and whatever may
//! be nearest is measured in `f64` on the vertices of the map. Of equally near faces the first patch's first
//! face is the answer, so it depends neither on the order of the search nor on what was asked before.
//!
//! The room is the only one that knows obvhs.

mod batch;
mod cell;
mod error;
mod geometry;
mod index;
mod query;
mod search;

pub use cell::{Cell, FieldWeights};
pub use error::ContactError;
pub use index::ContactIndex;
pub use query::{Hit, Query};
