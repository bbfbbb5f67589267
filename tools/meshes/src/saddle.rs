//! A bumpy saddle: strongly curved both ways, as between thumb and palm.

use dermatome::{mesh::shapes, skin::Skin};

use crate::grid::snapped;

/// Taxels along each side.
const COLUMNS: u32 = 100;

/// 10 000 taxels on a saddle of 0.2 m with bumps.
pub fn saddle() -> Skin {
    Skin::from_mesh("saddle", snapped(shapes::saddle(COLUMNS)))
}
