//! Values on taxels and receptive fields: frames of readings, and quantities derived from them on every
//! level, without pixels or files.
//!
//! In reading order: `unit` and `channel` (the measured quantity), `frame` (readings at one time on the taxels,
//! [`Frame`], or on every level, [`LevelFrame`]; and stages of processing, [`Stage`]); `match_taxels` assigns
//! the columns of a recording to taxels ([`Join`]), `condition` corrects and filters readings
//! ([`Conditioner`]), `noise` estimates their noise, `zero` follows their drift ([`ZeroTracker`]), `fill` closes gaps ([`Filler`]); `restrict` transfers them to all levels
//! ([`Restrictor`]); `contrast` and `edges` find where they change ([`Contrast`], [`Edges`]); `contacts`
//! finds contact regions ([`ContactTracker`]), `events` has words for what they do ([`EventDetector`]). `response` is what is known about the channels of taxels ([`Response`]),
//! `health` finds faulty taxels ([`Health`]), `order` finds which column is of which taxel ([`ColumnOrder`]), `summary` adds up a recording ([`Summary`]), `pool` carries readings to named
//! regions ([`GroupPool`]).
//!
//! A missing reading is NaN, in every type of this module: of a taxel that is absent, dead or masked, and of
//! a receptive field whose taxels all are. Zero is a reading.

mod channel;
mod condition;
mod contacts;
mod contrast;
mod edges;
mod error;
mod events;
mod fill;
mod frame;
mod health;
mod match_taxels;
mod noise;
mod order;
mod pool;
mod response;
mod restrict;
mod summary;
mod touch;
mod unit;
mod zero;

pub use channel::Channel;
pub(crate) use channel::main_channel;
pub use condition::{ConditionOptions, ConditionReport, Conditioner, Zero};
pub use contacts::{
    ContactEvent, ContactRegion, ContactTracker, Probe, Rest, RestFrames, TrackerOptions, TrackerState,
};
pub use contrast::{Contrast, reconstruct};
pub use edges::Edges;
pub use error::SignalError;
pub use events::{BodyWord, Event, EventContact, EventDetector, EventOptions, EventPlace, Phase, Word};
pub use fill::Filler;
pub use frame::{Frame, LevelFrame, Stage};
pub use health::{Health, HealthFinding, HealthOptions, HealthReport};
pub use match_taxels::{Duplicates, Join, JoinReport};
pub(crate) use noise::{QUANTISATION, RunningNoise};
pub use order::{ColumnOrder, LEAST_OBJECTIVE, Order, OrderError, OrderedColumn, SignalMap};
pub use pool::GroupPool;
pub use response::{Response, Scale, TaxelResponse, TaxelState};
pub use restrict::Restrictor;
pub use summary::{Group, Load, Summary, Totals};
pub(crate) use touch::Sphere;
pub use touch::{
    FaultCounts, Press, ReadoutOptions, Spreader, Touch, TouchOptions, TouchShape, TouchSimulation,
};
pub use unit::{ChannelKind, Quantity};
pub(crate) use unit::{parse_unit, unit_ratio};
pub use zero::{ZeroReport, ZeroTracker};
