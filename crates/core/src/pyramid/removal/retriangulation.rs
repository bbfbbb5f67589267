//! Fills the star of a removed vertex with triangles: a fan where it is nearly as good as the best
//! filling.

use crate::delaunay::smallest_first;
use crate::mesh::{HalfedgeMesh, MAX_RING, diagonals, triangle_cross};
use crate::pyramid::removal::star::{Limits, Star, folds_over, small, squared_sine};

/// A filling triangle has at least this double area on the flattened star, in squares of its
/// longest side on the skin: below, the weights of a point in it would be rounding noise.
const MIN_FLAT_AREA: f64 = 1e-9;

/// A fan is used if the sine of its smallest angle is at least this share of that of the best filling. On a
/// map a fan can always be undone; 0.6 makes 96 to 99 of 100 fillings fans and costs less than a degree of
/// the mean smallest angle of a level (0.8: 85 to 95 of 100).
const FAN_SHARE: f64 = 0.6;

/// Quality of a triangle that must not be used.
const REFUSED: f64 = -1.0;

/// Finds the triangles that fill a star; buffers are reused from star to star.
#[derive(Debug, Clone, Default)]
pub(super) struct Filler {
    /// Triangles of ring positions, ascending, which is counter-clockwise.
    pub(super) triangles: Vec<[u8; 3]>,
    /// Diagonals that must not be used.
    forbidden: Vec<[usize; 2]>,
    /// Quality of the best filling of the ring positions `i..=j`, and its position `k`, at `i n + j`.
    best: Vec<(f64, usize)>,
    stack: Vec<(usize, usize)>,
}

impl Filler {
    /// Fills `star`, without edges that exist elsewhere and without folds; `false` if that is not possible.
    pub(super) fn fill(&mut self, star: &Star, surface: &HalfedgeMesh, limits: &Limits) -> bool {
        self.forbidden.clear();
        if !self.optimise(star, limits) {
            return false;
        }
        let count = star.ring.len();
        let exists = |&[i, j]: &[usize; 2]| surface.has_edge(star.ring[i], star.ring[j]);
        if diagonals(&self.triangles, count).any(|d| exists(&d)) {
            // Rare, so all diagonals are tested only now; the filling is then found without those that exist.
            let all = (0..count).flat_map(|i| (i + 2..count).map(move |j| [i, j]));
            self.forbidden.extend(all.filter(|d| *d != [0, count - 1] && exists(d)));
            if !self.optimise(star, limits) {
                return false;
            }
        }
        !self.folds(star)
    }

    /// Chooses the best fan if it is nearly as good as the best filling, else the filling; `false` if all are
    /// refused.
    fn optimise(&mut self, star: &Star, limits: &Limits) -> bool {
        let n = star.ring.len();
        let (fan, apex, bound) = self.best_fan(star, limits);
        let share = FAN_SHARE * FAN_SHARE;
        // Up to five neighbours every filling is a fan; else the bound usually shows that no filling is much
        // better.
        let best = if n <= 5 || fan >= share * bound { fan } else { self.best_filling(star, limits) };
        if best <= 0.0 {
            return false;
        }
        self.triangles.clear();
        if fan >= share * best {
            let triangle = |step: usize| smallest_first([apex, (apex + step) % n, (apex + step + 1) % n]);
            self.triangles.extend((1..n - 1).map(|step| triangle(step).map(small)));
            return true;
        }
        self.stack.clear();
        self.stack.push((0, n - 1));
        while let Some((i, j)) = self.stack.pop() {
            if j > i + 1 {
                let k = self.best[i * n + j].1;
                self.triangles.push([i, k, j].map(small));
                self.stack.extend([(i, k), (k, j)]);
            }
        }
        true
    }

