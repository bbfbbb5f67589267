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
}
