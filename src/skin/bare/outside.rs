use glam::DVec3;

use crate::{
    id::{FaceId, IdVec, VertexId},
    skin::forest::Forest,
};

/// Below this mean cosine between the faces and the directions away from the centre, a piece bulges neither way: on a flat one
/// and on a saddle it is 0, on a cap of 20 degrees across 0.06.
const UNDECIDED: f64 = 0.02;

/// How the outside of the pieces without believable normals was found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Outside {
    /// Pieces that face away from the centre.
    pub centre: usize,
    /// Pieces that bulge neither way; the largest component of their vector area is positive now.
    pub undecided: usize,
}

/// Sums over the faces of one piece; areas are doubled.
#[derive(Debug, Clone, Default)]
struct Piece {
    area: f64,
    /// Area times place.
    moment: DVec3,
    direction: DVec3,
    has_normals: bool,
    /// How far its faces look away from the centre of the sheet.
    from_sheet: f64,
    /// How far its faces look away from its own centre.
    from_own: f64,
}

impl Piece {
    fn centre(&self) -> DVec3 {
        self.moment / self.area
    }

    /// Whether its faces look inwards, as far as that can be told; notes how.
    fn is_inside_out(&self, outside: &mut Outside) -> bool {
        let away = [self.from_sheet, self.from_own].map(|away| away / self.area);
        if let Some(away) = away.into_iter().find(|away| away.abs() >= UNDECIDED) {
            outside.centre += 1;
            return away < 0.0;
        }
        outside.undecided += 1;
        let larger = |a: f64, b: f64| if b.abs() > a.abs() { b } else { a };
        self.direction.to_array().into_iter().fold(0.0, larger) < 0.0
    }
}

/// Turns over the pieces without believable normals whose faces look towards the centre of the sheet, as the skin of a limb does
/// not, or towards their own where that one does not tell.
pub(super) fn turn_outward(
    triangles: &mut IdVec<FaceId, [VertexId; 3]>,
    positions: &IdVec<VertexId, DVec3>,
    given: &IdVec<VertexId, bool>,
) -> Outside {
    let (of_face, count) = number_pieces(triangles, positions.len());
    let mut pieces = vec![Piece::default(); count];
    let mut sheet = Piece::default();
    // Twice the vector area, and the middle.
    let face = |t: &[VertexId; 3]| {
        let [a, b, c] = t.map(|v| positions[v]);
        ((b - a).cross(c - a), (a + b + c) / 3.0)
    };
    for (f, t) in triangles.enumerate() {
        let (cross, middle) = face(t);
        for piece in [&mut pieces[of_face[f]], &mut sheet] {
            piece.area += cross.length();
            piece.moment += cross.length() * middle;
            piece.direction += cross;
            piece.has_normals |= t.iter().any(|&v| given[v]);
        }
    }
    for (f, t) in triangles.enumerate() {
        let (cross, middle) = face(t);
        let piece = &mut pieces[of_face[f]];
        piece.from_sheet += cross.dot((middle - sheet.centre()).normalize_or_zero());
        piece.from_own += cross.dot((middle - piece.centre()).normalize_or_zero());
    }
    let mut outside = Outside::default();
    let turn: Vec<bool> =
        pieces.iter().map(|piece| !piece.has_normals && piece.is_inside_out(&mut outside)).collect();
    for (t, &piece) in triangles.iter_mut().zip(&of_face) {
        if turn[piece] {
            t.swap(1, 2);
        }
    }
    outside
}

/// The piece of every face, and how many there are.
fn number_pieces(triangles: &IdVec<FaceId, [VertexId; 3]>, vertices: usize) -> (IdVec<FaceId, usize>, usize) {
    let mut forest = Forest::new(VertexId::new(vertices).raw());
    for &[a, b, c] in triangles {
        forest.join(a.raw(), b.raw());
        forest.join(a.raw(), c.raw());
    }
    let mut number = IdVec::<VertexId, Option<usize>>::filled(None, vertices);
    let mut count = 0;
    let of_face = triangles.map(|t| {
        *number[forest.root(t[0].raw()).into()].get_or_insert_with(|| {
            count += 1;
            count - 1
        })
    });
    (of_face, count)
}
