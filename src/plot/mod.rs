//! Pictures of maps and of skins, as SVG or PNG.
//!
//! A picture shows levels side by side at one scale, with their receptive fields or their
//! distortion, and the skin in space. [`plot_map`] and [`plot_skin`] lay out a [`Picture`], as does
//! [`plot_frame`] with the readings of one moment; [`Picture::to_svg`] and [`Picture::to_png`] write
//! it. [`image_png`] gives the pixels of a tactile image their colours.
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
//!
//! In reading order: [`plot_map`] and [`plot_frame`] choose patches and levels, `draw` makes a panel
//! of each (a level on its map, or the skin in space; `robot` is all patches as one), `colour` chooses
//! the colours, `layout` positions panels, captions and legends, and `picture` is the list of shapes
//! that comes out.

mod colour;
mod draw;
mod error;
mod image_png;
mod layout;
mod options;
mod patch_view;
mod picture;
mod plot_frame;
mod plot_map;
mod robot;

pub use error::PlotError;
pub use image_png::{ImageOptions, image_png};
pub use options::{Paint, PlotOptions, Viewpoint};
pub use picture::Picture;
pub use plot_frame::plot_frame;
pub use plot_map::{plot_map, plot_skin};
