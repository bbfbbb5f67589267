//! [`ReactiveSkins`]: the octrees of all links, and their boxes.

use std::sync::Arc;

use glam::DVec3;

use crate::bvh::Aabb;
use crate::contact::ContactError;
use crate::contact::coarse::Octree;
use crate::contact::patch::IndexedPatch;
use crate::contact::patch_bvh::PatchBvh;
use crate::contact::posed_links::Links;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::parallel::par_map;
use crate::skin::{LinkId, PatchId};

/// The skins that are searched separately: all rigid patches of a link together, and each patch that follows
/// several links.
#[derive(Debug, Clone)]
pub(in crate::contact) struct ReactiveSkins {
    pub(in crate::contact) skins: Arc<[ReactiveSkin]>,
    /// Their boxes in the current pose of the robot, in the world.
    boxes: Vec<Aabb>,
}

/// A skin that is searched separately.
#[derive(Debug)]
pub(in crate::contact) struct ReactiveSkin {
    pub(in crate::contact) link: LinkId,
    /// Its box, in m in the frame of the link.
    bounds: Aabb,
    /// Its patches, and the index of the first face of each in the octree.
    pub(in crate::contact) patches: Vec<(PatchId, u32)>,
    /// `None`: its vertices follow several links, so it is searched exactly.
    pub(in crate::contact) octree: Option<Octree>,
}

impl ReactiveSkins {
    /// # Errors
    /// If the patches of a link together have too many faces.
    pub(in crate::contact) fn new(
        links: &Links,
        patches: &IdVec<PatchId, Arc<IndexedPatch>>,
    ) -> Result<Self, ContactError> {
        let (rigid, soft): (Vec<PatchId>, Vec<PatchId>) =
            patches.ids().partition(|&id| patches[id].blend.is_none());
        let on =
            |link: LinkId| rigid.iter().copied().filter(|&id| patches[id].link == link).collect::<Vec<_>>();
        let links: Vec<Vec<PatchId>> =
            (0..links.len()).map(|link| on(LinkId::new(link))).filter(|ids| !ids.is_empty()).collect();
        let rigid = par_map(&links, |ids| ReactiveSkin::rigid(ids, patches));
        let soft = soft.into_iter().map(|id| {
            let IndexedPatch { link, bounds, .. } = *patches[id];
            Ok(ReactiveSkin { link, bounds, patches: vec![(id, 0)], octree: None })
        });
        let skins = rigid.into_iter().chain(soft).collect::<Result<Arc<[_]>, ContactError>>()?;
        Ok(Self { boxes: Vec::with_capacity(skins.len()), skins })
    }

    /// Fits the boxes to the poses of the links. Nothing is allocated after the first time.
    pub(in crate::contact) fn pose(&mut self, links: &Links, patches: &IdVec<PatchId, Arc<IndexedPatch>>) {
        let Self { skins, boxes } = self;
        boxes.clear();
        boxes.extend(skins.iter().map(|skin| {
            let bounds = if skin.octree.is_some() { skin.bounds } else { patches[skin.patches[0].0].bounds };
            bounds.moved(|corner| links.pose(skin.link).transform_point3(corner))
        }));
    }

    /// Calls `visit` with every skin whose box may be nearer to a point of the world than the value `visit`
    /// returned last, the one with the nearest box first. Robots have so few links that a tree over their
    /// boxes would be slower.
    #[inline(always)]
    pub(in crate::contact) fn each_near<'a>(
        &'a self,
        world: DVec3,
        mut visit: impl FnMut(&'a ReactiveSkin) -> f64,
    ) {
        /// Bound of the relative rounding error of the square of a distance.
        const ROUND_UP: f64 = 1.0 + 1e-9;
        let Self { skins, boxes } = self;
        let away = |skin: usize| world.distance_squared(world.clamp(boxes[skin].lo, boxes[skin].hi));
        let mut first = (f64::INFINITY, 0);
        if skins.len() > 1 {
            for skin in 0..skins.len() {
                let away = away(skin);
                first = if away < first.0 { (away, skin) } else { first };
            }
        }
        let mut reach = visit(&skins[first.1]);
        for skin in (0..skins.len()).filter(|&skin| skin != first.1) {
            if away(skin) <= reach * reach * ROUND_UP {
                reach = visit(&skins[skin]);
            }
        }
    }
}

impl ReactiveSkin {
    fn rigid(ids: &[PatchId], patches: &IdVec<PatchId, Arc<IndexedPatch>>) -> Result<Self, ContactError> {
        let first = &patches[ids[0]];
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let mut starts = Vec::new();
        let together;
        let skin = if let [_] = ids {
            starts.push((ids[0], 0));
            &first.tree
        } else {
            for &id in ids {
                let mesh = &patches[id].tree.mesh;
                let before = VertexId::new(positions.len()).raw();
                starts.push((id, FaceId::new(triangles.len()).raw()));
                positions.extend_from_slice(mesh.positions.as_slice());
                triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|v| v.raw() + before)));
            }
            together = PatchBvh::new(&first.name, &TriMesh::from_arrays(positions, &triangles))?;
            &together
        };
        Ok(Self { link: first.link, bounds: skin.bounds(), patches: starts, octree: Some(Octree::new(skin)) })
    }

    /// The patch of a face of the octree, and its face there.
    #[inline(always)]
    pub(in crate::contact) fn face(&self, face: u32) -> (PatchId, FaceId) {
        let after = self.patches.partition_point(|(_, first)| *first <= face);
        let (patch, first) = self.patches[after - 1];
        (patch, FaceId::from(face - first))
    }
}
