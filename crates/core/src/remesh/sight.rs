//! What can be seen of a link from far away: rays from points of its surface.

use glam::DVec3;

use crate::bvh::{BvhError, Ray, TriangleTree};
use crate::skin::Sheet;

/// Directions from which a point of a surface is viewed from far away.
const DIRECTIONS: u32 = 32;

/// Directions at a smaller angle to the surface are not tried: the cosine of 84 degrees.
const MIN_COSINE: f64 = 0.1;

/// A point is seen if this share of the directions on one of its sides is free. *Heuristic*: it is a tenth
/// in the middle of a tube twice as long as wide, a third at the bottom of a pocket as deep as wide.
const MIN_FREE_SHARE: f64 = 0.25;

/// Distance of the start of rays from the surface, over the size of the link.
const RAY_OFFSET: f64 = 1e-5;

/// How a point, or a face, is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct View {
    pub(super) is_seen: bool,
    /// The share of free directions, among those that decided.
    pub(super) free: f64,
}

/// All triangles of a link.
pub(super) struct Sight {
    positions: Vec<DVec3>,
    tree: TriangleTree,
    /// The diagonal of its box, in m.
    pub(super) size: f64,
    directions: Vec<DVec3>,
}

impl Sight {
    /// # Errors
    /// If there is nothing to search, or it is too far away.
    pub(super) fn new<'a>(sheets: impl Iterator<Item = &'a Sheet>) -> Result<Self, BvhError> {
        let mut positions = Vec::new();
        for (sheet, triangle) in sheets.flat_map(|sheet| sheet.triangles.iter().map(move |t| (sheet, t))) {
            positions.extend(corners(sheet, triangle).into_iter().flatten());
        }
        let triangles = (0..u32::try_from(positions.len() / 3).unwrap_or(u32::MAX)).map(of_triangle);
        let tree = TriangleTree::new(&positions, triangles)?;
        let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let size = low.distance(positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max));
        Ok(Self { positions, tree, size, directions: directions() })
    }

    /// How a point is seen from far away, on the side of its face where it is seen better.
    pub(super) fn view(&self, point: DVec3, normal: DVec3, blockers: &mut Blockers) -> View {
        let front = self.view_of_side(point, normal, blockers);
        if front.is_seen {
            return front;
        }
        let back = self.view_of_side(point, -normal, blockers);
        if back.is_seen || back.free > front.free { back } else { front }
    }

    fn view_of_side(&self, point: DVec3, normal: DVec3, blockers: &mut Blockers) -> View {
        let start = point + normal * (RAY_OFFSET * self.size);
        let is_above = |direction: &DVec3| direction.dot(normal) > MIN_COSINE;
        let all = self.directions.iter().map(|d| u32::from(is_above(d))).sum::<u32>();
        let needed = MIN_FREE_SHARE * f64::from(all);
        let (mut free, mut tried) = (0_u32, 0_u32);
        // Stops once enough directions are free, or too few can be, or of the first half, which is spread evenly, none is.
        for (&direction, blocker) in self.directions.iter().zip(&mut blockers.0).filter(|(d, _)| is_above(d))
        {
            let corners = |face| of_triangle(face).map(|v| self.positions[v as usize]);
            let ray = Ray::new(start, direction, 2.0 * self.size);
            let met = ray.and_then(|ray| self.tree.any_hit(&ray, *blocker, corners));
            *blocker = met.or(*blocker);
            (free, tried) = (free + u32::from(met.is_none()), tried + 1);
            let most = f64::from(free + all - tried);
            let is_dark = free == 0 && 2 * tried >= all;
            if f64::from(free) >= needed || most < needed || is_dark {
                break;
            }
        }
        View {
            is_seen: all > 0 && f64::from(free) >= needed,
            free: f64::from(free) / f64::from(tried.max(1)),
        }
    }
}

/// The triangle that last blocked each direction, which often blocks it for the next point, too. No answer depends on it.
#[derive(Clone, Default)]
pub(super) struct Blockers([Option<u32>; DIRECTIONS as usize]);

/// Each triangle has corners of its own.
fn of_triangle(face: u32) -> [u32; 3] {
    [3 * face, 3 * face + 1, 3 * face + 2]
}

/// The corners of a triangle, if all exist and are finite.
pub(super) fn corners(sheet: &Sheet, triangle: &[u32; 3]) -> Option<[DVec3; 3]> {
    let [a, b, c] = triangle.map(|v| sheet.positions.get(v as usize).copied().filter(|p| p.is_finite()));
    Some([a?, b?, c?])
}

/// Evenly distributed directions: a Fibonacci spiral on the sphere, in an order in which the first few are spread evenly, too.
fn directions() -> Vec<DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let direction = |k: u32| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(DIRECTIONS);
        let (sin, cos) = (golden * f64::from(k)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    };
    (0..DIRECTIONS).map(|k| direction(k.reverse_bits() / (u32::MAX / DIRECTIONS + 1))).collect()
}
