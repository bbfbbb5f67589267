//! Why a response cannot be estimated.

use crate::signal::SignalError;
use crate::skin::SkinError;
use crate::sparse::SparseError;

/// Why a response cannot be estimated.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum ResponseError {
    #[error(
        "the recordings have {touches} touches, {found} of them by one body on three taxels and more; {needed} \
         presses are needed, and some 400 for gains to 5 %"
    )]
    TooFewPresses { found: usize, touches: usize, needed: usize },
    #[error(
        "{saturated} of {readings} readings of touched taxels are at the largest value of their taxel; lighter touches are needed"
    )]
    Saturated { saturated: usize, readings: usize },
    #[error(
        "the edges of contacts are sharper than those of the model (a blur of {:.2} mm, its bound): this skin is not a \
         cover of independent springs, and gains from touches would be wrong by more than their sigma; use steps of \
         pressure",
        1e3 * blur
    )]
    ForeignContacts { blur: f64 },
    #[error(
        "readings grow with the depth of touches to the power of {power:.2}, a bound of the model: they are saturated, or \
         follow another law, and gains would be wrong by more than their sigma; use lighter touches, or steps of pressure"
    )]
    ForeignPower { power: f64 },
    #[error(
        "there is no step of pressure in {rows} rows; rows of a time in s and a pressure in Pa are needed"
    )]
    NoSteps { rows: usize },
    #[error("row {row} of the steps is at {found} s; times that grow are needed")]
    StepTime { row: usize, found: f64 },
    #[error(
        "row {row} of the steps has a pressure of {found} Pa; 0, or 10 to 1e8, is needed; is it in another unit?"
    )]
    StepPressure { row: usize, found: f64 },
    #[error(
        "the recording has frames in {found} of {needed} steps of pressure: it lasts from {} to {} s, steps begin from \
         {} to {} s; times of both must be on one clock",
        recording[0], recording[1], steps[0], steps[1]
    )]
    StepsOutside { found: usize, needed: usize, steps: [f64; 2], recording: [f64; 2] },
    #[error(
        "readings do not follow the steps of pressure (their median slope is {slope:.2}, and {residual:.2} are left, of \
         logarithms); steps of this recording are needed"
    )]
    StepsDoNotFit { slope: f64, residual: f64 },
    #[error("row {row} of the forces is at {found} s; times that do not fall are needed")]
    ForceTime { row: usize, found: f64 },
    #[error("row {row} of the forces has {found} N; a number from 0 on is needed")]
    Force { row: usize, found: f64 },
    #[error("the largest force is {most} N; 0.05 to 1000 N are needed; is it in another unit?")]
    ForceUnit { most: f64 },
    #[error(
        "{found} touches of known force fall into the recording, which lasts from {from} to {to} s; {needed} are needed, \
         and 20 for a scale to 2 %"
    )]
    TooFewForces { found: usize, needed: usize, from: f64, to: f64 },
    #[error(
        "the forces of {touches} touches do not fit their readings (the logarithm of the ratio differs by {disagreement:.2} \
         in the median); forces of this recording are needed"
    )]
    ForcesDoNotFit { touches: usize, disagreement: f64 },
    #[error(
        "times go back within a recording or from one to the next, so that a force belongs to several frames; one recording of \
         one episode is needed, or several whose times go on"
    )]
    ForceClocks,
    #[error(
        "times go back within the recording, so that readings at one time are of several steps of pressure; one recording \
         whose times go on is needed, with the steps of its clock"
    )]
    StepClocks,
    #[error("the response has no relative gains; what touches alone give is needed")]
    NotRelative,
    #[error(
        "steps of pressure are of one recording of one episode; {found} are given: join them, with their steps"
    )]
    StepRecordings { found: usize },
    #[error("the equations of a press are singular")]
    Singular,
    #[error("cancelled before it was done")]
    Cancelled,
    #[error(transparent)]
    Sparse(#[from] SparseError),
    #[error(transparent)]
    Signal(#[from] SignalError),
    #[error(transparent)]
    Skin(#[from] SkinError),
}
