//! What is drawn: one frame of values on pixels.

use crate::{map::ImageFrame, pyramid::LevelId};

/// One frame of one image of an atlas.
#[derive(Debug, Clone, PartialEq)]
pub struct TactileImage {
    /// `palm/L0`, or `L0` where charts are packed.
    pub name: String,
    /// The level whose values it shows.
    pub level: LevelId,
    /// Width and height in pixels.
    pub size_px: [u32; 2],
    /// The part of the map that it shows; the area of a pixel follows from it.
    pub frame: ImageFrame,
    /// Number of channels.
    pub channels: usize,
    /// The values, channel by channel, each row by row from the top: NaN where nothing is known.
    /// Intensive channels in their unit, extensive ones in their unit per m^2 of the map.
    pub values: Vec<f32>,
    /// Whether each pixel shows the skin: 1 or 0, row by row from the top. Pixels of the gutter have
    /// values but do not count: the sum of the covered ones times the area of a pixel is the amount
    /// of an extensive channel.
    pub coverage: Vec<u8>,
}
