use crate::{
    id::VertexId,
    pyramid::{
        Removal,
        removal::{MAX_RING, diagonals},
        surface::{Face, NEXT, Side, Surface},
    },
};

impl Surface {
    /// Removes a vertex: the faces of its `star`, each named by the side that leaves the vertex, become the filling.
    pub(super) fn refill(&mut self, removal: &Removal<'_>, star: &[Side]) {
        let ring = removal.ring;
        let last = ring.len() - 1;
        // What lies across each side of the ring; nothing beyond the new boundary edge.
        let mut outside = [Side::NONE; MAX_RING];
        for (i, side) in star.iter().enumerate() {
            outside[i] = self.faces[side.face()].twins[NEXT[side.k()]];
            self.alive[side.face()] = i < removal.triangles.len();
        }
        for (side, corners) in star.iter().zip(removal.triangles) {
            let corners = corners.map(|i| ring[usize::from(i)]);
            self.faces[side.face()] = Face { corners, twins: [Side::NONE; 3] };
        }
        for (side, &[i, k, j]) in star.iter().zip(removal.triangles) {
            let face = side.face();
            for (side, from, to) in [(0, i, k), (1, k, j)] {
                let here = Side::new(face, side);
                if to == from + 1 {
                    self.join(ring[usize::from(from)], here, outside[usize::from(from)]);
                } else if let Some(below) = removal.triangles.iter().position(|t| (t[0], t[2]) == (from, to))
                {
                    self.join(ring[usize::from(from)], here, Side::new(star[below].face(), 2));
                }
            }
            if i == 0 && usize::from(j) == last {
                self.join(ring[last], Side::new(face, 2), outside[last]);
            }
        }
        self.leaving[removal.vertex] = Side::NONE;
        for &v in ring {
            self.degree[v] -= 1;
        }
        let closing = removal.boundary.then_some([0, last]);
        for v in diagonals(removal.triangles, ring.len()).chain(closing).flatten() {
            self.degree[ring[v]] += 1;
        }
    }

    /// Makes `here`, which leaves `from`, and `there` twins.
    fn join(&mut self, from: VertexId, here: Side, there: Side) {
        self.faces[here.face()].twins[here.k()] = there;
        if there != Side::NONE {
            self.faces[there.face()].twins[there.k()] = here;
        }
        // A boundary vertex keeps its boundary side, which lies outside the star unless this is it.
        if there == Side::NONE || !self.on_boundary[from] {
            self.leaving[from] = here;
        }
    }
}
