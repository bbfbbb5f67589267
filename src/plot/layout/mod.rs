//! Where panels, captions, scale bar and legend stand on a picture.

pub(crate) mod caption;
pub(crate) mod grid;
