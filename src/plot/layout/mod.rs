//! Where panels, captions, scale bar and legend stand on a picture.

mod caption;
mod grid;
mod legend;
mod text;
mod view;

pub(crate) use caption::Caption;
pub(crate) use grid::{Layout, Slot};
pub(crate) use text::{number, printable};
pub(crate) use view::View;
