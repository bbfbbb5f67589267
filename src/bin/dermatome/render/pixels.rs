//! Which pixels images have, and how they follow from the taxels.

use dermatome::{
    atlas::{AtlasOptions, Resolution},
    image::Interpolation,
};

use crate::options::{Choice, one_of, side_mm};

/// Which pixels images have.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Images")]
pub(crate) struct PixelArgs {
    /// How a pixel follows from the taxels around it
    #[arg(long, value_parser = one_of(&INTERPOLATIONS), default_value = "linear")]
    pub(super) interpolate: Interpolation,
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

const INTERPOLATIONS: [Choice<Interpolation>; 3] = [
    ("linear", Interpolation::Linear, "Barycentric between the corners of each triangle"),
    ("nearest", Interpolation::Nearest, "The nearest taxel"),
    (
        "natural",
        Interpolation::Natural,
        "Natural neighbours: taxels without a reading are replaced by those around them",
    ),
];

impl PixelArgs {
    pub(crate) fn atlas_options(&self) -> AtlasOptions {
        let resolution = match (&self.size, self.pixel_mm) {
            (Some(size), _) => Resolution::Canvas([size[0], size[1]]),
            (None, Some(side)) => Resolution::Pixel(side),
            (None, None) => Resolution::Map,
        };
        AtlasOptions { resolution, packed: self.pack, ..AtlasOptions::default() }
    }
}
