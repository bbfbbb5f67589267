//! The simulated sensor: taxels on the bottom of a sphere, as on the end effector of the source paper's
//! experiment; and which of them are mistaken for others nearby.

use std::{collections::HashMap, ops::RangeInclusive};

use glam::{DMat3, DQuat, DVec2, DVec3, IVec3};

use crate::calib::{CalibError, Pose};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::numeric::Random;
use crate::run::{Cancelled, Run};

/// The centre of the disc of lattice points, in spacings: on no symmetry axis, so that no two points are
/// equally far.
const CENTRE: DVec2 = DVec2::new(0.13, 0.07);

/// How far from the south pole taxels may be, in radii: nearer to the north pole the lattice is torn apart.
const LARGEST_REACH: f64 = 1.9;

/// Accepted lengths of a skin, in m.
const LENGTHS: RangeInclusive<f64> = 1e-6..=1e3;

/// Taxels on the bottom of a sphere.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SensorLayout {
    /// Taxel frames: z is the outward normal, x the lattice direction.
    pub(crate) frames: IdVec<VertexId, Pose>,
    /// Pairs of lattice neighbours, ascending.
    pub(super) edges: Vec<[VertexId; 2]>,
    /// The triangles between them, seen from outside.
    pub(super) triangles: IdVec<FaceId, [VertexId; 3]>,
}

impl SensorLayout {
    /// The `taxels` points of a triangular lattice nearest to a point off its symmetries, lifted to
    /// the sphere by the Lambert equal-area projection about the south pole, which keeps their
    /// density. Lengths in m.
    /// Fails unless lengths are positive and the taxels fit on the sphere.
    pub(crate) fn new(taxels: usize, spacing: f64, radius: f64) -> Result<Self, CalibError> {
        check(taxels, spacing, radius)?;
        let (cells, plane) = lattice(taxels);
        let reach = plane.iter().map(|p| p.length()).fold(0.0, f64::max) * spacing;
        if reach > LARGEST_REACH * radius {
            let needed = "fewer taxels, a smaller spacing or a larger sphere";
            return Err(CalibError::BadOption {
                option: "the number of taxels",
                found: taxels as f64,
                needed,
            });
        }
        let frames: IdVec<VertexId, Pose> =
            plane.iter().map(|&p| frame(lift(p * spacing, radius), radius)).collect();
        let index: HashMap<(i32, i32), VertexId> =
            cells.iter().enumerate().map(|(k, &cell)| (cell, VertexId::new(k))).collect();
        let mut edges = Vec::with_capacity(3 * taxels);
        let mut triangles = IdVec::default();
        for (k, &(a, b)) in cells.iter().enumerate() {
            let here = VertexId::new(k);
            let at = |da: i32, db: i32| index.get(&(a + da, b + db)).copied();
            for other in [at(1, 0), at(0, 1), at(-1, 1)].into_iter().flatten() {
                edges.push([here.min(other), here.max(other)]);
            }
            // Counter-clockwise in the plane is clockwise from below.
            if let (Some(u), Some(v)) = (at(1, 0), at(0, 1)) {
                triangles.push([here, v, u]);
            }
            if let (Some(u), Some(w)) = (at(1, 0), at(1, -1)) {
                triangles.push([here, u, w]);
            }
        }
        edges.sort_unstable();
        Ok(Self { frames, edges, triangles })
    }

    /// `count` taxels far from each other: the lowest, then always the one farthest from those
    /// chosen.
    pub(super) fn spread(&self, count: usize, run: Run<'_>) -> Result<Vec<VertexId>, Cancelled> {
        if count == self.frames.len() {
            return Ok(self.frames.ids().collect());
        }
        let height = |v: &VertexId| self.frames[*v].position.z;
        let mut distances = self.frames.map(|_| f64::INFINITY);
        let mut chosen = Vec::with_capacity(count);
        let mut next = self.frames.ids().min_by(|a, b| height(a).total_cmp(&height(b)));
        while let Some(v) = next.filter(|_| chosen.len() < count) {
            run.check()?;
            chosen.push(v);
            let here = self.frames[v].position;
            for (d, frame) in distances.iter_mut().zip(&self.frames) {
                *d = d.min(frame.position.distance_squared(here));
            }
            next =
                distances.enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0))).map(|(v, _)| v);
        }
        chosen.sort_unstable();
        Ok(chosen)
    }

    pub(crate) fn mesh(&self) -> TriMesh {
        TriMesh { positions: self.frames.map(|f| f.position), triangles: self.triangles.clone() }
    }
}

