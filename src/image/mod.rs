//! Values on pixels: tactile images from frames through an atlas, and back.
//!
//! A pixel is a weighted sum of the values of a few vertices: [`Interpolation`] says which. In the
//! linear case the sum is a plane over each face, so a frame costs one plane for each face and then
//! one addition and one multiplication for each pixel; faces of few pixels are drawn pixel by pixel.
//! [`Renderer`] keeps what it drew and draws anew only the faces around the values that changed.
//!
//! Intensive channels keep their values: a constant pressure is a constant image. Extensive channels
//! are drawn per area and keep their total: with the weights `w` of the pixels, each of area `A`,
//! the amount `f` of a vertex is drawn as `f / (A sum w)`, so the covered pixels times `A` add up to
//! the sum of all amounts, whatever the size of the pixels. An amount that no pixel shows is given
//! to the nearest one.
//!
//! Directions are drawn as unit vectors.
//!
//! [`sample`] goes back: from images to the values that they show, by least squares.
//!
//! In reading order: `options`, `tactile_image`; `weights` (pixels in terms of vertices); `tile`, `layer` (what changed), `direction`, `renderer`; `sample`.

mod direction;
mod error;
mod layer;
mod options;
mod renderer;
mod sample;
mod tactile_image;
mod tile;
mod weights;

pub use error::ImageError;
pub use options::{Interpolation, RenderOptions};
pub(crate) use renderer::surface_of;
pub use renderer::{Renderer, static_images};
pub use sample::{Sampled, sample};
pub use tactile_image::TactileImage;
