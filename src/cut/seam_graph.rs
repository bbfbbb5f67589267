//! The surface on which seams are found: every boundary loop closed by a point, and the lengths of
//! its edges.

use std::{
    cmp::Reverse,
    collections::{BTreeSet, BinaryHeap},
};

use crate::{
    cut::{CutError, CutMesh, cut_mesh::check_disk},
    id::{FaceId, Id, IdVec, VertexId},
    mesh::{Adjacency, Edges, Halfedge, MeshError, TriMesh},
    numeric::{Csr, DisjointSets},
};

/// An edge of a [`SeamGraph`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct EdgeId(u32);

impl Id for EdgeId {
    fn new(index: usize) -> Self {
        Self(u32::try_from(index).expect("fewer edges than sides of faces, which 32 bits count"))
    }

    fn index(self) -> usize {
        self.0 as usize
    }
}

/// Edges of a seam, or of a candidate. Free edges belong to it too: they show through which loops it
/// passes.
pub(super) type SeamEdges = BTreeSet<EdgeId>;

/// Lengths are whole numbers of this share of the square root of the area: paths that are equally
/// long stay so when the surface is turned or scaled.
pub(super) const RESOLUTION: f64 = 1e-8;

/// Length of an edge of a loop or of a spoke to its apex: a loop counts as one point.
const FREE: u64 = 1;

/// Taxels are dense, and seams avoid them, where their density is more than this many times the
/// median one. *Heuristic*: triangulations of even taxels vary by less, and a seam through them
/// shall be straight.
const DENSE: f64 = 2.0;

/// The closed surface of a mesh: every boundary loop gets an apex, joined to each of its vertices.
#[derive(Debug)]
pub(super) struct SeamGraph<'m> {
    pub(super) mesh: &'m TriMesh,
    /// The boundary loops of the mesh, sorted by their smallest vertices.
    pub(super) loops: Vec<Vec<VertexId>>,
    /// The closed surface; the apex of loop `k` is vertex `n + k`.
    pub(super) closed: TriMesh,
    pub(super) adjacency: Adjacency,
    /// The edge of each side of each face.
    pub(super) edge_of: IdVec<FaceId, [EdgeId; 3]>,
    pub(super) ends: IdVec<EdgeId, [VertexId; 2]>,
    /// Length of each edge for shortest paths; see [`RESOLUTION`].
    pub(super) weights: IdVec<EdgeId, u64>,
    /// Lengths over the square root of the area; none for free edges.
    lengths: IdVec<EdgeId, f64>,
    is_on_loop: IdVec<VertexId, bool>,
    pub(super) paths: Paths,
}

impl<'m> SeamGraph<'m> {
    /// Closes a mesh; `densities` (1/m^2) of its taxels say where they are dense.
    ///
    /// # Errors
    /// If the mesh is not an oriented manifold.
    pub(super) fn new(
        mesh: &'m TriMesh,
        densities: Option<&IdVec<VertexId, f64>>,
    ) -> Result<Self, MeshError> {
        let loops = Adjacency::new(mesh)?.boundary_loops();
        let mut closed = mesh.clone();
        let mut is_on_loop = IdVec::<VertexId, bool>::filled(false, mesh.positions.len());
        for walk in &loops {
            walk.iter().for_each(|&v| is_on_loop[v] = true);
            let sum: glam::DVec3 = walk.iter().map(|&v| mesh.positions[v]).sum();
            let apex = closed.positions.push(sum / walk.len() as f64);
            for (&a, &b) in walk.iter().zip(walk.iter().cycle().skip(1)) {
                closed.triangles.push([b, a, apex]);
            }
        }
        let adjacency = Adjacency::new(&closed)?;
        let unit = mesh.area().sqrt();
        let factors = densities.map(cost_factors);
        let mut edge_of = IdVec::<FaceId, _>::filled([EdgeId::default(); 3], closed.triangles.len());
        let (mut ends, mut weights, mut lengths) = (IdVec::default(), IdVec::default(), IdVec::default());
        for along in Edges::new(&closed.triangles, closed.positions.len()).iter() {
            let [a, b] = [along[0].start(&closed), along[0].end(&closed)];
            let id = ends.push([a.min(b), a.max(b)]);
            along.iter().for_each(|h| edge_of[h.face()][h.side()] = id);
            let is_free = along.iter().any(|h| h.face().index() >= mesh.triangles.len());
            let length = if is_free { 0.0 } else { closed.positions[a].distance(closed.positions[b]) / unit };
            let factor = factors.as_ref().filter(|_| !is_free).map_or(1.0, |d| (d[a] * d[b]).sqrt());
            lengths.push(length);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
            let weight = ((length * factor / RESOLUTION).round() as u64).clamp(FREE, u64::MAX >> 32);
            weights.push(if is_free { FREE } else { weight });
        }
        let paths = Paths::new(closed.positions.len(), &closed.triangles, &edge_of);
        Ok(Self { mesh, loops, adjacency, edge_of, ends, weights, lengths, is_on_loop, paths, closed })
    }

