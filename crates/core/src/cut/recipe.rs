//! A seam and what it joins, and how one that was found on a coarse level is repeated on the skin.

use std::collections::BTreeSet;

use crate::cut::cones::ConformalFactor;
use crate::cut::handles::{join, open_handles};
use crate::cut::seam_graph::{EdgeId, SeamEdges, SeamGraph};
use crate::cut::shorten::shorten;
use crate::cut::{CutError, CutMesh};
use crate::id::{IdVec, VertexId};
use crate::mesh::TriMesh;

/// A seam, and what it joins: cones and apexes of loops.
#[derive(Debug, Clone, Default)]
pub(super) struct Seam {
    pub(super) edges: SeamEdges,
    pub(super) ends: BTreeSet<VertexId>,
}

impl Seam {
    /// The seam with more ends joined to it, shortened.
    pub(super) fn joined(&self, graph: &SeamGraph<'_>, ends: impl Iterator<Item = VertexId>) -> Self {
        let ends = self.ends.iter().copied().chain(ends).collect();
        Self { edges: shorten(graph, join(graph, &self.edges, &ends), &ends), ends }
    }
}

/// The seam without which the surface has no map: handles are opened, and of a closed surface the first two
/// cones are joined. Empty for a disk with holes.
pub(super) fn must_cut(graph: &SeamGraph<'_>) -> Seam {
    if graph.genus() > 0 {
        let handles = shorten(graph, open_handles(graph), &BTreeSet::new());
        // At least one loop is joined to it: the map has one outer boundary then.
        let ends: BTreeSet<_> = (!graph.loops.is_empty()).then(|| graph.apex(0)).into_iter().collect();
        let mut edges = join(graph, &handles, &ends);
        graph.rejoin(&mut edges, &ends);
        return Seam { edges, ends };
    }
    if !graph.loops.is_empty() {
        return Seam::default();
    }
    let mut fixed = IdVec::filled(false, graph.mesh.positions.len());
    let mut ends = BTreeSet::new();
    let factor = ConformalFactor::new(graph.mesh);
    for any in [0, 1].map(VertexId::new) {
        let cone = factor.as_ref().and_then(|factor| factor.next_cone(&fixed)).map_or(any, |(v, _)| v);
        fixed[cone] = true;
        ends.insert(cone);
    }
    let mut edges = join(graph, &SeamEdges::new(), &ends);
    if edges.len() == 1 {
        // A seam of one edge opens nothing: both its sides would have the same ends.
        let is_next = |edge: &EdgeId| graph.ends[*edge].iter().filter(|v| ends.contains(v)).count() == 1;
        let next = graph.ends.ids().find(is_next);
        edges.extend(next);
        ends.extend(next.into_iter().flat_map(|edge| graph.ends[edge]));
    }
    Seam { edges, ends }
}

/// The edges of a seam, and what it joins.
#[derive(Debug, Clone, Default, PartialEq)]
#[doc(hidden)]
pub struct Recipe {
    /// The edges of the mesh that are cut.
    pub(super) edges: Vec<[VertexId; 2]>,
    /// The vertices of loops at which these edges pass through the loop, which counts as one point.
    pub(super) spokes: Vec<VertexId>,
    /// A vertex of each loop that is joined.
    pub(super) loops: Vec<VertexId>,
    /// The vertices that the seam reaches.
    pub(super) cones: Vec<VertexId>,
}

impl Recipe {
    /// That of a seam of `graph`.
    pub(super) fn new(graph: &SeamGraph<'_>, seam: &Seam) -> Self {
        let own = graph.mesh.positions.len();
        let loops = seam.ends.iter().filter_map(|v| v.index().checked_sub(own));
        Self {
            edges: graph.mesh_edges(&seam.edges),
            spokes: graph.spokes(&seam.edges),
            loops: loops.map(|k| graph.loops[k][0]).collect(),
            cones: seam.ends.iter().copied().filter(|v| v.index() < own).collect(),
        }
    }

    /// The recipe for a finer mesh, with the vertices of this one at `origins`.
    #[doc(hidden)]
    pub fn on_finer(&self, origins: &IdVec<VertexId, VertexId>) -> Self {
        let map = |vertices: &[VertexId]| vertices.iter().map(|&v| origins[v]).collect();
        Self {
            edges: self.edges.iter().map(|ends| ends.map(|v| origins[v])).collect(),
            spokes: map(&self.spokes),
            loops: map(&self.loops),
            cones: map(&self.cones),
        }
    }

