//! How far the skin is from a contact over a part of a coarse face.
//!
//! A distance changes no faster than its point moves. Let a part of a face with unit normal `n` be moved to the points
//! `p + l(p) n`, with a linear `l`, and be at least `gap` from the skin there. Then a contact over `p`, no higher than
//! `l(p)`, is as far from the skin as if that were at most `l(p) - gap` high, or farther. Parts are tilted as the distance
//! from the skin changes between their corners, so that what is lost is of second order in their size. Upper bounds follow
//! where the skin crosses all lines along the normal, or else from how far each part is from the skin.

use std::array;

use glam::DVec3;

use crate::bvh::Start;
use crate::contact::coarse::distance::Part;
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{closest_point, triangle_cross};
use crate::skin::PatchId;

/// Parts along a side of a face.
const SIDE: usize = 3;
const PARTS: usize = SIDE * SIDE;
/// Corners of parts.
const NODES: usize = (SIDE + 1) * (SIDE + 2) / 2;

/// Contacts up to this distance from the skin, in m, are known best. The bounds of nearer contacts would be closer if it
/// were less.
const CLOSE: f64 = 0.004;

/// A face whose doubled area is less than this part of its longest side squared has no known heights: its normal is not
/// known to `CLOSE` times the rounding.
const FLAT: f64 = 1e-4;

/// The cosine of the steepest skin, against a face, that is known to cross the lines over it.
const STEEPEST: f64 = 0.1;

/// How much deeper than expected the skin is looked for below a moved part.
const DEEPER: f64 = 1.25;

/// How often the plane between two triangles is turned to part them by more.
const TURNS: usize = 2;

/// Gaps are measured to this part of the distance from the skin.
const FINE: f64 = 1e-5;

/// Distances of parts from the skin below this part of the longest side of a face do not matter.
const SMALL: f64 = 1e-6;

/// How often a part is cut to measure how far it is from the skin.
const CUTS: u32 = 8;

/// An upper bound in m, as the first half of the bits of an `f32`.
#[derive(Debug, Clone, Copy)]
struct Length(u16);

impl Length {
    /// Not a number.
    const UNKNOWN: Self = Self(u16::MAX);

    #[expect(clippy::cast_possible_truncation, reason = "rounded up")]
    fn at_least(x: f64) -> Self {
        let x = (x as f32).next_up();
        Self((x.to_bits() >> 16) as u16 + u16::from(x > 0.0))
    }

    fn get(self) -> f64 {
        f32::from_bits(u32::from(self.0) << 16).into()
    }
}

/// What is known over the parts of a face. Small, since answers wait for it to come from memory.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Columns {
    /// How far the skin is at most above and below the face at each node, in between as linear.
    heights: [[Length; 2]; NODES],
    /// How far each part is at most from the skin; unknown where that crosses all lines over it.
    away: [Length; PARTS],
    /// Contacts farther than this from the face may be nearer to the skin than `heights` say.
    close: Length,
}

fn node(i: usize, j: usize) -> usize {
    j * (2 * SIDE + 3 - j) / 2 + i
}

/// The nodes of a triangle.
fn nodes([a, b, c]: [DVec3; 3]) -> [DVec3; NODES] {
    let mut at = (0..=SIDE).flat_map(|j| (0..=SIDE - j).map(move |i| [i, j].map(|k| k as f64 / SIDE as f64)));
    array::from_fn(|_| at.next().map_or(a, |[s, t]| a * (1.0 - s - t) + b * s + c * t))
}

/// The nodes of each part, counterclockwise.
fn parts() -> [[usize; 3]; PARTS] {
    let mut parts = (0..SIDE).flat_map(|j| {
        (0..2 * (SIDE - j) - 1).map(move |k| match (k / 2, k % 2) {
            (i, 0) => [node(i, j), node(i + 1, j), node(i, j + 1)],
            (i, _) => [node(i + 1, j + 1), node(i, j + 1), node(i + 1, j)],
        })
    });
    array::from_fn(|_| parts.next().unwrap_or_default())
}

/// The part that has a point of a face, its nodes, and their weights at the point.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to SIDE")]
fn part_at([_, s, t]: [f64; 3]) -> (usize, [usize; 3], [f64; 3]) {
    let [s, t] = [s, t].map(|x| x * SIDE as f64);
    let j = (t as usize).min(SIDE - 1);
    let i = (s as usize).min(SIDE - 1 - j);
    let [s, t] = [s - i as f64, t - j as f64];
    let part = j * (2 * SIDE - j) + 2 * i;
    if (i + j + 1 < SIDE) & (s + t > 1.0) {
        let nodes = [node(i + 1, j + 1), node(i, j + 1), node(i + 1, j)];
        (part + 1, nodes, [s + t - 1.0, 1.0 - s, 1.0 - t])
    } else {
        (part, [node(i, j), node(i + 1, j), node(i, j + 1)], [1.0 - s - t, s, t])
    }
}

