use crate::{
    id::{FaceId, Id, IdVec, VertexId},
    mesh::{Edges, MeshError, TriMesh},
};

/// One side of a face: halfedge `k` of a face runs from its corner `k` to its corner `k + 1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Halfedge {
    /// The face on its left.
    pub face: FaceId,
    /// Which side of the face: 0, 1 or 2.
    pub side: u8,
}

impl Halfedge {
    /// Its place when the sides of all faces are counted through.
    const fn slot(self) -> usize {
        3 * self.face.index() + self.side as usize
    }

    /// The same as it is stored; meshes with more sides than fit are refused by [`TriMesh::validate`].
    const fn raw_slot(self) -> u32 {
        3 * self.face.raw() + self.side as u32
    }

    pub(crate) fn from_slot(slot: usize) -> Self {
        Self { face: FaceId::new(slot / 3), side: [0, 1, 2][slot % 3] }
    }

    /// The side of the same face that starts where this one ends.
    #[inline]
    #[must_use]
    pub const fn next(self) -> Self {
        Self { face: self.face, side: (self.side + 1) % 3 }
    }

    /// The vertex it leaves.
    #[inline]
    #[must_use]
    pub fn start(self, mesh: &TriMesh) -> VertexId {
        mesh.triangles[self.face][self.side as usize]
    }

    /// The vertex it reaches.
    #[inline]
    #[must_use]
    pub fn end(self, mesh: &TriMesh) -> VertexId {
        mesh.triangles[self.face][(self.side as usize + 1) % 3]
    }

    /// The side of the same face that ends where this one starts; across it lies the next face counter-clockwise
    /// around that vertex.
    #[inline]
    #[must_use]
    pub(crate) const fn previous(self) -> Self {
        Self { face: self.face, side: (self.side + 2) % 3 }
    }
}

impl Id for Halfedge {
    fn new(index: usize) -> Self {
        Self::from_slot(index)
    }

    fn index(self) -> usize {
        self.slot()
    }
}

/// Slot of [`Adjacency::twins`] that says: no face on the other side.
const BOUNDARY: u32 = u32::MAX;

/// Who borders whom in an oriented manifold mesh with boundary.
///
/// One-rings run counter-clockwise seen from outside. The ring of a boundary vertex is an open
/// chain: its first entry is the next vertex along the boundary loop, its last the previous one.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjacency {
    /// The halfedge on the other side, by slot `3 face + side`.
    twins: Vec<u32>,
    /// Where each vertex's ring starts in `rings`; one more entry than vertices.
    starts: Vec<u32>,
    rings: Vec<VertexId>,
    on_boundary: IdVec<VertexId, bool>,
}

impl Adjacency {
    /// Finds the neighbours of every vertex and face.
    ///
    /// # Errors
    /// If corners are out of range, an edge has more than two faces or two that run the same way,
    /// a vertex has more than one fan of faces, or none.
    pub fn new(mesh: &TriMesh) -> Result<Self, MeshError> {
        mesh.validate()?;
        let vertices = mesh.positions.len();
        let mut adjacency = Self {
            twins: pair_halfedges(mesh)?,
            starts: Vec::with_capacity(vertices + 1),
            rings: Vec::with_capacity(3 * mesh.triangles.len() + vertices),
            on_boundary: IdVec::filled(false, vertices),
        };
        // Where each fan starts: the halfedge along the boundary if there is one, else any.
        let mut first = IdVec::<VertexId, u32>::filled(BOUNDARY, vertices);
        let mut degrees = IdVec::<VertexId, u32>::filled(0, vertices);
        for (slot, &v) in mesh.triangles.iter().flatten().enumerate() {
            degrees[v] += 1;
            let is_open = adjacency.twins[slot] == BOUNDARY;
            if is_open || first[v] == BOUNDARY {
                first[v] = Halfedge::from_slot(slot).raw_slot();
            }
            adjacency.on_boundary[v] |= is_open;
        }
        adjacency.starts.push(0);
        for v in mesh.positions.ids() {
            if degrees[v] == 0 {
                return Err(MeshError::IsolatedVertex { vertex: v });
            }
            if adjacency.push_ring(mesh, first[v]) != degrees[v] {
                return Err(MeshError::NonManifoldVertex { vertex: v, fans: adjacency.count_fans(mesh, v) });
            }
        }
        Ok(adjacency)
    }

    /// Walks the fan of halfedge `first` counter-clockwise, and says how many faces it has.
    fn push_ring(&mut self, mesh: &TriMesh, first: u32) -> u32 {
        let mut slot = first;
        let mut faces = 0;
        loop {
            let here = Halfedge::from_slot(slot as usize);
            self.rings.push(here.end(mesh));
            faces += 1;
            let back = here.previous();
            let twin = self.twins[back.slot()];
            if twin == BOUNDARY {
                self.rings.push(back.start(mesh));
                break;
            }
            if twin == first {
                break;
            }
            slot = twin;
        }
        self.starts.push(VertexId::new(self.rings.len()).raw());
        faces
    }

