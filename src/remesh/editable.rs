//! A triangle mesh whose edges can be split, collapsed and flipped: flat arrays of halfedges.

use glam::DVec3;

use crate::id::{FaceId, VertexId};
use crate::mesh::{Adjacency, Halfedge, MeshError, TriMesh};

/// No halfedge, vertex or face.
pub(super) const NONE: u32 = u32::MAX;

/// An oriented manifold. Side `k` of face `f`, from its corner `k` to the next one, is the halfedge `3 f + k`.
pub(super) struct Editable {
    pub(super) positions: Vec<DVec3>,
    /// The corners of each face, counter-clockwise seen from outside; [`NONE`] in those that are gone.
    pub(super) faces: Vec<[u32; 3]>,
    /// The halfedge on the other side of each.
    twins: Vec<[u32; 3]>,
    /// Whether each halfedge is on a sharp edge or a rim.
    sharp: Vec<[bool; 3]>,
    /// A halfedge that leaves each vertex; [`NONE`] for those that are gone.
    leaving: Vec<u32>,
    /// Number of neighbours of each vertex.
    pub(super) degree: Vec<u32>,
    pub(super) on_boundary: Vec<bool>,
}

fn index(k: u32) -> usize {
    k as usize
}

/// The number of the next element of a list; meshes are far smaller than 32 bits can count.
fn count<T>(list: &[T]) -> u32 {
    VertexId::new(list.len()).raw()
}