    /// The vertex that stands for a loop.
    pub(super) fn apex(&self, of_loop: usize) -> VertexId {
        VertexId::new(self.mesh.positions.len() + of_loop)
    }

    /// The vertex that stands for the loop on which a vertex lies, if it lies on one.
    pub(super) fn apex_at(&self, v: VertexId) -> Option<VertexId> {
        self.loops.iter().position(|walk| walk.contains(&v)).map(|k| self.apex(k))
    }

    /// Handles of the surface.
    pub(super) fn genus(&self) -> usize {
        usize::try_from((2 - self.adjacency.euler_characteristic()) / 2).unwrap_or(0)
    }

    /// Whether an edge is one of a boundary or a spoke.
    pub(super) fn is_free(&self, edge: EdgeId) -> bool {
        let at = |v: VertexId| v.index() >= self.mesh.positions.len() || self.is_on_loop[v];
        self.lengths[edge] == 0.0 && self.ends[edge].into_iter().all(at)
    }

    /// The ends of the edges of a seam that are edges of the mesh.
    pub(super) fn mesh_edges(&self, seam: &SeamEdges) -> Vec<[VertexId; 2]> {
        let is_own = |ends: &[VertexId; 2]| ends[1].index() < self.mesh.positions.len();
        seam.iter().map(|&e| self.ends[e]).filter(is_own).collect()
    }

    /// The vertices of loops whose edges to the apex belong to a seam.
    pub(super) fn spokes(&self, seam: &SeamEdges) -> Vec<VertexId> {
        let is_spoke = |ends: &[VertexId; 2]| ends[1].index() >= self.mesh.positions.len();
        seam.iter().map(|&e| self.ends[e]).filter(is_spoke).map(|[v, _]| v).collect()
    }

    /// Length of a seam over the square root of the area.
    pub(super) fn length(&self, seam: &SeamEdges) -> f64 {
        seam.iter().map(|&e| self.lengths[e]).sum()
    }

    pub(super) fn weight(&self, seam: &SeamEdges) -> u64 {
        seam.iter().map(|&e| self.weights[e]).sum()
    }

    pub(super) fn vertices(&self, seam: &SeamEdges) -> BTreeSet<VertexId> {
        seam.iter().flat_map(|&e| self.ends[e]).collect()
    }

    /// The closed surface cut along a seam, free edges included.
    pub(super) fn open(&self, seam: &SeamEdges) -> CutMesh {
        let across = |h: Halfedge| {
            self.adjacency.twin(h).filter(|_| !seam.contains(&self.edge_of[h.face()][h.side()]))
        };
        CutMesh::new(&self.closed.triangles, self.closed.positions.len(), across)
    }

    /// The mesh cut along a seam; its free edges change nothing.
    pub(super) fn cut(&self, seam: &SeamEdges) -> CutMesh {
        let faces = self.mesh.triangles.len();
        let across = |h: Halfedge| {
            let twin = self.adjacency.twin(h).filter(|twin| twin.face().index() < faces);
            twin.filter(|_| !seam.contains(&self.edge_of[h.face()][h.side()]))
        };
        CutMesh::new(&self.mesh.triangles, self.mesh.positions.len(), across)
    }

    /// The mesh cut along a seam, if that is one disk with holes.
    ///
    /// # Errors
    /// If it is not.
    pub(super) fn checked(&self, seam: &SeamEdges) -> Result<CutMesh, CutError> {
        let cut = self.cut(seam);
        let first = self.vertices(seam).first().copied().unwrap_or_default();
        check_disk(&cut.mesh(&self.mesh.positions), first)?;
        Ok(cut)
    }

    /// The seam without the heaviest edge of every cycle, and without the dead ends that this leaves: paths
    /// that meet twice would cut out a piece. A loop counts as one point.
    pub(super) fn tree_of(&self, seam: SeamEdges) -> SeamEdges {
        let mut pieces = DisjointSets::<VertexId>::new(self.closed.positions.len());
        for (k, walk) in self.loops.iter().enumerate() {
            walk.iter().for_each(|&v| pieces.join(v, self.apex(k)));
        }
        let mut edges: Vec<EdgeId> = seam.into_iter().collect();
        edges.sort_by_key(|&e| (self.weights[e], e));
        let joins = |e: &EdgeId| {
            let [a, b] = self.ends[*e];
            let is_new = pieces.root(a) != pieces.root(b);
            pieces.join(a, b);
            is_new
        };
        let mut tree: SeamEdges = edges.into_iter().filter(joins).collect();
        self.prune(&mut tree, &self.loops.iter().flatten().copied().collect());
        tree
    }

    /// Removes dead ends, except those at the vertices to `keep`.
    pub(super) fn prune(&self, seam: &mut SeamEdges, keep: &BTreeSet<VertexId>) {
        loop {
            let degrees = self.degrees(seam);
            let is_loose = |v: VertexId| degrees[v] == 1 && !keep.contains(&v);
            let before = seam.len();
            seam.retain(|&e| !self.ends[e].into_iter().any(is_loose));
            if seam.len() == before {
                return;
            }
        }
    }

