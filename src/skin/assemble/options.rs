//! How a draft is assembled, and what comes of it.

use glam::DVec3;

use crate::{
    mesh::FillHoles,
    skin::{
        Remark, Skin,
        weld::options::{Weld, WeldOptions},
    },
};

/// How a draft is assembled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AssembleOptions {
    /// Longest edge between bare taxels over the spacing of the taxels at its ends, from 1 to 20.
    /// What is longer spans a real gap, and a boundary stays there.
    pub gap: f64,
    /// Which holes are filled; the longest loop of a patch is its outer boundary and stays, but for a
    /// pin-hole of a closed body.
    pub fill_holes: FillHoles,
    /// Which vertices at one place are one taxel.
    pub weld: Weld,
    /// Drop faces with the corners of an earlier one, split edges with more than two faces into solids
    /// that touch there or sheets that continue each other, and cut surfaces with one side open.
    pub repair: bool,
    /// Where the outside of bare taxels is, as a direction in the frame of their link, for components
    /// of which neither normals nor anything else of the file tells it.
    pub outside: Option<DVec3>,
    /// Leave out the sheets that cannot be repaired, instead of refusing the draft.
    pub keep_going: bool,
}

impl AssembleOptions {
    pub(in crate::skin) const fn welding(&self) -> WeldOptions {
        WeldOptions { weld: self.weld, repair: self.repair }
    }
}

impl Default for AssembleOptions {
    fn default() -> Self {
        Self {
            gap: 2.5,
            fill_holes: FillHoles::None,
            weld: Weld::Auto,
            repair: false,
            outside: None,
            keep_going: false,
        }
    }
}

/// A skin, and what had to be done to get it.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// The skin.
    pub skin: Skin,
    /// What was changed or left out, sheet by sheet.
    pub remarks: Vec<Remark>,
}
