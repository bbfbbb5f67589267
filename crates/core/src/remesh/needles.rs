//! Needles of the surface: rows of points along their long sides, before the first round.
//!
//! Where the longest edges are halved first, a needle becomes three that are half as long, since its diagonals are
//! longer than its sides: one of n spacings becomes n^1.6 faces. Here the sides of needles are divided at once, and
//! each face is triangulated between the points on one side and those on the two others: it becomes as many faces as
//! there are points. A face next to a needle becomes a fan, whose needles are divided in turn.

use std::collections::HashSet;

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, HalfedgeMesh, MeshError, TriMesh};
use crate::remesh::faces::height;
use crate::remesh::rounds::{Freedom, Rounds};

/// Faces longer than this many spacings, and this many times as long as high, are needles.
const LONG: f64 = 32.0;
const SLENDER: f64 = 8.0;

/// Most times that needles are divided; those of a strip are gone after two, and what is left is halved.
const MAX_PASSES: usize = 8;

impl Rounds<'_> {
    /// Divides the sides of needles into edges of about one spacing, or of the height of the needle where that is
    /// more. All faces must be alive.
    pub(super) fn divide_needles(&mut self) {
        for _ in 0..MAX_PASSES {
            let Some(pieces) = self.pieces() else { return };
            // Fails where two needles share two sides, as those of a flat body of two faces: they are halved.
            let Ok(divided) = self.divided(&pieces) else { return };
            *self = divided;
        }
    }

    /// How many edges each side of each face becomes; `None` if there is no needle.
    fn pieces(&self) -> Option<IdVec<FaceId, [u32; 3]>> {
        let own = |face: FaceId| {
            let lengths = [0, 1, 2].map(|side| self.length(Halfedge::new(face, side)));
            let height = height(self.mesh.corners(face).map(|v| self.positions[v]));
            let longest = lengths.into_iter().fold(0.0, f64::max);
            let step = self.target.max(height);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most `MAX_TAXELS`"
            )]
            let count = |length: f64| (length / step).ceil().max(1.0) as u32;
            if longest > LONG * self.target && longest > SLENDER * height {
                lengths.map(count)
            } else {
                [1; 3]
            }
        };
        let own: IdVec<FaceId, [u32; 3]> = self.mesh.face_ids().map(own).collect();
        let of_edge = |h: Halfedge| {
            let [here, there] = [h, self.mesh.twin(h)];
            let count = |h: Halfedge| own[h.face()][h.side()];
            if there == Halfedge::NONE { count(here) } else { count(here).max(count(there)) }
        };
        let is_any = own.iter().flatten().any(|&count| count > 1);
        is_any.then(|| self.mesh.face_ids().map(|face| Halfedge::of_face(face).map(of_edge)).collect())
    }

    /// The mesh with points on the sides of its faces.
    fn divided(&self, pieces: &IdVec<FaceId, [u32; 3]>) -> Result<Self, MeshError> {
        let (mut positions, mut freedom) = (self.positions.clone(), self.freedom.clone());
        let mut sharp = HashSet::new();
        // The vertices along each side, without its end.
        let mut along = pieces.map(|_| <[Vec<VertexId>; 3]>::default());
        for h in self.edges() {
            let (a, b, count) = (self.mesh.origin(h), self.mesh.target(h), pieces[h.face()][h.side()]);
            let [from, to] = [a, b].map(|v| self.positions[v]);
            let mut line = vec![a];
            for k in 1..count {
                line.push(positions.push(from.lerp(to, f64::from(k) / f64::from(count))));
                freedom.push(if self.is_sharp(h) { Freedom::Line } else { Freedom::Surface });
            }
            line.push(b);
            if self.is_sharp(h) {
                sharp.extend(line.windows(2).map(|ends| [ends[0].min(ends[1]), ends[0].max(ends[1])]));
            }
            let twin = self.mesh.twin(h);
            if twin != Halfedge::NONE {
                along[twin.face()][twin.side()] = line[1..].iter().rev().copied().collect();
            }
            line.pop();
            along[h.face()][h.side()] = line;
        }
        let mut triangles = IdVec::default();
        for (face, sides) in along.enumerate() {
            let most = [0, 1, 2].into_iter().rev().max_by_key(|&side| sides[side].len()).unwrap_or(0);
            if sides[most].len() == 1 {
                triangles.push(self.mesh.corners(face));
                continue;
            }
            let [base, next, last] = [0, 1, 2].map(|k| &sides[(most + k) % 3]);
            let lower = [base, &next[..1]].concat();
            let mut upper = [&next[..], last, &base[..1]].concat();
            upper.reverse();
            between(&lower, &upper, &positions, |face| _ = triangles.push(face));
        }
        let (mesh, _) = HalfedgeMesh::new(&TriMesh { positions: positions.clone(), triangles })?;
        let is_sharp = |h: Halfedge| {
            let [a, b] = [mesh.origin(h), mesh.target(h)];
            sharp.contains(&[a.min(b), a.max(b)])
        };
        let sharp = mesh.face_ids().map(|face| Halfedge::of_face(face).map(is_sharp)).collect();
        let near = positions.map(|_| None);
        let Self { surface, lines, spacing, target, .. } = *self;
        Ok(Self { mesh, positions, sharp, freedom, near, surface, lines, spacing, target })
    }
}

