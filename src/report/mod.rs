//! What a build tells about itself: measures ([`measure`]) and pictures of maps.
//!
//! Pictures show levels side by side at one scale, with their receptive fields or their distortion.
//!
//! [`plot_map`] draws a picture as SVG text, [`render_png`] turns one into a PNG with the letters that come with the
//! crate: the same bytes on every machine, fonts installed or not.

mod cells;
mod colours;
mod error;
mod layout;
mod measures;
mod outline;
mod panel;
mod path;
mod plot;
mod png;

pub use error::ReportError;
pub use measures::{LevelReport, PatchReport, Report, Stages, measure};
pub use plot::{Paint, PlotOptions, plot_map};
pub use png::render_png;
