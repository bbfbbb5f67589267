//! The presses that a bundle adjustment is made of: up to eight frames each, as the contact model sees them.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, VertexCorners, closest_point};
use crate::numeric::median;
use crate::response::contact::View;
use crate::signal::RunningNoise;
use crate::skin::Patch;

/// A taxel is touched from this many times its noise on.
pub(super) const HOT: f64 = 4.5;

/// The largest reading that a taxel next to it confirms by at least as much: touches are felt by several, spikes by one.
pub(super) fn confirmed(read: &[f64], neighbours: impl Fn(usize) -> f64) -> f64 {
    let of = |(k, &x): (usize, &f64)| if x > 0.0 { x.min(neighbours(k)) } else { 0.0 };
    read.iter().enumerate().map(of).fold(0.0, f64::max)
}

/// A press: one body on one patch.
#[derive(Debug, Clone)]
pub(super) struct Press {
    /// Its taxels: rows of the whole system.
    pub(super) taxels: Vec<u32>,
    pub(super) frames: Vec<PressFrame>,
}

/// The noise of a taxel, which is at least a share of the median of all, and of the largest [confirmed] reading.
pub(super) fn least_noise(noise: &RunningNoise, median: f64, largest: f64) -> f64 {
    /// A lower noise is one of a converter with coarse steps: a single taxel must not outweigh all others.
    const SHARE: f64 = 0.5;
    const SHARE_OF_LARGEST: f64 = 2e-3;
    // `max` takes the other number for NaN.
    noise.sigma.max(SHARE * median).max(SHARE_OF_LARGEST * largest).max(f64::MIN_POSITIVE)
}

/// The median noise of those taxels of which it is known.
pub(super) fn median_noise<'n>(all: impl Iterator<Item = &'n RunningNoise>) -> f64 {
    median(all.map(|noise| noise.sigma).filter(|sigma| !sigma.is_nan())).unwrap_or(0.0)
}

impl Press {
    /// Its taxels with a reading above [`HOT`] times their noise.
    pub(super) fn hot_taxels(&self, noise: &[f64]) -> impl Iterator<Item = usize> {
        let is_hot = |k: usize, taxel: u32| {
            self.frames.iter().any(|frame| frame.readings[k] > HOT * noise[taxel as usize])
        };
        self.taxels.iter().enumerate().filter(move |&(k, &v)| is_hot(k, v)).map(|(_, &v)| v as usize)
    }
}

#[derive(Debug, Clone)]
pub(super) struct PressFrame {
    /// Each taxel as this frame sees it.
    pub(super) views: Vec<View>,
    /// Its reading; NaN where it has none, or is saturated.
    pub(super) readings: Vec<f64>,
}

/// What finds the planes of contacts.
pub(super) struct Surface<'s> {
    patch: &'s Patch,
    around: VertexCorners,
}

/// A point of the surface and its normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Foot {
    at: DVec3,
    normal: DVec3,
}

impl<'s> Surface<'s> {
    pub(super) fn new(patch: &'s Patch) -> Self {
        Self {
            patch,
            around: VertexCorners::new(patch.mesh.triangles.iter().copied(), patch.mesh.positions.len()),
        }
    }

    /// The point of the surface next to the mean of these taxels, by weights.
    pub(super) fn foot(&self, weights: impl Iterator<Item = (VertexId, f64)> + Clone) -> Option<Foot> {
        let mesh: &TriMesh = &self.patch.mesh;
        let (sum, moment) = weights
            .clone()
            .fold((0.0, DVec3::ZERO), |(sum, moment), (v, w)| (sum + w, moment + w * mesh.positions[v]));
        let mean = moment / sum;
        let away = |v: VertexId| mesh.positions[v].distance_squared(mean);
        let nearest = weights.map(|(v, _)| v).min_by(|&a, &b| away(a).total_cmp(&away(b)))?;
        let found = self
            .around
            .faces(nearest)
            .map(|face: FaceId| (face, closest_point(mean, mesh.corners(face), mesh.triangles[face])));
        let (face, closest) = found.min_by(|a, b| a.1.squared.total_cmp(&b.1.squared))?;
        let corners = mesh.triangles[face].into_iter().zip(closest.barycentric);
        let mix = |of: &IdVec<VertexId, DVec3>| corners.clone().map(|(v, w)| w * of[v]).sum::<DVec3>();
        Some(Foot { at: mix(&mesh.positions), normal: mix(&self.patch.taxels.normals).try_normalize()? })
    }

    /// Taxels as the contacts at these feet see them. The axes of all are one direction, that of the middle one,
    /// projected on each tangent plane.
    pub(super) fn views(&self, feet: &[Foot], taxels: &[VertexId]) -> Vec<Vec<View>> {
        let middle = feet[feet.len() / 2].normal.any_orthonormal_vector();
        let of = |foot: &Foot| {
            let normal = foot.normal;
            let axis = middle.reject_from_normalized(normal);
            // A body that has rolled by a quarter of a turn and more has lost its axis.
            let axis =
                if axis.length() < LEAST_AXIS { normal.any_orthonormal_vector() } else { axis.normalize() };
            let frame = [axis, normal.cross(axis), normal];
            let view = |&v: &VertexId| {
                let offset = self.patch.mesh.positions[v] - foot.at;
                let [x, y, z] = frame.map(|axis| self.patch.taxels.normals[v].dot(axis));
                View {
                    at: frame.map(|axis| offset.dot(axis)),
                    slope: [x, y].map(|n| -n / z.max(LEAST_COSINE)),
                }
            };
            taxels.iter().map(view).collect()
        };
        feet.iter().map(of).collect()
    }
}

/// The least length of a projected axis, and the least cosine of a normal with that of the plane.
const LEAST_AXIS: f64 = 0.2;
const LEAST_COSINE: f64 = 0.3;
