//! [`LiveTaxels`]: whether the taxel of an answer works, and the nearest working one.

use glam::DVec3;

use crate::bvh::PointTree;
use crate::contact::Cell;
use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::pyramid::LevelId;
use crate::skin::{PatchId, Presence, TaxelId};

/// The taxels of a map that work.
#[derive(Debug, Clone)]
pub struct LiveTaxels {
    /// `None` where all taxels of a patch work.
    patches: IdVec<PatchId, Option<Taxels>>,
}

/// The taxels of a patch of which some do not work.
#[derive(Debug, Clone)]
struct Taxels {
    presence: IdVec<VertexId, Presence>,
    ids: IdVec<VertexId, TaxelId>,
    /// In m, as they are in the map.
    positions: IdVec<VertexId, DVec3>,
    /// The vertices of level 0 at the centres of the fields of each level.
    origins: IdVec<LevelId, IdVec<VertexId, VertexId>>,
    /// The working ones, by their index in `live`.
    tree: PointTree,
    live: IdVec<VertexId, VertexId>,
}

impl Taxels {
    /// `None` if all of them work.
    fn new(patch: &PatchMap) -> Option<Self> {
        let presence = patch.taxels.presence.clone();
        let live: IdVec<VertexId, VertexId> =
            presence.ids().filter(|&taxel| presence[taxel] == Presence::Present).collect();
        if live.len() == presence.len() {
            return None;
        }
        let positions = patch.levels[LevelId::new(0)].level.mesh.positions.clone();
        let tree = PointTree::new(live.map(|&taxel| positions[taxel]).as_slice(), |_| DVec3::ZERO);
        let origins = patch.levels.map(|map| map.level.origins.clone());
        Some(Self { presence, ids: patch.taxels.ids.clone(), positions, origins, tree, live })
    }

    /// The working taxel nearest to the weighted mean of the fields of a cell.
    fn nearest(&self, cell: &Cell) -> Option<TaxelId> {
        let origins = self.origins.get(cell.level)?;
        let mut at = DVec3::ZERO;
        for (field, weight) in cell.weights.iter() {
            at += self.positions[*origins.get(field)?] * weight;
        }
        let mut found = Vec::new();
        self.tree.nearest(at, 1, f64::INFINITY, &mut found);
        found.first().map(|&(live, _): &(VertexId, f64)| self.ids[self.live[live]])
    }
}

impl LiveTaxels {
    /// The working taxels of a valid map.
    pub fn new(map: &SkinMap) -> Self {
        Self { patches: map.patches.map(Taxels::new) }
    }

    /// The presence of the taxel of a cell, and the working taxel of its patch that is nearest to the cell:
    /// its own taxel if that works, `None` if none does.
    pub fn nearest(&self, patch: PatchId, cell: &Cell) -> (Presence, Option<TaxelId>) {
        let Some(taxels) = self.patches.get(patch).and_then(Option::as_ref) else {
            return (Presence::Present, Some(cell.taxel));
        };
        let origin = taxels.origins.get(cell.level).and_then(|origins| origins.get(cell.field));
        match origin.map(|&origin| taxels.presence[origin]) {
            Some(Presence::Present) => (Presence::Present, Some(cell.taxel)),
            Some(other) => (other, taxels.nearest(cell)),
            None => (Presence::Absent, None),
        }
    }
}
