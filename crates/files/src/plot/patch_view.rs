//! A patch for pictures, with or without its map.

use glam::{DAffine3, DVec3};

use crate::id::{FaceId, IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::mesh::TriMesh;
use crate::plot::PlotError;
use crate::pyramid::LevelId;
use crate::skin::{Covariance, Patch, Presence, RegionName, Skin, Taxels, world_pose};

pub(crate) struct PatchView<'a> {
    pub(crate) name: &'a str,
    /// The taxels and the triangles between them, in the link's frame.
    pub(crate) mesh: &'a TriMesh,
    pub(crate) pose: DAffine3,
    presence: &'a IdVec<VertexId, Presence>,
    covariances: Option<&'a IdVec<VertexId, Option<Covariance>>>,
    regions: Option<&'a IdVec<VertexId, Option<RegionName>>>,
    /// The levels with their maps; `None` for a skin that has no map.
    levels: Option<&'a IdVec<LevelId, MapLevel>>,
}

impl<'a> PatchView<'a> {
    pub(crate) fn of_map(map: &'a SkinMap, patch: &'a PatchMap) -> Result<Self, PlotError> {
        let mesh = &patch.levels.get(LevelId::default()).ok_or(PlotError::Empty)?.level.mesh;
        let pose = world_pose(&map.links, patch.link);
        Ok(Self { levels: Some(&patch.levels), ..Self::of_taxels(&patch.name, mesh, pose, &patch.taxels) })
    }

    pub(crate) fn of_skin(skin: &'a Skin, patch: &'a Patch) -> Self {
        Self::of_taxels(&patch.name, &patch.mesh, world_pose(&skin.links, patch.link), &patch.taxels)
    }

    /// Taxels and the triangles between them, without a map.
    pub(crate) fn of_taxels(name: &'a str, mesh: &'a TriMesh, pose: DAffine3, taxels: &'a Taxels) -> Self {
        let Taxels { presence, covariances, regions, .. } = taxels;
        let (covariances, regions) = (covariances.as_ref(), regions.as_ref());
        Self { name, mesh, pose, presence, covariances, regions, levels: None }
    }

    pub(crate) fn level(&self, level: LevelId) -> Option<&'a MapLevel> {
        self.levels?.get(level)
    }

    /// This level, or the coarsest if there are fewer.
    pub(crate) fn level_at_most(&self, level: LevelId) -> Option<&'a MapLevel> {
        self.level(level).or_else(|| self.levels?.iter().last())
    }

    /// The edges between its taxels along which it is cut, if it has a map.
    pub(crate) fn seam(&self) -> Vec<[VertexId; 2]> {
        self.level(LevelId::default()).map(MapLevel::seam).unwrap_or_default()
    }

    pub(crate) fn is_live(&self, taxel: VertexId) -> bool {
        self.presence[taxel].reads_pressure()
    }

    pub(crate) fn no_map(&self, what: &'static str) -> PlotError {
        PlotError::NoMap { patch: self.name.to_owned(), what }
    }

    /// The name of the region of a taxel.
    pub(crate) fn region(&self, taxel: VertexId) -> Option<&'a RegionName> {
        self.regions?[taxel].as_ref()
    }

    /// The standard deviation of each taxel's position, in m: the square root of the trace of its
    /// covariance; NaN where that is unknown.
    pub(crate) fn sigmas(&self) -> Result<IdVec<VertexId, f64>, PlotError> {
        let unknown = || PlotError::NoCovariances { patch: self.name.to_owned() };
        Ok(self.covariances.ok_or_else(unknown)?.map(|c| c.map_or(f64::NAN, Covariance::sigma)))
    }
}

/// Patches together in the world.
#[derive(Debug, Default)]
pub(crate) struct Robot {
    name: String,
    mesh: TriMesh,
    /// Presence, regions, and covariances if all patches have them, each in the frame of its link.
    taxels: Taxels,
}

impl Robot {
    pub(crate) fn new(patches: &[PatchView<'_>]) -> Self {
        let (mut positions, mut triangles) = (Vec::<DVec3>::new(), Vec::<[VertexId; 3]>::new());
        let (mut presence, mut covariances) = (Vec::new(), Some(Vec::new()));
        let mut regions = Vec::new();
        for patch in patches {
            let before = positions.len();
            positions.extend(patch.mesh.positions.iter().map(|&p| patch.pose.transform_point3(p)));
            let moved = |t: &[VertexId; 3]| t.map(|v| VertexId::new(before + v.index()));
            triangles.extend(patch.mesh.triangles.iter().map(moved));
            presence.extend(patch.presence.iter().copied());
            regions.extend(patch.mesh.positions.ids().map(|taxel| patch.region(taxel).cloned()));
            covariances = covariances.zip(patch.covariances).map(|(mut all, more)| {
                all.extend(more.iter().copied());
                all
            });
        }
        let covariances = covariances.map(IdVec::from);
        Self {
            name: format!("{} patches", patches.len()),
            mesh: TriMesh { positions: positions.into(), triangles: IdVec::<FaceId, _>::from(triangles) },
            taxels: Taxels {
                presence: presence.into(),
                covariances,
                regions: Some(regions.into()),
                ..Taxels::default()
            },
        }
    }

    pub(crate) fn view(&self) -> PatchView<'_> {
        PatchView::of_taxels(&self.name, &self.mesh, DAffine3::IDENTITY, &self.taxels)
    }
}
