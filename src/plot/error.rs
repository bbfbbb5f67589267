//! Why a picture cannot be drawn.

use crate::{map::MapError, pyramid::LevelId, skin::SkinError, sparse::SparseError};

/// Why a picture cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum PlotError {
    /// A map or a skin without patches.
    #[error("there is no patch: there is nothing to draw")]
    Empty,
    /// A patch that the map does not have.
    #[error("there is no patch {patch:?}; the patches are {}", known.join(", "))]
    UnknownPatch { patch: String, known: Vec<String> },
    /// A level that none of the patches drawn has.
    #[error("there is no level {level}; the levels are 0 to {last}")]
    UnknownLevel { level: LevelId, last: usize },
    /// A skin without a map, where a picture needs one.
    #[error("patch {patch:?} has no map, so its {what} cannot be drawn")]
    NoMap { patch: String, what: &'static str },
    /// A patch whose taxels have no covariances.
    #[error("patch {patch:?} has no covariances, so the uncertainty of its taxels cannot be drawn")]
    NoCovariances { patch: String },
    /// A viewpoint that is not a direction.
    #[error(
        "there is no view from azimuth {azimuth} and elevation {elevation} degrees; elevations are -90 to 90"
    )]
    Direction { azimuth: f64, elevation: f64 },
    /// A time of the unfolding that is not between its ends.
    #[error("there is no unfolding at {time}; it begins at 0, the skin in space, and ends at 1, its map")]
    Time { time: f64 },
    /// A patch whose unfolding does not fit into memory.
    #[error("patch {patch:?} cannot be unfolded: {source}")]
    Unfold { patch: String, source: SparseError },
    /// A width that the panels of a row do not fit into, or that is too large.
    #[error(
        "a picture {width} pixels wide cannot be drawn: {panels} {} at least {least}, and {most} is the most",
        if *panels == 1 { "panel needs" } else { "panels side by side need" }
    )]
    Width { width: u32, panels: usize, least: u32, most: u32 },
    /// A picture that is too small or too large.
    #[error("a picture of {width} x {height} pixels cannot be drawn; {least} to {most} a side can")]
    Size { width: u32, height: u32, least: u32, most: u32 },
    /// A channel that a frame does not have, or a range of values without a length.
    #[error(
        "channel {channel} of {channels} cannot be drawn from {} to {}; the channels count from 0, and a range rises",
        range[0], range[1]
    )]
    Channel { channel: usize, channels: usize, range: [f64; 2] },
    /// A range that the colours cannot show.
    #[error(
        "the colours cannot show values from {} to {}; a range rises, one of areas has 1 between its ends, and \
         receptive fields and taxel ids have none",
        range[0], range[1]
    )]
    Range { range: [f64; 2] },
    /// A frame of another map.
    #[error("the frame has not one value of the channel for each vertex of patch {patch:?}, level {level}")]
    FrameOfAnotherMap { patch: String, level: LevelId },
    /// Data that is not a valid map.
    #[error(transparent)]
    Map(#[from] MapError),
    /// Data that is not a valid skin.
    #[error(transparent)]
    Skin(#[from] SkinError),
}