    /// Quality and apex of the fan whose worst triangle is best, and an upper bound for all fillings: each
    /// has a triangle on every side of the ring, and every such triangle is also in a fan.
    fn best_fan(&self, star: &Star, limits: &Limits) -> (f64, usize, f64) {
        let n = star.ring.len();
        let mut best_on_side = [REFUSED; MAX_RING];
        let mut fan = (REFUSED, 0);
        for apex in 0..n {
            let mut worst = f64::INFINITY;
            let mut from = (apex + 1) % n;
            for _ in 1..n - 1 {
                let to = if from + 1 == n { 0 } else { from + 1 };
                let quality = self.quality(star, limits, smallest_first([apex, from, to]));
                worst = worst.min(quality);
                best_on_side[from] = best_on_side[from].max(quality);
                from = to;
            }
            if worst > fan.0 {
                fan = (worst, apex);
            }
        }
        (fan.0, fan.1, best_on_side[..n].iter().copied().fold(f64::INFINITY, f64::min))
    }

    /// The filling whose worst triangle is best, by dynamic programming over the polygons that one
    /// diagonal cuts off (`(klincsek1980)`); returns its quality.
    fn best_filling(&mut self, star: &Star, limits: &Limits) -> f64 {
        let n = star.ring.len();
        self.best.clear();
        self.best.resize(n * n, (REFUSED, 0));
        for i in 0..n - 1 {
            self.best[i * n + i + 1].0 = f64::INFINITY;
        }
        for span in 2..n {
            for i in 0..n - span {
                let j = i + span;
                let mut best = (REFUSED, 0);
                for k in i + 1..j {
                    let parts = self.best[i * n + k].0.min(self.best[k * n + j].0);
                    if parts > best.0 {
                        let worst = parts.min(self.quality(star, limits, [i, k, j]));
                        if worst > best.0 {
                            best = (worst, k);
                        }
                    }
                }
                self.best[i * n + j] = best;
            }
        }
        self.best[n - 1].0
    }

    fn quality(&self, star: &Star, limits: &Limits, [i, k, j]: [usize; 3]) -> f64 {
        let used = |d: &[usize; 2]| [[i, k], [k, j], [i, j]].contains(d);
        if self.forbidden.iter().any(used) { REFUSED } else { quality(star, limits, [i, k, j]) }
    }

    /// Whether two of the filling's triangles that share a diagonal turn away from each other.
    fn folds(&self, star: &Star) -> bool {
        let cross = |t: [u8; 3]| triangle_cross(t.map(|i| star.offsets[usize::from(i)]));
        self.triangles.iter().any(|&above| {
            let [i, k, j] = above;
            let below = self.triangles.iter().filter(|t| [(i, k), (k, j)].contains(&(t[0], t[2])));
            below.copied().any(|t| folds_over(cross(above), cross(t)))
        })
    }
}