impl Columns {
    /// The least and the largest distance from the skin of a contact, by the point of the face nearest to it, how far that
    /// is, negative on the back, and how far the contact is from the point as high over it. The least may be no number.
    pub(super) fn range(&self, barycentric: [f64; 3], height: f64, beside: f64) -> [f64; 2] {
        let (part, nodes, weights) = part_at(barycentric);
        let side = usize::from(height < 0.0);
        let [above, below] = [side, 1 - side].map(|side| {
            nodes.iter().zip(weights).map(|(&k, weight)| self.heights[k][side].get() * weight).sum::<f64>()
        });
        let (height, away) = (height.abs(), self.away[part].get());
        let least = if height <= self.close.get() { height - above - beside } else { f64::NEG_INFINITY };
        let most = if away.is_nan() {
            (height + above.max(below)).min((height + below).max(above - height) + beside)
        } else {
            height + away
        };
        [least, most]
    }
}

/// The sides of a triangle seen along a direction: outward, and how far along that each is.
struct Outline([(DVec3, f64); 3]);

impl Outline {
    fn new(corners: &[DVec3; 3], along: DVec3) -> Self {
        Self([0, 1, 2].map(|k| {
            let outward = (corners[(k + 1) % 3] - corners[k]).cross(along).normalize_or_zero();
            (outward, outward.dot(corners[k]))
        }))
    }

    /// At least how far the convex hull of points is beside the triangle; not positive over it.
    fn beside(&self, points: &[DVec3]) -> f64 {
        let least = |out: DVec3| points.iter().map(|&p| out.dot(p)).fold(f64::INFINITY, f64::min);
        self.0.iter().map(|&(out, at)| least(out) - at).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// A part of a face and where it is moved to.
struct Lid {
    part: [DVec3; 3],
    moved: [DVec3; 3],
    /// Unit normals of both.
    up: DVec3,
    tilted: DVec3,
    /// Below the moved part all skin is known up to this depth.
    deepest: f64,
    /// No skin lower than this, below the face, counts.
    close: f64,
}

impl Lid {
    /// How far a point is below the moved part, and whether that is not too deep.
    fn depth(&self, p: DVec3) -> (f64, bool) {
        let depth = self.tilted.dot(self.moved[0] - p) / self.tilted.dot(self.up);
        (depth, depth <= self.deepest && self.up.dot(self.part[0] - p) <= self.close)
    }
}

/// A triangle of the skin.
struct Piece {
    face: FaceId,
    corners: [DVec3; 3],
    /// At least how far it is from a face that is moved.
    gap: f64,
}

/// The skin of a patch.
pub(super) struct Skin<'a> {
    pub(super) tree: &'a PatchBvh,
    /// Which sides of each face have no face on the other side.
    open: IdVec<FaceId, [bool; 3]>,
}

impl<'a> Skin<'a> {
    pub(super) fn new(tree: &'a PatchBvh) -> Self {
        let triangles = &tree.mesh.triangles;
        // No face has the side from `p` to `q`.
        let is_missing = |p: VertexId, q: VertexId| {
            !tree
                .corners
                .faces(p)
                .any(|f| (0..3).any(|k| [triangles[f][k], triangles[f][(k + 1) % 3]] == [p, q]))
        };
        let open = |&[a, b, c]: &[VertexId; 3]| [is_missing(b, a), is_missing(c, b), is_missing(a, c)];
        Self { tree, open: triangles.iter().map(open).collect::<Vec<_>>().into() }
    }

