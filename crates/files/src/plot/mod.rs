//! Pictures of maps and of skins, as SVG or PNG.
//!
//! A picture shows levels side by side at one scale, with their receptive fields or their distortion, and the
//! skin in space. [`plot_map`] and [`plot_skin`] lay out a [`Picture`], as does [`plot_frame`] with the
//! readings of one frame; [`Picture::to_svg`] and [`Picture::to_png`] write it. [`image_png`] colours the
//! pixels of a tactile image. [`plot_diff`] draws what changed between two files of one skin, [`plot_signals`] the map
//! from signals next to the true one.
//!
//! ```
//! use dermatome::{mesh::shapes, pipeline, plot, skin::Skin};
//!
//! let skin = Skin::from_mesh("palm", shapes::cap(300, 0.05, 1.0));
//! let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
//! let picture = plot::plot_map(&map, &plot::PlotOptions { width_px: 800, ..Default::default() })?;
//! assert!(picture.to_svg().contains("palm, level 0"));
//! assert!(picture.to_png()?.starts_with(b"\x89PNG"));
//! # Ok::<(), dermatome::Error>(())
//! ```

mod colour;
mod draw;
mod error;
mod image_png;
mod layout;
mod patch_view;
mod picture;
mod plot_design;
mod plot_diff;
mod plot_frame;
mod plot_map;
mod plot_signals;

use crate::body::FieldLevel;
use crate::pyramid::LevelId;

pub(crate) use colour::DIVERGING;
pub use error::PlotError;
pub use image_png::{ImageOptions, image_png, value_colour};
pub(crate) use layout::{number, printable};
pub use picture::Picture;
pub use plot_design::{DesignedPatch, plot_design};
pub use plot_diff::plot_diff;
pub use plot_frame::{FramePlotter, colour_range, plot_frame};
pub use plot_map::{plot_map, plot_skin};
pub use plot_signals::plot_signals;

/// The quantity that the colours of a plot show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Paint {
    /// The receptive field to which each taxel belongs most; neighbouring fields have different colours.
    #[default]
    Fields,
    /// `s1/s2` of each triangle.
    Angle,
    /// `s1 s2` of each triangle: its area on the map over that on the skin.
    Area,
    /// The uncertainty of each taxel's position: the square root of the trace of its covariance.
    Sigma,
    /// The named region of each taxel; neighbouring regions have different colours, and maps have their names.
    Regions,
}

impl Paint {
    /// Whether the centres of taxels or fields are shown: if the colours are those of single taxels or
    /// fields.
    pub(crate) fn has_dots(self) -> bool {
        matches!(self, Self::Fields | Self::Sigma | Self::Regions)
    }
}

/// Options of a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotOptions {
    /// Names of the patches, one row each; none: all.
    pub patches: Vec<String>,
    /// The levels, side by side; none: the finest three. A patch that lacks a level leaves its slot
    /// empty.
    pub levels: Vec<LevelId>,
    /// Levels of the whole body and of modalities, next to these where readings are drawn: their values at the taxels, on
    /// level 0.
    pub field_levels: Vec<FieldLevel>,
    /// The quantity that the colours show; not used for readings.
    pub paint: Paint,
    /// The viewpoint of the skin in space, next to its maps; `None`: the maps alone.
    pub space: Option<Viewpoint>,
    /// Times at which the skin is drawn as it unfolds, side by side: 0 is the skin in space, 1 its map. None:
    /// levels are drawn instead.
    pub unfold: Vec<f64>,
    /// Values at the ends of the scale of colours: of [`Paint::Angle`], [`Paint::Area`] or
    /// [`Paint::Sigma`] (m), or of readings in the unit of their channel, of an extensive one per m^2.
    /// `None`: the rounded range of all but a hundredth of the drawn values, of readings that of all.
    pub range: Option<[f64; 2]>,
    /// Width of the picture, in pixels.
    pub width_px: u32,
}

impl Default for PlotOptions {
    fn default() -> Self {
        Self {
            patches: Vec::new(),
            levels: Vec::new(),
            field_levels: Vec::new(),
            paint: Paint::default(),
            space: None,
            unfold: Vec::new(),
            range: None,
            width_px: 1600,
        }
    }
}

/// The viewpoint of a skin, in the frame of the world.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Viewpoint {
    /// From outside: along the mean normal of each patch, tilted so that its shape shows.
    #[default]
    Outside,
    /// From one direction.
    From {
        /// Angle from x towards y, in radians.
        azimuth: f64,
        /// Angle above the xy plane, in radians.
        elevation: f64,
    },
}
