//! Panels: a level on its map, or the skin in space as a camera sees it.

pub(crate) mod camera;
pub(crate) mod depth_buffer;
pub(crate) mod depth_order;
pub(crate) mod outline;
pub(crate) mod panel;
pub(crate) mod svg_path;
pub(crate) mod view;
pub(crate) mod view_3d;
