//! Somatosensory maps: every patch with every level, its map and how they are joined.
//!
//! A [`SkinMap`] is what `map.glb` holds and all that lookup and images need; it can be made from
//! a skin or read back from a file.

mod carried_places;
mod error;
mod frame;
mod skin_map;

pub(crate) use carried_places::{CarriedRow, carried_places, carried_rows};
pub use error::MapError;
pub use frame::ImageFrame;
pub(crate) use frame::PixelGrid;
pub use skin_map::{MapLevel, PatchMap, SkinMap};
