//! All patches of a skin as one surface in the world, to be seen together.

use glam::{DAffine3, DVec3};

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
    plot::patch_view::PatchView,
    skin::{Covariance, Presence, TaxelId},
};

/// Patches side by side in the world.
#[derive(Debug, Default)]
pub(crate) struct Robot {
    pub(crate) name: String,
    pub(crate) mesh: TriMesh,
    pub(crate) ids: IdVec<VertexId, TaxelId>,
    pub(crate) presence: IdVec<VertexId, Presence>,
    /// As the patches have them, each in the frame of its link; `None` if one has none.
    pub(crate) covariances: Option<IdVec<VertexId, Covariance>>,
}

impl Robot {
    pub(crate) fn new(patches: &[PatchView<'_>]) -> Self {
        let (mut positions, mut triangles) = (Vec::<DVec3>::new(), Vec::<[VertexId; 3]>::new());
        let mut ids = Vec::new();
        let mut presence = Vec::new();
        let mut covariances = Some(Vec::new());
        for patch in patches {
            let before = positions.len();
            positions.extend(patch.mesh.positions.iter().map(|&p| patch.pose.transform_point3(p)));
            let moved = |t: &[VertexId; 3]| t.map(|v| VertexId::new(before + v.index()));
            triangles.extend(patch.mesh.triangles.iter().map(moved));
            ids.extend(patch.ids.iter().copied());
            presence.extend(patch.presence.iter().copied());
            covariances = covariances.zip(patch.covariances).map(|(mut all, more)| {
                all.extend(more.iter().copied());
                all
            });
        }
        Self {
            name: format!("{} patches", patches.len()),
            mesh: TriMesh { positions: positions.into(), triangles: IdVec::<FaceId, _>::from(triangles) },
            ids: ids.into(),
            presence: presence.into(),
            covariances: covariances.map(IdVec::from),
        }
    }

    pub(crate) fn view(&self) -> PatchView<'_> {
        PatchView::new(
            &self.name,
            &self.mesh,
            DAffine3::IDENTITY,
            &self.ids,
            &self.presence,
            self.covariances.as_ref(),
        )
    }
}
