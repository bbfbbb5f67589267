//! How patches lie to each other: contacts go on over gaps, and from link to link, as the links are at rest.

use glam::{DAffine3, DVec3};

use crate::id::IdVec;
use crate::map::{PatchMap, SkinMap};
use crate::skin::{LinkId, PatchId, world_pose};

/// The gaps that contacts may go on over, and the poses of the links.
#[derive(Debug, Clone)]
pub(super) struct Bridges {
    links: IdVec<PatchId, LinkId>,
    poses: IdVec<LinkId, DAffine3>,
    /// Two patches, the first before the second, and the longest link between them, in m; ascending.
    gaps: Vec<([PatchId; 2], f64)>,
}

impl Bridges {
    pub(super) fn new(map: &SkinMap) -> Self {
        Self {
            links: map.patches.map(|patch: &PatchMap| patch.link),
            poses: map.links.ids().map(|link| world_pose(&map.links, link)).collect(),
            gaps: map.gaps().into_iter().map(|gap| (gap.patches, gap.width[1])).collect(),
        }
    }

    pub(super) fn link(&self, patch: PatchId) -> LinkId {
        self.links[patch]
    }

    /// A point in the frame of the link of one patch, in that of another.
    pub(super) fn moved(&self, point: DVec3, ends: [PatchId; 2]) -> DVec3 {
        let [from, to] = ends.map(|patch| self.links[patch]);
        if from == to {
            return point;
        }
        self.poses[to].inverse().transform_point3(self.poses[from].transform_point3(point))
    }

    /// The longest link over the gap between two patches, in m; `None` without one.
    pub(super) fn gap(&self, [a, b]: [PatchId; 2]) -> Option<f64> {
        let place = self.gaps.binary_search_by_key(&[a.min(b), a.max(b)], |(patches, _)| *patches).ok()?;
        Some(self.gaps[place].1)
    }
}