/// Squared sine of the smallest angle of a triangle on the skin, or a refusal if it is inverted on
/// the flattened star, lower than allowed, turned away from the star's normal, or folded over a face beyond the ring.
fn quality(star: &Star, limits: &Limits, [i, k, j]: [usize; 3]) -> f64 {
    let (a, b, c) = (star.offsets[i], star.offsets[k], star.offsets[j]);
    let cross = triangle_cross([a, b, c]);
    let squared = cross.length_squared();
    let along = cross.dot(star.normal);
    let least = limits.min_cos_turn.powi(2) * squared * star.normal.length_squared();
    // Written so that NaN refuses.
    let turns = !(along > 0.0 && along * along >= least);
    let [x, y, z] = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
    let flat = (star.flat[k] - star.flat[i]).perp_dot(star.flat[j] - star.flat[i]);
    if turns || flat <= MIN_FLAT_AREA * x.max(y).max(z) {
        return REFUSED;
    }
    let sine = squared_sine(cross, [x, y, z]);
    if sine.is_nan() || sine < limits.min_squared_sine.min(star.squared_sine) {
        return REFUSED;
    }
    let folds = (k == i + 1 && folds_over(cross, star.beyond[i]))
        || (j == k + 1 && folds_over(cross, star.beyond[k]))
        || (i == 0 && j + 1 == star.ring.len() && folds_over(cross, star.beyond[j]));
    if folds { REFUSED } else { sine }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use glam::DVec3;

    use super::*;
    use crate::id::VertexId;
    use crate::mesh::{TriMesh, shapes};

    const LIMITS: Limits = Limits { min_cos_turn: 0.5, max_sagitta: 0.35, min_squared_sine: 1e-4 };

    /// A vertex at the origin whose neighbours lie around it at these distances.
    fn wheel(radii: &[f64]) -> TriMesh {
        let mut mesh = shapes::fan(u32::try_from(radii.len()).unwrap());
        for (p, r) in mesh.positions.iter_mut().skip(1).zip(radii) {
            *p *= *r;
        }
        mesh
    }

    fn fill(mesh: &TriMesh) -> Option<(Star, Vec<[u8; 3]>)> {
        let (surface, _) = HalfedgeMesh::new(mesh).unwrap();
        let (mut star, mut filler) = (Star::default(), Filler::default());
        let fits = star.gather(&surface, &mesh.positions, VertexId::new(0), &LIMITS)
            && filler.fill(&star, &surface, &LIMITS);
        fits.then_some((star, filler.triangles))
    }

    /// Fillings cover the polygon of the ring once.
    #[test]
    fn a_filling_has_the_area_of_its_star() {
        for radii in
            [&[1.0; 3][..], &[1.0; 4], &[1.0; 7], &[1.0, 2.0, 1.0, 1.5, 1.0, 0.8, 1.0, 2.0, 1.0], &[1.0; 32]]
        {
            let mesh = wheel(radii);
            let (star, triangles) = fill(&mesh).unwrap();
            let area = |t: &[u8; 3]| {
                let [a, b, c] = t.map(|i| star.flat[usize::from(i)]);
                0.5 * (b - a).perp_dot(c - a)
            };
            assert!(triangles.iter().all(|t| area(t) > 0.0), "no triangle is inverted");
            let filled: f64 = triangles.iter().map(area).sum();
            assert!((filled - mesh.area()).abs() < 1e-12, "{filled} of {}", mesh.area());
            assert_eq!(triangles.len(), radii.len() - 2);
            assert_eq!(diagonals(&triangles, radii.len()).count(), radii.len() - 3);
        }
    }

    /// Of the two diagonals of a kite the short one gives the larger angles.
    #[test]
    fn fillings_maximise_the_smallest_angle() {
        let (star, triangles) = fill(&wheel(&[3.0, 1.0, 3.0, 1.0])).unwrap();
        let [i, j] = diagonals(&triangles, 4).next().unwrap();
        assert!((star.flat[i] - star.flat[j]).length() < 2.1, "the diagonal from {i} to {j}");
    }

    /// A spike's neighbours lie on a circle, so its filling faces along the spike, away from all of
    /// its star's faces.
    #[test]
    fn fillings_must_face_the_direction_of_their_star() {
        let mut pleated = wheel(&[1.0; 8]);
        for (i, p) in pleated.positions.iter_mut().skip(1).enumerate() {
            p.z = if i % 2 == 0 { 4.0 } else { -4.0 };
        }
        assert!(fill(&pleated).is_none(), "a ruff has no smooth filling");
    }

    #[test]
    fn boundary_vertices_are_removed_but_not_at_corners() {
        let half = |turn: f64| {
            // A boundary vertex at the origin whose boundary turns by `turn`.
            let ring = (0..4).map(|i| {
                let (sin, cos) = ((TAU / 2.0 - turn) * f64::from(i) / 3.0).sin_cos();
                DVec3::new(cos, sin, 0.0)
            });
            let positions = std::iter::once(DVec3::ZERO).chain(ring).collect();
            TriMesh::from_arrays(positions, &[[0, 1, 2], [0, 2, 3], [0, 3, 4]])
        };
        assert!(fill(&half(0.5)).is_some(), "nearly straight");
        assert!(fill(&half(TAU / 4.0)).is_none(), "a right angle");
    }
}
