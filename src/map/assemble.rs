use glam::DVec2;

use crate::{
    flatten::distortion,
    id::{IdVec, VertexId},
    map::{MapFrame, MapLevel, PatchMap},
    pyramid::{Level, LevelId, Pyramid},
    skin::Patch,
};

impl PatchMap {
    /// Joins a patch, its pyramid and the maps of its levels (m); images have `pixel` metres per pixel.
    #[must_use]
    pub fn new(
        patch: &Patch,
        pyramid: Pyramid,
        maps: IdVec<LevelId, IdVec<VertexId, DVec2>>,
        pixel: f64,
    ) -> Self {
        let levels = pyramid.levels.into_iter().zip(maps);
        Self {
            name: patch.name.clone(),
            link: patch.link,
            ids: patch.taxels.ids.clone(),
            covariances: patch.taxels.covariances.clone(),
            levels: levels.map(|(level, uv)| MapLevel::new(patch, level, uv, pixel)).collect(),
        }
    }
}

impl MapLevel {
    fn new(patch: &Patch, level: Level, uv: IdVec<VertexId, DVec2>, pixel: f64) -> Self {
        Self {
            normals: level.origins.map(|&taxel| patch.taxels.normals[taxel]),
            distortion: distortion(&level.mesh, &uv),
            frame: MapFrame::around(&uv, pixel),
            mesh: level.mesh,
            areas: level.areas,
            origins: level.origins,
            uv,
            up: level.up,
            direct: level.direct,
        }
    }
}
