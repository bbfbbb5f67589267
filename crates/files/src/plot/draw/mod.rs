//! Panels: a level on its map, or the skin in space from a camera.

mod camera;
mod drawn_mesh;
mod depth_buffer;
mod map_view;
mod outline;
mod panel;
mod view_3d;

pub(crate) use camera::Camera;
pub(crate) use panel::Panel;
