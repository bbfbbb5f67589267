//! Which pixel is which place of the skin: every chart rasterised once, then filled with values.
//!
//! A [`Chart`] says for every pixel of a level's image which face and which place in it the pixel
//! shows. An [`Atlas`] holds the charts of all levels and patches, one image each or packed into
//! one image per level; [`crate::image`] draws values through it. [`LevelImage`] fills the channels
//! of `map.exr`, a band of rows at a time, so that an image of a whole skin need never be in memory
//! at once.
//!
//! In reading order: `rasterize`, `options`, `layout`, `bound`, `chart`, `parts`; `image`, `stretch`,
//! `level_image`.

mod bound;
mod chart;
mod error;
mod image;
mod layout;
mod level_image;
mod options;
mod parts;
mod rasterize;
mod stretch;

pub(crate) use bound::{fitting_pixel, pixels_of};
pub use chart::Chart;
pub use error::AtlasError;
pub use image::{ImageRows, Samples};
pub use level_image::{LevelImage, skin_images};
pub use options::{AtlasOptions, Resolution};
pub use parts::{Atlas, AtlasPart};
pub(crate) use stretch::{Stretch, face_stretch};
