//! The outline of a map: rims, where the skin ends, and the two banks of its seam.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};

use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap};
use crate::mesh::{TriMesh, boundary_edges, loops_of};
use crate::pattern::drawing::Layer;

/// The outline of the finest map of a patch. What fills holes does not belong to it.
pub(super) struct Outline {
    /// Positions of the vertices of the skin, in m.
    positions: IdVec<VertexId, DVec3>,
    /// Positions of the vertices of the mesh that is cut open, on the map, in m.
    uv: IdVec<VertexId, DVec2>,
    /// Pieces of the outline with their vertices, cut open, in order, faces on the left.
    pub(super) pieces: Vec<Piece>,
    /// Each edge of a bank by its vertices on the skin, and its vertices where it is cut open; faces on the left.
    banks: BTreeMap<[VertexId; 2], [VertexId; 2]>,
    /// The curves of the seam on the skin, each from a rim, a branch or an end to the next.
    pub(super) seams: Vec<Vec<VertexId>>,
}

/// A rim, or a piece of it between banks of a seam; or a bank.
pub(super) struct Piece {
    /// [`Layer::Cut`] or [`Layer::Seam`].
    pub(super) layer: Layer,
    pub(super) points: Vec<DVec2>,
    pub(super) is_closed: bool,
}

/// A point of a seam on one of its banks.
#[derive(Debug, Clone, Copy)]
pub(super) struct BankPoint {
    /// On the map, in m.
    pub(super) at: DVec2,
    /// The direction of the bank, of length 1; the skin is on its left.
    pub(super) along: DVec2,
}

impl Outline {
    pub(super) fn new(patch: &PatchMap, level: &MapLevel) -> Self {
        let whole = without_fillers(&level.level.mesh, patch.filled);
        let opened = without_fillers(&level.opened(), patch.filled);
        let uv = level.opened_uv();
        let unsplit = |v: VertexId| level.unsplit().map_or(v, |unsplit| unsplit.as_slice()[v.index()]);
        let on_skin = |[a, b]: [VertexId; 2]| [unsplit(a), unsplit(b)];
        let (rims, edges) = (boundary_edges(&whole), boundary_edges(&opened));
        let is_rim = |edge| rims.binary_search(&on_skin(edge)).is_ok();
        let banks: BTreeMap<_, _> =
            edges.iter().filter(|&&edge| !is_rim(edge)).map(|&edge| (on_skin(edge), edge)).collect();
        let mut pieces = Vec::new();
        for walk in loops_of(&edges) {
            pieces.extend(pieces_of(&walk, is_rim).into_iter().map(|(layer, vertices, is_closed)| Piece {
                layer,
                points: vertices.into_iter().map(|v| uv[v]).collect(),
                is_closed,
            }));
        }
        let ends = rims.iter().flatten().copied().collect();
        let seams = curves(&banks, &ends);
        Self { positions: whole.positions, uv, pieces, banks, seams }
    }

    /// Length of a curve on the skin, in m.
    pub(super) fn length(&self, seam: &[VertexId]) -> f64 {
        seam.windows(2).map(|edge| self.edge_length([edge[0], edge[1]])).sum()
    }

    /// The point of a seam at this length on the skin from its beginning (m), on its left and on its right bank.
    pub(super) fn on_banks(&self, seam: &[VertexId], from_start: f64) -> Option<[BankPoint; 2]> {
        let mut rest = from_start;
        let last = seam.len().checked_sub(2)?;
        for (k, edge) in seam.windows(2).enumerate() {
            let (u, v) = (edge[0], edge[1]);
            let length = self.edge_length([u, v]);
            if rest <= length || k == last {
                let part = if length > 0.0 { (rest / length).min(1.0) } else { 0.0 };
                let [left, right] = [self.banks.get(&[u, v])?, self.banks.get(&[v, u])?];
                return Some([self.on_bank(left, part), self.on_bank(right, 1.0 - part)]);
            }
            rest -= length;
        }
        None
    }

    fn on_bank(&self, &[a, b]: &[VertexId; 2], part: f64) -> BankPoint {
        let [a, b] = [self.uv[a], self.uv[b]];
        BankPoint { at: a.lerp(b, part), along: (b - a).normalize_or_zero() }
    }

    fn edge_length(&self, [a, b]: [VertexId; 2]) -> f64 {
        self.positions[a].distance(self.positions[b])
    }
}

/// A mesh without its last faces, which fill holes.
fn without_fillers(mesh: &TriMesh, filled: usize) -> TriMesh {
    let count = mesh.triangles.len().saturating_sub(filled);
    let triangles = mesh.triangles.iter().take(count).copied().collect();
    TriMesh { positions: mesh.positions.clone(), triangles }
}

/// A closed walk, split where rim and seam meet: the layer, the vertices, and whether it is closed.
fn pieces_of(walk: &[VertexId], is_rim: impl Fn([VertexId; 2]) -> bool) -> Vec<(Layer, Vec<VertexId>, bool)> {
    let count = walk.len();
    let layer = |k: usize| {
        if is_rim([walk[k % count], walk[(k + 1) % count]]) { Layer::Cut } else { Layer::Seam }
    };
    let Some(start) = (0..count).find(|&k| layer(k) != layer(k + count - 1)) else {
        return if count == 0 { Vec::new() } else { vec![(layer(0), walk.to_vec(), true)] };
    };
    let mut pieces: Vec<(Layer, Vec<VertexId>, bool)> = Vec::new();
    for k in start..start + count {
        if pieces.last().is_none_or(|piece| piece.0 != layer(k)) {
            pieces.push((layer(k), vec![walk[k % count]], false));
        }
        pieces.iter_mut().next_back().into_iter().for_each(|piece| piece.1.push(walk[(k + 1) % count]));
    }
    pieces
}

/// The curves of a graph of edges, between vertices where it ends or branches or that are among `ends`; then loops.
fn curves(banks: &BTreeMap<[VertexId; 2], [VertexId; 2]>, ends: &BTreeSet<VertexId>) -> Vec<Vec<VertexId>> {
    let mut around = BTreeMap::<VertexId, BTreeSet<VertexId>>::new();
    for &[a, b] in banks.keys() {
        around.entry(a).or_default().insert(b);
        around.entry(b).or_default().insert(a);
    }
    let is_node = |v: &VertexId| around[v].len() != 2 || ends.contains(v);
    let mut done = BTreeSet::new();
    let mut found = Vec::new();
    let (nodes, inner): (Vec<VertexId>, Vec<VertexId>) = around.keys().partition(|v| is_node(v));
    for start in nodes.into_iter().chain(inner) {
        for &second in &around[&start] {
            if done.contains(&[start, second]) {
                continue;
            }
            let mut curve = vec![start, second];
            done.extend([[start, second], [second, start]]);
            let mut last = [start, second];
            while !is_node(&last[1]) && last[1] != start {
                let Some(&next) = around[&last[1]].iter().find(|&&v| v != last[0]) else { break };
                curve.push(next);
                last = [last[1], next];
                done.extend([last, [last[1], last[0]]]);
            }
            found.push(curve);
        }
    }
    found
}
