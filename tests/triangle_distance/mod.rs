//! Distances from triangles, as plainly as can be: what lookups are tested against.

use glam::DVec3;

fn distance_to_segment(q: DVec3, a: DVec3, b: DVec3) -> f64 {
    let ab = b - a;
    let t = if ab == DVec3::ZERO { 0.0 } else { ((q - a).dot(ab) / ab.length_squared()).clamp(0.0, 1.0) };
    q.distance(a + ab * t)
}

/// Distance of a point from a triangle, which may have no area.
pub(crate) fn distance_to_triangle(q: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let sides =
        distance_to_segment(q, a, b).min(distance_to_segment(q, b, c)).min(distance_to_segment(q, c, a));
    let cross = (b - a).cross(c - a);
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    if cross.length() < 1e-9 * longest {
        return sides; // a segment: its normal is noise
    }
    let normal = cross.normalize();
    let over = [(a, b), (b, c), (c, a)].iter().all(|&(s, e)| normal.dot((e - s).cross(q - s)) > 0.0);
    if over { (q - a).dot(normal).abs().min(sides) } else { sides }
}
