//! Why values and pixels do not fit.

use crate::{map::MapError, pyramid::LevelId};

/// Why values and pixels do not fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The map breaks a rule.
    #[error(transparent)]
    Map(#[from] MapError),
    /// An atlas that was made of another map.
    #[error("image {part} of the atlas shows a patch, a level or a face that the map does not have")]
    Atlas {
        /// Name of the image.
        part: String,
    },
    /// A level that no patch has.
    #[error("no image shows level {level}; the levels are 0 to {last}")]
    Level {
        /// The level asked for.
        level: LevelId,
        /// The coarsest level there is.
        last: LevelId,
    },
    /// A chart without a pixel, where an amount has to be drawn.
    #[error(
        "no pixel of image {part} shows patch {patch}, so its amounts cannot be kept; use smaller pixels"
    )]
    NoPixel {
        /// Name of the image.
        part: String,
        /// Name of the patch.
        patch: String,
    },
    /// An image that the renderer does not draw.
    #[error("image {name:?} is not one of the map's; there are {known:?}")]
    UnknownImage {
        /// Its name.
        name: String,
        /// The first ten that there are.
        known: Vec<String>,
    },
    /// An image of another size, or with another number of values.
    #[error(
        "image {name} has {} x {} pixels in {channels} channels and {values} values; {} x {} pixels in {needed_channels} \
         channels are needed",
        found[0], found[1], needed[0], needed[1]
    )]
    Size {
        /// Its name.
        name: String,
        /// Width and height found.
        found: [u32; 2],
        /// Channels found.
        channels: usize,
        /// Values found.
        values: usize,
        /// Width and height needed.
        needed: [u32; 2],
        /// Channels needed.
        needed_channels: usize,
    },
}
