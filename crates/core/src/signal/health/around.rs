//! The taxels of a skin, counted through all patches, and which are near each other.

use glam::DVec3;

use crate::id::VertexId;
use crate::map::SkinMap;
use crate::mesh::edges;
use crate::numeric::{Csr, argsort};
use crate::pyramid::LevelId;
use crate::signal::Frame;
use crate::skin::{PatchId, Presence, TaxelId};

/// A taxel with its neighbours, and the directions in which they lie.
#[derive(Debug, Clone)]
pub(in crate::signal) struct Around {
    /// Where each taxel is, in the order of the patches.
    pub(in crate::signal) taxels: Vec<(PatchId, VertexId)>,
    pub(in crate::signal) ids: Vec<TaxelId>,
    pub(in crate::signal) positions: Vec<DVec3>,
    pub(in crate::signal) normals: Vec<DVec3>,
    pub(in crate::signal) is_present: Vec<bool>,
    /// The neighbours of each taxel on the mesh in the order of their angles around its normal, which are in rad.
    pub(in crate::signal) neighbours: Csr<(u32, f64)>,
    /// The taxels at most two edges away from each one, itself among them, in ascending order.
    within_two: Csr<u32>,
}

impl Around {
    pub(in crate::signal) fn new(map: &SkinMap) -> Self {
        let (mut taxels, mut ids, mut is_present) = (Vec::new(), Vec::new(), Vec::new());
        let (mut positions, mut normals, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
        let mut first = 0_u32;
        for (patch, about) in map.patches.enumerate() {
            let mesh = &about.levels[LevelId::new(0)].level.mesh;
            taxels.extend(mesh.positions.ids().map(|vertex| (patch, vertex)));
            ids.extend(about.taxels.ids.iter().copied());
            is_present.extend(about.taxels.presence.iter().map(|presence| *presence == Presence::Present));
            positions.extend(mesh.positions.iter().copied());
            normals.extend(about.taxels.normals.iter().copied());
            for [a, b] in edges(mesh) {
                let [a, b] = [a, b].map(|v: VertexId| first + v.raw());
                pairs.extend([(a as usize, b), (b as usize, a)]);
            }
            first += u32::try_from(mesh.positions.len()).unwrap_or(u32::MAX);
        }
        let near: Csr<u32> = Csr::from_pairs(taxels.len(), pairs.iter().copied());
        let mut neighbours = Csr::with_capacity(taxels.len(), pairs.len());
        let mut within_two = Csr::with_capacity(taxels.len(), 4 * pairs.len());
        for (k, own) in (0_u32..).zip(near.iter()) {
            let at = k as usize;
            let (x, normal) = (normals[at].any_orthonormal_vector(), normals[at]);
            let angle = |&other: &u32| {
                let away = positions[other as usize] - positions[at];
                away.dot(normal.cross(x)).atan2(away.dot(x))
            };
            let angles: Vec<f64> = own.iter().map(angle).collect();
            neighbours.push(argsort(&angles).into_iter().map(|rank| (own[rank], angles[rank])));
            let mut two: Vec<u32> = own.iter().flat_map(|&other| &near[other as usize]).copied().collect();
            two.extend(own.iter().copied().chain([k]));
            two.sort_unstable();
            two.dedup();
            within_two.push(two);
        }
        Self { taxels, ids, positions, normals, is_present, neighbours, within_two }
    }

    pub(in crate::signal) fn len(&self) -> usize {
        self.taxels.len()
    }

    /// The taxels at most two edges away from one, itself among them.
    pub(in crate::signal) fn near(&self, taxel: usize) -> &[u32] {
        &self.within_two[taxel]
    }

    pub(in crate::signal) fn is_near(&self, a: u32, b: u32) -> bool {
        self.within_two[a as usize].binary_search(&b).is_ok()
    }

    pub(in crate::signal) fn of(&self, taxel: usize) -> impl Iterator<Item = usize> + Clone {
        self.neighbours[taxel].iter().map(|&(other, _)| other as usize)
    }

    /// Whether a taxel lies between neighbours that `is_hot`: none of the gaps between them is much wider than half a
    /// turn. Bodies are convex: between two places a press is at least as deep as at the shallower one.
    pub(super) fn is_surrounded(&self, taxel: usize, is_hot: impl Fn(usize) -> bool) -> bool {
        const WIDEST: f64 = 190.0 / 180.0 * std::f64::consts::PI;
        let mut angles = self.neighbours[taxel]
            .iter()
            .filter(|(other, _)| is_hot(*other as usize))
            .map(|(_, angle)| *angle);
        let Some(first) = angles.next() else { return false };
        let (mut last, mut gap) = (first, 0.0_f64);
        for angle in angles {
            gap = gap.max(angle - last);
            last = angle;
        }
        gap.max(first + std::f64::consts::TAU - last) < WIDEST
    }
}

/// The readings of one channel of a frame, in the order of the taxels.
pub(in crate::signal) fn readings(frame: &Frame, channel: usize) -> impl Iterator<Item = f64> + '_ {
    frame.values.iter().flat_map(move |patch| patch[channel].iter().copied())
}
