//! A patch as pictures see it, with its map or without.

use glam::DAffine3;

use crate::{
    id::{IdVec, VertexId},
    map::{MapLevel, PatchMap, SkinMap},
    mesh::TriMesh,
    plot::PlotError,
    pyramid::LevelId,
    skin::{Covariance, Patch, Presence, Skin, TaxelId, world_pose},
};

pub(crate) struct PatchView<'a> {
    pub(crate) name: &'a str,
    /// The taxels and the triangles between them, in the link's frame.
    pub(crate) mesh: &'a TriMesh,
    pub(crate) pose: DAffine3,
    pub(crate) ids: &'a IdVec<VertexId, TaxelId>,
    presence: &'a IdVec<VertexId, Presence>,
    covariances: Option<&'a IdVec<VertexId, Covariance>>,
    /// The levels with their maps; `None` for a skin that has no map.
    levels: Option<&'a IdVec<LevelId, MapLevel>>,
}

impl<'a> PatchView<'a> {
    pub(crate) fn of_map(map: &'a SkinMap, patch: &'a PatchMap) -> Result<Self, PlotError> {
        Ok(Self {
            name: &patch.name,
            mesh: &patch.levels.get(LevelId::default()).ok_or(PlotError::Empty)?.level.mesh,
            pose: world_pose(&map.links, patch.link),
            ids: &patch.taxels.ids,
            presence: &patch.taxels.presence,
            covariances: patch.taxels.covariances.as_ref(),
            levels: Some(&patch.levels),
        })
    }

    pub(crate) fn of_skin(skin: &'a Skin, patch: &'a Patch) -> Self {
        Self {
            name: &patch.name,
            mesh: &patch.mesh,
            pose: world_pose(&skin.links, patch.link),
            ids: &patch.taxels.ids,
            presence: &patch.taxels.presence,
            covariances: patch.taxels.covariances.as_ref(),
            levels: None,
        }
    }

    pub(crate) fn level(&self, level: LevelId) -> Option<&'a MapLevel> {
        self.levels?.get(level)
    }

    /// This level, or the coarsest if there are fewer.
    pub(crate) fn level_at_most(&self, level: LevelId) -> Option<&'a MapLevel> {
        self.level(level).or_else(|| self.levels?.iter().last())
    }

    /// Whether a taxel reads pressure.
    pub(crate) fn is_live(&self, taxel: VertexId) -> bool {
        self.presence[taxel].reads_pressure()
    }

    /// The error of a picture that needs a map.
    pub(crate) fn no_map(&self, what: &'static str) -> PlotError {
        PlotError::NoMap { patch: self.name.to_owned(), what }
    }

    /// The standard deviation of each taxel's position, in m: the square root of the trace of its
    /// covariance.
    pub(crate) fn sigmas(&self) -> Result<IdVec<VertexId, f64>, PlotError> {
        let unknown = || PlotError::NoCovariances { patch: self.name.to_owned() };
        Ok(self.covariances.ok_or_else(unknown)?.map(|c| c.sigma()))
    }
}
