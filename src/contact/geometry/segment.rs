//! Distances between segments, and between a segment and a triangle, in `f64`.

use glam::DVec3;

use crate::{
    contact::geometry::ray::pierces,
    id::VertexId,
    mesh::{Closest, closest_point},
};

/// The nearest point of a triangle, by a numbering of its own.
pub(super) fn closest(q: DVec3, corners: [DVec3; 3]) -> Closest {
    closest_point(q, corners, [0, 1, 2].map(VertexId::new))
}

/// Squared distance of `q` to the segment `ab`, which may be a point.
fn point_to_segment(q: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let (along, offset) = (b - a, q - a);
    let t = along.dot(offset) / along.length_squared();
    if t >= 1.0 {
        q.distance_squared(b)
    } else if t > 0.0 {
        (offset - along * t).length_squared()
    } else {
        // Also where the segment is a point and `t` is not a number.
        offset.length_squared()
    }
}

/// Squared distance between two segments, each of which may be a point.
///
/// Either an end of one is nearest to the other, or both nearest points are inside: then they are
/// where the common normal meets the two lines.
pub(super) fn segment_to_segment(p: [DVec3; 2], q: [DVec3; 2]) -> f64 {
    let ends = [
        point_to_segment(p[0], q),
        point_to_segment(p[1], q),
        point_to_segment(q[0], p),
        point_to_segment(q[1], p),
    ];
    let nearest_end = ends.into_iter().fold(f64::INFINITY, f64::min);
    let (u, v, w) = (p[1] - p[0], q[1] - q[0], q[0] - p[0]);
    let normal = u.cross(v);
    let area = normal.length_squared();
    let (s, t) = (w.cross(v).dot(normal), w.cross(u).dot(normal));
    // Also false for parallel segments, whose ends are as near as anything between them.
    if s > 0.0 && s < area && t > 0.0 && t < area {
        let height = w.dot(normal);
        nearest_end.min(height * height / area)
    } else {
        nearest_end
    }
}

/// Squared distance between a segment and a triangle; 0 where they cross.
pub(super) fn segment_to_triangle(segment: [DVec3; 2], corners: [DVec3; 3]) -> f64 {
    if pierces(segment, corners) {
        return 0.0;
    }
    let ends = segment.map(|p| closest(p, corners).squared);
    let sides = [0, 1, 2].map(|k| segment_to_segment(segment, [corners[k], corners[(k + 1) % 3]]));
    ends.into_iter().chain(sides).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;

    #[test]
    fn crossed_parallel_and_collapsed_segments() {
        let x = [DVec3::ZERO, DVec3::X];
        let lifted = |p: [DVec3; 2], z: f64| p.map(|p| p + DVec3::Z * z);
        let crossing = [DVec3::new(0.5, -1.0, 0.0), DVec3::new(0.5, 1.0, 0.0)];
        assert_eq!(segment_to_segment(x, lifted(crossing, 2.0)), 4.0);
        assert_eq!(segment_to_segment(x, lifted(x, 3.0)), 9.0);
        assert_eq!(segment_to_segment(x, [DVec3::Y; 2]), 1.0);
        assert_eq!(segment_to_segment(x, x.map(|p| p + DVec3::X * 3.0)), 4.0);
        let triangle = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
        assert_eq!(
            segment_to_triangle([DVec3::new(1.0, 1.0, -1.0), DVec3::new(1.0, 1.0, 1.0)], triangle),
            0.0
        );
        assert_eq!(
            segment_to_triangle([DVec3::new(1.0, 1.0, 2.0), DVec3::new(1.0, 1.0, 3.0)], triangle),
            4.0
        );
    }

    proptest! {
        #![proptest_config(soup::fixed(300, 21))]

        /// No sample of the segment is nearer to the triangle, and a fine sampling comes as near.
        #[test]
        fn no_point_of_the_segment_is_nearer(corners in soup::triangle(), ends in soup::triangle()) {
            const STEPS: u32 = 512;
            let segment = [ends[0], ends[1]];
            let found = segment_to_triangle(segment, corners).sqrt();
            let sampled = (0..=STEPS).map(|k| {
                closest(segment[0].lerp(segment[1], f64::from(k) / f64::from(STEPS)), corners).squared.sqrt()
            });
            let sampled = sampled.fold(f64::INFINITY, f64::min);
            let step = segment[0].distance(segment[1]) / f64::from(STEPS);
            prop_assert!(sampled >= found - 1e-7 && sampled <= found + step + 1e-12, "{found} but {sampled} by samples");
        }
    }
}
