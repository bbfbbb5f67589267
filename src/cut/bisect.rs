//! Divides a surface in two along a short border, for charts of their own.
//!
//! *Heuristic*, after the hierarchical decomposition of `(katz2003)`: two vertices far apart, and
//! between the places that are clearly nearer to one of them the shortest border of all
//! (`min_cut`).

use std::cmp::Reverse;

use crate::{
    cut::{
        CutError,
        min_cut::FlowGraph,
        seam_graph::{EdgeId, Paths, RESOLUTION, SeamGraph, Tree},
    },
    id::{FaceId, IdVec, VertexId},
    mesh::{Halfedge, TriMesh},
    numeric::{DisjointSets, argsort},
};

/// A face is clearly nearer to one of two vertices if its distances to both differ by this share of
/// their sum.
const CLEARLY: f64 = 0.3;

/// Sweeps that look for two vertices far apart.
const SWEEPS: usize = 4;

/// A surface on which borders are sought.
pub(crate) struct Bisection<'m> {
    graph: SeamGraph<'m>,
    /// Lengths of all edges, those of the boundary too.
    lengths: IdVec<EdgeId, u64>,
    paths: Paths,
}

impl<'m> Bisection<'m> {
    /// For a mesh in one piece; `densities` (1/m^2) of its taxels say where they are dense, and
    /// borders avoid them.
    ///
    /// # Errors
    /// If the mesh is not an oriented manifold.
    pub(crate) fn new(mesh: &'m TriMesh, densities: Option<&IdVec<VertexId, f64>>) -> Result<Self, CutError> {
        let graph = SeamGraph::new(mesh, densities)?;
        let unit = mesh.area().sqrt();
        let length = |(edge, &[a, b]): (EdgeId, &[VertexId; 2])| {
            if b.index() >= mesh.positions.len() {
                return graph.weights[edge];
            }
            let length = mesh.positions[a].distance(mesh.positions[b]) / unit;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
            let whole = (length / RESOLUTION).round() as u64;
            whole.clamp(1, u64::MAX >> 32)
        };
        let lengths = graph.ends.enumerate().map(length).collect();
        let paths = Paths::new(mesh.positions.len(), &mesh.triangles, &graph.edge_of);
        Ok(Self { graph, lengths, paths })
    }

    fn distances(&self, from: impl Iterator<Item = VertexId>) -> IdVec<VertexId, u64> {
        let Tree { distances, .. } = self.paths.tree(&self.lengths, from);
        distances
    }

    /// Which faces belong to the second half.
    pub(crate) fn halves(&self) -> IdVec<FaceId, bool> {
        let [a, b] = self.far_pair();
        let distances = [a, b].map(|v| self.distances(std::iter::once(v)));
        let mesh = self.graph.mesh;
        let nearness = |corners: &[VertexId; 3]| {
            let [near, far] =
                [&distances[0], &distances[1]].map(|d| corners.map(|v| d[v] as f64).iter().sum::<f64>());
            (near - far) / (near + far)
        };
        let nearness = mesh.triangles.map(nearness);
        let fixed = |face: FaceId| (nearness[face].abs() > CLEARLY).then_some(nearness[face] > 0.0);
        let halves = self.shortest_border(&fixed);
        if halves.iter().any(|side| *side) && halves.iter().any(|side| !*side) {
            return halves;
        }
        // No face is clearly nearer to one of them: there are few.
        let order = argsort(&nearness);
        let mut halves = nearness.map(|_| false);
        order.iter().skip(order.len().div_ceil(2)).for_each(|&k| halves[FaceId::new(k)] = true);
        halves
    }

    fn far_pair(&self) -> [VertexId; 2] {
        let mut pair = [VertexId::default(); 2];
        for _ in 0..SWEEPS {
            let distances = self.distances(std::iter::once(pair[1]));
            let reached = distances.ids().filter(|&v| distances[v] != u64::MAX);
            let farthest = reached.max_by_key(|&v| (distances[v], Reverse(v)));
            pair = [pair[1], farthest.unwrap_or_default()];
        }
        pair
    }

