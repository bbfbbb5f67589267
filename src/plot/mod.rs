//! Pictures of maps and of skins.
//!
//! Pictures show levels side by side at one scale, with their receptive fields or their distortion, and the skin in space.
//!
//! [`plot_map`] and [`plot_skin`] draw a picture as SVG text, [`render_png`] turns one into a PNG with the letters that come with the
//! crate: the same bytes on every machine, fonts installed or not.

mod colour;
mod draw;
mod error;
mod layout;
mod palette;
mod patch_view;
mod plot_map;
mod png;

pub use draw::camera::Viewpoint;
pub use error::PlotError;
pub use plot_map::{Paint, PlotOptions, plot_map, plot_skin};
pub use png::render_png;
