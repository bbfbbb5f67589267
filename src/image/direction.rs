//! One channel of one chart as it is drawn: numbers, or directions.
//!
//! A pixel shows the direction of the weighted mean of the unit vectors behind it: angles jump where a
//! turn is full, vectors do not.

use crate::{
    id::{IdVec, VertexId},
    image::{layer::Layer, tile::Tile},
    signal::Quantity,
};

/// What a channel of a tile is drawn with.
#[derive(Debug, Clone)]
pub(super) enum ChannelLayer {
    Numbers(Box<Layer>),
    Directions(Box<Directions>),
}

/// Directions, drawn by their cosines and sines.
#[derive(Debug, Clone)]
pub(super) struct Directions {
    parts: [Layer; 2],
    /// The cosines or sines of one frame.
    values: IdVec<VertexId, f64>,
}

/// Cosines and sines of the directions on the pixels of an image; empty for other channels.
pub(super) type DirectionPixels = [Vec<f32>; 2];

impl ChannelLayer {
    /// A layer that shows nothing.
    pub(super) fn new(tile: &Tile<'_>, quantity: Quantity) -> Self {
        let layer = || Layer::new(tile, quantity);
        match quantity {
            Quantity::Intensive | Quantity::Extensive => Self::Numbers(Box::new(layer())),
            Quantity::Direction => Self::Directions(Box::new(Directions {
                parts: [layer(), layer()],
                values: IdVec::filled(f64::NAN, tile.values),
            })),
        }
    }

    /// Draws values into the pixels of its channel, which hold what it drew last.
    pub(super) fn draw(
        &mut self,
        tile: &Tile<'_>,
        values: &IdVec<VertexId, f64>,
        drawn: &mut DirectionPixels,
        pixels: &mut [f32],
    ) {
        match self {
            Self::Numbers(layer) => {
                layer.draw(tile, values, pixels);
            }
            Self::Directions(directions) => directions.draw(tile, values, drawn, pixels),
        }
    }
}

impl Directions {
    fn draw(
        &mut self,
        tile: &Tile<'_>,
        angles: &IdVec<VertexId, f64>,
        drawn: &mut DirectionPixels,
        pixels: &mut [f32],
    ) {
        assert_eq!(angles.len(), self.values.len(), "one value per vertex");
        let mut any = false;
        for ((layer, drawn), part) in self.parts.iter_mut().zip(&mut *drawn).zip([f64::cos, f64::sin]) {
            self.values.iter_mut().zip(angles).for_each(|(x, &angle)| *x = part(angle));
            any |= layer.draw(tile, &self.values, drawn);
        }
        if any {
            let [cosines, sines] = drawn;
            for run in &tile.surface.runs.all {
                for at in (run.at as usize..).take(run.length.into()) {
                    pixels[at] = sines[at].atan2(cosines[at]);
                }
            }
            tile.gutter.fill(pixels);
        }
    }
}
