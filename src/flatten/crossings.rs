//! Which boundary edges of a map cross or touch: every pair once, found by splitting the boxes at
//! medians.
//!
//! The tests are exact signs of areas, compared one by one: neither rounding nor underflow hides a
//! crossing.

use std::{collections::BTreeSet, ops::ControlFlow};

use glam::DVec2;

use crate::{delaunay::orientation, flatten::energy::elements::Uv, id::VertexId};

/// Boxes in a leaf of the tree: below this, comparing all pairs is quicker than splitting.
const LEAF: usize = 16;

/// Crossings are counted up to this number. Edges that lie on each other have a crossing a pair:
/// the 18 000 edges of 6000 coincident triangles have 160 million, which take a minute.
pub(crate) const MAX_CROSSINGS: usize = 1_000_000;

/// One boundary edge on the map, with its box.
#[derive(Debug, Clone, Copy)]
struct Segment {
    ends: [VertexId; 2],
    from: DVec2,
    to: DVec2,
    low: DVec2,
    high: DVec2,
}

impl Segment {
    fn new(ends: [VertexId; 2], uv: &Uv) -> Self {
        let [from, to] = ends.map(|v| uv[v]);
        Self { ends, from, to, low: from.min(to), high: from.max(to) }
    }
}

/// Number of pairs of boundary edges without a common vertex that cross or touch on the map, at
/// most [`MAX_CROSSINGS`].
pub(crate) fn boundary_crossings(edges: &[[VertexId; 2]], uv: &Uv) -> usize {
    crossings_up_to(MAX_CROSSINGS, edges, uv)
}

/// Whether any two boundary edges without a common vertex cross or touch on the map.
pub(crate) fn boundary_crosses_itself(edges: &[[VertexId; 2]], uv: &Uv) -> bool {
    crossings_up_to(1, edges, uv) > 0
}

/// The vertices of the boundary edges that cross or touch another one on the map, ids rising; of the
/// first [`MAX_CROSSINGS`] pairs.
pub(crate) fn crossing_vertices(edges: &[[VertexId; 2]], uv: &Uv) -> Vec<VertexId> {
    let mut found = BTreeSet::new();
    each_crossing(MAX_CROSSINGS, edges, uv, &mut |pair| found.extend(pair.into_iter().flatten()));
    found.into_iter().collect()
}

fn crossings_up_to(most: usize, edges: &[[VertexId; 2]], uv: &Uv) -> usize {
    each_crossing(most, edges, uv, &mut |_| ())
}

