//! Seams that every cut needs: handles opened, and loops joined.

use std::collections::BTreeSet;

use crate::cut::seam_graph::{EdgeId, SeamEdges, SeamGraph};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::Halfedge;
use crate::numeric::{DisjointSets, order_by};

/// Roots from which a system of loops is tried, evenly spread over the vertices' numbers.
const ROOTS: usize = 4;

/// A seam that opens all handles, the shortest of those from a few roots: the edges in neither the
/// shortest-path tree of the root nor the spanning tree of the faces with the longest loops, and the paths
/// from them to the root (`(erickson2004)`). Empty without handles.
pub(super) fn open_handles(graph: &SeamGraph<'_>) -> SeamEdges {
    let last = graph.mesh.positions.len() - 1;
    let roots = (0..ROOTS).map(|k| VertexId::new(k * last / (ROOTS - 1)));
    let seams = roots.map(|root| from_root(graph, root));
    seams.min_by_key(|seam| graph.weight(seam)).unwrap_or_default()
}

fn from_root(graph: &SeamGraph<'_>, root: VertexId) -> SeamEdges {
    let tree = graph.paths.tree(&graph.weights, std::iter::once(root));
    let mut in_tree = IdVec::<EdgeId, _>::filled(false, graph.ends.len());
    tree.parents.iter().flatten().for_each(|&(_, edge)| in_tree[edge] = true);
    let length = |e| {
        let [a, b] = graph.ends[e];
        tree.distances[a].saturating_add(tree.distances[b]).saturating_add(graph.weights[e])
    };
    let rest: Vec<_> = graph.ends.ids().filter(|&e| !in_tree[e]).collect();
    let lengths: Vec<_> = rest.iter().map(|&e| length(e)).collect();
    let mut faces_of = IdVec::<EdgeId, _>::filled([FaceId::default(); 2], graph.ends.len());
    for face in graph.closed.triangles.ids() {
        for side in 0..3 {
            if let Some(twin) = graph.adjacency.twin(Halfedge::new(face, side)) {
                faces_of[graph.edge_of[face][side]] = [face, twin.face()];
            }
        }
    }
    let mut cotree = DisjointSets::<FaceId>::new(graph.closed.triangles.len());
    let mut seam = SeamEdges::new();
    for e in order_by(rest.len(), &|a, b| lengths[b].cmp(&lengths[a])).into_iter().map(|k| rest[k]) {
        let [f, g] = faces_of[e];
        if cotree.root(f) != cotree.root(g) {
            cotree.join(f, g);
            continue;
        }
        seam.insert(e);
        graph.ends[e].into_iter().for_each(|v| seam.extend(tree.path(v)));
    }
    graph.prune(&mut seam, &BTreeSet::new());
    seam
}

/// The seam with `ends` joined to it: the nearest by a shortest path, until all are connected
/// (`(takahashi1980)`).
pub(super) fn join(graph: &SeamGraph<'_>, seam: &SeamEdges, ends: &BTreeSet<VertexId>) -> SeamEdges {
    let mut here = graph.vertices(seam);
    let mut left = ends - &here;
    if here.is_empty() {
        here.extend(left.pop_first());
    }
    seam.iter().copied().chain(graph.paths.tree_to(&graph.weights, &here, left)).collect()
}