    /// How many edges of the seam each vertex has.
    pub(super) fn degrees(&self, seam: &SeamEdges) -> IdVec<VertexId, u32> {
        let mut degrees = IdVec::filled(0, self.closed.positions.len());
        seam.iter().flat_map(|&e| self.ends[e]).for_each(|v| degrees[v] += 1);
        degrees
    }

    /// The edges of the shortest path from one set of vertices to another; none if there is no path.
    pub(super) fn path(&self, from: &BTreeSet<VertexId>, to: &BTreeSet<VertexId>) -> Option<Vec<EdgeId>> {
        self.paths.shortest(&self.weights, from.iter().copied(), |v| to.contains(&v))
    }

    /// Weighted distances over the square root of the area from a set of vertices.
    pub(super) fn distances(&self, from: impl Iterator<Item = VertexId>) -> IdVec<VertexId, u64> {
        self.paths.tree(&self.weights, from).distances
    }
}

/// Factor on the length of paths at each vertex; 1 where the density is normal.
fn cost_factors(densities: &IdVec<VertexId, f64>) -> IdVec<VertexId, f64> {
    let mut sorted = densities.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let dense = sorted.get(sorted.len() / 2).copied().unwrap_or(1.0) * DENSE;
    densities.map(|rho| (rho / dense).sqrt().max(1.0))
}

/// Which vertices edges join, for shortest paths.
#[derive(Debug)]
pub(super) struct Paths {
    neighbours: Csr<(VertexId, EdgeId)>,
}

/// Shortest paths from a set of vertices to all others.
#[derive(Debug)]
pub(super) struct Tree {
    /// `u64::MAX` where there is no path.
    pub(super) distances: IdVec<VertexId, u64>,
    /// The last step of the path to each vertex; none at the sources.
    pub(super) parents: IdVec<VertexId, Option<(VertexId, EdgeId)>>,
}

impl Tree {
    /// The edges of the path to a vertex, backwards.
    pub(super) fn path(&self, to: VertexId) -> impl Iterator<Item = EdgeId> + '_ {
        let mut at = to;
        std::iter::from_fn(move || {
            let (from, edge) = self.parents[at]?;
            at = from;
            Some(edge)
        })
    }
}

impl Paths {
    /// From the corners of faces and the edges of their sides.
    pub(super) fn new(
        vertices: usize,
        triangles: &IdVec<FaceId, [VertexId; 3]>,
        edge_of: &IdVec<FaceId, [EdgeId; 3]>,
    ) -> Self {
        let sides = triangles
            .iter()
            .zip(edge_of)
            .flat_map(|(&[a, b, c], &[ab, bc, ca])| [(a, b, ab), (b, c, bc), (c, a, ca)]);
        let both = sides.flat_map(|(a, b, edge)| [(a.index(), (b, edge)), (b.index(), (a, edge))]);
        Self { neighbours: Csr::from_pairs(vertices, both) }
    }

    /// The shortest paths from `sources` (Dijkstra).
    pub(super) fn tree(&self, weights: &IdVec<EdgeId, u64>, sources: impl Iterator<Item = VertexId>) -> Tree {
        self.search(weights, sources, |_| false).0
    }

    /// The edges of the shortest path from `sources` to a vertex that is a target; of equally near
    /// ones the smallest.
    pub(super) fn shortest(
        &self,
        weights: &IdVec<EdgeId, u64>,
        sources: impl Iterator<Item = VertexId>,
        is_target: impl Fn(VertexId) -> bool,
    ) -> Option<Vec<EdgeId>> {
        let (tree, reached) = self.search(weights, sources, is_target);
        reached.map(|v| tree.path(v).collect())
    }

    fn search(
        &self,
        weights: &IdVec<EdgeId, u64>,
        sources: impl Iterator<Item = VertexId>,
        is_target: impl Fn(VertexId) -> bool,
    ) -> (Tree, Option<VertexId>) {
        let vertices = self.neighbours.len();
        let mut tree =
            Tree { distances: IdVec::filled(u64::MAX, vertices), parents: IdVec::filled(None, vertices) };
        let mut heap = BinaryHeap::new();
        for v in sources {
            tree.distances[v] = 0;
            heap.push(Reverse((0, v)));
        }
        while let Some(Reverse((distance, v))) = heap.pop() {
            if distance > tree.distances[v] {
                continue;
            }
            if is_target(v) {
                return (tree, Some(v));
            }
            for &(w, edge) in &self.neighbours[v.index()] {
                let further = distance + weights[edge];
                if further < tree.distances[w] {
                    tree.distances[w] = further;
                    tree.parents[w] = Some((v, edge));
                    heap.push(Reverse((further, w)));
                }
            }
        }
        (tree, None)
    }
}
