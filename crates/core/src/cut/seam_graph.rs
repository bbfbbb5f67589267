//! The surface on which seams are found: every boundary loop closed by a point, and the lengths of
//! its edges.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use glam::DVec3;

use crate::cut::cut_mesh::check_disk;
use crate::cut::{CutError, CutMesh};
use crate::id::{FaceId, Id, IdVec, VertexId};
use crate::mesh::{Adjacency, Edges, Halfedge, MeshError, TriMesh, boundary_loops};
use crate::numeric::{Csr, DisjointSets};
use crate::skin::Taxels;

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

/// The largest length of an edge: sums of as many as 32 bits count are below 64 bits.
const LONGEST: u64 = u64::MAX >> 32;

/// Taxels are dense, and seams avoid them, where their density is more than this many times the
/// median one. *Heuristic*: triangulations of even taxels vary by less, and a seam through them
/// should not bend.
const DENSE: f64 = 2.0;

/// Factor on the length of paths through skin that faces away from the side where seams are wanted. *Heuristic*.
const AWAY: f64 = 4.0;

/// Factors by weight, over the mean one, are at least and at most these.
const WEIGHTED: [f64; 2] = [0.25, 4.0];

/// A face is a needle if its height is below this share of its longest edge.
const THIN: f64 = 0.03;

