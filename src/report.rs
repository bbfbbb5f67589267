//! The measures of a build, level by level ([`measure`]), as in `report.json`. Maps are measured in the
//! 32-bit numbers of `map.glb`.
//!
//! ```
//! use dermatome::{mesh::shapes, pipeline, report, skin::Skin};
//!
//! let skin = Skin::from_mesh("palm", shapes::cap(300, 0.05, 1.0));
//! let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
//! let patches = report::measure(&map);
//! assert_eq!(patches[0].levels[0].distortion.flips, 0);
//! # Ok::<(), dermatome::Error>(())
//! ```

use serde::Serialize;

use crate::flatten::{Convergence, Distortion};
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::mesh::boundary_loops;
use crate::pyramid::LevelId;

/// One patch of a map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatchReport {
    /// Name of the patch.
    pub name: String,
    /// Name of its link.
    pub link: String,
    /// Its levels, finest first.
    pub levels: Vec<LevelReport>,
}

/// One level of a [`PatchReport`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LevelReport {
    /// The level; 0 is the skin itself.
    pub level: usize,
    /// Number of vertices: taxels or fields.
    pub vertices: usize,
    /// Number of triangles.
    pub faces: usize,
    /// Length of the seam along which the level is cut, in m; 0 without one.
    pub seam: f64,
    /// Number of boundary loops of the map.
    pub boundary_loops: usize,
    /// How faithful the level's map is.
    #[serde(flatten)]
    pub distortion: Distortion,
    /// How far its minimisation came, where known.
    #[serde(flatten)]
    pub convergence: Option<Convergence>,
}

/// The measures of every patch of a map, in its order.
pub fn measure(map: &SkinMap) -> Vec<PatchReport> {
    let level = |(id, map): (LevelId, &MapLevel)| LevelReport {
        level: id.index(),
        vertices: map.level.mesh.positions.len(),
        faces: map.level.mesh.triangles.len(),
        seam: map.seam_length(),
        boundary_loops: boundary_loops(&map.opened()).len(),
        distortion: map.distortion,
        convergence: map.convergence,
    };
    let patch = |patch: &PatchMap| PatchReport {
        name: patch.name.clone(),
        link: map.links[patch.link].name.clone(),
        levels: patch.levels.enumerate().map(level).collect(),
    };
    map.patches.iter().map(patch).collect()
}
