//! Values on taxels and receptive fields: frames of readings, and quantities derived from them on every
//! level, without pixels or files.
//!
//! A missing reading is NaN, in every type of this module: of a taxel that is absent, dead or masked, and of
//! a receptive field whose taxels all are. Zero is a reading.

mod body_fields;
mod carry;
mod carry_down;
mod channel;
mod clock;
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

pub use body_fields::BodyFields;
pub use carry::Carry;
pub use carry_down::CarryDown;
pub use channel::{Channel, main_channel};
pub use clock::{Clock, Tick};
pub use condition::{ConditionOptions, ConditionReport, Conditioner, Zero};
pub use contacts::{ContactEvent, ContactRegion, ContactTracker, Probe, Rest, TrackerOptions, TrackerState};
pub use contrast::{Contrast, reconstruct};
pub use edges::Edges;
pub use error::SignalError;
pub use events::{BodyWord, Event, EventContact, EventDetector, EventOptions, EventPlace, Phase, Word};
pub use fill::Filler;
pub use frame::{Frame, LevelFrame, ModalityValues, Stage};
pub use health::{Health, HealthFinding, HealthOptions, HealthReport};
pub use match_taxels::{Duplicates, Join, JoinReport};
pub(crate) use noise::{QUANTISATION, RunningNoise};
pub use order::{ColumnOrder, LEAST_OBJECTIVE, Order, OrderError, OrderedColumn, SignalMap};
pub use pool::GroupPool;
pub use response::{Response, Scale, TaxelResponse, TaxelState};
pub use restrict::Restrictor;
pub use summary::{Group, Load, LoadingStep, OutsideSteps, Summary, Totals};
pub(crate) use touch::Sphere;
pub use touch::{
    FaultCounts, Press, ReadoutOptions, Spreader, Touch, TouchOptions, TouchShape, TouchSimulation,
};
pub use unit::{ChannelKind, Quantity, parse_unit, unit_ratio};
pub use zero::{ZeroReport, ZeroTracker};
