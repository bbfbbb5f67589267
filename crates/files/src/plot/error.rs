//! Why a picture cannot be drawn.

use crate::{contact::ContactError, map::MapError, pyramid::LevelId, skin::SkinError, sparse::SparseError};

/// Why a picture cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum PlotError {
    #[error("there is no patch: there is nothing to draw")]
    Empty,
    #[error("there is no patch {patch:?}; the patches are {}", known.join(", "))]
    UnknownPatch { patch: String, known: Vec<String> },
    #[error("there is no level {level}; the levels are 0 to {last}")]
    UnknownLevel { level: LevelId, last: usize },
    #[error(
        "there is no level {level} without a mesh; the map has {count} levels of the whole body or of modalities"
    )]
    UnknownFieldLevel { level: LevelId, count: usize },
    #[error("patch {patch:?} has no map, so its {what} cannot be drawn")]
    NoMap { patch: String, what: &'static str },
    #[error("the places of changes cannot be found on the map: {source}")]
    Places { source: Box<ContactError> },
    #[error("patch {patch:?} has no covariances, so the uncertainty of its taxels cannot be drawn")]
    NoCovariances { patch: String },
    #[error("no patch has named regions, so none can be drawn; `read_regions` or the skin's file names them")]
    NoRegions,
    #[error(
        "there is no view from azimuth {azimuth} and elevation {elevation} degrees; elevations are -90 to 90"
    )]
    Direction { azimuth: f64, elevation: f64 },
    #[error("there is no unfolding at {time}; it begins at 0, the skin in space, and ends at 1, its map")]
    Time { time: f64 },
    #[error("patch {patch:?} cannot be unfolded: {source}")]
    Unfold { patch: String, source: SparseError },
    #[error(
        "a picture {width} pixels wide cannot be drawn: {panels} {} at least {least}; at most {most} are possible",
        if *panels == 1 { "panel needs" } else { "panels side by side need" }
    )]
    Width { width: u32, panels: usize, least: u32, most: u32 },
    #[error("a picture of {width} x {height} pixels cannot be drawn; its sides must be {least} to {most}")]
    Size { width: u32, height: u32, least: u32, most: u32 },
    #[error(
        "channel {channel} of {channels} cannot be drawn from {} to {}; channels count from 0, and the first number of a range must be smaller",
        range[0], range[1]
    )]
    Channel { channel: usize, channels: usize, range: [f64; 2] },
    #[error(
        "the colours cannot show values from {} to {}; the first number of a range must be smaller, one of areas must \
         contain 1, and receptive fields have no range",
        range[0], range[1]
    )]
    Range { range: [f64; 2] },
    #[error("the frame has not one value of the channel for each vertex of patch {patch:?}, level {level}")]
    FrameOfAnotherMap { patch: String, level: LevelId },
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Skin(#[from] SkinError),
}