    /// The columns of a triangle, for contacts up to `farthest` (m) from it. Lengths are wrong by at most `rounding` (m).
    pub(super) fn columns(&self, corners: [DVec3; 3], farthest: f64, rounding: f64) -> Columns {
        let (nodes, normal) = (nodes(corners), triangle_cross(corners));
        let longest = (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max);
        let mut columns = Columns {
            heights: [[Length::UNKNOWN; 2]; NODES],
            away: [Length::UNKNOWN; PARTS],
            close: Length::UNKNOWN,
        };
        let mut is_crossed = [false; PARTS];
        if normal.length() > FLAT * longest * longest {
            let mut start = Start::Root;
            let mut distance = |q: DVec3| {
                let mut best = None;
                let packet = self.tree.nearest(PatchId::new(0), q, start, &mut best);
                start = packet.map_or(Start::Root, Start::Packet);
                Best::squared(best.as_ref()).sqrt()
            };
            let away = distance(corners.iter().sum::<DVec3>() / 3.0);
            columns.close = Length::at_least((CLOSE + away).min(farthest));
            let (close, outline) = (columns.close.get(), Outline::new(&corners, normal));
            for (side, up) in [normal, -normal].into_iter().map(DVec3::normalize).enumerate() {
                let rise = nodes.map(|p| close - distance(p + up * close));
                let lift = close - rise.into_iter().fold(f64::INFINITY, f64::min);
                let moved: [DVec3; NODES] = array::from_fn(|k| nodes[k] + up * (lift + rise[k]));
                let pieces = self.pieces(&outline, &moved, up, lift, rounding);
                let mut heights = [f64::NEG_INFINITY; NODES];
                for (part, corners) in parts().into_iter().enumerate() {
                    let [part_of, moved] = [&nodes, &moved].map(|points| corners.map(|k| points[k]));
                    let tilted = triangle_cross(moved).normalize_or_zero();
                    let tilted = tilted * tilted.dot(up).signum();
                    let lid = Lid { part: part_of, moved, up, tilted, deepest: DEEPER * lift, close };
                    let gap = least_gap(&lid, &pieces, lift);
                    corners
                        .iter()
                        .for_each(|&k| heights[k] = heights[k].max(lift + rise[k] - gap + rounding));
                    if side == 0 {
                        is_crossed[part] = gap > rounding && self.is_crossed(&lid, &pieces, rounding);
                    }
                }
                (0..NODES).for_each(|k| columns.heights[k][side] = Length::at_least(heights[k]));
            }
        }
        for (part, nodes_of) in parts().into_iter().enumerate() {
            if !is_crossed[part] {
                let mut most = SMALL * longest + rounding;
                let corners = nodes_of.map(|k| nodes[k]);
                Part::new(corners).raise(self.tree, CUTS, &mut most);
                columns.away[part] = Length::at_least(most + rounding);
            }
        }
        columns
    }

    /// The skin around the moved nodes of a face, seen along `up` as an outline, nearest first: what may be nearer than `lift`, and
    /// what is over the face and not much deeper.
    fn pieces(
        &self,
        outline: &Outline,
        moved: &[DVec3; NODES],
        up: DVec3,
        lift: f64,
        rounding: f64,
    ) -> Vec<Piece> {
        let centre = moved.iter().sum::<DVec3>() / NODES as f64;
        let radius = moved.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
        let bottom = moved.iter().map(|&p| up.dot(p)).fold(f64::INFINITY, f64::min);
        let mut pieces = Vec::new();
        self.tree.each_around(centre, (radius + DEEPER * lift + rounding) * (1.0 + 1e-9), |face| {
            let corners = self.tree.mesh.corners(face);
            let [a, b, c] = corners.map(|p| bottom - up.dot(p));
            let (below, beside) = (a.min(b).min(c).max(0.0), outline.beside(&corners));
            let gap = (below * below + beside.max(0.0) * beside).sqrt();
            if gap < lift || beside <= rounding {
                pieces.push(Piece { face, corners, gap });
            }
        });
        pieces.sort_unstable_by(|a, b| a.gap.total_cmp(&b.gap));
        pieces
    }

