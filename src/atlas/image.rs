//! Images as rows of named channels, which `io::image` writes: in memory, or a band at a time.

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

    /// What the samples are.
    pub(crate) const fn kind(&self) -> SampleKind {
        match self {
            Self::F32(_) => SampleKind::F32,
            Self::U32(_) => SampleKind::U32,
        }
    }

    /// The samples of `range`; none if there are not that many.
    fn slice(&self, range: Range<usize>) -> Self {
        match self {
            Self::F32(x) => Self::F32(x.get(range).unwrap_or_default().to_vec()),
            Self::U32(x) => Self::U32(x.get(range).unwrap_or_default().to_vec()),
        }
    }
}

/// What a channel's samples are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleKind {
    /// 32-bit floats.
    F32,
    /// 32-bit unsigned integers.
    U32,
}

/// One channel of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name, as `position.X`.
    pub name: String,
    /// Its values: width times height, row by row from the top.
    pub samples: Samples,
}

/// An image of one level: plain pixels in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct TactileImage {
    /// Patch and level, as `palm/L0`.
    pub name: String,
    /// The part of the map it shows, and its size in pixels.
    pub frame: ImageFrame,
    /// The channels, all of the same size.
    pub channels: Vec<Channel>,
}

impl TactileImage {
    /// The channel of that name, if there is one.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<&Samples> {
        self.channels.iter().find(|c| c.name == name).map(|c| &c.samples)
    }
}

/// An image that is asked for a band of rows at a time, so that it need not be in memory as a
/// whole.
pub trait ImageRows: Sync {
    /// Patch and level, as `palm/L0`.
    fn name(&self) -> &str;

    /// The part of the map it shows, and its size in pixels.
    fn frame(&self) -> &ImageFrame;

    /// The names of the channels, as `position.X`, and what their samples are.
    fn channels(&self) -> Vec<(String, SampleKind)>;

    /// The samples of the channels in that order, for `rows` counted from the top: width times the
    /// number of rows each. The rows lie inside of the image.
    fn rows(&self, rows: Range<u32>) -> Vec<Samples>;
}

impl ImageRows for TactileImage {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame(&self) -> &ImageFrame {
        &self.frame
    }

    fn channels(&self) -> Vec<(String, SampleKind)> {
        self.channels.iter().map(|c| (c.name.clone(), c.samples.kind())).collect()
    }

    fn rows(&self, rows: Range<u32>) -> Vec<Samples> {
        let at = |row: u32| row as usize * self.frame.size_px[0] as usize;
        self.channels.iter().map(|c| c.samples.slice(at(rows.start)..at(rows.end))).collect()
    }
}
