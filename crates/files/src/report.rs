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
use crate::map::{MapLevel, OnPatch, PatchMap, SkinMap};
use crate::mesh::boundary_loops;
use crate::pyramid::LevelId;

/// One patch of a map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatchReport {
    /// Name of the patch.
    pub name: String,
    /// Name of its link.
    pub link: String,
    /// Where it lies on an atlas, if the map is drawn on that of another skin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub atlas: Option<OnPatch>,
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
        atlas: patch.atlas.clone(),
        levels: patch.levels.enumerate().map(level).collect(),
    };
    map.patches.iter().map(patch).collect()
}

/// On what a map of a skin is drawn, in a sentence for the atlas and one for each patch; none for a free map.
pub fn atlas_sentences(map: &SkinMap) -> Vec<String> {
    let Some(on) = &map.atlas else { return Vec::new() };
    let mirrored = if on.is_mirrored { ", mirrored: the skin is that of the other hand" } else { "" };
    let of_patch = |patch: &PatchMap| {
        let OnPatch { patch: of, landmarks, left_out, free_dirichlet } = patch.atlas.as_ref()?;
        let left_out = if *left_out > 0 { format!(", {left_out} left out") } else { String::new() };
        let energy = patch.levels.first()?.distortion.symmetric_dirichlet;
        let above = free_dirichlet.map_or_else(String::new, |free| {
            format!(
                ", {:.3} {} the free map",
                (energy - free).abs(),
                if energy < free { "below" } else { "above" }
            )
        });
        let name = &patch.name;
        Some(format!(
            "{name}: on its patch {of} by {landmarks} landmarks{left_out}; symmetric Dirichlet energy {energy:.3}{above}"
        ))
    };
    let first = format!("on the map of {}{mirrored}", on.name);
    std::iter::once(first).chain(map.patches.iter().filter_map(of_patch)).collect()
}
