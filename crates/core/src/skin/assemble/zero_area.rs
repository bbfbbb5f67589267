//! Faces without area: caps and needles `(botsch2001)`, dropped at the boundary and flipped away
//! elsewhere.

use std::collections::{HashMap, HashSet, VecDeque};

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, triangle_cross};
use crate::parallel::par_collect;

/// A face lower than this share of its longest side has no area. Rounding of positions to `f32` moves the
/// middle one of three collinear taxels off the line by up to 1e-5 of their distance; no real face is that
/// thin.
const FLATTEST: f64 = 1e-5;

/// Height of a triangle over its longest side, as a share of that side: `sqrt(3)/2` if equilateral,
/// 0 without area.
pub(in crate::skin) fn slenderness([a, b, c]: [DVec3; 3]) -> f64 {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    let height = triangle_cross([a, b, c]).length() / longest;
    // Squares of very short or long edges under- or overflow: 0/0.
    if height.is_nan() { 0.0 } else { height }
}

/// Whether a triangle has no area, up to rounding.
pub(in crate::skin) fn has_no_area(corners: [DVec3; 3]) -> bool {
    slenderness(corners) <= FLATTEST
}

/// The faces without area, by how they were treated.
#[derive(Debug, Default)]
pub(super) struct Cleared {
    /// Faces at the boundary that were dropped.
    pub dropped: Vec<FaceId>,
    /// Faces whose longest side was flipped.
    pub flipped: Vec<FaceId>,
    /// Faces that could neither be dropped nor flipped.
    pub kept: Vec<FaceId>,
}

impl Cleared {
    /// Drops pieces of which no face has an area, unless there are no others: they are lines, on which nothing lies.
    pub(super) fn drop_flat_pieces(&mut self, mesh: &TriMesh, piece: &IdVec<FaceId, Option<usize>>) {
        let mut is_flat = piece.map(|_| false);
        self.dropped.iter().chain(&self.kept).for_each(|&face| is_flat[face] = true);
        let with_area: HashSet<usize> =
            mesh.triangles.ids().filter(|&face| !is_flat[face]).filter_map(|face| piece[face]).collect();
        if with_area.is_empty() {
            return;
        }
        let is_line = |face: &FaceId| piece[*face].is_some_and(|piece| !with_area.contains(&piece));
        self.dropped.extend(self.kept.iter().copied().filter(is_line));
        self.dropped.sort_unstable();
        self.kept.retain(|face| !is_line(face));
    }
}

/// Removes the faces without area from a manifold mesh of consistent winding.
///
/// Where the longest side lies on the boundary the face is dropped, and the boundary then runs through its
/// middle corner. Elsewhere that would open a slit, so the longest side is flipped: the face and its
/// neighbour become two faces with area. Every step removes one face without area, so the work is linear in
/// their number. Dropped faces remain in the list of triangles: the caller must leave them out.
pub(super) fn clear_zero_area(mesh: &mut TriMesh) -> Cleared {
    let is_flat = |&face: &FaceId| has_no_area(mesh.corners(face));
    let flat = par_collect(mesh.triangles.len(), |faces, flat| {
        flat.extend(faces.map(FaceId::new).filter(is_flat));
    });
    let mut cleared = Cleared::default();
    if flat.is_empty() {
        return cleared;
    }
    let mut edges = DirectedEdges::new(mesh);
    let mut queue: VecDeque<FaceId> = flat.iter().copied().collect();
    let mut gone = HashSet::new();
    while let Some(face) = queue.pop_front() {
        if gone.contains(&face) || !has_no_area(mesh.corners(face)) {
            continue;
        }
        let around = edges.neighbours(mesh.triangles[face]);
        let step = edges.drop_or_flip(mesh, face);
        match step {
            Step::Dropped => {
                gone.insert(face);
                cleared.dropped.push(face);
            }
            Step::Flipped => cleared.flipped.push(face),
            Step::Stuck => continue,
        }
        // Now its neighbours may be dropped or flipped. Only successful steps get here, so this ends.
        queue.extend(around.into_iter().flatten());
        if matches!(step, Step::Flipped) {
            queue.extend(edges.neighbours(mesh.triangles[face]).into_iter().flatten());
        }
    }
    cleared.kept = flat.into_iter().filter(|f| !gone.contains(f) && has_no_area(mesh.corners(*f))).collect();
    cleared
}

