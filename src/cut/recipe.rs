//! What defines a seam, so that the seam found on a coarse level can be repeated on the skin.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    cut::{
        CutError, CutMesh,
        handles::{far_pair, join, open_handles},
        seam_graph::{SeamEdges, SeamGraph},
        shorten::shorten,
    },
    id::{IdVec, VertexId},
    mesh::TriMesh,
};

/// What must be cut, which loops are joined and where slits end.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Recipe {
    /// Whether there is a seam at all.
    pub(super) is_cut: bool,
    /// The edges that must be cut: of closed surfaces and handles.
    pub(super) base: Vec<[VertexId; 2]>,
    /// The vertices of loops at which these edges pass through the loop, which counts as one point.
    pub(super) spokes: Vec<VertexId>,
    /// A vertex of each loop to be joined.
    pub(super) loops: Vec<VertexId>,
    /// If not empty, the edges that join pairs of loops through what is curved between them: used instead
    /// of all the rest.
    pub(super) through: Vec<[VertexId; 2]>,
    /// Where the slits end, in the order in which they are cut.
    pub(super) slits: Vec<VertexId>,
    /// The area ratio of the trial map, where a limit was given; else 0.
    pub(crate) area_ratio: f64,
}

impl Recipe {
    /// The recipe for a finer mesh, on which `origins` says where the vertices are.
    pub(crate) fn on_finer(&self, origins: &IdVec<VertexId, VertexId>) -> Self {
        let map = |vertices: &[VertexId]| vertices.iter().map(|&v| origins[v]).collect();
        let edges = |edges: &[[VertexId; 2]]| edges.iter().map(|ends| ends.map(|v| origins[v])).collect();
        Self {
            is_cut: self.is_cut,
            base: edges(&self.base),
            spokes: map(&self.spokes),
            loops: map(&self.loops),
            through: edges(&self.through),
            slits: map(&self.slits),
            area_ratio: self.area_ratio,
        }
    }

    /// Cuts a mesh, whose taxels have these densities (1/m^2); nothing where the recipe cuts
    /// nothing.
    ///
    /// # Errors
    /// If the mesh is not an oriented manifold in one piece, or not a disk with holes after the cut.
    pub(crate) fn cut(
        &self,
        mesh: &TriMesh,
        densities: Option<&IdVec<VertexId, f64>>,
    ) -> Result<Option<CutMesh>, CutError> {
        if !self.is_cut {
            return Ok(None);
        }
        let graph = SeamGraph::new(mesh, densities)?;
        if !self.through.is_empty()
            && let Some(cut) = self.cut_through(&graph)
        {
            return Ok(Some(cut));
        }
        let mut seam = self.shortest_seam(&graph).unwrap_or_else(|| must_cut(&graph));
        let wanted = |walk: &Vec<VertexId>| walk.iter().any(|v| self.loops.contains(v));
        let loops: Vec<usize> = (0..graph.loops.len()).filter(|&k| wanted(&graph.loops[k])).collect();
        if !loops.is_empty() {
            seam = join_loops(&graph, &seam, &loops);
        }
        for &end in &self.slits {
            seam = slit(&graph, &seam, end);
        }
        graph.checked(&seam).map(Some)
    }

    /// The mesh cut along the seam that joins pairs of loops; `None` if that does not open it.
    fn cut_through(&self, graph: &SeamGraph<'_>) -> Option<CutMesh> {
        let path = |&[a, b]: &[VertexId; 2]| graph.path(&[a].into(), &[b].into());
        let paths: Vec<_> = self.through.iter().map(path).collect::<Option<_>>()?;
        graph.checked(&graph.tree_of(paths.into_iter().flatten().collect())).ok()
    }

    /// The required cuts as shortest paths between the ends of their edges; `None` if these do not open
    /// the surface.
    fn shortest_seam(&self, graph: &SeamGraph<'_>) -> Option<SeamEdges> {
        let spokes = self.spokes.iter().map(|&v| Some([v, graph.apex_at(v)?])).collect::<Option<Vec<_>>>()?;
        let mut seam = SeamEdges::new();
        let mut uses = BTreeMap::<VertexId, u32>::new();
        for &[a, b] in self.base.iter().chain(&spokes) {
            seam.extend(graph.path(&[a].into(), &[b].into())?);
            [a, b].iter().for_each(|&v| *uses.entry(v).or_default() += 1);
        }
        let ends = uses.into_iter().filter(|x| x.1 == 1).map(|x| x.0).collect();
        graph.prune(&mut seam, &ends);
        let shorter = shorten(graph, seam, &ends);
        graph.checked(&shorter).is_ok().then_some(shorter)
    }
}

/// The seam without which the surface has no map: handles are opened, and of a closed surface two
/// far points are joined. Empty for a disk with holes.
pub(super) fn must_cut(graph: &SeamGraph<'_>) -> SeamEdges {
    if graph.genus() > 0 {
        let seam = shorten(graph, open_handles(graph), &BTreeSet::new());
        // At least one loop is joined to it: the map has one outer boundary then.
        let first = (!graph.loops.is_empty()).then(|| graph.apex(0));
        return join(graph, &seam, &first.into_iter().collect());
    }
    if !graph.loops.is_empty() {
        return SeamEdges::new();
    }
    let seam = join(graph, &SeamEdges::new(), &far_pair(graph).into_iter().collect());
    if seam.len() > 1 {
        return seam;
    }
    // A seam of one edge opens nothing: both its sides would have the same ends.
    let ends = graph.vertices(&seam);
    let next = graph.ends.ids().find(|&e| graph.ends[e].iter().filter(|v| ends.contains(v)).count() == 1);
    seam.into_iter().chain(next).collect()
}

/// The seam with loops joined to it, shortened.
pub(super) fn join_loops(graph: &SeamGraph<'_>, seam: &SeamEdges, loops: &[usize]) -> SeamEdges {
    let ends: BTreeSet<VertexId> = loops.iter().map(|&k| graph.apex(k)).collect();
    shorten(graph, join(graph, seam, &ends), &ends)
}

/// The seam with a shortest path from a vertex to it, or to a loop.
pub(super) fn slit(graph: &SeamGraph<'_>, seam: &SeamEdges, end: VertexId) -> SeamEdges {
    let mut to = graph.vertices(seam);
    to.extend((0..graph.loops.len()).map(|k| graph.apex(k)));
    let path = graph.path(&[end].into(), &to).unwrap_or_default();
    seam.iter().copied().chain(path).collect()
}
