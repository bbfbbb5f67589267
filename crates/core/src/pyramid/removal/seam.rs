//! The seam of a patch that is mapped cut open, from level to level: its two sides are coarsened
//! together, so that every level has the same seam.
//!
//! The mesh that is coarsened is the uncut one. Each corner of a face has two ids: that of a vertex of the
//! mesh, and that of a place of the cut mesh. An edge belongs to the seam if the places differ across it. A
//! vertex along the seam may be removed if its star may on both sides; the seam then runs straight past it.
//! Vertices where the seam ends, branches or meets the boundary are kept.

use crate::cut::{CutMesh, PlaceId};
use crate::delaunay::smallest_first;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Adjacency, Halfedge, MeshError, TriMesh};
use crate::pyramid::removal::star::small;
use crate::pyramid::{Removal, RemovalLog};

/// The relation of a vertex to the seam.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SeamRole {
    /// Not on it.
    Off,
    /// Between two of its edges.
    Along,
    /// Where it ends or branches, or meets the boundary.
    Fixed,
}

/// The seam of the current level.
#[derive(Debug, Clone)]
pub(crate) struct SeamedLevel {
    /// The role of each vertex of the level.
    pub(crate) roles: IdVec<VertexId, SeamRole>,
    /// The level cut open: corners of every face, dead ones included, and their uncut vertices.
    pub(crate) cut: CutMesh,
    /// The removals from the cut level.
    pub(super) log: RemovalLog,
}

impl SeamedLevel {
    /// The seam of a mesh that is cut into `cut`.
    pub(crate) fn new(mesh: &TriMesh, cut: CutMesh) -> Result<Self, MeshError> {
        let adjacency = Adjacency::new(mesh)?;
        let mut degrees = IdVec::<VertexId, u32>::filled(0, mesh.positions.len());
        for [a, b] in cut.seam_edges(mesh, &adjacency) {
            degrees[a] += 1;
            degrees[b] += 1;
        }
        let role = |(v, &degree): (VertexId, &u32)| match degree {
            0 => SeamRole::Off,
            2 if !adjacency.is_boundary(v) => SeamRole::Along,
            _ => SeamRole::Fixed,
        };
        let roles = degrees.enumerate().map(role).collect();
        Ok(Self { roles, cut, log: RemovalLog::default() })
    }

    fn corner(&self, h: Halfedge) -> PlaceId {
        self.cut.triangles[h.face()][h.side()]
    }

    /// The two positions around a star, given by the halfedges that leave its vertex, to which the seam leads
    /// from there; `None` if there are not two.
    pub(super) fn crossings(&self, star: &[Halfedge]) -> Option<[usize; 2]> {
        let last = star.len().checked_sub(1)?;
        let name = |k: usize| self.corner(star[k]);
        let mut found = (0..star.len()).filter(|&k| name(k) != name(if k == 0 { last } else { k - 1 }));
        let pair = [found.next()?, found.next()?];
        found.next().is_none().then_some(pair)
    }

    /// Whether the seam ends at the neighbour to which a halfedge of a star leads: then that is one place on
    /// both sides. `before` is the halfedge before it around the star.
    pub(super) fn ends_at(&self, h: Halfedge, before: Halfedge) -> bool {
        self.corner(h.next()) == self.corner(before.previous())
    }

    /// Applies the removal of a vertex, whose `star` becomes the removal's triangles in this order; along the
    /// seam the star of one side, then that of the other.
    pub(super) fn apply(&mut self, removal: &Removal<'_>, star: &[Halfedge]) {
        let Removal { vertex, ring, boundary, triangles } = *removal;
        if self.roles[vertex] != SeamRole::Along {
            let names = self.names(star, ring.len());
            self.record(self.corner(star[0]), &names, boundary, triangles);
            self.rename(star, &names, triangles);
            return;
        }
        // The seam connects the first vertex of the ring and this one.
        let Some([_, middle]) = self.crossings(star) else { return };
        let (left, right) = triangles.split_at(middle - 1);
        let local = |p: u8| small(if p == 0 { ring.len() - middle } else { usize::from(p) - middle });
        // In the order of the corners of faces, and ascending.
        let right: Vec<[u8; 3]> = right.iter().map(|t| t.map(local)).collect();
        let ascending: Vec<[u8; 3]> = right.iter().map(|&t| smallest_first(t)).collect();
        let sides = [&star[..middle], &star[middle..]];
        let [left_ring, right_ring] = sides.map(|side| self.names(side, side.len() + 1));
        let [left_centre, right_centre] = sides.map(|side| self.corner(side[0]));
        self.record(left_centre, &left_ring, true, left);
        self.record(right_centre, &right_ring, true, &ascending);
        let (slots, others) = star.split_at(middle - 1);
        self.rename(slots, &left_ring, left);
        self.rename(others, &right_ring, &right);
    }

    fn record(&mut self, vertex: PlaceId, ring: &[PlaceId], boundary: bool, triangles: &[[u8; 3]]) {
        let ring: Vec<VertexId> = ring.iter().map(|place| place.opened()).collect();
        self.log.push(&Removal { vertex: vertex.opened(), ring: &ring, boundary, triangles });
    }

    /// The places of a ring of `count` vertices, from the faces of its star.
    fn names(&self, star: &[Halfedge], count: usize) -> Vec<PlaceId> {
        let last = star.last().filter(|_| count > star.len()).map(|h| self.corner(h.previous()));
        star.iter().map(|h| self.corner(h.next())).chain(last).collect()
    }

    fn rename(&mut self, slots: &[Halfedge], names: &[PlaceId], triangles: &[[u8; 3]]) {
        for (h, t) in slots.iter().zip(triangles) {
            self.cut.triangles[h.face()] = t.map(|i| names[usize::from(i)]);
        }
    }

    /// Moves to the next level, of the vertices `parents` and the faces `is_kept`. Returns the removals, and
    /// for each place its place on the level before.
    pub(crate) fn compact(
        &mut self,
        parents: &IdVec<VertexId, VertexId>,
        is_kept: impl Fn(FaceId) -> bool,
    ) -> (RemovalLog, IdVec<PlaceId, PlaceId>) {
        let kept: Vec<[PlaceId; 3]> =
            self.cut.triangles.enumerate().filter(|(f, _)| is_kept(*f)).map(|(_, t)| *t).collect();
        let mut number = IdVec::<PlaceId, Option<PlaceId>>::filled(None, self.cut.unsplit.len());
        kept.iter().flatten().for_each(|&v| number[v] = Some(v));
        let mut places = IdVec::<PlaceId, PlaceId>::default();
        for v in number.ids() {
            number[v] = number[v].map(|v| places.push(v));
        }
        // The first places are the vertices of the mesh.
        let count = parents.len();
        let mut of_parent = IdVec::<VertexId, VertexId>::filled(VertexId::default(), self.roles.len());
        parents.enumerate().for_each(|(v, &parent)| of_parent[parent] = v);
        let unsplit = places.map(|&place| of_parent[self.cut.unsplit[place]]);
        debug_assert!(
            unsplit.enumerate().take(count).all(|(place, v)| place == PlaceId::first_of(*v)),
            "the first ones"
        );
        let triangles = kept.iter().map(|t| t.map(|v| number[v].unwrap_or_default())).collect();
        self.cut = CutMesh { triangles, unsplit };
        self.roles = parents.map(|&parent| self.roles[parent]);
        (std::mem::take(&mut self.log), places)
    }
}
