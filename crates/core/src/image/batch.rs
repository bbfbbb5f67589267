//! Draws frames of a recording sixteen at a time, if the same taxels have readings in all of them.
//!
//! A face is a plane in each frame, and the planes of sixteen frames are computed at once; so are the sixteen
//! values of a pixel, which are copied to their images in strips of pixels. Every number follows from the
//! same operations in the same order as in [`Renderer::render`], so it has the same bits.

use crate::image::layer::Layer;
use crate::image::runs::{AT_ONCE, PlanesAtOnce};
use crate::image::{Renderer, TactileImage, Tile};
use crate::numeric::storable;
use crate::pyramid::LevelId;
use crate::signal::{Frame, Restrictor};

/// Draws many frames of readings into the first image of a renderer, on one thread.
#[derive(Debug, Clone)]
pub struct BatchRenderer {
    restrictor: Restrictor,
    renderer: Renderer,
    frame: Frame,
    /// For every channel of every tile the readings of its patch, and the values of its level.
    readings: Vec<Vec<[f64; AT_ONCE]>>,
    values: Vec<[f64; AT_ONCE]>,
    planes: Vec<PlanesAtOnce>,
}

impl BatchRenderer {
    /// A renderer of frames of the shape of `frame`, which is overwritten.
    #[must_use]
    pub fn new(restrictor: Restrictor, renderer: Renderer, frame: Frame) -> Self {
        let taxels = |(tile, channel, _): (&Tile, usize, &Layer)| frame.values[tile.patch][channel].len();
        let readings = layers(&renderer).map(|layer| vec![[0.0; AT_ONCE]; taxels(layer)]).collect();
        Self { restrictor, renderer, frame, readings, values: Vec::new(), planes: Vec::new() }
    }

    /// Draws frames into images, each laid out as
    /// [`TactileImage::values`](crate::image::TactileImage::values): the same bits as
    /// [`Restrictor::restrict`] and [`Renderer::render`] give. `read` fills the frame of an image by its
    /// index; it may be called twice for one frame.
    ///
    /// # Panics
    /// As those two.
    pub fn render(&mut self, mut read: impl FnMut(usize, &mut Frame), images: &mut [f32]) {
        // No channel, no pixel: nothing to draw.
        let size = self.renderer.images[0].values.len().max(1);
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

    /// Draws sixteen frames; does nothing and returns `false` if the taxels with readings change among them.
    fn render_at_once(&mut self, read: &mut dyn FnMut(usize, &mut Frame), images: &mut [f32]) -> bool {
        for k in 0..AT_ONCE {
            read(k, &mut self.frame);
            for ((tile, channel, _), readings) in layers(&self.renderer).zip(&mut self.readings) {
                for (of_frames, &x) in readings.iter_mut().zip(&self.frame.values[tile.patch][channel]) {
                    of_frames[k] = storable(x);
                }
            }
        }
        if !self.fits() {
            // The renderer learns which taxels have readings.
            self.renderer.render(self.restrictor.restrict(&self.frame));
            if !self.fits() {
                return false;
            }
        }
        let TactileImage { values: drawn, coverage, .. } = &self.renderer.images[0];
        // Sets the pixels that show no skin.
        images.chunks_mut(drawn.len()).for_each(|image| image.copy_from_slice(drawn));
        for ((tile, channel, layer), readings) in layers(&self.renderer).zip(&mut self.readings) {
            let values = if tile.level > LevelId::new(0) {
                let values = &mut self.values;
                self.restrictor.restrict_at_once(tile.patch, channel, tile.level, readings, values);
                if !layer.fits(values) {
                    return false;
                }
                values
            } else {
                readings
            };
            let images = &mut images[channel * coverage.len()..];
            layer.draw_at_once(&tile.surface, values, &mut self.planes, images, drawn.len());
        }
        true
    }

    /// Whether the same taxels have readings as in the frame that was drawn last.
    fn fits(&self) -> bool {
        layers(&self.renderer).zip(&self.readings).all(|((tile, channel, layer), readings)| {
            if tile.level > LevelId::new(0) {
                self.restrictor.fits(tile.patch, channel, readings)
            } else {
                layer.fits(readings)
            }
        })
    }
}

/// The layers of the first image, with their tile and channel.
fn layers(renderer: &Renderer) -> impl Iterator<Item = (&Tile, usize, &Layer)> {
    let tiles = renderer.tiles[0].iter();
    tiles.flat_map(|tile| tile.layers.iter().enumerate().map(move |(channel, layer)| (tile, channel, layer)))
}