fn check(taxels: usize, spacing: f64, radius: f64) -> Result<(), CalibError> {
    /// So many fill some GB.
    const MOST_TAXELS: usize = 10_000_000;
    if !(3..=MOST_TAXELS).contains(&taxels) {
        let (option, found) = ("the number of taxels", taxels as f64);
        return Err(CalibError::BadOption { option, found, needed: "3 to 10 million" });
    }
    for (option, found) in [("the spacing in m", spacing), ("the radius in m", radius)] {
        if !LENGTHS.contains(&found) {
            return Err(CalibError::BadOption { option, found, needed: "0.000001 to 1000" });
        }
    }
    Ok(())
}

/// The lattice cells, row by row, and their positions in spacings from the centre of the disc.
fn lattice(count: usize) -> (Vec<(i32, i32)>, Vec<DVec2>) {
    // A disc of n points has the radius 0.53 sqrt(n); the axes of the lattice are oblique.
    #[expect(clippy::cast_possible_truncation, reason = "at most 10 million taxels")]
    let reach = (0.7 * (count as f64).sqrt()) as i32 + 4;
    let place = |(a, b): (i32, i32)| {
        let (a, b) = (f64::from(a), f64::from(b));
        DVec2::new(a + 0.5 * b, 0.75_f64.sqrt() * b) - CENTRE
    };
    let mut cells: Vec<(i32, i32)> =
        (-reach..=reach).flat_map(|b| (-reach..=reach).map(move |a| (a, b))).collect();
    let mut distances: Vec<f64> = cells.iter().map(|&cell| place(cell).length_squared()).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let farthest = distances[count - 1];
    // Of equally far cells the first ones.
    let mut left = count - distances.partition_point(|&d| d < farthest);
    cells.retain(|&cell| {
        let distance = place(cell).length_squared();
        let is_one_of_them = distance == farthest && left > 0;
        left -= usize::from(is_one_of_them);
        distance < farthest || is_one_of_them
    });
    let plane = cells.iter().map(|&cell| place(cell)).collect();
    (cells, plane)
}

/// The inverse of Lambert's projection. With `s = |p| / 2R` the sine of half the polar angle it is algebraic,
/// so it does not use the system's sines.
fn lift(p: DVec2, radius: f64) -> DVec3 {
    let s2 = p.length_squared() / (4.0 * radius * radius);
    let stretch = (1.0 - s2).sqrt();
    DVec3::new(p.x * stretch, p.y * stretch, -radius * (1.0 - 2.0 * s2))
}

fn frame(position: DVec3, radius: f64) -> Pose {
    let z = position / radius;
    let x = (DVec3::X - z * z.x).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
    let rotation = DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z)).normalize();
    Pose { position, rotation }
}

/// A wrongly attributed displacement leads to a taxel within this distance, in m.
const MISATTRIBUTION_DISTANCE: f64 = 0.03;

/// Taxels by the cube of space in which they are, of side [`MISATTRIBUTION_DISTANCE`].
#[derive(Debug, Default)]
pub(super) struct Neighbourhoods(HashMap<IVec3, Vec<VertexId>>);

impl Neighbourhoods {
    pub(super) fn new(layout: &SensorLayout) -> Self {
        let mut cells: HashMap<IVec3, Vec<VertexId>> = HashMap::new();
        for (v, frame) in layout.frames.enumerate() {
            cells.entry(Self::of(frame.position)).or_default().push(v);
        }
        Self(cells)
    }

    fn of(position: DVec3) -> IVec3 {
        (position / MISATTRIBUTION_DISTANCE).floor().as_ivec3()
    }

    /// One of the taxels that may be mistaken for the end of an edge, with equal probability.
    pub(super) fn misattributed(
        &self,
        layout: &SensorLayout,
        from: VertexId,
        to: VertexId,
        chance: &mut Random,
    ) -> Option<VertexId> {
        /// A third of the taxels around are near enough, so few draws suffice.
        const DRAWS: usize = 30;
        let here = layout.frames[from].position;
        let is_near = |v: VertexId| {
            let squared = layout.frames[v].position.distance_squared(here);
            v != from && v != to && squared < MISATTRIBUTION_DISTANCE * MISATTRIBUTION_DISTANCE
        };
        let steps = (0..27).map(|k| IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
        let around: Vec<&[VertexId]> =
            steps.filter_map(|step| self.0.get(&(Self::of(here) + step))).map(Vec::as_slice).collect();
        let total = around.iter().map(|cell| cell.len()).sum();
        for _ in 0..DRAWS {
            let mut k = chance.below(total);
            let cell = around.iter().find(|cell| {
                let inside = k < cell.len();
                k -= if inside { 0 } else { cell.len() };
                inside
            })?;
            if is_near(cell[k]) {
                return Some(cell[k]);
            }
        }
        let near: Vec<VertexId> = around.into_iter().flatten().copied().filter(|&v| is_near(v)).collect();
        (!near.is_empty()).then(|| near[chance.below(near.len())])
    }
}
