//! Values on taxels and receptive fields: frames of readings, and what follows from them on every
//! level. Nothing here knows of pixels or files.
//!
//! In reading order: `channel` says what is measured, `frame` holds one moment of it on the taxels
//! ([`Frame`]) or on every level ([`LevelFrame`]), and what sees frames one after the other ([`Stage`]); `match_taxels` puts the columns of a recording to their
//! taxels ([`Join`]), `condition` corrects and filters them ([`Conditioner`]), `fill` closes gaps ([`Filler`]); `restrict` carries
//! them to all levels ([`Restrictor`]); `contrast` and `edges` say where they change ([`Contrast`], [`Edges`]);
//! `contacts` finds what touches the skin ([`ContactTracker`]).
//!
//! A reading that is not there is NaN, in every type of this module: a taxel that is absent, dead or
//! masked, and a receptive field all of whose taxels are. Zero is a reading.

mod channel;
mod condition;
mod contacts;
mod contrast;
mod edges;
mod error;
mod fill;
mod frame;
mod match_taxels;
mod restrict;
mod touch;

pub(crate) use channel::unit_ratio;
pub use channel::{Channel, Quantity};
pub use condition::{ConditionOptions, ConditionReport, Conditioner};
pub use contacts::{ContactEvent, ContactRegion, ContactTracker, TrackerOptions};
pub use contrast::{Contrast, reconstruct};
pub use edges::Edges;
pub use error::SignalError;
pub use fill::Filler;
pub use frame::{Frame, LevelFrame, Stage};
pub use match_taxels::{Duplicates, Join, JoinReport};
pub use restrict::Restrictor;
pub use touch::{Press, Spreader, Touch, TouchOptions, TouchSimulation};