/// Factor on the length of paths along needles: one at a seam collapses on the map, at almost no energy.
const NEEDLE: f64 = 1.5;

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
    /// Closes a mesh; `costs` are factors on the length of paths at its vertices.
    pub(super) fn new(mesh: &'m TriMesh, costs: Option<&IdVec<VertexId, f64>>) -> Result<Self, MeshError> {
        let loops = Adjacency::new(mesh)?.boundary_loops();
        let mut closed = mesh.clone();
        let mut is_on_loop = IdVec::<VertexId, bool>::filled(false, mesh.positions.len());
        for walk in &loops {
            walk.iter().for_each(|&v| is_on_loop[v] = true);
            let sum: DVec3 = walk.iter().map(|&v| mesh.positions[v]).sum();
            let apex = closed.positions.push(sum / walk.len() as f64);
            for (&a, &b) in walk.iter().zip(walk.iter().cycle().skip(1)) {
                closed.triangles.push([b, a, apex]);
            }
        }
        let adjacency = Adjacency::new(&closed)?;
        let unit = mesh.area().sqrt();
        let needles = needles(mesh);
        let mut edge_of = IdVec::<FaceId, _>::filled([EdgeId::default(); 3], closed.triangles.len());
        let (mut ends, mut weights, mut lengths) = (IdVec::default(), IdVec::default(), IdVec::default());
        for along in Edges::new(&closed.triangles, closed.positions.len()).iter() {
            let [a, b] = [along[0].start(&closed), along[0].end(&closed)];
            let id = ends.push([a.min(b), a.max(b)]);
            along.iter().for_each(|h| edge_of[h.face()][h.side()] = id);
            let is_free = along.iter().any(|h| h.face().index() >= mesh.triangles.len());
            let length = if is_free { 0.0 } else { closed.positions[a].distance(closed.positions[b]) / unit };
            let factor = if is_free { 1.0 } else { costs.map_or(1.0, |c| (c[a] * c[b]).sqrt()) };
            let factor = if !is_free && (needles[a] || needles[b]) { factor * NEEDLE } else { factor };
            lengths.push(length);
            weights.push(if is_free { FREE } else { whole(length * factor) });
        }
        let paths = Paths::new(closed.positions.len(), &closed.triangles, &edge_of);
        Ok(Self { mesh, loops, adjacency, edge_of, ends, weights, lengths, is_on_loop, paths, closed })
    }

    /// The vertex that stands for a loop.
    pub(super) fn apex(&self, of_loop: usize) -> VertexId {
        VertexId::new(self.mesh.positions.len() + of_loop)
    }

    /// The vertex that stands for the loop that a vertex is on, if it is on one.
    pub(super) fn apex_at(&self, v: VertexId) -> Option<VertexId> {
        self.loops.iter().position(|walk| walk.contains(&v)).map(|k| self.apex(k))
    }

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
    pub(super) fn checked(&self, seam: &SeamEdges) -> Result<CutMesh, CutError> {
        let cut = self.cut(seam);
        let first = self.vertices(seam).first().copied().unwrap_or_default();
        check_disk(&cut.mesh(&self.mesh.positions), first)?;
        Ok(cut)
    }

    /// Whether a mesh that is cut along a seam has one loop, and those that the seam does not meet.
    pub(super) fn leaves_one_rim(&self, seam: &SeamEdges, cut: &CutMesh) -> bool {
        let met = self.vertices(seam);
        let free = self.loops.iter().filter(|walk| !walk.iter().any(|v| met.contains(v))).count();
        boundary_loops(&cut.mesh(&self.mesh.positions)).len() == free + 1
    }

    /// Lengths of edges for paths that pass through no loop: those of a rim have theirs, spokes are too long.
    pub(super) fn weights_without_loops(&self) -> IdVec<EdgeId, u64> {
        let unit = self.mesh.area().sqrt();
        let weight = |(edge, &[a, b]): (EdgeId, &[VertexId; 2])| match self.is_free(edge) {
            true if b.index() >= self.mesh.positions.len() => LONGEST,
            true => whole(self.mesh.positions[a].distance(self.mesh.positions[b]) / unit),
            false => self.weights[edge],
        };
        self.ends.enumerate().map(weight).collect()
    }

    /// Removes edges of a seam until it leaves the mesh in one piece. A seam opens the closed surface to a disk, but where it
    /// passes through a vertex of a loop and meets the same loop elsewhere, the loop cuts off what lies between. The free
    /// edges of the result are the spokes of all vertices at which it meets a loop.
    pub(super) fn rejoin(&self, seam: &mut SeamEdges, keep: &BTreeSet<VertexId>) {
        if self.loops.is_empty() {
            return;
        }
        seam.retain(|&edge| !self.is_free(edge));
        let (mut pieces, mut cut) = (DisjointSets::<FaceId>::new(self.mesh.triangles.len()), Vec::new());
        for h in self.mesh.triangles.ids().flat_map(Halfedge::of_face) {
            let is_own = |twin: &Halfedge| *twin > h && twin.face().index() < self.mesh.triangles.len();
            let Some(twin) = self.adjacency.twin(h).filter(is_own) else { continue };
            let edge = self.edge_of[h.face()][h.side()];
            if seam.contains(&edge) {
                cut.push((edge, [h.face(), twin.face()]));
            } else {
                pieces.join(h.face(), twin.face());
            }
        }
        for (edge, [f, g]) in cut {
            if pieces.root(f) != pieces.root(g) {
                pieces.join(f, g);
                seam.remove(&edge);
            }
        }
        let spokes = self.vertices(seam).into_iter().flat_map(|v| &self.paths.neighbours[v.index()]);
        let spokes: Vec<EdgeId> = spokes
            .filter(|(apex, _)| apex.index() >= self.mesh.positions.len())
            .map(|&(_, edge)| edge)
            .collect();
        seam.extend(spokes);
        self.prune(seam, keep);
    }

    /// Removes dead ends, except those at the vertices to `keep`.
    pub(super) fn prune(&self, seam: &mut SeamEdges, keep: &BTreeSet<VertexId>) {
        let mut degrees = self.degrees(seam);
        let mut loose: Vec<VertexId> = self.vertices(seam).into_iter().filter(|&v| degrees[v] == 1).collect();
        while let Some(v) = loose.pop() {
            if degrees[v] != 1 || keep.contains(&v) {
                continue;
            }
            let at = self.paths.neighbours[v.index()].iter().find(|(_, edge)| seam.contains(edge));
            let Some(&(w, edge)) = at else { continue };
            seam.remove(&edge);
            degrees[v] -= 1;
            degrees[w] -= 1;
            loose.push(w);
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
}

/// A length over the square root of the area as a whole number; see [`RESOLUTION`].
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
fn whole(length: f64) -> u64 {
    ((length / RESOLUTION).round() as u64).clamp(FREE, LONGEST)
}

/// Factors on the length of paths at each taxel: seams avoid taxels that are dense, whose weights are high or
/// that face away from `side`, a unit vector. None where all are equal.
#[doc(hidden)]
pub fn seam_costs(taxels: &Taxels, side: Option<DVec3>) -> Option<IdVec<VertexId, f64>> {
    let densities = taxels.wanted_densities();
    let of_density = densities.as_ref().map(|densities| {
        let mut sorted = densities.as_slice().to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let dense = sorted.get(sorted.len() / 2).copied().unwrap_or(1.0) * DENSE;
        densities.map(|rho| (rho / dense).sqrt().max(1.0))
    });
    let of_weight = taxels.weights.as_ref().map(|weights| {
        let mean = weights.iter().sum::<f64>() / weights.len() as f64;
        let [least, most] = WEIGHTED;
        weights.map(|w| if mean > 0.0 { (w / mean).clamp(least, most) } else { 1.0 })
    });
    let of_side = side.map(|side| taxels.normals.map(|n| AWAY.powf(0.5 - 0.5 * n.dot(side))));
    let given = [of_density, of_weight, of_side].into_iter().flatten();
    given.reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a * b).collect())
}

