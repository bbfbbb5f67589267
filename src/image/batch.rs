//! Frames of a recording drawn side by side, sixteen at a time, where the same taxels have readings in all of them.
//!
//! A face is a plane in each frame, and the planes of sixteen frames are computed at once; so are the sixteen values of
//! a pixel, which strips of pixels carry to their images. Every number follows from the same operations in the same
//! order as in [`Renderer::render`], so it has the same bits.

use std::ops::Range;

use crate::image::layer::Layer;
use crate::image::runs::{AT_ONCE, PlanesAtOnce};
use crate::image::{Renderer, Tile};
use crate::pyramid::LevelId;
use crate::signal::{Frame, Restrictor};

/// Draws many frames of readings into images of one part of an atlas: the first of the renderer. One thread.
#[derive(Debug, Clone)]
pub struct BatchRenderer {
    restrictor: Restrictor,
    renderer: Renderer,
    frame: Frame,
    /// Of every channel of every tile the values of its vertices.
    values: Vec<Vec<[f64; AT_ONCE]>>,
    planes: Vec<PlanesAtOnce>,
    /// The pixels that show no skin.
    gaps: Vec<Range<usize>>,
}

impl BatchRenderer {
    /// What draws frames like `frame`, which is written over.
    #[must_use]
    pub fn new(restrictor: Restrictor, renderer: Renderer, frame: Frame) -> Self {
        let (mut gaps, mut end) = (Vec::new(), 0);
        for run in renderer.images[0].coverage.chunk_by(|a, b| a == b) {
            end += run.len();
            if run[0] == 0 {
                gaps.push(end - run.len()..end);
            }
        }
        Self { restrictor, renderer, frame, values: Vec::new(), planes: Vec::new(), gaps }
    }

    /// Draws frames into images, one after the other as [`TactileImage::values`](crate::image::TactileImage::values):
    /// the same bits as [`Restrictor::restrict`] and [`Renderer::render`] give. `read` fills the frame of an image by
    /// its number; it may be called twice for one.
    ///
    /// # Panics
    /// As those two.
    pub fn render(&mut self, mut read: impl FnMut(usize, &mut Frame), images: &mut [f32]) {
        let size = self.renderer.images[0].values.len();
        for (images, first) in images.chunks_mut(AT_ONCE * size).zip((0..).step_by(AT_ONCE)) {
            let mut read = |k: usize, frame: &mut Frame| read(first + k, frame);
            if images.len() == AT_ONCE * size && self.render_at_once(&mut read, images) {
                continue;
            }
            for (k, image) in images.chunks_mut(size).enumerate() {
                read(k, &mut self.frame);
                image.copy_from_slice(&self.renderer.render(self.restrictor.restrict(&self.frame))[0].values);
            }
        }
    }

    /// Draws sixteen frames unless taxels come or go among them, or pixels do not follow planes.
    fn render_at_once(&mut self, read: &mut dyn FnMut(usize, &mut Frame), images: &mut [f32]) -> bool {
        let (size, count) = (self.renderer.images[0].values.len(), self.renderer.images[0].coverage.len());
        for (k, image) in images.chunks_mut(size).enumerate() {
            read(k, &mut self.frame);
            if !self.put_aside(k) {
                if k > 0 {
                    return false;
                }
                // The renderer learns which taxels have readings.
                self.renderer.render(self.restrictor.restrict(&self.frame));
                if !self.put_aside(k) {
                    return false;
                }
            }
            for pixels in image.chunks_mut(count) {
                self.gaps.iter().for_each(|gap| pixels[gap.clone()].fill(f32::NAN));
            }
        }
        for ((tile, channel, layer), values) in layers(&self.renderer).zip(&self.values) {
            layer.draw_at_once(&tile.surface, values, &mut self.planes, &mut images[channel * count..], size);
        }
        true
    }

    /// Puts the values of frame `k` of sixteen next to those of the others; false if other taxels have readings than
    /// when the renderer drew last.
    fn put_aside(&mut self, k: usize) -> bool {
        let level = self.renderer.images[0].level;
        let levels = (level > LevelId::new(0)).then(|| self.restrictor.restrict(&self.frame));
        self.values.resize_with(layers(&self.renderer).count(), Vec::new);
        layers(&self.renderer).zip(&mut self.values).all(|((tile, channel, layer), aside)| {
            let values = match levels {
                Some(levels) => &levels.values[tile.patch][channel][level],
                None => &self.frame.values[tile.patch][channel],
            };
            layer.put_aside(values, k, aside)
        })
    }
}

/// The layers of the first image, with their tile and channel.
fn layers(renderer: &Renderer) -> impl Iterator<Item = (&Tile, usize, &Layer)> {
    let tiles = renderer.tiles[0].iter();
    tiles.flat_map(|tile| tile.layers.iter().enumerate().map(move |(channel, layer)| (tile, channel, layer)))
}
