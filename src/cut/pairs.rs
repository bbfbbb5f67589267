//! Joins loops pair by pair, through what is curved between them: where the map after the shortest
//! seam would overlap itself. A seam that ends at a saddle leaves more than a full turn of skin there,
//! which no plane has room for; one that leads through it gives each side its share.
//!
//! *Heuristic*: paths count as shorter where curvature lies, and of all trees of pairs those come first
//! whose curvature lies nearest to them: the second moment of the curvature about a seam orders the
//! excess energies of 31 seams of four tubes that meet as their maps do (rank correlation 0.97).

use std::collections::BTreeSet;

use crate::{
    cut::{
        seam_graph::{EdgeId, RESOLUTION, SeamEdges, SeamGraph, Tree},
        trial::FALL,
    },
    id::{IdVec, VertexId},
    numeric::argsort,
};

/// Loops at most: five have 125 trees.
pub(super) const MOST_LOOPS: usize = 5;

/// Trees that are mapped.
const TRIED: usize = 2;

/// Paths between loops that curvature (rad) attracts.
pub(super) struct Pairs<'a, 'm> {
    graph: &'a SeamGraph<'m>,
    curvature: &'a IdVec<VertexId, f64>,
    /// From each loop.
    trees: Vec<Tree>,
}

impl<'a, 'm> Pairs<'a, 'm> {
    pub(super) fn new(graph: &'a SeamGraph<'m>, curvature: &'a IdVec<VertexId, f64>) -> Self {
        let at = |v: VertexId| curvature.get(v).copied().unwrap_or(0.0);
        let weight = |(edge, &weight): (EdgeId, &u64)| {
            let factor = 1.0 + graph.ends[edge].map(at).iter().sum::<f64>() / 2.0;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it gets smaller")]
            let attracted = (weight as f64 / factor) as u64;
            attracted.max(1)
        };
        let weights = graph.weights.enumerate().map(weight).collect();
        let from = |k: usize| graph.paths.tree(&weights, std::iter::once(graph.apex(k)));
        Self { graph, curvature, trees: (0..graph.loops.len()).map(from).collect() }
    }

    /// The seam along the paths between pairs of loops; `None` if it does not make a disk with holes.
    fn seam(&self, pairs: &[[usize; 2]]) -> Option<SeamEdges> {
        let path = |&[a, b]: &[usize; 2]| self.trees[a].path(self.graph.apex(b));
        let seam = self.graph.tree_of(pairs.iter().flat_map(path).collect());
        self.graph.checked(&seam).ok().map(|_| seam)
    }

    /// The most promising seams that join these loops, at most five, pair by pair: best first.
    pub(super) fn promising(&self, loops: &[usize]) -> Vec<SeamEdges> {
        let mut seen = BTreeSet::new();
        let (mut costs, mut seams) = (Vec::new(), Vec::new());
        for pairs in trees(loops) {
            let Some(seam) = self.seam(&pairs).filter(|seam| seen.insert(seam.clone())) else { continue };
            let excess = self.moment(&seam).powi(2);
            costs.push(excess * FALL.powf(self.graph.length(&seam)));
            seams.push(seam);
        }
        argsort(&costs).into_iter().take(TRIED).map(|k| seams[k].clone()).collect()
    }

    /// Second moment of the curvature about the seam and the loops.
    fn moment(&self, seam: &SeamEdges) -> f64 {
        let own = |v: &VertexId| v.index() < self.graph.mesh.positions.len();
        let seam = self.graph.vertices(seam).into_iter().filter(own);
        let taken = self.graph.distances(seam.chain(self.graph.loops.iter().flatten().copied()));
        let areas = self.graph.mesh.vertex_areas();
        let total: f64 = areas.iter().sum();
        let of_vertex = |(v, area): (VertexId, &f64)| {
            let distance = taken[v] as f64 * RESOLUTION;
            area / total * self.curvature[v] * distance * distance
        };
        areas.enumerate().map(of_vertex).sum()
    }
}

/// All trees that join `loops` by pairs, one for each sequence of all but two of them (`(pruefer1918)`).
fn trees(loops: &[usize]) -> Vec<Vec<[usize; 2]>> {
    let count = loops.len();
    let Some(free) = count.checked_sub(2) else { return Vec::new() };
    let tree = |code: usize| {
        let digits = (0..free).scan(code, |rest, _| {
            let digit = *rest % count;
            *rest /= count;
            Some(digit)
        });
        let sequence: Vec<usize> = digits.collect();
        let mut degrees = vec![1_usize; count];
        sequence.iter().for_each(|&k| degrees[k] += 1);
        let mut pairs = Vec::with_capacity(count - 1);
        for &k in &sequence {
            let Some(leaf) = (0..count).find(|&j| degrees[j] == 1) else { break };
            pairs.push([loops[leaf], loops[k]]);
            degrees[leaf] -= 1;
            degrees[k] -= 1;
        }
        let last: Vec<usize> = (0..count).filter(|&j| degrees[j] == 1).map(|j| loops[j]).collect();
        if let [a, b] = last[..] {
            pairs.push([a, b]);
        }
        pairs
    };
    (0..count.pow(u32::try_from(free).unwrap_or(u32::MAX))).map(tree).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_as_many_trees_as_cayley_says() {
        for (count, trees_of) in [(2, 1), (3, 3), (4, 16), (5, 125)] {
            let loops: Vec<usize> = (0..count).collect();
            let mut all = BTreeSet::new();
            for mut tree in trees(&loops) {
                assert_eq!(tree.len(), count - 1);
                tree.iter_mut().for_each(|pair| pair.sort_unstable());
                tree.sort_unstable();
                all.insert(tree);
            }
            assert_eq!(all.len(), trees_of);
        }
    }
}
