//! glTF 2.0, binary (`.glb`) and text (`.gltf`): skins in and out, maps out and in.
//!
//! The types of the `gltf` crate serve both directions, and its validation judges the JSON. Reading
//! never trusts a file: a [`document::Document`] hands out buffers and accessors only after it has
//! checked them against the bytes that are there, and keeps a budget so that a small file cannot ask
//! for much memory; node trees, attributes and triangles are checked where they are read. What is not
//! read is not checked.
//!
//! To read: `json`, `chunks`, `document` (file to JSON and bytes), `accessor` (bytes to numbers), `nodes`,
//! `primitive`, then `read_skin` and `read_map`, and `animation` for how links move. To write:
//! `writer`, `write_skin`, `write_map`, `write_animations`; `extras` is what a map adds
//! to both.

mod accessor;
mod animation;
mod chunks;
mod document;
mod extras;
mod joints;
mod json;
mod nodes;
mod notes;
mod primitive;
mod read_map;
mod read_skin;
mod upright;
mod write_animations;
mod write_map;
mod write_skin;
mod writer;

pub(super) use animation::read_animation;
pub use read_map::{map_from_bytes, read_map};
pub(super) use read_skin::read_gltf;
pub(crate) use write_map::as_in_map_file;
pub use write_map::{map_to_bytes, write_map, write_pyramids};
pub(super) use write_skin::write_skin;
