//! Why a picture cannot be drawn.

use crate::{map::MapError, pyramid::LevelId, skin::SkinError, sparse::SparseError};

/// Why a picture cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// A map or a skin without patches.
    #[error("there is no patch: there is nothing to draw")]
    Empty,
    /// A patch that the map does not have.
    #[error("there is no patch {patch:?}; the patches are {}", known.join(", "))]
    UnknownPatch {
        /// The patch asked for.
        patch: String,
        /// The patches there are.
        known: Vec<String>,
    },
    /// A level that none of the patches drawn has.
    #[error("there is no level {level}; the levels are 0 to {last}")]
    UnknownLevel {
        /// The level asked for.
        level: LevelId,
        /// The coarsest level there is.
        last: usize,
    },
    /// A skin without a map, where a picture needs one.
    #[error("patch {patch:?} has no map, so its {what} cannot be drawn")]
    NoMap {
        /// The patch.
        patch: String,
        /// What of the map.
        what: &'static str,
    },
    /// A patch whose taxels have no covariances.
    #[error("patch {patch:?} has no covariances, so the uncertainty of its taxels cannot be drawn")]
    NoCovariances {
        /// The patch.
        patch: String,
    },
    /// A viewpoint that is not a direction.
    #[error(
        "there is no view from azimuth {azimuth} and elevation {elevation} degrees; elevations are -90 to 90"
    )]
    Direction {
        /// The azimuth asked for, in degrees.
        azimuth: f64,
        /// The elevation asked for, in degrees.
        elevation: f64,
    },
    /// A time of the unfolding that is not between its ends.
    #[error("there is no unfolding at {time}; it begins at 0, the skin in space, and ends at 1, its map")]
    Time {
        /// The time asked for.
        time: f64,
    },
    /// A patch whose unfolding does not fit into memory.
    #[error("patch {patch:?} cannot be unfolded: {source}")]
    Unfold {
        /// The patch.
        patch: String,
        /// Why its system cannot be solved.
        source: SparseError,
    },
    /// A width that the panels of a row do not fit into, or that is too large.
    #[error(
        "a picture {width} pixels wide cannot be drawn: {panels} {} at least {least}, and {most} is the most",
        if *panels == 1 { "panel needs" } else { "panels side by side need" }
    )]
    Width {
        /// Its width, in pixels.
        width: u32,
        /// Panels in a row.
        panels: usize,
        /// Least width for them.
        least: u32,
        /// Largest width.
        most: u32,
    },
    /// A picture that is too small or too large.
    #[error("a picture of {width} x {height} pixels cannot be drawn; {least} to {most} a side can")]
    Size {
        /// Its width, in pixels.
        width: u32,
        /// Its height, in pixels.
        height: u32,
        /// Least width.
        least: u32,
        /// Largest side.
        most: u32,
    },
    /// A channel that a frame does not have, or a range of values without a length.
    #[error(
        "channel {channel} of {channels} cannot be drawn from {} to {}; the channels count from 0, and a range rises",
        range[0], range[1]
    )]
    Channel {
        /// The channel asked for.
        channel: usize,
        /// Number of channels.
        channels: usize,
        /// The values at the ends of the scale.
        range: [f64; 2],
    },
    /// A range that the colours cannot show.
    #[error(
        "the colours cannot show values from {} to {}; a range rises, one of areas has 1 between its ends, and \
         receptive fields and taxel ids have none",
        range[0], range[1]
    )]
    Range {
        /// The values at the ends of the scale.
        range: [f64; 2],
    },
    /// A frame of another map.
    #[error("the frame has not one value of the channel for each vertex of patch {patch:?}, level {level}")]
    FrameOfAnotherMap {
        /// The patch.
        patch: String,
        /// The level.
        level: LevelId,
    },
    /// Data that is not a valid map.
    #[error(transparent)]
    Map(#[from] MapError),
    /// Data that is not a valid skin.
    #[error(transparent)]
    Skin(#[from] SkinError),
}
