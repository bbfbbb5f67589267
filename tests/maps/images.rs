//! Images that are in memory as a whole: what files are compared with.

use std::ops::Range;

use dermatome::{
    atlas::{ImageRows, Samples},
    map::ImageFrame,
};
use rayon::prelude::*;

/// One channel of an image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Channel {
    pub(crate) name: String,
    pub(crate) samples: Samples,
}

/// An image of one level.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WholeImage {
    pub(crate) name: String,
    pub(crate) frame: ImageFrame,
    pub(crate) channels: Vec<Channel>,
}

impl WholeImage {
    /// All rows of an image, in bands of 16.
    pub(crate) fn of(image: &impl ImageRows) -> Self {
        let height = image.frame().size_px[1];
        let bands: Vec<_> = (0..height.div_ceil(16))
            .into_par_iter()
            .map(|band| image.rows(16 * band..height.min(16 * (band + 1))))
            .collect();
        let empty = image.channels().into_iter().zip(image.rows(0..0));
        let mut channels: Vec<_> = empty.map(|(name, samples)| Channel { name, samples }).collect();
        for part in bands.into_iter().flat_map(|band| band.into_iter().enumerate()) {
            match (&mut channels[part.0].samples, part.1) {
                (Samples::F32(all), Samples::F32(part)) => all.extend(part),
                (Samples::U32(all), Samples::U32(part)) => all.extend(part),
                (all, part) => panic!("{part:?} in a channel of {all:?}"),
            }
        }
        Self { name: image.name().to_owned(), frame: *image.frame(), channels }
    }

    /// The channel of that name, if there is one.
    pub(crate) fn channel(&self, name: &str) -> Option<&Samples> {
        self.channels.iter().find(|c| c.name == name).map(|c| &c.samples)
    }
}

impl ImageRows for WholeImage {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame(&self) -> &ImageFrame {
        &self.frame
    }

    fn channels(&self) -> Vec<String> {
        self.channels.iter().map(|c| c.name.clone()).collect()
    }

    fn rows(&self, rows: Range<u32>) -> Vec<Samples> {
        let at = |row: u32| row as usize * self.frame.size_px[0] as usize;
        let range = at(rows.start)..at(rows.end);
        let slice = |c: &Channel| match &c.samples {
            Samples::F32(x) => Samples::F32(x.get(range.clone()).unwrap_or_default().to_vec()),
            Samples::U32(x) => Samples::U32(x.get(range.clone()).unwrap_or_default().to_vec()),
        };
        self.channels.iter().map(slice).collect()
    }
}
