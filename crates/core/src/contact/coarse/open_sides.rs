//! [`OpenSides`]: the edges of a skin with an odd number of faces, where it ends, and whether they are
//! outside a region.

use glam::DVec3;

use crate::mesh::TriMesh;
use crate::numeric::bits;

/// Regions are enlarged by this fraction of their radius and by this length (m), for rounding.
const REGION_ROUNDING: f64 = 1e-9;

/// The open sides of a skin, in groups near each other.
#[derive(Debug, Clone, Default)]
pub(super) struct OpenSides(Vec<Group>);

#[derive(Debug, Clone)]
struct Group {
    centre: DVec3,
    radius: f64,
    edges: Vec<[DVec3; 2]>,
}

/// The hull of two points `tip` and `tip + length * axis` and of points around that axis: at distances of up to `radius` from it, from
/// `from` to `to` along it.
pub(super) struct Hull {
    pub(super) tip: DVec3,
    pub(super) axis: DVec3,
    pub(super) length: f64,
    from: f64,
    to: f64,
    radius: f64,
}

impl Hull {
    pub(super) fn new(tip: DVec3, end: DVec3, points: &[DVec3]) -> Self {
        let axis = (end - tip).normalize_or_zero();
        let (mut from, mut to, mut radius) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
        for offset in points.iter().map(|p| *p - tip) {
            let along = offset.dot(axis);
            (from, to) = (from.min(along), to.max(along));
            radius = radius.max((offset - axis * along).length());
        }
        let radius = radius * (1.0 + REGION_ROUNDING) + REGION_ROUNDING;
        Self { tip, axis, length: tip.distance(end), from, to, radius }
    }
}

impl OpenSides {
    /// Vertices at the same position count as one, so that triangles without a common vertex are also joined.
    pub(super) fn new(mesh: &TriMesh) -> Self {
        let mut order: Vec<_> = mesh.positions.enumerate().map(|(v, p)| (bits(p.to_array()), v)).collect();
        order.sort_unstable();
        let mut first = vec![order[0].1; order.len()];
        for same in order.chunk_by(|a, b| a.0 == b.0) {
            same.iter().for_each(|(_, v)| first[v.index()] = same[0].1);
        }
        let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|v| first[v.index()]);
            edges.extend([[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]));
        }
        edges.sort_unstable();
        let open =
            edges.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1 && same[0][0] != same[0][1]);
        let mut open: Vec<[DVec3; 2]> = open.map(|same| same[0].map(|v| mesh.positions[v])).collect();
        // A search tests all groups, and all edges in some of them.
        let most = (open.len() as f64).sqrt().max(16.0) / 2.0;
        let mut groups = Vec::new();
        if !open.is_empty() {
            group(&mut open, most, &mut groups);
        }
        Self(groups)
    }

    /// Whether certainly none of them meets a hull.
    ///
    /// The hull lies in each of three convex bodies around its axis: a cylinder, and two cones with the tips
    /// `tip` and the end. An edge is off the hull if it is off one of them: if a plane, along which the
    /// radius of the body is linear, separates it.
    pub(super) fn are_off(&self, hull: &Hull) -> bool {
        let &Hull { tip, axis, length, from, to, radius } = hull;
        let (bottom, top) = (from.min(0.0), to.max(length));
        let cone = |run: f64, beyond: f64| {
            if run > REGION_ROUNDING { radius * beyond / run + REGION_ROUNDING } else { f64::INFINITY }
        };
        self.0.iter().all(|group| {
            let offset = group.centre - tip;
            let along = offset.dot(axis);
            let beside = (offset - axis * along).length();
            let r = group.radius;
            let is_off = along + r < bottom || along - r > top || beside > r + radius;
            is_off
                || group.edges.iter().all(|edge| {
                    let offsets = edge.map(|p| p - tip);
                    let along = offsets.map(|x| x.dot(axis));
                    if along[0].max(along[1]) < bottom || along[0].min(along[1]) > top {
                        return true;
                    }
                    // The direction from the axis to the nearest point of the edge, projected along the axis.
                    let beside = [0, 1].map(|k| offsets[k] - axis * along[k]);
                    let side = beside[1] - beside[0];
                    let t =
                        (-beside[0].dot(side) / side.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                    let out = (beside[0] + side * t).normalize_or_zero();
                    let far = beside.map(|x| out.dot(x));
                    let off = |body: &dyn Fn(f64) -> f64| (0..2).all(|k| far[k] > body(along[k]));
                    out != DVec3::ZERO
                        && (off(&|_| radius)
                            || off(&|along| cone(from - bottom, along - bottom))
                            || off(&|along| cone(top - to, top - along)))
                })
        })
    }
}

/// Halves groups of edges along the longest side of their box until each has at most `most`.
fn group(edges: &mut [[DVec3; 2]], most: f64, groups: &mut Vec<Group>) {
    let ends = || edges.iter().flatten();
    let lo = ends().fold(DVec3::INFINITY, |a, b| a.min(*b));
    let hi = ends().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b));
    if edges.len() as f64 <= most {
        let centre = lo.midpoint(hi);
        let radius = ends().map(|p| p.distance(centre)).fold(0.0, f64::max) * (1.0 + REGION_ROUNDING)
            + REGION_ROUNDING;
        groups.push(Group { centre, radius, edges: edges.to_vec() });
        return;
    }
    let axis = (hi - lo).max_position();
    edges.sort_by(|x, y| (x[0] + x[1])[axis].total_cmp(&(y[0] + y[1])[axis]));
    let (first, second) = edges.split_at_mut(edges.len() / 2);
    group(first, most, groups);
    group(second, most, groups);
}