    /// Number of fans around `v`; looks through the whole mesh, for an error message alone.
    fn count_fans(&self, mesh: &TriMesh, v: VertexId) -> usize {
        let corners = mesh.triangles.iter().flatten().enumerate();
        // Ascending, so that a binary search finds the place of a slot.
        let leaving: Vec<usize> = corners.filter(|&(_, &w)| w == v).map(|(slot, _)| slot).collect();
        let next = |slot: usize| self.twins[Halfedge::from_slot(slot).previous().slot()];
        let mut seen = vec![false; leaving.len()];
        let mut fans = 0;
        let is_open = |slot: usize| self.twins[slot] == BOUNDARY;
        // Open fans first, each from its one open end; what is left then are closed fans.
        for open in [true, false] {
            for at in 0..leaving.len() {
                if seen[at] || (open && !is_open(leaving[at])) {
                    continue;
                }
                fans += 1;
                let mut at = at;
                while !seen[at] {
                    seen[at] = true;
                    if let Ok(place) = leaving.binary_search(&(next(leaving[at]) as usize)) {
                        at = place;
                    }
                }
            }
        }
        fans
    }

    /// The neighbours of `v`, counter-clockwise; for a boundary vertex from the next to the
    /// previous vertex of its loop.
    #[inline]
    #[must_use]
    pub fn ring(&self, v: VertexId) -> &[VertexId] {
        &self.rings[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }

    /// Whether `v` lies on a boundary loop.
    #[inline]
    #[must_use]
    pub fn is_boundary(&self, v: VertexId) -> bool {
        self.on_boundary[v]
    }

    /// The halfedge on the other side, or `None` on the boundary.
    #[inline]
    #[must_use]
    pub fn twin(&self, h: Halfedge) -> Option<Halfedge> {
        let twin = self.twins[h.slot()];
        (twin != BOUNDARY).then(|| Halfedge::from_slot(twin as usize))
    }

    /// Number of undirected edges.
    #[must_use]
    pub fn edge_count(&self) -> usize {
        self.rings.len() / 2
    }

    /// Vertices minus edges plus faces: 1 for a disk, 2 for a sphere, one less for each hole.
    #[must_use]
    pub fn euler_characteristic(&self) -> i64 {
        let count = |n: usize| i64::try_from(n).expect("counts fit into 63 bits");
        count(self.on_boundary.len()) - count(self.edge_count()) + count(self.twins.len() / 3)
    }

    /// The boundary loops, each from its smallest vertex, faces on the left; sorted by that vertex.
    #[must_use]
    pub fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        let mut seen = IdVec::<VertexId, bool>::filled(false, self.on_boundary.len());
        let mut loops = Vec::new();
        for v in self.on_boundary.ids() {
            if !self.is_boundary(v) || seen[v] {
                continue;
            }
            let mut walk = Vec::new();
            let mut at = v;
            while !seen[at] {
                seen[at] = true;
                walk.push(at);
                at = self.ring(at)[0];
            }
            loops.push(walk);
        }
        loops
    }

    /// The component of every face, numbered in the order of their first faces, and their number.
    #[must_use]
    pub fn components(&self) -> (IdVec<FaceId, u32>, usize) {
        const NONE: u32 = u32::MAX;
        let mut of_face = IdVec::<FaceId, u32>::filled(NONE, self.twins.len() / 3);
        let mut count = 0_u32;
        let mut stack = Vec::new();
        for seed in of_face.ids() {
            if of_face[seed] != NONE {
                continue;
            }
            of_face[seed] = count;
            stack.push(seed);
            while let Some(face) = stack.pop() {
                for side in 0..3 {
                    if let Some(twin) = self.twin(Halfedge { face, side })
                        && of_face[twin.face] == NONE
                    {
                        of_face[twin.face] = count;
                        stack.push(twin.face);
                    }
                }
            }
            count += 1;
        }
        (of_face, count as usize)
    }
}

/// The other halfedge of every edge, by slot.
fn pair_halfedges(mesh: &TriMesh) -> Result<Vec<u32>, MeshError> {
    let mut twins = vec![BOUNDARY; 3 * mesh.triangles.len()];
    for uses in Edges::new(&mesh.triangles, mesh.positions.len()).iter() {
        match *uses {
            [_] => {}
            [a, b] if a.start(mesh) == b.end(mesh) => {
                twins[a.slot()] = b.raw_slot();
                twins[b.slot()] = a.raw_slot();
            }
            _ => return Err(same_way(mesh, uses)),
        }
    }
    Ok(twins)
}

/// The first two halfedges of an edge that run the same way; of three, two always do.
fn same_way(mesh: &TriMesh, uses: &[Halfedge]) -> MeshError {
    let from = uses[0].start(mesh);
    let to = uses[0].end(mesh);
    let forward = uses.iter().filter(|h| h.start(mesh) == from).count();
    let (from, to) = if forward >= 2 { (from, to) } else { (to, from) };
    let mut faces = uses.iter().filter(|h| h.start(mesh) == from).map(|h| h.face);
    let (first, second) = (faces.next().unwrap_or_default(), faces.next().unwrap_or_default());
    MeshError::NonManifoldEdge { from, to, first, second }
}
