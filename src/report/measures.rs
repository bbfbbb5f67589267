use serde::Serialize;

use crate::{
    flatten::Distortion,
    map::{PatchMap, SkinMap},
    mesh::{Adjacency, TriMesh},
    pyramid::LevelId,
};

/// What `report.json` holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Version of dermatome that made the map.
    pub version: String,
    /// The file it was made from.
    pub input: String,
    /// Wall-clock seconds by stage, in the order of the stages.
    pub seconds: Stages,
    /// Largest resident memory of the process, where the system tells it.
    pub peak_memory_bytes: Option<u64>,
    /// The patches, in the order of the map.
    pub patches: Vec<PatchReport>,
}

/// Wall-clock seconds of a build.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Stages {
    /// Reading and assembling the skin.
    pub read: f64,
    /// Making the pyramids.
    pub coarsen: f64,
    /// Making the maps of every level.
    pub flatten: f64,
    /// Making the images.
    pub rasterise: f64,
    /// Writing the map and the images.
    pub write: f64,
}

/// One patch of a [`Report`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatchReport {
    /// Name of the patch.
    pub name: String,
    /// Name of its link.
    pub link: String,
    /// Its levels, finest first.
    pub levels: Vec<LevelReport>,
}

/// One level of a [`PatchReport`]; the measures are those of [`crate::flatten::Distortion`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[allow(missing_docs, reason = "named as in Distortion, which tells their meaning")]
pub struct LevelReport {
    pub level: usize,
    pub vertices: usize,
    pub faces: usize,
    pub boundary_loops: usize,
    pub flips: usize,
    pub crossings: usize,
    pub qc_mean: f64,
    pub qc_max: f64,
    pub area_mean: f64,
    pub area_max: f64,
    pub symmetric_dirichlet: f64,
}

impl LevelReport {
    /// The counts and measures of one level.
    #[must_use]
    pub fn new(level: LevelId, mesh: &TriMesh, d: &Distortion) -> Self {
        Self {
            level: level.index(),
            vertices: mesh.positions.len(),
            faces: mesh.triangles.len(),
            boundary_loops: Adjacency::new(mesh).map_or(0, |a| a.boundary_loops().len()),
            flips: d.flips,
            crossings: d.crossings,
            qc_mean: d.qc_mean,
            qc_max: d.qc_max,
            area_mean: d.area_mean,
            area_max: d.area_max,
            symmetric_dirichlet: d.symmetric_dirichlet,
        }
    }
}

/// The patches of a map, as a [`Report`] tells them.
#[must_use]
pub fn measure(map: &SkinMap) -> Vec<PatchReport> {
    let levels = |patch: &PatchMap| {
        patch.levels.enumerate().map(|(k, l)| LevelReport::new(k, &l.mesh, &l.distortion)).collect()
    };
    map.patches
        .iter()
        .map(|patch| PatchReport {
            name: patch.name.clone(),
            link: map.links[patch.link].name.clone(),
            levels: levels(patch),
        })
        .collect()
}