/// Triangulates the polygon between two lines with the same ends, the second on the left of the first, each with an
/// inner vertex: of the two edges that may come next always the shorter.
fn between(
    lower: &[VertexId],
    upper: &[VertexId],
    positions: &IdVec<VertexId, DVec3>,
    mut add: impl FnMut([VertexId; 3]),
) {
    let (last, top) = (lower.len() - 2, upper.len() - 2);
    let distance = |i: usize, j: usize| positions[lower[i]].distance_squared(positions[upper[j]]);
    add([lower[0], lower[1], upper[1]]);
    let (mut i, mut j) = (1, 1);
    while i < last || j < top {
        if j == top || i < last && distance(i + 1, j) <= distance(i, j + 1) {
            add([lower[i], lower[i + 1], upper[j]]);
            i += 1;
        } else {
            add([lower[i], upper[j + 1], upper[j]]);
            j += 1;
        }
    }
    add([lower[last], lower[last + 1], upper[top]]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Adjacency;
    use crate::remesh::surface::Surface;
    use crate::remesh::{remesh, sharp_edges};

    /// The faces before the first round.
    fn divided(mesh: &TriMesh, spacing: f64) -> TriMesh {
        let surface = Surface::new(mesh.clone()).unwrap();
        let (halfedges, _) = HalfedgeMesh::new(mesh).unwrap();
        let mut rounds = Rounds::new(halfedges, mesh.positions.clone(), &surface, spacing);
        rounds.sharp = sharp_edges(&rounds.mesh, &rounds.positions, spacing);
        let sharp_length = |rounds: &Rounds<'_>| -> f64 {
            rounds.edges().filter(|&h| rounds.is_sharp(h)).map(|h| rounds.length(h)).sum()
        };
        let before = sharp_length(&rounds);
        rounds.divide_needles();
        assert!((sharp_length(&rounds) / before - 1.0).abs() < 1e-9, "the length of sharp edges");
        assert!(rounds.pieces().is_none(), "a needle is left");
        rounds.split_surface();
        TriMesh { triangles: rounds.mesh.triangles(), positions: rounds.positions }
    }

    fn mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriMesh {
        TriMesh::from_arrays(positions.iter().copied().map(DVec3::from).collect(), triangles)
    }

    /// Two triangles.
    fn strip(length: f64, width: f64) -> TriMesh {
        let corners = [[0.0, 0.0, 0.0], [length, 0.0, 0.0], [length, width, 0.0], [0.0, width, 0.0]];
        mesh(&corners, &[[0, 1, 2], [0, 2, 3]])
    }

    /// A plate with a needle along one side, whose other end is a fan of needles.
    fn plate_with_needles() -> TriMesh {
        let corners = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.5, -0.01, 0.0],
            [1.05, 0.3, 0.0],
            [1.05, 0.31, 0.0],
        ];
        mesh(&corners, &[[0, 1, 2], [0, 2, 3], [0, 4, 1], [1, 5, 6], [1, 6, 2]])
    }

    /// Two strips with a sharp edge between them.
    fn ridge() -> TriMesh {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.02, 0.0], [0.0, 0.02, 0.0]];
        let walls = [[1.0, 0.0, 0.02], [0.0, 0.0, 0.02]];
        mesh(&[&corners[..], &walls].concat(), &[[0, 1, 2], [0, 2, 3], [1, 0, 5], [1, 5, 4]])
    }

    /// Halved alone, a strip of 2400 spacings has 37 times `area / spacing^2` faces, the ridge 8.6 times.
    #[test]
    fn before_the_first_round_there_are_as_many_faces_as_fit_on_the_surface() {
        for (name, mesh, spacing) in [
            ("a strip", strip(12.0, 0.02), 0.005),
            ("a wide strip", strip(4.0, 0.1), 0.005),
            ("a triangle", mesh(&[[0.0; 3], [4.0, -0.05, 0.0], [4.0, 0.05, 0.0]], &[[0, 1, 2]]), 0.005),
            ("a low triangle", mesh(&[[0.0; 3], [4.0, 0.0, 0.0], [2.0, 0.1, 0.0]], &[[0, 1, 2]]), 0.005),
            ("a plate", plate_with_needles(), 0.01),
            ("a ridge", ridge(), 0.002),
        ] {
            let made = divided(&mesh, spacing);
            let share = made.triangles.len() as f64 * spacing * spacing / mesh.area();
            assert!(share < 7.0, "{name}: {share} faces in the square of the spacing");
            assert!((made.area() / mesh.area() - 1.0).abs() < 1e-9, "{name}: {} m^2", made.area());
            let topology = |mesh| Adjacency::new(mesh).unwrap().topology();
            assert_eq!(topology(&made), topology(&mesh), "{name}");
        }
    }

    /// Strips of one spacing side by side.
    #[test]
    fn faces_grow_as_the_length_of_needles() {
        let needles = |length: f64| {
            let columns = 7;
            let at = |k: u32| DVec3::new(f64::from(k % 2) * length, 0.005 * f64::from(k / 2), 0.0);
            let pair = |k: u32| [[2 * k, 2 * k + 1, 2 * k + 3], [2 * k, 2 * k + 3, 2 * k + 2]];
            let triangles: Vec<[u32; 3]> = (0..columns).flat_map(pair).collect();
            TriMesh::from_arrays((0..2 * columns + 2).map(at).collect(), &triangles)
        };
        for (name, shape) in
            [("a strip", &(|length| strip(length, 0.02)) as &dyn Fn(f64) -> TriMesh), ("needles", &needles)]
        {
            let [short, long] = [1.0, 4.0].map(|length| divided(&shape(length), 0.005).triangles.len());
            assert!(long < 5 * short, "{name}: {short} faces, and {long} of the fourfold length");
        }
    }

    /// The two faces of a flat body share all sides.
    #[test]
    fn needles_that_share_two_sides_are_left_to_the_rounds() {
        let body = mesh(&[[0.0; 3], [0.8, -0.01, 0.0], [0.8, 0.01, 0.0]], &[[0, 1, 2], [0, 2, 1]]);
        let made = remesh(&body, 0.01).unwrap();
        assert!((made.area() / body.area() - 1.0).abs() < 0.1, "{} m^2", made.area());
    }
}