    /// The same halves with the shortest border within `reach` (m) of theirs, both in one piece.
    pub(crate) fn straightened(&self, mut halves: IdVec<FaceId, bool>, reach: f64) -> IdVec<FaceId, bool> {
        self.join_strays(&mut halves);
        let border: Vec<VertexId> =
            self.border(&halves).flat_map(|h| [h.start(self.graph.mesh), h.end(self.graph.mesh)]).collect();
        let distances = self.distances(border.into_iter());
        let reach = reach / self.graph.mesh.area().sqrt() / RESOLUTION;
        let is_near =
            |face: FaceId| self.graph.mesh.triangles[face].iter().any(|&v| (distances[v] as f64) <= reach);
        let fixed = |face: FaceId| (!is_near(face)).then_some(halves[face]);
        let both = [false, true].map(|side| halves.ids().any(|face| fixed(face) == Some(side)));
        if both == [true, true] {
            halves = self.shortest_border(&fixed);
            self.join_strays(&mut halves);
        }
        halves
    }

    /// Halfedges between the halves, once for each edge.
    fn border<'a>(&'a self, halves: &'a IdVec<FaceId, bool>) -> impl Iterator<Item = Halfedge> + 'a {
        self.inner_edges().filter(|[h, twin]| halves[h.face()] != halves[twin.face()]).map(|[h, _]| h)
    }

    /// Both halfedges of every edge between two faces of the mesh.
    fn inner_edges(&self) -> impl Iterator<Item = [Halfedge; 2]> + '_ {
        let faces = self.graph.mesh.triangles.len();
        let sides = (0..faces).flat_map(|face| [0, 1, 2].map(|side| Halfedge::new(FaceId::new(face), side)));
        let pair = |h| self.graph.adjacency.twin(h).map(|twin| [h, twin]);
        sides.filter_map(pair).filter(move |[h, twin]| h < twin && twin.face().index() < faces)
    }

    /// The shortest border between the faces that are fixed on either side.
    fn shortest_border(&self, fixed: &dyn Fn(FaceId) -> Option<bool>) -> IdVec<FaceId, bool> {
        let [source, sink] = [0, 1];
        let mut nodes = 2;
        let node_of: IdVec<FaceId, usize> = self
            .graph
            .mesh
            .triangles
            .ids()
            .map(|face| match fixed(face) {
                Some(false) => source,
                Some(true) => sink,
                None => {
                    nodes += 1;
                    nodes - 1
                }
            })
            .collect();
        let mut flow = FlowGraph::new(nodes);
        for [h, twin] in self.inner_edges() {
            let [a, b] = [h, twin].map(|h| node_of[h.face()]);
            if a != b {
                flow.join(a, b, self.graph.weights[self.graph.edge_of[h.face()][h.side()]]);
            }
        }
        let is_first = flow.cut(source, sink);
        node_of.map(|&node| !is_first[node])
    }

    /// Gives every piece of a half but its largest to the other one.
    fn join_strays(&self, halves: &mut IdVec<FaceId, bool>) {
        let mesh = self.graph.mesh;
        for side in [false, true] {
            let mut pieces = DisjointSets::<FaceId>::new(mesh.triangles.len());
            for [h, twin] in self.inner_edges() {
                if halves[h.face()] == halves[twin.face()] {
                    pieces.join(h.face(), twin.face());
                }
            }
            let mut areas = mesh.triangles.map(|_| 0.0);
            for face in mesh.triangles.ids().filter(|&face| halves[face] == side) {
                areas[pieces.root(face)] += mesh.face_area(face);
            }
            let largest = areas
                .ids()
                .fold(FaceId::default(), |best, face| if areas[face] > areas[best] { face } else { best });
            for face in mesh.triangles.ids() {
                if halves[face] == side && pieces.root(face) != largest {
                    halves[face] = !side;
                }
            }
        }
    }
}
