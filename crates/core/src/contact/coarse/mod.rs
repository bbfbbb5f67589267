//! [`Octree`]: the distance from the skin of one link, with guaranteed bounds, in constant time.
//!
//! An octree divides the space around the rigid patches of a link. A cell stores two *empty balls*, whose
//! inside contains no skin, and a face of level 0 near it. With `S` the skin, `d(q)` the distance of a
//! contact `q` from it, and a ball `(m, r)` empty if `d(m) >= r`:
//!
//! 1. Below: `d(q) >= r - |q - m|` for every `q` and every empty ball, since `d` changes no faster than its point moves.
//! 2. Above: `d(q) <= |q - x|` for every point `x` of `S`.
//! 3. Between: let `(a, ra)` and `(b, rb)` be empty. If the segment `ab` crosses `S` an odd number of times and no open side
//!    (an edge with an odd number of faces) meets the hull of `q`, `a` and `b`, then `d(q) <= max(|q - a| - ra, |q - b| - rb)`.
//!    *Proof.* Modulo 2, the part of `S` in the triangle `qab` is a chain of curves that ends on the border of the triangle
//!    alone, as no open side meets it. So `S` crosses the border an even number of times, and `qa` or `qb` at least once, say
//!    `qa` in `y`. As `|y - a| >= ra`, `d(q) <= |q - y| <= |q - a| - ra`. Where the triangle touches vertices or edges of
//!    `S`, the bound follows from neighbouring triangles by continuity.
//!    If `q` lies in the ball `a`, then `qa` is not crossed, and `d(q) <= |q - b| - rb`; so `a` may also be the largest empty
//!    ball around the centre of the cell, which is not stored.
//!
//! The bounds are tight if balls touch the skin at the point below the cell: with its centre at the distance
//! `R` from the contact, a ball loosens the bound by `t^2 / 2R` at a lateral distance `t` from that point.
//! The conditions of 3 are verified when the octree is built (`grow`, `open_sides`), for all contacts of the
//! cell at once. Cells where they fail, mainly at the rims of open patches, bound the distance from above by
//! the nearest point of their face (2).
//!
//! Radii are measured from centres that are rounded to `f32` and are rounded down, so rounding only widens the interval.

mod grow;
mod open_sides;
pub(in crate::contact) mod skins;

use glam::{DVec3, Vec3};

use crate::bvh::Aabb;
use crate::mesh::triangle_cross;

/// Bit of a node that is a leaf; its other bits are the index of the leaf.
const LEAF: u32 = 1 << 31;

/// Binary digits of the position in a cell of the top grid: more than the depth of the octree.
const DIGITS: u32 = 20;

/// The data of a cell, in m from the centre of the grid. Small, since the time of an answer is that of
/// loading it from memory.
#[derive(Debug, Clone, Copy)]
struct Record {
    /// Two empty balls: centre and radius. The first is on the cell's side of the skin.
    balls: [([f32; 3], f32); 2],
    /// A point of the skin.
    touch: [f32; 3],
}

/// A cell that is not divided. Neighbouring cells may share a record.
#[derive(Debug, Clone, Copy)]
struct Leaf {
    record: u32,
    /// A face near the cell, and two flags.
    face: u32,
}

impl Leaf {
    /// The balls also bound the distance from above (statement 3).
    const CERTIFIED: u32 = 1 << 31;
    /// The first ball is outside the skin.
    const OUTSIDE: u32 = 1 << 30;

    fn face(self) -> u32 {
        self.face & !(Self::CERTIFIED | Self::OUTSIDE)
    }
}

impl Record {
    /// How far a point is outside each ball; negative inside.
    #[inline(always)]
    fn excess(&self, q: DVec3) -> [f64; 2] {
        self.balls.map(|(centre, radius)| q.distance(wide(centre)) - f64::from(radius))
    }

    /// A lower bound of the distance of the skin from a point that is this far outside each ball.
    #[inline(always)]
    fn least([a, b]: [f64; 2]) -> f64 {
        (-a).max(-b).max(0.0)
    }

    /// An upper bound of the distance of the skin from a point of a certified cell.
    #[inline(always)]
    fn most(&self, q: DVec3, [a, b]: [f64; 2]) -> f64 {
        a.max(b).min(q.distance(wide(self.touch)))
    }
}

