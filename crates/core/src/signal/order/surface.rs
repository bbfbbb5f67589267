//! The taxels on which columns are placed, and how far they are from each other along the skin.

use std::collections::HashMap;

use glam::DVec3;

use crate::id::VertexId;
use crate::map::SkinMap;
use crate::numeric::{Csr, DisjointSets, distances_from, median};
use crate::parallel::par_rows;
use crate::signal::OrderError;
use crate::signal::health::around::Around;
use crate::skin::{PatchId, TaxelId, world_pose};

/// Most taxels, and columns: sums and distances are square matrices, of 32 MB at most, and work grows with the cube.
pub(super) const MOST_TAXELS: usize = 2048;

/// Taxels of separate pieces of the skin are connected where they are this many spacings apart or less.
const BRIDGE: f64 = 2.0;

/// The taxels that are present, in the order of the patches.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    pub(super) taxels: Vec<(PatchId, VertexId)>,
    pub(super) ids: Vec<TaxelId>,
    /// How many taxels have each id.
    counts: HashMap<TaxelId, usize>,
    /// Lengths of paths along the skin, in m, row by row; pieces that are far from each other are joined where they are
    /// nearest.
    pub(super) distances: Vec<f64>,
    /// The median length of edges, in m.
    pub(super) spacing: f64,
}

impl Surface {
    pub(super) fn new(map: &SkinMap) -> Result<Self, OrderError> {
        let around = Around::new(map);
        let present: Vec<usize> = (0..around.len()).filter(|&k| around.is_present[k]).collect();
        // Absent taxels conduct paths, so they count.
        if around.len() > MOST_TAXELS {
            return Err(OrderError::TooLarge { what: "taxels", found: around.len(), most: MOST_TAXELS });
        }
        let mut positions = Vec::with_capacity(around.len());
        for about in &map.patches {
            let pose = world_pose(&map.links, about.link);
            positions.extend(
                about
                    .levels
                    .iter()
                    .next()
                    .into_iter()
                    .flat_map(|finest| finest.level.mesh.positions.iter().map(|&p| pose.transform_point3(p))),
            );
        }
        let edges = (0..around.len()).flat_map(|a| around.of(a).map(move |b| (a, b)));
        let spacing = median(edges.map(|(a, b)| positions[a].distance(positions[b]))).unwrap_or(0.0);
        let mut pairs = Vec::new();
        // Paths over two edges are straighter than along edges alone.
        for a in 0..around.len() {
            let near = around.near(a).iter().filter(|&&b| b as usize != a);
            pairs.extend(near.map(|&b| (a, (b, positions[a].distance(positions[b as usize])))));
        }
        join_pieces(&positions, spacing, &mut pairs);
        let graph = Csr::from_pairs(positions.len(), pairs.iter().copied());
        let row = u32::try_from(present.len()).unwrap_or(u32::MAX);
        let starts: Vec<u32> = (0..=row).map(|k| k * row).collect();
        let distances = par_rows(&starts, |k, out: &mut [f64]| {
            let mut all = vec![0.0; positions.len()];
            distances_from(&graph, present[k], &mut all);
            out.iter_mut().zip(&present).for_each(|(x, &to)| *x = all[to]);
        });
        let mut counts = HashMap::new();
        present.iter().for_each(|&k| *counts.entry(around.ids[k]).or_default() += 1);
        Ok(Self {
            taxels: present.iter().map(|&k| around.taxels[k]).collect(),
            ids: present.iter().map(|&k| around.ids[k]).collect(),
            counts,
            distances,
            spacing,
        })
    }

    pub(super) fn len(&self) -> usize {
        self.ids.len()
    }

    pub(super) fn distance(&self, a: usize, b: usize) -> f64 {
        self.distances[a * self.len() + b]
    }

    /// The number of the taxel of an id, or how many have it.
    pub(super) fn taxel(&self, id: TaxelId) -> Result<usize, usize> {
        let count = self.counts.get(&id).copied().unwrap_or(0);
        let found = self.ids.iter().position(|known| *known == id);
        found.filter(|_| count == 1).ok_or(count)
    }

    /// The same without some taxels.
    pub(super) fn without(&self, left_out: &[usize]) -> Self {
        let kept: Vec<usize> = (0..self.len()).filter(|k| !left_out.contains(k)).collect();
        Self {
            taxels: kept.iter().map(|&k| self.taxels[k]).collect(),
            ids: kept.iter().map(|&k| self.ids[k]).collect(),
            counts: self.counts.clone(),
            distances: kept.iter().flat_map(|&a| kept.iter().map(move |&b| self.distance(a, b))).collect(),
            spacing: self.spacing,
        }
    }
}

/// Connects pieces of a skin: where they are near each other in space, and else at their nearest taxels.
fn join_pieces(positions: &[DVec3], spacing: f64, pairs: &mut Vec<(usize, (u32, f64))>) {
    let mut sets = DisjointSets::<VertexId>::new(positions.len());
    pairs.iter().for_each(|&(a, (b, _))| sets.join(VertexId::new(a), VertexId::from(b)));
    let pieces = sets.labels();
    if pieces.count < 2 {
        return;
    }
    // Of each two pieces the nearest taxels.
    let mut nearest: Vec<(f64, usize, usize)> = vec![(f64::INFINITY, 0, 0); pieces.count * pieces.count];
    let piece = |k: usize| pieces.of[VertexId::new(k)];
    let mut bridges: Vec<(f64, usize, usize)> = Vec::new();
    for a in 0..positions.len() {
        for b in (a + 1..positions.len()).filter(|&b| piece(b) != piece(a)) {
            let length = positions[a].distance(positions[b]);
            if length <= BRIDGE * spacing {
                bridges.push((length, a, b));
            }
            let (low, high) = (piece(a).min(piece(b)), piece(a).max(piece(b)));
            let known = &mut nearest[low * pieces.count + high];
            if length < known.0 {
                *known = (length, a, b);
            }
        }
    }
    nearest.retain(|(length, ..)| length.is_finite());
    nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
    let near = bridges.len();
    bridges.extend(nearest);
    for (k, (length, a, b)) in bridges.into_iter().enumerate() {
        let ends = [a, b].map(VertexId::new);
        if k < near || sets.root(ends[0]) != sets.root(ends[1]) {
            pairs.extend([(a, (ends[1].raw(), length)), (b, (ends[0].raw(), length))]);
            sets.join(ends[0], ends[1]);
        }
    }
}