/// Calls `found` with each of the first `most` pairs of edges that cross or touch; returns their number.
fn each_crossing(
    most: usize,
    edges: &[[VertexId; 2]],
    uv: &Uv,
    found: &mut dyn FnMut([[VertexId; 2]; 2]),
) -> usize {
    let mut segments: Vec<Segment> = edges.iter().map(|&ends| Segment::new(ends, uv)).collect();
    let mut count = 0;
    let _ = each_near_pair(&mut segments, &mut |s, t| {
        if meet(s, t) {
            count += 1;
            found([s.ends, t.ends]);
        }
        if count < most { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    count
}

fn bounds(segments: &[Segment]) -> (DVec2, DVec2) {
    segments
        .iter()
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi), s| (lo.min(s.low), hi.max(s.high)))
}

/// Splits at the median along the longer side of the box.
fn split(segments: &mut [Segment]) -> (&mut [Segment], &mut [Segment]) {
    let (lo, hi) = bounds(segments);
    let axis = usize::from((hi - lo).y > (hi - lo).x);
    let middle = segments.len() / 2;
    segments.select_nth_unstable_by(middle, |s, t| {
        (s.from[axis] + s.to[axis]).total_cmp(&(t.from[axis] + t.to[axis])).then(s.ends.cmp(&t.ends))
    });
    segments.split_at_mut(middle)
}

/// What is done with a pair of segments, and whether to go on.
type Visit<'v> = dyn FnMut(&Segment, &Segment) -> ControlFlow<()> + 'v;

/// Visits every pair of segments without a common vertex whose boxes touch, in an order that
/// depends only on them, until `visit` breaks off.
///
/// Pairs are found by splitting the set of boxes against itself at medians, so the work grows with
/// the number of segments and of near pairs, not with its square.
fn each_near_pair(segments: &mut [Segment], visit: &mut Visit<'_>) -> ControlFlow<()> {
    if segments.len() <= LEAF {
        return (1..segments.len()).try_for_each(|i| {
            let mut others = segments[..i].iter().filter(|s| near(s, &segments[i]));
            others.try_for_each(|s| visit(s, &segments[i]))
        });
    }
    let (left, right) = split(segments);
    between(left, right, visit)?;
    each_near_pair(left, visit)?;
    each_near_pair(right, visit)
}

/// Visits the near pairs of one of `left` and one of `right`.
fn between(left: &mut [Segment], right: &mut [Segment], visit: &mut Visit<'_>) -> ControlFlow<()> {
    let ((llo, lhi), (rlo, rhi)) = (bounds(left), bounds(right));
    if llo.cmpgt(rhi).any() || rlo.cmpgt(lhi).any() {
        return ControlFlow::Continue(());
    }
    if left.len().max(right.len()) <= LEAF {
        left.iter().try_for_each(|s| right.iter().filter(|t| near(s, t)).try_for_each(|t| visit(s, t)))
    } else if left.len() >= right.len() {
        let (a, b) = split(left);
        between(a, right, visit)?;
        between(b, right, visit)
    } else {
        let (a, b) = split(right);
        between(left, a, visit)?;
        between(left, b, visit)
    }
}

/// Whether the boxes of two segments without a common vertex touch.
fn near(s: &Segment, t: &Segment) -> bool {
    let apart = s.low.cmpgt(t.high).any() || t.low.cmpgt(s.high).any();
    !apart && s.ends.iter().all(|v| !t.ends.contains(v))
}

/// Whether two segments without a common vertex, whose boxes touch, have a common point.
fn meet(s: &Segment, t: &Segment) -> bool {
    let straddles = |s: &Segment, t: &Segment| {
        orientation([s.from, s.to, t.from]) * orientation([s.from, s.to, t.to]) <= 0.0
    };
    straddles(s, t) && straddles(t, s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TriMesh, boundary_edges, shapes};

    fn crossings(mesh: &TriMesh, uv: &Uv) -> usize {
        boundary_crossings(&boundary_edges(mesh), uv)
    }

    fn flat(mesh: &TriMesh) -> Uv {
        mesh.positions.map(|p| p.truncate())
    }

    #[test]
    fn a_bow_tie_crosses_once() {
        let mesh = shapes::square();
        let mut uv = flat(&mesh);
        let (b, c) = (uv[VertexId::new(1)], uv[VertexId::new(2)]);
        (uv[VertexId::new(1)], uv[VertexId::new(2)]) = (c, b);
        assert_eq!(crossings(&mesh, &uv), 1, "two opposite sides of the square");
    }

    /// 2000 coincident triangles have 18 million pairs of edges that touch.
    #[test]
    fn counting_ends_at_the_largest_number() {
        let places = [DVec2::ZERO, DVec2::X, DVec2::Y];
        let uv: Uv = (0..6000).map(|i| places[i % 3]).collect();
        let edge = |i: usize| [i, if i % 3 == 2 { i - 2 } else { i + 1 }].map(VertexId::new);
        let edges: Vec<_> = (0..6000).map(edge).collect();
        assert_eq!(boundary_crossings(&edges, &uv), MAX_CROSSINGS);
        assert!(boundary_crosses_itself(&edges, &uv));
    }

    /// The tree must find what comparing every pair finds.
    #[test]
    fn splitting_finds_every_pair() {
        let mesh = shapes::lattice(40, 3, 0.01);
        // A strip rolled up one and a half times around a slightly shrinking circle.
        let uv =
            mesh.positions.map(|p| DVec2::from_angle(p.x * 23.0) * (0.3 + 0.02 * (p.x * 60.0).sin() + p.y));
        let edges = boundary_edges(&mesh);
        let segments: Vec<_> = edges.iter().map(|&ends| Segment::new(ends, &uv)).collect();
        let cross = |s: &Segment, t: &Segment| near(s, t) && meet(s, t);
        let all: usize = (1..segments.len())
            .map(|i| segments[..i].iter().filter(|s| cross(s, &segments[i])).count())
            .sum();
        assert!(all > 0, "the strip overlaps itself");
        assert_eq!(crossings(&mesh, &uv), all);
    }
}
