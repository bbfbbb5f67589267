use std::{
    cmp::Reverse,
    collections::{BTreeMap, BinaryHeap},
};

use glam::{DVec2, DVec3};

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
};

/// Pairs of faces that are looked at, and cells that are filled, before the faces are drawn pixel by pixel instead: a
/// second's work. A skin of 20 thousand taxels needs about a tenth.
const MOST_PAIRS: usize = 1 << 22;

/// Faces that share less than this on the picture may be drawn in any order, in square pixels.
const LEAST_OVERLAP_PX2: f64 = 0.01;

/// Faces that are in front of each other by at most this may pass for one behind the other, in pixels.
const LEAST_GAP_PX: f64 = 0.5;

/// The faces from the farthest to the nearest: each before all that hide a part of it. `None` if there is no such order,
/// because faces pass through each other or hide each other in a circle, or if it would take too long to find.
///
/// `places` are pixels to the right and down, and towards the viewer. Where the mesh leaves a choice the middle that is
/// farther comes first.
pub(crate) fn back_to_front(mesh: &TriMesh, places: &IdVec<VertexId, DVec3>) -> Option<Vec<FaceId>> {
    let corners: IdVec<FaceId, [DVec3; 3]> = mesh.triangles.map(|t| counter_clockwise(t.map(|v| places[v])));
    let hides = overlaps(&corners)?;
    let mut by_middle: Vec<FaceId> = corners.ids().collect();
    let middle = |face: FaceId| corners[face].iter().map(|p| p.z).sum::<f64>();
    by_middle.sort_by(|&a, &b| middle(a).total_cmp(&middle(b)).then(a.cmp(&b)));
    let mut rank = IdVec::<FaceId, usize>::filled(0, corners.len());
    for (k, &face) in by_middle.iter().enumerate() {
        rank[face] = k;
    }
    let mut behind = IdVec::<FaceId, usize>::filled(0, corners.len());
    hides.iter().flatten().for_each(|&front| behind[front] += 1);
    let mut free: BinaryHeap<Reverse<usize>> =
        by_middle.iter().filter(|&&face| behind[face] == 0).map(|&face| Reverse(rank[face])).collect();
    let mut order = Vec::with_capacity(corners.len());
    while let Some(Reverse(k)) = free.pop() {
        let face = by_middle[k];
        order.push(face);
        for &front in &hides[face] {
            behind[front] -= 1;
            if behind[front] == 0 {
                free.push(Reverse(rank[front]));
            }
        }
    }
    (order.len() == corners.len()).then_some(order)
}

/// The faces that hide a part of each face.
fn overlaps(corners: &IdVec<FaceId, [DVec3; 3]>) -> Option<IdVec<FaceId, Vec<FaceId>>> {
    let boxes = corners.map(|t| {
        let [a, b, c] = t.map(DVec3::truncate);
        (a.min(b).min(c), a.max(b).max(c))
    });
    let extent: f64 = boxes.iter().map(|(lo, hi)| (*hi - *lo).max_element()).sum();
    let side = (extent / boxes.len().max(1) as f64).max(1.0);
    let cell = |p: DVec2| {
        #[expect(clippy::cast_possible_truncation, reason = "`as` saturates; too many cells are refused")]
        let [x, y] = [(p.x / side).floor() as i64, (p.y / side).floor() as i64];
        [x, y]
    };
    let mut cells = BTreeMap::<[i64; 2], Vec<FaceId>>::new();
    let (mut filled, mut pairs) = (0_usize, 0_usize);
    for (face, &(lo, hi)) in boxes.enumerate() {
        let ([left, top], [right, bottom]) = (cell(lo), cell(hi));
        let count =
            right.abs_diff(left).saturating_add(1).saturating_mul(bottom.abs_diff(top).saturating_add(1));
        filled = filled.saturating_add(usize::try_from(count).unwrap_or(usize::MAX));
        if filled > MOST_PAIRS {
            return None;
        }
        for at in (top..=bottom).flat_map(|y| (left..=right).map(move |x| [x, y])) {
            cells.entry(at).or_default().push(face);
        }
    }
    let mut hides = corners.map(|_| Vec::new());
    for (&at, faces) in &cells {
        pairs = pairs.saturating_add(faces.len().saturating_mul(faces.len()) / 2);
        if pairs > MOST_PAIRS {
            return None;
        }
        for (k, &a) in faces.iter().enumerate() {
            for &b in &faces[k + 1..] {
                // Two boxes share several cells; the one with the upper left corner of what they share counts.
                if cell(boxes[a].0.max(boxes[b].0)) != at {
                    continue;
                }
                match front(&corners[a], &corners[b]) {
                    Front::Neither => {}
                    Front::First => hides[b].push(a),
                    Front::Second => hides[a].push(b),
                    Front::Both => return None,
                }
            }
        }
    }
    Some(hides)
}

/// Which of two faces hides a part of the other.
#[derive(Debug, PartialEq)]
enum Front {
    Neither,
    First,
    Second,
    /// They pass through each other.
    Both,
}

fn front(a: &[DVec3; 3], b: &[DVec3; 3]) -> Front {
    let shared = intersection(a, b);
    let area: f64 = (1..shared.len().saturating_sub(1))
        .map(|k| 0.5 * (shared[k] - shared[0]).perp_dot(shared[k + 1] - shared[0]))
        .sum();
    if area.is_nan() || area < LEAST_OVERLAP_PX2 {
        return Front::Neither;
    }
    // Linear over what they share, so that its corners tell.
    let gaps = shared.iter().map(|&p| nearness(a, p) - nearness(b, p));
    let (least, most) = gaps.fold((0.0_f64, 0.0_f64), |(lo, hi), gap| (lo.min(gap), hi.max(gap)));
    match (most > LEAST_GAP_PX, least < -LEAST_GAP_PX) {
        (true, true) => Front::Both,
        _ if most > -least => Front::First,
        _ if most < -least => Front::Second,
        _ => Front::Neither,
    }
}

