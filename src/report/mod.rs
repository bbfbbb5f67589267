//! What a build tells about itself: measures ([`measure`]) and pictures of maps.
//!
//! Pictures show levels side by side at one scale, with their receptive fields or their distortion, and the skin in space.
//!
//! [`plot_map`] and [`plot_skin`] draw a picture as SVG text, [`render_png`] turns one into a PNG with the letters that come with the
//! crate: the same bytes on every machine, fonts installed or not.

mod camera;
mod caption;
mod cells;
mod coat;
mod colours;
mod depth;
mod error;
mod layout;
mod measures;
mod order;
mod outline;
mod palette;
mod panel;
mod path;
mod plot;
mod png;
mod range;
mod space;
mod subject;

pub use camera::Viewpoint;
pub use error::ReportError;
pub use measures::{LevelReport, PatchReport, Report, Stages, measure};
pub use plot::{Paint, PlotOptions, plot_map, plot_skin};
pub use png::render_png;