enum Step {
    Dropped,
    Flipped,
    Stuck,
}

/// The face at each directed edge, updated while faces are dropped and flipped.
#[derive(Debug)]
struct DirectedEdges {
    faces: HashMap<(VertexId, VertexId), FaceId>,
    on_boundary: IdVec<VertexId, bool>,
}

impl DirectedEdges {
    fn new(mesh: &TriMesh) -> Self {
        let faces = HashMap::with_capacity(3 * mesh.triangles.len());
        let mut edges = Self { faces, on_boundary: IdVec::filled(false, mesh.positions.len()) };
        for (face, &t) in mesh.triangles.enumerate() {
            edges.insert(face, t);
        }
        for &[a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if edges.face(to, from).is_none() {
                    (edges.on_boundary[from], edges.on_boundary[to]) = (true, true);
                }
            }
        }
        edges
    }

    fn insert(&mut self, face: FaceId, [a, b, c]: [VertexId; 3]) {
        self.faces.extend([(a, b), (b, c), (c, a)].map(|edge| (edge, face)));
    }

    fn face(&self, from: VertexId, to: VertexId) -> Option<FaceId> {
        self.faces.get(&(from, to)).copied()
    }

    /// The faces across the three sides.
    fn neighbours(&self, [a, b, c]: [VertexId; 3]) -> [Option<FaceId>; 3] {
        [self.face(b, a), self.face(c, b), self.face(a, c)]
    }

    fn drop_or_flip(&mut self, mesh: &mut TriMesh, face: FaceId) -> Step {
        let [a, c, middle] = from_longest_side(mesh, face);
        let Some(beyond) = self.face(c, a) else {
            let inner_sides =
                [(middle, c), (a, middle)].iter().filter(|s| self.faces.contains_key(s)).count();
            // Two boundaries through one vertex would make two fans.
            if self.on_boundary[middle] && inner_sides == 2 {
                return Step::Stuck;
            }
            for side in [(a, c), (c, middle), (middle, a)] {
                self.faces.remove(&side);
            }
            self.on_boundary[middle] = true;
            return Step::Dropped;
        };
        let Some(&far) = mesh.triangles[beyond].iter().find(|&&v| v != a && v != c) else {
            return Step::Stuck;
        };
        let joined = far == middle || self.face(middle, far).is_some() || self.face(far, middle).is_some();
        let [first, second] = [[a, far, middle], [far, c, middle]];
        let is_flat = |t: [VertexId; 3]| has_no_area(t.map(|v| mesh.positions[v]));
        if joined || is_flat(first) || is_flat(second) {
            return Step::Stuck;
        }
        self.faces.remove(&(a, c));
        self.faces.remove(&(c, a));
        for (face, t) in [(face, first), (beyond, second)] {
            mesh.triangles[face] = t;
            self.insert(face, t);
        }
        Step::Flipped
    }
}

/// The corners of `face`, turned so that the longest side runs from the first to the second.
fn from_longest_side(mesh: &TriMesh, face: FaceId) -> [VertexId; 3] {
    let [a, b, c] = mesh.triangles[face];
    let length = |p: VertexId, q: VertexId| mesh.positions[p].distance_squared(mesh.positions[q]);
    let (ab, bc, ca) = (length(a, b), length(b, c), length(c, a));
    if ab >= bc && ab >= ca {
        [a, b, c]
    } else if bc >= ca {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
