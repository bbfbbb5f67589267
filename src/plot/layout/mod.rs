//! Where panels, captions, scale bar and legend stand on a picture.

mod caption;
mod grid;
mod legend;
mod text;

pub(crate) use caption::Caption;
pub(crate) use grid::{Layout, Slot, View, lay_out, slots};
pub(crate) use text::{minus, number, printable, signed, ticks};
