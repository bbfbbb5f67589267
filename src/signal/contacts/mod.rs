//! Contacts: connected regions of taxels that are pressed, followed from frame to frame.
//!
//! Regions live on the mesh of level 0. A region is a set of taxels above the lower threshold that
//! are joined by edges, and at least one of them is above the upper threshold (canny1986): noise at
//! the border of a contact neither splits it nor makes it flicker. Two taxels next to the same taxel
//! without a reading are joined too, so that a dead taxel does not cut a contact in two.
//!
//! In reading order: `options` has the thresholds, `noise` estimates them where none are given,
//! `region` is the result, `find` finds the taxels of the regions of a frame, `split` splits regions
//! with several peaks, `place` measures force, place and shape, `tracks` joins them to those of the last frame, `tracker` does all of it
//! ([`ContactTracker`]).
//!
//! Readings must be near 0 where nothing touches the skin. Where the threshold is estimated, the mean
//! of the same first frames is subtracted from each taxel; else subtract a baseline first
//! ([`Conditioner`](crate::signal::Conditioner)).

mod find;
mod noise;
mod options;
mod place;
mod region;
mod split;
mod tracker;
mod tracks;

pub use options::TrackerOptions;
pub use region::{ContactEvent, ContactRegion};
pub use tracker::ContactTracker;
