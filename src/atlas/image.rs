//! Images as rows of named channels, which `io::image` writes a band at a time.

use std::ops::Range;

use crate::map::ImageFrame;

/// The values of one channel, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// Measures.
    F32(Vec<f32>),
    /// Ids.
    U32(Vec<u32>),
}

impl Samples {
    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::F32(x) => x.len(),
            Self::U32(x) => x.len(),
        }
    }
}

/// An image that is asked for a band of rows at a time, so that it need not be in memory as a
/// whole.
pub trait ImageRows: Sync {
    /// Patch and level, as `palm/L0`.
    fn name(&self) -> &str;

    /// The part of the map it shows, and its size in pixels.
    fn frame(&self) -> &ImageFrame;

    /// The names of the channels, as `position.X`.
    fn channels(&self) -> Vec<String>;

    /// The samples of the channels in that order, for `rows` counted from the top: width times the
    /// number of rows each, always of the same type. The rows lie inside of the image; there may be
    /// none.
    fn rows(&self, rows: Range<u32>) -> Vec<Samples>;
}