    /// Cuts a mesh, on which seams have these costs; nothing where the recipe cuts nothing.
    /// Fails if the mesh is not an oriented manifold in one piece, or not a disk with holes after the cut.
    #[doc(hidden)]
    pub fn cut(
        &self,
        mesh: &TriMesh,
        costs: Option<&IdVec<VertexId, f64>>,
    ) -> Result<Option<CutMesh>, CutError> {
        if self.edges.is_empty() {
            return Ok(None);
        }
        let graph = SeamGraph::new(mesh, costs)?;
        let loops = self.loops.iter().filter_map(|&v| graph.apex_at(v));
        let ends: BTreeSet<VertexId> = self.cones.iter().copied().chain(loops).collect();
        if let Some(seam) = self.along(&graph, &ends)
            && let Ok(cut) = graph.checked(&seam)
            && graph.leaves_one_rim(&seam, &cut)
        {
            return Ok(Some(cut));
        }
        // Paths that meet twice open too much, or too little: the seam is found anew.
        let seam = must_cut(&graph).joined(&graph, ends.into_iter());
        graph.checked(&seam.edges).map(Some)
    }

    /// The seam along shortest paths between the ends of its edges, shortened. A path through a loop would replace an edge
    /// between two of its vertices, and leave a handle closed.
    fn along(&self, graph: &SeamGraph<'_>, ends: &BTreeSet<VertexId>) -> Option<SeamEdges> {
        let spokes = self.spokes.iter().map(|&v| Some([v, graph.apex_at(v)?])).collect::<Option<Vec<_>>>()?;
        let mut seam = SeamEdges::new();
        let weights = graph.weights_without_loops();
        for &[a, b] in &self.edges {
            seam.extend(graph.paths.shortest(&weights, std::iter::once(a), |v| v == b)?);
        }
        for [v, apex] in spokes {
            seam.extend(graph.path(&[v].into(), &[apex].into())?);
        }
        graph.prune(&mut seam, ends);
        Some(shorten(graph, seam, ends))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::{Cut, decide};
    use crate::mesh::{boundary_loops, shapes};
    use crate::numeric::Random;

    /// A block with windows, and holes at some of its faces.
    fn holed_frame(windows: u32, fine: u32, holes: u64) -> TriMesh {
        let mut mesh = shapes::frame(windows, fine, 0.01);
        let mut random = Random::new(holes, 0);
        let mut is_free = IdVec::filled(true, mesh.positions.len());
        let triangles = mesh.triangles.iter().filter(|corners| {
            let is_hole = random.uniform() < 0.2 && corners.iter().all(|&v| is_free[v]);
            if is_hole {
                corners.iter().for_each(|&v| is_free[v] = false);
            }
            !is_hole
        });
        mesh.triangles = triangles.copied().collect();
        mesh
    }

    /// A seam that opens a handle may pass through the rim of a hole that it joins elsewhere, and must not cut off what
    /// lies between.
    #[test]
    fn handles_beside_holes_are_opened_in_one_piece() {
        for (windows, fine) in [(1, 2), (2, 2), (3, 2), (2, 3), (4, 3), (8, 2)] {
            for holes in 0..20 {
                let mesh = holed_frame(windows, fine, holes);
                let graph = SeamGraph::new(&mesh, None).unwrap();
                let mut seam = join(&graph, &open_handles(&graph), &[graph.apex(0)].into());
                graph.rejoin(&mut seam, &[graph.apex(0)].into());
                if let Err(error) = graph.checked(&seam) {
                    panic!("{windows} windows of {fine} edges, holes {holes}: {error}");
                }
            }
        }
    }

    /// An edge between two vertices of one loop opened no handle on the skin: the path through the loop was shorter.
    #[test]
    fn all_loops_joined_are_one() {
        for windows in 1..4 {
            for holes in 0..20 {
                let mesh = holed_frame(windows, 1, holes);
                let decided = decide(&mesh, None, &Cut::All, &|_, _| None).unwrap();
                let cut = decided.cut(&mesh, None).unwrap().unwrap();
                let loops = boundary_loops(&cut.mesh(&mesh.positions)).len();
                assert_eq!(loops, 1, "{windows} windows, holes {holes}");
            }
        }
    }
}