#[inline(always)]
fn wide(x: [f32; 3]) -> DVec3 {
    Vec3::from_array(x).as_dvec3()
}

/// The octree of a link.
#[derive(Debug, Clone)]
pub(in crate::contact) struct Octree {
    /// The box of the skin, and the centre of the grid, in m in the frame of the link. The other members are
    /// relative to the centre.
    bounds: Aabb,
    centre: DVec3,
    /// The least corner of the grid of top cells, their number, and their number per metre.
    lo: DVec3,
    dims: [u32; 3],
    per_metre: f64,
    /// The top cells, x first, and the eight children of each divided one: the index of the first child, or a leaf.
    nodes: Vec<u32>,
    leaves: Vec<Leaf>,
    records: Vec<Record>,
    /// Largest change of a distance by the rounding of `Record::touch`, in m.
    slack: f64,
}

/// The answer of an octree for a point.
#[derive(Debug, Clone, Copy)]
pub(in crate::contact) struct Interval {
    /// The index of a face near it.
    pub(in crate::contact) face: u32,
    /// Lower and upper bound of the distance of the skin, in m.
    pub(in crate::contact) least: f64,
    pub(in crate::contact) most: f64,
    /// Whether it is outside.
    pub(in crate::contact) is_outside: bool,
}

impl Interval {
    pub(in crate::contact) const UNKNOWN: Self =
        Self { face: 0, least: f64::INFINITY, most: f64::INFINITY, is_outside: true };
}

/// The distance of a point from the nearest point of a triangle, up to rounding, but always to a point of it:
/// cheaper than [`closest_point`](crate::mesh::closest_point), which also determines features.
#[inline(always)]
fn near_point(q: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac, aq) = (b - a, c - a, q - a);
    let (bb, bc, cc) = (ab.length_squared(), ab.dot(ac), ac.length_squared());
    let (qb, qc) = (aq.dot(ab), aq.dot(ac));
    let area = bb * cc - bc * bc;
    let (s, t) = (cc * qb - bc * qc, bb * qc - bc * qb);
    if s >= 0.0 && t >= 0.0 && s + t <= area && area > 0.0 {
        let (s, t) = (s / area, t / area);
        return (aq - ab * s - ac * t).length();
    }
    // The minimum ignores sides without length, whose parameter is NaN.
    let side = |from: DVec3, along: DVec3, dot: f64, squared: f64| {
        (from - along * (dot / squared).clamp(0.0, 1.0)).length_squared()
    };
    let (bq, side_bc) = (q - b, c - b);
    let sides = side(aq, ab, qb, bb).min(side(aq, ac, qc, cc));
    let third = side(bq, side_bc, bq.dot(side_bc), side_bc.length_squared());
    aq.length_squared().min(sides).min(third).sqrt()
}

impl Octree {
    /// Most divisions of a cell of the top grid.
    pub(in crate::contact) const MOST_DEPTH: u32 = DIGITS - 1;

    /// The interval of a point (m, in the frame of the link); `corners` gives those of a face.
    #[inline(always)]
    pub(in crate::contact) fn interval(&self, q: DVec3, corners: impl FnOnce(u32) -> [DVec3; 3]) -> Interval {
        let local = q - self.centre;
        let (leaf, is_inside) = self.leaf(local);
        let record = &self.records[leaf.record as usize];
        let (face, excess) = (leaf.face(), record.excess(local));
        let least = Record::least(excess);
        if is_inside && leaf.face & Leaf::CERTIFIED != 0 {
            let most = record.most(local, excess) + self.slack;
            let is_outside = (leaf.face & Leaf::OUTSIDE != 0) == (excess[0] <= excess[1]);
            return Interval { face, least, most, is_outside };
        }
        // Beyond the grid the bounds of balls are loose.
        let least = if is_inside { least } else { least.max(self.bounds.least_distance(q)) };
        let corners = corners(face);
        let is_outside = triangle_cross(corners).dot(q - corners[0]) >= 0.0;
        Interval { face, least, most: near_point(q, corners) + self.slack, is_outside }
    }

