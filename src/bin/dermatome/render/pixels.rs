//! Which pixels images have, and how they follow from the taxels.

use clap::ValueEnum;
use dermatome::{
    atlas::{AtlasOptions, Resolution},
    image::Interpolation,
};

use crate::options::side_mm;

/// Which pixels images have.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Images")]
pub(crate) struct PixelArgs {
    /// How a pixel follows from the taxels around it
    #[arg(long, value_enum, default_value_t = InterpolationArg::Linear)]
    interpolate: InterpolationArg,
    /// Side of a pixel [default: that of the map]
    #[arg(long, value_name = "MM", value_parser = side_mm, conflicts_with = "size")]
    pixel_mm: Option<f64>,
    /// Height and width of every image, in pixels; the map is drawn as large as fits
    #[arg(long, num_args = 2, value_names = ["H", "W"])]
    size: Option<Vec<u32>>,
    /// Draw all patches of a level into one image
    #[arg(long)]
    pack: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum InterpolationArg {
    /// Barycentric between the corners of each triangle
    Linear,
    /// The nearest taxel
    Nearest,
    /// Natural neighbours: taxels without a reading are replaced by those around them
    Natural,
}

impl PixelArgs {
    pub(crate) fn atlas_options(&self) -> AtlasOptions {
        let resolution = match (&self.size, self.pixel_mm) {
            (Some(size), _) => Resolution::Canvas([size[0], size[1]]),
            (None, Some(side)) => Resolution::Pixel(side),
            (None, None) => Resolution::Map,
        };
        AtlasOptions { resolution, packed: self.pack, ..AtlasOptions::default() }
    }

    pub(crate) fn interpolation(&self) -> Interpolation {
        match self.interpolate {
            InterpolationArg::Linear => Interpolation::Linear,
            InterpolationArg::Nearest => Interpolation::Nearest,
            InterpolationArg::Natural => Interpolation::Natural,
        }
    }
}
