//! All patches as one graph: their triangles, and links over the gaps between them.

use glam::{DAffine3, DVec3};

use crate::body::BodyTaxel;
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::mesh::{TriMesh, VertexCorners, neighbours};
use crate::numeric::Csr;
use crate::pyramid::LevelId;
use crate::signal::contacts::ContactRegion;
use crate::skin::{PatchId, world_pose};

/// The taxels of all patches, numbered patch after patch.
#[derive(Debug, Clone)]
pub(super) struct Joined {
    /// The number of the first taxel of each patch.
    starts: IdVec<PatchId, usize>,
    /// The patch of each taxel.
    patch_of: IdVec<VertexId, PatchId>,
    /// All triangles. Positions are in the frame of the link if there is one, else in the world at rest.
    pub(super) mesh: TriMesh,
    pub(super) normals: IdVec<VertexId, DVec3>,
    around: VertexCorners,
    links: Csr<VertexId>,
    /// The taxels next to each one on the skin, then those that it has links to.
    pub(super) next: Csr<u32>,
    /// The poses of the patches at rest.
    poses: IdVec<PatchId, DAffine3>,
}

impl Joined {
    pub(super) fn new(map: &SkinMap) -> Self {
        let (mut mesh, mut normals, mut patch_of) = (TriMesh::default(), IdVec::default(), IdVec::default());
        let mut links = map.patches.iter().map(|patch| patch.link);
        let first = links.next();
        let is_on_one = links.all(|link| Some(link) == first);
        let pose = |link| if is_on_one { DAffine3::IDENTITY } else { world_pose(&map.links, link) };
        let poses = map.patches.map(|patch| pose(patch.link));
        let mut starts = IdVec::default();
        for (id, patch) in map.patches.enumerate() {
            let (own, start) = (&patch.levels[LevelId::new(0)].level.mesh, mesh.positions.len());
            let place = |x: &DVec3| if is_on_one { *x } else { poses[id].transform_point3(*x) };
            let turn = |n: &DVec3| if is_on_one { *n } else { poses[id].transform_vector3(*n) };
            own.positions.iter().for_each(|x| {
                mesh.positions.push(place(x));
                patch_of.push(id);
            });
            patch.taxels.normals.iter().for_each(|n| {
                normals.push(turn(n));
            });
            let shifted = |t: &[VertexId; 3]| t.map(|v| VertexId::new(start + v.index()));
            own.triangles.iter().for_each(|t| {
                mesh.triangles.push(shifted(t));
            });
            starts.push(start);
        }
        let count = mesh.positions.len();
        let number = |end: BodyTaxel| VertexId::new(starts[end.patch] + end.taxel.index());
        let both = |ends: &[BodyTaxel; 2]| {
            let [a, b] = ends.map(number);
            [(a.index(), b), (b.index(), a)]
        };
        let links = Csr::from_pairs(count, map.body.links.iter().flat_map(both));
        let on_skin = neighbours([&mesh]);
        let mut next = Csr::with_capacity(count, on_skin.items().len() + links.items().len());
        for (on_skin, over) in on_skin.iter().zip(links.iter()) {
            next.push(on_skin.iter().copied().chain(over.iter().map(|v| v.raw())));
        }
        let around = VertexCorners::new(mesh.triangles.iter().copied(), count);
        Self { starts, patch_of, mesh, normals, around, links, next, poses }
    }

    pub(super) fn number(&self, at: BodyTaxel) -> VertexId {
        VertexId::new(self.starts[at.patch] + at.taxel.index())
    }

    pub(super) fn patch_of(&self, taxel: VertexId) -> PatchId {
        self.patch_of[taxel]
    }

    /// The number of the first taxel of a patch.
    pub(super) fn start(&self, patch: PatchId) -> usize {
        self.starts[patch]
    }

    pub(super) fn taxel(&self, number: VertexId) -> BodyTaxel {
        let patch = self.patch_of[number];
        BodyTaxel { patch, taxel: VertexId::new(number.index() - self.starts[patch]) }
    }

    pub(super) fn has_links(&self) -> bool {
        !self.links.items().is_empty()
    }

    /// The corners of the faces around a taxel, then the taxels that it has links to.
    pub(super) fn around(&self, taxel: VertexId) -> impl Iterator<Item = VertexId> + Clone {
        let corners = self.around.faces(taxel).flat_map(|face| self.mesh.triangles[face]);
        corners.chain(self.links[taxel.index()].iter().copied())
    }

    /// The taxels that a taxel has links to.
    pub(super) fn over_gaps(&self, taxel: VertexId) -> &[VertexId] {
        &self.links[taxel.index()]
    }

    /// The numbers of the taxels of a region.
    pub(super) fn numbers(&self, region: &ContactRegion) -> impl Iterator<Item = VertexId> {
        region.all_taxels().map(|at| self.number(at))
    }

    /// A point in the frame of the link of one patch, in that of another, as the links are at rest.
    pub(super) fn moved(&self, point: DVec3, [from, to]: [PatchId; 2]) -> DVec3 {
        let [from, to] = [from, to].map(|patch| self.poses[patch]);
        if from == to { point } else { to.inverse().transform_point3(from.transform_point3(point)) }
    }

    /// Turns a region of numbers into its parts: that of the patch with most of `force`, and the taxels of the others.
    pub(super) fn divide(&self, region: &mut ContactRegion, force: impl Fn(VertexId) -> f64) {
        let patch = |taxel: &VertexId| self.patch_of[*taxel];
        let runs = || region.taxels.chunk_by(|a, b| patch(a) == patch(b));
        let first = region.taxels.first().map(patch).unwrap_or_default();
        let is_on_one = region.taxels.last().map(patch).is_none_or(|last| last == first);
        let mut best = (f64::NEG_INFINITY, first);
        for run in runs().take(if is_on_one { 0 } else { usize::MAX }) {
            let sum: f64 = run.iter().map(|&taxel| force(taxel)).sum();
            if sum > best.0 {
                best = (sum, patch(&run[0]));
            }
        }
        region.patch = best.1;
        if !is_on_one {
            let others = region.taxels.iter().map(|&taxel| self.taxel(taxel));
            region.beyond.extend(others.filter(|at| at.patch != best.1));
            region.taxels.retain(|taxel| patch(taxel) == best.1);
        }
        let start = self.starts[best.1];
        region.taxels.iter_mut().for_each(|taxel| *taxel = VertexId::new(taxel.index() - start));
    }
}