/// The side after `h` in its face.
pub(super) const fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// The side before `h` in its face.
pub(super) const fn before(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

impl Editable {
    /// # Errors
    /// If the mesh is not an oriented manifold.
    pub(super) fn new(mesh: &TriMesh) -> Result<Self, MeshError> {
        let adjacency = Adjacency::new(mesh)?;
        let twin = |face: FaceId, side: usize| {
            let twin = adjacency.twin(Halfedge::new(face, side));
            twin.map_or(NONE, |h| 3 * h.face().raw() + VertexId::new(h.side()).raw())
        };
        let mut this = Self {
            positions: mesh.positions.to_vec(),
            faces: mesh.triangles.iter().map(|t| t.map(VertexId::raw)).collect(),
            twins: mesh.triangles.ids().map(|face| [0, 1, 2].map(|side| twin(face, side))).collect(),
            sharp: vec![[false; 3]; mesh.triangles.len()],
            leaving: vec![NONE; mesh.positions.len()],
            degree: mesh.positions.ids().map(|v| count(adjacency.ring(v))).collect(),
            on_boundary: vec![false; mesh.positions.len()],
        };
        (0..count(&this.faces)).for_each(|face| this.anchor(face));
        for h in 0..3 * count(&this.faces) {
            if this.twin(h) == NONE {
                let ends = [this.origin(h), this.target(h)];
                ends.into_iter().for_each(|v| this.on_boundary[index(v)] = true);
            }
        }
        Ok(this)
    }

    /// What is left of it.
    pub(super) fn finish(mut self) -> TriMesh {
        self.compact();
        TriMesh::from_arrays(self.positions, &self.faces)
    }

    /// Closes the gaps of vertices and faces that are gone, in their order; returns the old vertices.
    pub(super) fn compact(&mut self) -> Vec<usize> {
        let places = |alive: &mut dyn Iterator<Item = bool>| {
            let (mut places, mut kept) = (Vec::new(), Vec::new());
            for (k, is_alive) in alive.enumerate() {
                places.push(if is_alive { count(&kept) } else { NONE });
                kept.extend(is_alive.then_some(k));
            }
            (places, kept)
        };
        let (vertices, kept) = places(&mut self.leaving.iter().map(|&h| h != NONE));
        let (faces, kept_faces) = places(&mut self.faces.iter().map(|face| face[0] != NONE));
        let moved = |h: u32| if h == NONE { NONE } else { 3 * faces[index(h / 3)] + h % 3 };
        self.twins = kept_faces.iter().map(|&face| self.twins[face].map(moved)).collect();
        self.sharp = kept_faces.iter().map(|&face| self.sharp[face]).collect();
        self.faces = kept_faces.iter().map(|&face| self.faces[face].map(|v| vertices[index(v)])).collect();
        self.leaving = kept.iter().map(|&v| moved(self.leaving[v])).collect();
        self.positions = kept.iter().map(|&v| self.positions[v]).collect();
        self.degree = kept.iter().map(|&v| self.degree[v]).collect();
        self.on_boundary = kept.iter().map(|&v| self.on_boundary[v]).collect();
        kept
    }

    pub(super) fn is_alive(&self, v: u32) -> bool {
        self.leaving[index(v)] != NONE
    }

    /// All halfedges of the faces that there are, once for each edge.
    pub(super) fn edge(&self, h: u32) -> bool {
        let twin = self.twin(h);
        self.faces[index(h / 3)][0] != NONE && (twin == NONE || h < twin)
    }

    pub(super) fn halfedges(&self) -> u32 {
        3 * count(&self.faces)
    }

    pub(super) fn origin(&self, h: u32) -> u32 {
        self.faces[index(h / 3)][index(h % 3)]
    }

    pub(super) fn target(&self, h: u32) -> u32 {
        self.origin(next(h))
    }

    /// The corner of the face of `h` that is not on it.
    pub(super) fn apex(&self, h: u32) -> u32 {
        self.origin(before(h))
    }

    pub(super) fn twin(&self, h: u32) -> u32 {
        self.twins[index(h / 3)][index(h % 3)]
    }

    pub(super) fn is_sharp(&self, h: u32) -> bool {
        self.sharp[index(h / 3)][index(h % 3)]
    }

    pub(super) fn at(&self, v: u32) -> DVec3 {
        self.positions[index(v)]
    }

    pub(super) fn length(&self, h: u32) -> f64 {
        self.at(self.origin(h)).distance(self.at(self.target(h)))
    }

    /// Twice the area of a face along its normal.
    pub(super) fn cross(&self, face: u32) -> DVec3 {
        let [a, b, c] = self.faces[index(face)].map(|v| self.at(v));
        (b - a).cross(c - a)
    }

    /// Calls `visit` with the halfedges that leave a vertex, one for each of its faces.
    pub(super) fn each_leaving(&self, v: u32, mut visit: impl FnMut(u32)) {
        let first = self.leaving[index(v)];
        let mut h = first;
        loop {
            visit(h);
            h = self.twin(before(h));
            if h == first {
                return;
            }
            if h == NONE {
                break;
            }
        }
        h = self.twin(first);
        while h != NONE {
            visit(next(h));
            h = self.twin(next(h));
        }
    }

    /// Calls `visit` with the neighbours of a vertex, and whether the edge to each is sharp.
    pub(super) fn each_neighbour(&self, v: u32, mut visit: impl FnMut(u32, bool)) {
        self.each_leaving(v, |h| {
            visit(self.target(h), self.is_sharp(h));
            let arriving = before(h);
            if self.twin(arriving) == NONE {
                visit(self.origin(arriving), self.is_sharp(arriving));
            }
        });
    }

    pub(super) fn has_edge(&self, a: u32, b: u32) -> bool {
        let mut found = false;
        self.each_neighbour(a, |w, _| found |= w == b);
        found
    }

    pub(super) fn set_sharp(&mut self, h: u32, sharp: bool) {
        self.join(h, self.twin(h), sharp);
    }

    /// Makes `h` and `twin` the two sides of one edge.
    fn join(&mut self, h: u32, twin: u32, sharp: bool) {
        for (h, twin) in [(h, twin), (twin, h)] {
            if h != NONE {
                self.twins[index(h / 3)][index(h % 3)] = twin;
                self.sharp[index(h / 3)][index(h % 3)] = sharp;
            }
        }
    }

    /// Lets the corners of a face leave by it.
    fn anchor(&mut self, face: u32) {
        for (h, v) in (3 * face..).zip(self.faces[index(face)]) {
            self.leaving[index(v)] = h;
        }
    }

    /// What lies across a halfedge, to be joined to another.
    fn outside(&self, h: u32) -> (u32, bool) {
        (self.twin(h), self.is_sharp(h))
    }

    /// Cuts the edge of `h` in two at a new vertex in its middle, and its faces with it.
    pub(super) fn split(&mut self, h: u32) -> u32 {
        let twin = self.twin(h);
        let (a, b, sharp) = (self.origin(h), self.target(h), self.is_sharp(h));
        let m = count(&self.positions);
        self.positions.push(self.at(a).midpoint(self.at(b)));
        self.leaving.push(NONE);
        self.degree.push(2);
        self.on_boundary.push(twin == NONE);
        let [left, right] = [Some(h), Some(twin).filter(|&twin| twin != NONE)].map(|side| {
            let h = side?;
            // The face `p q c` of `h` becomes `p m c`, and a new one `m q c`.
            let (q, c) = (self.target(h), self.apex(h));
            let (face, added) = (h / 3, count(&self.faces));
            let (across, back) = (self.outside(next(h)), self.outside(before(h)));
            let p = self.origin(h);
            self.faces[index(face)] = [p, m, c];
            self.faces.push([m, q, c]);
            self.twins.push([NONE; 3]);
            self.sharp.push([false; 3]);
            self.join(3 * face + 2, back.0, back.1);
            self.join(3 * added + 1, across.0, across.1);
            self.join(3 * face + 1, 3 * added + 2, false);
            self.anchor(face);
            self.anchor(added);
            self.degree[index(c)] += 1;
            self.degree[index(m)] += 1;
            Some((3 * face, 3 * added))
        });
        let Some((start, end)) = left else { return m };
        match right {
            // The halves of the twin run the other way.
            Some((first, second)) => {
                self.join(start, second, sharp);
                self.join(end, first, sharp);
            }
            None => {
                self.join(start, NONE, sharp);
                self.join(end, NONE, sharp);
            }
        }
        m
    }

    /// Turns the edge of `h` in its two faces, so that it joins the other two corners.
    pub(super) fn flip(&mut self, h: u32) {
        let twin = self.twin(h);
        let (a, b, c, d) = (self.origin(h), self.target(h), self.apex(h), self.apex(twin));
        let (first, second) = (h / 3, twin / 3);
        let [bc, ca, ad, db] = [next(h), before(h), next(twin), before(twin)].map(|side| self.outside(side));
        self.faces[index(first)] = [c, a, d];
        self.faces[index(second)] = [d, b, c];
        for (h, (twin, sharp)) in
            [(3 * first, ca), (3 * first + 1, ad), (3 * second, db), (3 * second + 1, bc)]
        {
            self.join(h, twin, sharp);
        }
        self.join(3 * first + 2, 3 * second + 2, false);
        self.anchor(first);
        self.anchor(second);
        for (v, more) in [(a, false), (b, false), (c, true), (d, true)] {
            let degree = &mut self.degree[index(v)];
            *degree = if more { *degree + 1 } else { *degree - 1 };
        }
    }

    /// Whether the edge of `h` can shrink to a point without changing what the surface is.
    pub(super) fn can_collapse(&self, h: u32) -> bool {
        let twin = self.twin(h);
        let (a, b) = (self.origin(h), self.target(h));
        if twin != NONE && self.on_boundary[index(a)] && self.on_boundary[index(b)] {
            return false;
        }
        let mut apexes = [self.apex(h), NONE];
        if twin != NONE {
            apexes[1] = self.apex(twin);
        }
        let is_thin =
            |&&v: &&u32| v != NONE && self.degree[index(v)] <= if self.on_boundary[index(v)] { 2 } else { 3 };
        if apexes.iter().any(|v| is_thin(&v)) {
            return false;
        }
        // Only the apexes may be neighbours of both.
        let mut is_linked = true;
        self.each_neighbour(a, |v, _| is_linked &= v == b || apexes.contains(&v) || !self.has_edge(v, b));
        is_linked
    }

    /// Shrinks the edge of `h` to its target; `around` are the halfedges that leave its origin.
    pub(super) fn collapse(&mut self, h: u32, around: &[u32]) {
        let twin = self.twin(h);
        let (a, b) = (self.origin(h), self.target(h));
        let sides = if twin == NONE { 1 } else { 2 };
        self.degree[index(b)] += self.degree[index(a)] - 2 - sides;
        for &leaving in around {
            self.faces[index(leaving / 3)][index(leaving % 3)] = b;
        }
        self.leaving[index(a)] = NONE;
        for side in [h, twin].into_iter().filter(|&side| side != NONE) {
            let apex = self.apex(side);
            self.degree[index(apex)] -= 1;
            let (p, q) = (self.outside(next(side)), self.outside(before(side)));
            self.faces[index(side / 3)] = [NONE; 3];
            let sharp = p.1 || q.1;
            match (p.0, q.0) {
                (NONE, q) => self.join(q, NONE, sharp),
                (p, q) => self.join(p, q, sharp),
            }
            [p.0, q.0].into_iter().filter(|&h| h != NONE).for_each(|h| self.anchor(h / 3));
        }
        for face in around.iter().map(|leaving| leaving / 3) {
            if self.faces[index(face)][0] != NONE {
                self.anchor(face);
            }
        }
    }
}