    /// Whether the skin crosses every line over a part that is moved off the skin.
    ///
    /// Over the part, all triangles that are deep enough below the moved part, but not too deep, must look up, and none
    /// of their sides may be open. Where one ends, another goes on, so they cover all of the part if they cover its centre.
    /// What is `rounding` beside the part counts as over it.
    fn is_crossed(&self, lid: &Lid, pieces: &[Piece], rounding: f64) -> bool {
        let outline = Outline::new(&lid.part, lid.up);
        let centre = lid.part.iter().sum::<DVec3>() / 3.0;
        let mut is_covered = false;
        for Piece { face, corners, .. } in pieces {
            if outline.beside(corners) > rounding {
                continue;
            }
            let depths = corners.map(|p| lid.depth(p));
            if depths.iter().all(|&(depth, _)| depth < 0.0) || depths.iter().all(|&(_, is_known)| !is_known) {
                continue;
            }
            let is_open = (0..3).any(|k| {
                self.open[*face][k] && outline.beside(&[corners[k], corners[(k + 1) % 3]]) <= rounding
            });
            let is_known = depths.iter().all(|&(depth, is_known)| depth >= 0.0 && is_known);
            let is_upright = triangle_cross(*corners).normalize_or_zero().dot(lid.up) > STEEPEST;
            if is_open || !is_known || !is_upright {
                return false;
            }
            is_covered |= Outline::new(corners, lid.up).beside(&[centre]) <= rounding;
        }
        is_covered
    }
}

/// At least how far a moved part is from the pieces, and at most `most`.
fn least_gap(lid: &Lid, pieces: &[Piece], most: f64) -> f64 {
    let mut least = most;
    let at = lid.tilted.dot(lid.moved[0]);
    for Piece { corners, gap: away, .. } in pieces {
        if *away >= least {
            break;
        }
        let [d, e, f] = corners.map(|p| lid.tilted.dot(p));
        let rough = (at - d.max(e).max(f)).max(*away);
        if rough < least {
            let is_fine = rough > least - FINE * most;
            least = if is_fine { rough } else { least.min(gap(&lid.moved, corners, least).max(rough)) };
        }
    }
    least
}

/// At least how far two triangles are apart: as far as a plane parts them, that along the second or one across the line
/// between points of theirs that are near each other. Ends once that is `enough`.
fn gap(triangle: &[DVec3; 3], other: &[DVec3; 3], enough: f64) -> f64 {
    let parted = |across: DVec3| {
        let [a, b, c] = triangle.map(|p| across.dot(p));
        let [d, e, f] = other.map(|p| across.dot(p));
        (d.min(e).min(f) - a.max(b).max(c)).max(a.min(b).min(c) - d.max(e).max(f))
    };
    let ids = [0, 1, 2].map(VertexId::new);
    let nearest = |corners: &[DVec3; 3], p: DVec3| -> DVec3 {
        let weights = closest_point(p, *corners, ids).barycentric;
        corners.iter().zip(weights).map(|(corner, weight)| *corner * weight).sum()
    };
    let mut gap = parted(triangle_cross(*other).normalize_or_zero());
    let mut from = triangle.iter().sum::<DVec3>() / 3.0;
    for _ in 0..TURNS {
        if gap >= enough {
            break;
        }
        let to = nearest(other, from);
        from = nearest(triangle, to);
        gap = gap.max(parted((to - from).normalize_or_zero()));
    }
    gap
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_part_are_in_its_column() {
        let at = nodes([DVec3::ZERO, DVec3::X, DVec3::Y]);
        for (part, corners) in parts().into_iter().enumerate() {
            let [a, b, c] = corners.map(|k| at[k]);
            assert!((b - a).cross(c - a).z > 0.0, "counterclockwise");
            for [s, t] in [[0.01, 0.01], [0.98, 0.01], [0.01, 0.98], [0.3, 0.3]] {
                let p = a * (1.0 - s - t) + b * s + c * t;
                let (found, nodes, weights) = part_at([1.0 - p.x - p.y, p.x, p.y]);
                assert_eq!((found, nodes), (part, corners), "{p}");
                let q: DVec3 = nodes.iter().zip(weights).map(|(&k, weight)| at[k] * weight).sum();
                assert!(p.distance(q) < 1e-15);
            }
        }
        assert_eq!(part_at([0.0, 1.0, 0.0]).0, 2 * (SIDE - 1));
        assert_eq!(part_at([0.0, 0.0, 1.0]).0, PARTS - 1);
    }

    #[test]
    fn lengths_are_rounded_up() {
        for x in [0.0, 1e-300, 1.0, 1.0 + 1e-9, 0.0123, -0.0123, -1.0] {
            let found = Length::at_least(x).get();
            assert!(found > x && found < x + 0.01 * x.abs() + 1e-30, "{found} for {x}");
        }
    }

    #[test]
    fn triangles_are_as_far_apart_as_their_nearest_points() {
        let flat = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let above = flat.map(|p| p * 0.2 + DVec3::new(0.1, 0.1, 0.5));
        let beside = flat.map(|p| p + DVec3::new(2.0, 0.0, 1.0));
        let on_edge = [DVec3::new(0.7, 0.7, 1.0), DVec3::new(0.7, 0.7, -1.0), DVec3::new(2.0, 2.0, 0.0)];
        let point = [DVec3::new(0.2, 0.2, -0.3); 3];
        for (other, apart) in
            [(above, 0.5), (beside, 2.0_f64.sqrt()), (on_edge, 0.2 * 2.0_f64.sqrt()), (point, 0.3)]
        {
            let found = gap(&flat, &other, f64::INFINITY);
            assert!(found <= apart + 1e-15 && found > 0.99 * apart, "{found} of {apart}");
        }
        assert_eq!(gap(&flat, &flat, f64::INFINITY), 0.0);
    }
}
