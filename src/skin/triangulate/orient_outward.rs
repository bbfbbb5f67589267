use glam::DVec3;

use crate::{
    id::{FaceId, IdVec, VertexId},
    numeric::DisjointSets,
};

/// Below this mean cosine between the faces and the directions away from the centre, a piece bulges neither way: on a flat one
/// and on a saddle it is 0, on a cap of 20 degrees across 0.06.
const UNDECIDED: f64 = 0.02;

/// The file's normals tell the outside of a piece if so many of them look to one side of its faces.
const MAJORITY: f64 = 2.0 / 3.0;

/// How the outside of the pieces was found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Outside {
    /// Pieces that face away from the centre.
    pub centre: usize,
    /// Pieces that bulge neither way; the largest component of their vector area is positive now.
    pub undecided: usize,
    /// Normals of the file that look to the other side than most of their piece.
    pub opposed: usize,
    /// Normals of the file.
    pub normals: usize,
}

/// Sums over the faces of one piece; areas are doubled.
#[derive(Debug, Clone, Default)]
struct Piece {
    area: f64,
    /// Area times place.
    moment: DVec3,
    direction: DVec3,
    /// Normals of the file that look out of its faces, and those that look in.
    out: usize,
    inward: usize,
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
        let normals = self.out + self.inward;
        outside.normals += normals;
        outside.opposed += self.out.min(self.inward);
        if normals > 0 && self.out.max(self.inward) as f64 >= MAJORITY * normals as f64 {
            return self.inward > self.out;
        }
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

/// Turns over the pieces whose faces look against most normals of the file, and where there are none, or they disagree, those
/// whose faces look towards the centre of the sheet, as the skin of a limb does not, or towards their own where that one does
/// not tell.
pub(super) fn turn_outward(
    triangles: &mut IdVec<FaceId, [VertexId; 3]>,
    positions: &IdVec<VertexId, DVec3>,
    file: &IdVec<VertexId, DVec3>,
) -> Outside {
    let (of_face, count) = number_pieces(triangles, positions.len());
    let mut pieces = vec![Piece::default(); count];
    let mut sheet = Piece::default();
    // Twice the vector area, and the middle.
    let face = |t: &[VertexId; 3]| {
        let [a, b, c] = t.map(|v| positions[v]);
        ((b - a).cross(c - a), (a + b + c) / 3.0)
    };
    let mut taxels: IdVec<VertexId, (DVec3, Option<usize>)> =
        IdVec::filled((DVec3::ZERO, None), positions.len());
    for (f, t) in triangles.enumerate() {
        let (cross, middle) = face(t);
        for &v in t {
            taxels[v] = (taxels[v].0 + cross, Some(of_face[f]));
        }
        for piece in [&mut pieces[of_face[f]], &mut sheet] {
            piece.area += cross.length();
            piece.moment += cross.length() * middle;
            piece.direction += cross;
        }
    }
    for (f, t) in triangles.enumerate() {
        let (cross, middle) = face(t);
        let piece = &mut pieces[of_face[f]];
        piece.from_sheet += cross.dot((middle - sheet.centre()).normalize_or_zero());
        piece.from_own += cross.dot((middle - piece.centre()).normalize_or_zero());
    }
    for (&(cross, piece), n) in taxels.iter().zip(file).filter(|(_, n)| **n != DVec3::ZERO) {
        if let Some(piece) = piece {
            let side = if cross.dot(*n) < 0.0 { &mut pieces[piece].inward } else { &mut pieces[piece].out };
            *side += 1;
        }
    }
    let mut outside = Outside::default();
    let turn: Vec<bool> = pieces.iter().map(|piece| piece.is_inside_out(&mut outside)).collect();
    for (t, &piece) in triangles.iter_mut().zip(&of_face) {
        if turn[piece] {
            t.swap(1, 2);
        }
    }
    outside
}

/// The piece of every face, and how many there are.
fn number_pieces(triangles: &IdVec<FaceId, [VertexId; 3]>, vertices: usize) -> (IdVec<FaceId, usize>, usize) {
    let mut sets = DisjointSets::<VertexId>::new(vertices);
    for &[a, b, c] in triangles {
        sets.join(a, b);
        sets.join(a, c);
    }
    let mut number = IdVec::<VertexId, Option<usize>>::filled(None, vertices);
    let mut count = 0;
    let of_face = triangles.map(|t| {
        *number[sets.root(t[0])].get_or_insert_with(|| {
            count += 1;
            count - 1
        })
    });
    (of_face, count)
}