/// The part of the picture that two triangles share (Sutherland and Hodgman 1974).
fn intersection(a: &[DVec3; 3], b: &[DVec3; 3]) -> Vec<DVec2> {
    let mut shared: Vec<DVec2> = a.iter().map(|p| p.truncate()).collect();
    for k in 0..3 {
        let (from, to) = (b[k].truncate(), b[(k + 1) % 3].truncate());
        let side = |p: DVec2| (to - from).perp_dot(p - from);
        let mut kept = Vec::with_capacity(shared.len() + 1);
        for (i, &p) in shared.iter().enumerate() {
            let q = shared[(i + 1) % shared.len()];
            let (at_p, at_q) = (side(p), side(q));
            if at_p >= 0.0 {
                kept.push(p);
            }
            if (at_p > 0.0 && at_q < 0.0) || (at_p < 0.0 && at_q > 0.0) {
                kept.push(p.lerp(q, at_p / (at_p - at_q)));
            }
        }
        shared = kept;
    }
    shared
}

/// How near a face is to the viewer at a place.
fn nearness(t: &[DVec3; 3], at: DVec2) -> f64 {
    let normal = (t[1] - t[0]).cross(t[2] - t[0]);
    t[0].z - normal.truncate().dot(at - t[0].truncate()) / normal.z
}

fn counter_clockwise([a, b, c]: [DVec3; 3]) -> [DVec3; 3] {
    if (b - a).truncate().perp_dot((c - a).truncate()) < 0.0 { [a, c, b] } else { [a, b, c] }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use crate::mesh::shapes;

    use super::*;

    fn faces(corners: &[[f64; 3]]) -> (TriMesh, IdVec<VertexId, DVec3>) {
        let triangles: Vec<[u32; 3]> =
            (0_u32..).step_by(3).map(|k| [k, k + 1, k + 2]).take(corners.len() / 3).collect();
        let places: Vec<DVec3> = corners.iter().map(|&p| DVec3::from(p)).collect();
        (TriMesh::from_arrays(places.clone(), &triangles), places.into())
    }

    fn indices(order: Option<Vec<FaceId>>) -> Option<Vec<usize>> {
        order.map(|order| order.into_iter().map(FaceId::index).collect())
    }

    /// The middle of the large face is nearer, yet the small one hides a part of it: sorting by middles would be wrong.
    #[test]
    fn a_face_comes_before_what_hides_it() {
        let large = [[0.0, 0.0, 0.0], [90.0, 0.0, 90.0], [90.0, 90.0, 90.0]];
        let small = [[10.0, 3.0, 20.0], [14.0, 3.0, 20.0], [12.0, 6.0, 20.0]];
        let (mesh, places) = faces(&[large, small].concat());
        assert_eq!(indices(back_to_front(&mesh, &places)), Some(vec![0, 1]));
        let (mesh, places) = faces(&[small, large].concat());
        assert_eq!(indices(back_to_front(&mesh, &places)), Some(vec![1, 0]));
    }

    #[test]
    fn faces_that_pass_through_each_other_have_no_order() {
        let flat = [[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [10.0, 20.0, 0.0]];
        let tilted = [[0.0, 0.0, 5.0], [20.0, 0.0, -5.0], [10.0, 20.0, 0.0]];
        let (mesh, places) = faces(&[flat, tilted].concat());
        assert_eq!(back_to_front(&mesh, &places), None);
    }

    /// Three bars, each over the next.
    #[test]
    fn faces_that_hide_each_other_in_a_circle_have_no_order() {
        let bar = |turn: f64| {
            let (sin, cos) = turn.sin_cos();
            [[-40.0, 10.0, -20.0], [40.0, 10.0, 20.0], [40.0, 18.0, 20.0]]
                .map(|[x, y, z]| [cos * x - sin * y, sin * x + cos * y, z])
        };
        let turn = std::f64::consts::TAU / 3.0;
        let (mesh, places) = faces(&[bar(0.0), bar(turn), bar(2.0 * turn)].concat());
        assert_eq!(back_to_front(&mesh, &places), None);
    }

    #[test]
    fn too_many_overlaps_are_given_up() {
        let slivers: Vec<[f64; 3]> = (0..4000)
            .flat_map(|k| [[0.0, 0.0, 0.0], [900.0, 0.1, f64::from(k)], [900.0, 9.0, f64::from(k)]])
            .collect();
        let (mesh, places) = faces(&slivers);
        assert_eq!(back_to_front(&mesh, &places), None);
    }

    proptest! {
        /// Wherever two faces of a folded sheet lie over each other, the nearer one is drawn later.
        #[test]
        fn nearer_faces_come_later(fold in 0.1..3.0_f64, turn in 0.0..6.3_f64) {
            let mesh = shapes::tube(9, 4, 30.0, 80.0 * fold);
            let (sin, cos) = turn.sin_cos();
            let places = mesh.positions.map(|p| DVec3::new(p.x, cos * p.y - sin * p.z, sin * p.y + cos * p.z));
            let order = back_to_front(&mesh, &places).unwrap();
            prop_assert_eq!(order.len(), mesh.triangles.len());
            let corners = |face: FaceId| counter_clockwise(mesh.triangles[face].map(|v| places[v]));
            for (k, &far) in order.iter().enumerate() {
                for &near in &order[k + 1..] {
                    prop_assert_ne!(front(&corners(far), &corners(near)), Front::First, "{:?} hides {:?}", far, near);
                }
            }
        }
    }
}
