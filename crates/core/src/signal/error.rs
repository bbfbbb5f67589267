//! Why readings cannot be used with a map or be simulated.

use crate::contact::ContactError;
use crate::pyramid::LevelId;
use crate::skin::{SkinError, TaxelId};

/// Why readings cannot be used with a map or be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum SignalError {
    #[error(
        "columns {} and {} of the readings both have the taxel id {taxel}; each column needs \
         another id (the first line of a table names them), or choose the first",
        columns[0], columns[1]
    )]
    DuplicateId { taxel: TaxelId, columns: [usize; 2] },
    #[error(
        "the readings have {found} columns without ids, but the map has {needed} taxels; needed are \
         {needed} columns in the order of the map, patch after patch, or an array `ids` with the taxel id \
         of each of the {found} columns"
    )]
    Width { found: usize, needed: usize },
    #[error("{ids} taxel ids for readings of {width} columns; one for each column is needed")]
    IdCount { ids: usize, width: usize },
    #[error(
        "none of the {columns} taxel ids of the readings is in the map; the first is {first}, that of the \
         map {known}; readings of the skin that the map was made of are needed"
    )]
    NoneMatched { columns: usize, first: TaxelId, known: TaxelId },
    #[error(
        "channel {channel:?} is in {unit:?}, which is not a known unit; the nearest is {nearest}; needed: one of force \
         (N, mN, kgf, lbf), pressure (Pa, kPa, bar, psi, mmHg, cmH2O, N/cm^2, kgf/cm^2), charge (pC), temperature \
         (K, degC), or count, V, F, Ohm"
    )]
    Unit { channel: String, unit: String, nearest: String },
    #[error("{given} {what}s for {} channels ({}); one for each channel is needed", known.len(), list(known))]
    ChannelCount { what: &'static str, given: usize, known: Vec<String> },
    #[error(
        "recording {number} is in {found:?}, and the first in {first:?}; recordings of one sensor are needed"
    )]
    Units { number: usize, found: String, first: String },
    #[error(
        "channel {channel:?} is in {stated:?} as the readings state, and in {given:?} as is given; one unit is needed: the other \
         is left out, or the file corrected"
    )]
    UnitTwice { channel: String, stated: String, given: String },
    #[error(
        "the response has gains and the zero of {known} of {taxels} taxels of the map, and the readings are not about 0 where \
         nothing touches; a zero is needed, of each taxel in the response or of all readings"
    )]
    ZerosUnknown { known: usize, taxels: usize },
    #[error(
        "patches share the taxel id {taxel}, and the readings without ids have a column for each of its taxels; a response names \
         taxels by their ids: ids of their own are needed"
    )]
    SharedIds { taxel: TaxelId },
    #[error("two channels are called {name:?}; names must differ")]
    ChannelTwice { name: String },
    #[error("the readings have no channel {name:?}; they have {}", list(known))]
    NoChannel { name: String, known: Vec<String> },
    #[error(
        "channel {channel:?} is in {unit:?}, and the response is of readings in {needed:?}; readings in that unit, or a \
         response of these are needed"
    )]
    ResponseUnit { channel: String, unit: String, needed: String },
    #[error(
        "none of the {taxels} taxels of the response is in the map; the first is {first}, that of the map {known}; a response \
         of the same skin is needed"
    )]
    ForeignResponse { taxels: usize, first: TaxelId, known: TaxelId },
    #[error(
        "{level} has values of readings of {modality}, and channels {} are of something else; a channel whose name begins with \
         {modality}, or of its quantity, is needed",
        list(known)
    )]
    NotOfModality { level: String, modality: String, known: Vec<String> },
    #[error("the map has no level {level} without a mesh; it has {}", list(known))]
    NoFields { level: LevelId, known: Vec<String> },
    #[error("stored zeros need a response that has some")]
    NoStoredZeros,
    #[error("slow and fast components, steps and known forces need times, and the readings have none")]
    NoTimes,
    #[error(
        "events need the time of each frame, and a frame has none; readings with times, or their rate, are needed"
    )]
    NoEventTime,
    #[error("{option} is {found}; {needed} is needed")]
    Option { option: String, found: f64, needed: String },
    #[error(
        "no channel of the readings ({}) measures touches: a force, pressure, charge or counts",
        list(known)
    )]
    NoTouch { known: Vec<String> },
    #[error("the readings have no frame; at least one is needed")]
    NoFrames,
    #[error("the skin has no working taxel that could sense a touch")]
    NoTaxels,
    #[error("a frame with {found:?} values in its patches; one of the map, with {needed:?}, is needed")]
    ForeignFrame { found: Vec<usize>, needed: Vec<usize> },
    #[error("{frames} frames of {taxels} taxels do not fit into a page; at most {most} do")]
    TooLong { frames: usize, taxels: usize, most: usize },
    #[error(transparent)]
    Contact(#[from] ContactError),
    #[error(transparent)]
    Skin(#[from] SkinError),
}

/// The first names of a list.
fn list(names: &[String]) -> String {
    names.iter().take(10).map(String::as_str).collect::<Vec<_>>().join(", ")
}

impl SignalError {
    #[doc(hidden)]
    pub fn option(option: impl Into<String>, found: f64, needed: impl Into<String>) -> Self {
        Self::Option { option: option.into(), found, needed: needed.into() }
    }
}
