//! Tactile images: every chart rasterised once, then filled with values.
//!
//! A [`Chart`] says for every pixel of a level's image which face and which place in it the pixel
//! shows. [`LevelImage`] fills the channels of `map.exr` from it, a band of rows at a time, so that
//! an image of a whole skin need never be in memory at once.

mod chart;
mod error;
mod image;
mod level_image;
mod rasterize;
mod stretch;

pub use chart::Chart;
pub use error::AtlasError;
pub use image::{ImageRows, SampleKind, Samples};
pub use level_image::{LevelImage, skin_images};
pub use stretch::{Stretch, face_stretch};
