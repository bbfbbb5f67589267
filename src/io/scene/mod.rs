//! glTF 2.0, binary (`.glb`) and text (`.gltf`): skins in and out, maps out and in.
//!
//! Reading never trusts the file. A [`document::Document`] hands out buffers, views and accessors only after it has
//! checked them against the bytes that are really there, and keeps a budget so that a small file cannot ask for much
//! memory; node trees, attributes and triangles are checked where they are read. Writing goes through the types of the `gltf`
//! crate.

mod accessor;
mod attributes;
mod buffers;
mod document;
mod gather;
mod level_extras;
mod links_out;
mod map_in;
mod map_out;
mod nodes;
mod schema;
mod skin_in;
mod skin_out;
mod triangles;
mod write;

pub use map_in::{read_map, read_map_if_any};
pub use map_out::{write_map, write_pyramids};
pub use skin_in::read_gltf;
pub use skin_out::{write_skin_glb, write_skin_gltf};