    /// The leaf of the cell of a point, or of the nearest cell if the point is outside the grid; and whether it is inside.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
    fn leaf(&self, q: DVec3) -> (Leaf, bool) {
        let at = (q - self.lo) * self.per_metre;
        let [nx, ny, _] = self.dims;
        let end = DVec3::from_array(self.dims.map(f64::from));
        let is_inside = at.cmpge(DVec3::ZERO).all() & at.cmplt(end).all();
        let at = at.clamp(DVec3::ZERO, end - 1e-9) * f64::from(1 << DIGITS);
        let [x, y, z] = at.to_array().map(|x| x as u32);
        let top = ((z >> DIGITS) * ny + (y >> DIGITS)) * nx + (x >> DIGITS);
        let (mut node, mut digit) = (self.nodes[top as usize], DIGITS);
        while node & LEAF == 0 {
            digit -= 1;
            let part = (x >> digit & 1) | (y >> digit & 1) << 1 | (z >> digit & 1) << 2;
            node = self.nodes[(node + part) as usize];
        }
        (self.leaves[(node & !LEAF) as usize], is_inside)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::bvh::Start;
    use crate::contact::patch_bvh::{Best, PatchBvh};
    use crate::id::FaceId;
    use crate::mesh::{TriMesh, shapes};
    use crate::numeric::Random;
    use crate::skin::PatchId;

    /// How many of `count` contacts, near the skin and up to 30 mm beyond the octree, are at a distance
    /// outside their interval.
    fn violations(mesh: &TriMesh, count: usize) -> usize {
        let skin = PatchBvh::new("odd", mesh).unwrap();
        let octree = Octree::new(&skin);
        assert!(octree.bytes() <= (50 * mesh.triangles.len()).max(512 << 10), "{} bytes", octree.bytes());
        let bounds = skin.bounds();
        let mut random = Random::new(4, 0);
        let mut is_wrong = |k: usize| {
            let mut unit = || DVec3::new(random.uniform(), random.uniform(), random.uniform());
            let q = if k.is_multiple_of(3) {
                bounds.lo - 0.08 + (bounds.hi - bounds.lo + 0.16) * unit()
            } else {
                let weights = unit();
                let spread = (unit() - 0.5) * if k % 3 == 1 { 0.004 } else { 0.04 * weights.x };
                let [a, b, c] = mesh.corners(FaceId::new(random.below(mesh.triangles.len())));
                (a * weights.x + b * weights.y + c * weights.z) / weights.element_sum() + spread
            };
            let mut best = None;
            skin.nearest(PatchId::new(0), q, Start::Root, &mut best);
            let away = Best::squared(best.as_ref()).sqrt();
            let found = octree.interval(q, |face| mesh.corners(FaceId::from(face)));
            away < found.least - 1e-12 || away > found.most + 1e-12
        };
        (0..count).filter(|&k| is_wrong(k)).count()
    }

    /// A one-sided strip of `around` times `across` squares.
    fn moebius_strip(around: u32, across: u32) -> TriMesh {
        let at = |i: u32, j: u32| {
            let (angle, v) =
                (f64::from(i) / f64::from(around) * TAU, (f64::from(j) / f64::from(across) - 0.5) * 0.04);
            let radius = 0.07 + v * (angle / 2.0).cos();
            DVec3::new(radius * angle.cos(), radius * angle.sin(), v * (angle / 2.0).sin())
        };
        let positions = (0..around).flat_map(|i| (0..=across).map(move |j| at(i, j))).collect();
        let id = |i: u32, j: u32| if i < around { i * (across + 1) + j } else { across - j };
        let square = |(i, j): (u32, u32)| {
            let [a, b, c, d] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        let squares = (0..around).flat_map(|i| (0..across).map(move |j| (i, j)));
        TriMesh::from_arrays(positions, &squares.flat_map(square).collect::<Vec<_>>())
    }

    fn odd_meshes() -> Vec<(&'static str, TriMesh)> {
        let mut random = Random::new(9, 0);
        let raw = |mesh: &TriMesh| mesh.triangles.iter().map(|t| t.map(|v| v.raw())).collect::<Vec<_>>();
        let cap = shapes::cap(4000, 0.08, 1.9);
        let (positions, faces) = (cap.positions.as_slice().to_vec(), raw(&cap));
        let soup: Vec<DVec3> = (0..300)
            .flat_map(|_| {
                let centre = random.vector(0.06);
                [(); 3].map(|()| centre + random.vector(0.008))
            })
            .collect();
        let triples: Vec<[u32; 3]> = (0..300).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let both = faces.iter().flat_map(|&[a, b, c]| [[a, b, c], [a, c, b]]).collect::<Vec<_>>();
        let some: Vec<[u32; 3]> = faces.iter().copied().filter(|_| random.below(3) > 0).collect();
        let count = u32::try_from(positions.len()).unwrap();
        let inner = positions.iter().map(|p| *p * 0.985);
        let nested = positions.iter().copied().chain(inner).collect();
        let shifted = faces.iter().map(|t| t.map(|v| v + count));
        // Three sheets that meet on a line, with faces that are points, lines and doubled.
        let fan = |k: u32| {
            shapes::lattice(20, 20, 0.005).positions.map(|p| {
                let angle = 2.0 * f64::from(k);
                DVec3::new(p.x * angle.cos(), p.x * angle.sin(), p.y)
            })
        };
        let lattice = shapes::lattice(20, 20, 0.005);
        let sheet = u32::try_from(lattice.positions.len()).unwrap();
        let sheets: Vec<DVec3> = (0..3).flat_map(|k| fan(k).as_slice().to_vec()).collect();
        let mut sheet_faces: Vec<[u32; 3]> =
            (0..3).flat_map(|k| raw(&lattice).into_iter().map(move |t| t.map(|v| v + k * sheet))).collect();
        sheet_faces.extend((0..60).map(|k| [[k, k, k], [k, k + 1, k + 2], [k, k + 1, k]][k as usize % 3]));
        let needles: Vec<DVec3> =
            soup.chunks(3).flat_map(|t| [t[0], t[1], t[0].lerp(t[1], 0.4) + (t[2] - t[0]) * 1e-7]).collect();
        vec![
            ("soup", TriMesh::from_arrays(soup.clone(), &triples)),
            ("needles", TriMesh::from_arrays(needles, &triples)),
            ("a point", TriMesh::from_arrays(vec![DVec3::ONE; 3], &[[0, 1, 2]])),
            ("one triangle", shapes::triangle()),
            ("faces twice", TriMesh::from_arrays(positions.clone(), &both)),
            ("a third of the faces missing", TriMesh::from_arrays(positions.clone(), &some)),
            (
                "nested caps",
                TriMesh::from_arrays(nested, &faces.iter().copied().chain(shifted).collect::<Vec<_>>()),
            ),
            ("far from its origin", TriMesh { positions: cap.positions.map(|p| *p + 1e3), ..cap.clone() }),
            ("of 8 m", TriMesh { positions: cap.positions.map(|p| *p * 50.0), ..cap.clone() }),
            ("of 2 mm", TriMesh { positions: cap.positions.map(|p| *p * 0.0125), ..cap.clone() }),
            ("moebius strip", moebius_strip(160, 8)),
            ("three sheets on a line", TriMesh::from_arrays(sheets, &sheet_faces)),
            ("torus", shapes::torus(60, 30, 0.05, 0.012)),
            ("tube", shapes::tube(80, 60, 0.03, 0.15)),
            ("ball", shapes::ball(4, 0.06)),
        ]
    }

    #[test]
    fn intervals_contain_the_distance_on_odd_meshes() {
        for (name, mesh) in odd_meshes() {
            assert_eq!(violations(&mesh, 20_000), 0, "{name}");
        }
    }

    #[test]
    #[ignore = "takes minutes"]
    fn a_million_intervals_contain_the_distance_on_odd_meshes() {
        for (name, mesh) in odd_meshes() {
            assert_eq!(violations(&mesh, 1_000_000), 0, "{name}");
        }
    }

    #[test]
    fn octrees_are_the_same_with_any_number_of_threads() {
        let skin = PatchBvh::new("tube", &shapes::tube(80, 60, 0.03, 0.15)).unwrap();
        let [one, two] = [1, 2].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| format!("{:?}", Octree::new(&skin)))
        });
        assert!(one == two && one.len() > 10_000);
    }
}