/// The vertices of faces that are needles.
fn needles(mesh: &TriMesh) -> IdVec<VertexId, bool> {
    let mut found = IdVec::filled(false, mesh.positions.len());
    for (face, corners) in mesh.triangles.enumerate() {
        let [a, b, c] = mesh.corners(face);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        if 2.0 * mesh.face_area(face) < THIN * longest {
            corners.iter().for_each(|&v| found[v] = true);
        }
    }
    found
}

/// Which vertices edges join, for shortest paths.
#[derive(Debug)]
pub(super) struct Paths {
    neighbours: Csr<(VertexId, EdgeId)>,
}

/// What becomes of a vertex that a search reaches.
enum Met {
    /// The search goes on.
    Way,
    End,
    /// The path to it is a source from now on.
    Source,
}

/// Shortest paths from a set of vertices to all others.
#[derive(Debug)]
pub(super) struct PathTree {
    /// `u64::MAX` where there is no path.
    pub(super) distances: IdVec<VertexId, u64>,
    /// The last step of the path to each vertex; none at the sources.
    pub(super) parents: IdVec<VertexId, Option<(VertexId, EdgeId)>>,
}

impl PathTree {
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
    pub(super) fn tree(
        &self,
        weights: &IdVec<EdgeId, u64>,
        sources: impl Iterator<Item = VertexId>,
    ) -> PathTree {
        self.search(weights, sources, |_| Met::Way).0
    }

    /// The edges of the shortest path from `sources` to a vertex that is a target; of equally near
    /// ones the smallest.
    pub(super) fn shortest(
        &self,
        weights: &IdVec<EdgeId, u64>,
        sources: impl Iterator<Item = VertexId>,
        is_target: impl Fn(VertexId) -> bool,
    ) -> Option<Vec<EdgeId>> {
        let mut reached = None;
        let met = |v| {
            if !is_target(v) {
                return Met::Way;
            }
            reached = Some(v);
            Met::End
        };
        let (tree, _) = self.search(weights, sources, met);
        reached.map(|v| tree.path(v).collect())
    }

    /// The edges of shortest paths that join targets to `sources` and to each other, always the nearest
    /// one.
    pub(super) fn tree_to(
        &self,
        weights: &IdVec<EdgeId, u64>,
        sources: &BTreeSet<VertexId>,
        mut targets: BTreeSet<VertexId>,
    ) -> Vec<EdgeId> {
        let met = |v| {
            if targets.is_empty() {
                Met::End
            } else if targets.remove(&v) {
                Met::Source
            } else {
                Met::Way
            }
        };
        self.search(weights, sources.iter().copied(), met).1
    }

    /// The shortest paths from `sources`, in order of their lengths, and the edges of those that became
    /// sources too. `met` decides what becomes of each vertex that is reached.
    fn search(
        &self,
        weights: &IdVec<EdgeId, u64>,
        sources: impl Iterator<Item = VertexId>,
        mut met: impl FnMut(VertexId) -> Met,
    ) -> (PathTree, Vec<EdgeId>) {
        let vertices = self.neighbours.len();
        let mut tree =
            PathTree { distances: IdVec::filled(u64::MAX, vertices), parents: IdVec::filled(None, vertices) };
        let (mut heap, mut edges) = (BinaryHeap::new(), Vec::new());
        for v in sources {
            tree.distances[v] = 0;
            heap.push(Reverse((0, v)));
        }
        while let Some(Reverse((distance, v))) = heap.pop() {
            if distance > tree.distances[v] {
                continue;
            }
            match met(v) {
                Met::Way => {}
                Met::End => break,
                Met::Source => {
                    let mut at = Some(v);
                    while let Some(w) = at {
                        tree.distances[w] = 0;
                        heap.push(Reverse((0, w)));
                        let step = tree.parents[w].take();
                        edges.extend(step.map(|(_, edge)| edge));
                        at = step.map(|(from, _)| from);
                    }
                    continue;
                }
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
        (tree, edges)
    }
}
