//! glTF 2.0, binary (`.glb`) and text (`.gltf`): skins in and out, maps out and in.
//!
//! Reading never trusts the file. A [`document::Document`] hands out buffers, views and accessors only after it has
//! checked them against the bytes that are really there, and keeps a budget so that a small file cannot ask for much
//! memory; node trees, attributes and triangles are checked where they are read. Writing goes through the types of the `gltf`
//! crate.

mod accessor;
mod attributes;
mod buffers;
mod container;
mod decode;
mod document;
mod extras;
mod guard;
mod nodes;
mod read_map;
mod read_skin;
mod transform;
mod triangles;
mod write_links;
mod write_map;
mod write_skin;
mod writer;

pub use read_map::{read_map, read_map_if_any};
pub use read_skin::read_gltf;
pub use write_map::{write_map, write_pyramids};
pub use write_skin::{write_skin_glb, write_skin_gltf};
