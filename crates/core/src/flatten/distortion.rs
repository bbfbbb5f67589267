//! Measures of the distortion of any map, and of the convergence of its minimisation.

use glam::DVec2;

use crate::flatten::energy::elements::keeps_orientation;
use crate::flatten::overlap::overlaps;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{FlatTriangle, SingularValues, SymmetricDirichlet, TriMesh};
use crate::parallel::par_each;

/// Symmetric Dirichlet energy beyond which a map is far from isometric.
pub(crate) const FAR: f64 = 50.0;

/// Symmetric Dirichlet energy above which a map is of no use.
#[doc(hidden)]
pub const ABSURD: f64 = 15.0;

/// Symmetric Dirichlet energy above which a map is poor: other seams are tried, and a user is warned.
#[doc(hidden)]
pub const POOR: f64 = 6.0;

/// A map with a face of a larger ratio of stretches is poor.
#[doc(hidden)]
pub const POOR_STRETCHES: f64 = 20.0;

/// Ratios are clamped to this, so that one face without area on the map does not make a mean infinite.
const LARGEST: f64 = 1e12;

/// How faithful a map is. Means are weighted with the areas on the skin.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Distortion {
    /// Triangles whose map is mirrored or has no area.
    pub flips: usize,
    /// Overlaps of the map: pairs of boundary edges that cross or touch (counted up to a million), and
    /// vertices about which the map winds more than once. A map without flips and crossings is one to one.
    pub crossings: usize,
    /// Mean `s1/s2`, 1 at a conformal map.
    pub qc_mean: f64,
    /// Largest `s1/s2`.
    pub qc_max: f64,
    /// Mean of `max(r, 1/r)`, `r` the area ratio after equalising the total areas.
    pub area_mean: f64,
    /// Largest `max(r, 1/r)`.
    pub area_max: f64,
    /// Symmetric Dirichlet energy after the best scale, 4 at an isometry, infinite where a face
    /// flips.
    pub symmetric_dirichlet: f64,
}

/// Whether a map is a minimum of its energy.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Convergence {
    /// Whether the minimisation ended at a minimum: not at its limit of steps, and not because no step
    /// lowered the energy although its gradient is large.
    pub converged: bool,
    /// Length of the gradient of the energy over the energy, with positions in units of the square root of
    /// the area; the energy of fillers, which keep holes open and loops apart, is included. 0 for a map that
    /// minimises nothing.
    pub gradient: f64,
}

impl Distortion {
    /// Whether faces are several times too small or too large: the symmetric Dirichlet energy is
    /// beyond 50.
    pub fn is_far_from_isometric(&self) -> bool {
        self.symmetric_dirichlet > FAR
    }

    /// Whether the map is of no use: the symmetric Dirichlet energy is beyond 15.
    pub fn is_absurd(&self) -> bool {
        self.symmetric_dirichlet > ABSURD
    }

    /// Whether the map is so poor that a user should be warned: the symmetric Dirichlet energy is beyond 6, or
    /// the stretches of some face beyond a ratio of 20.
    pub fn is_poor(&self) -> bool {
        !(self.symmetric_dirichlet <= POOR && self.qc_max <= POOR_STRETCHES)
    }
}

/// Measures the map `uv` (m) of `mesh`.
///
/// ```
/// use dermatome::{flatten::distortion, mesh::shapes};
///
/// let skin = shapes::lattice(5, 4, 0.01);
/// let uv = skin.positions.map(|p| p.truncate());
/// let measured = distortion(&skin, &uv);
/// assert_eq!((measured.flips, measured.crossings), (0, 0));
/// assert!((measured.symmetric_dirichlet - 4.0).abs() < 1e-12, "a flat skin is its own map");
/// ```
///
/// Faces without area on the skin count as flips when they are mirrored, but have no singular values and are
/// left out of the other measures. All faces of a mirrored map are flips. Of a mesh without area all means
/// are NaN.
///
/// # Panics
/// If `uv` does not have one entry per vertex, or a corner does not exist.
pub fn distortion(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Distortion {
    assert_eq!(mesh.positions.len(), uv.len(), "one map position per vertex");
    let of_face = |face: FaceId| {
        let at = mesh.triangles[face].map(|v| uv[v]);
        let flat = FlatTriangle::new(mesh.corners(face));
        (flat.area(), SingularValues::of(&flat.jacobian(at)), keeps_orientation(at))
    };
    let mut sums = Sums::default();
    let mut flips = 0;
    par_each(mesh.triangles.len(), of_face, |_, (area, stretches, is_kept)| {
        flips += usize::from(!is_kept);
        if area > 0.0 {
            sums.add(area, stretches);
        }
    });
    sums.finish(flips, overlaps(mesh, uv))
}

#[derive(Debug, Default)]
struct Sums {
    /// Area on the skin, magnitude of the area on the map, of every face.
    areas: Vec<(f64, f64)>,
    qc: f64,
    qc_max: f64,
    dirichlet: SymmetricDirichlet,
}

impl Sums {
    fn add(&mut self, area: f64, SingularValues { s1, s2 }: SingularValues) {
        let s2 = s2.abs().max(f64::MIN_POSITIVE);
        let qc = (s1 / s2).min(LARGEST);
        self.qc += area * qc;
        self.qc_max = self.qc_max.max(qc);
        self.dirichlet.add(area, s1, s2);
        self.areas.push((area, area * s1 * s2));
    }

    fn finish(self, flips: usize, crossings: usize) -> Distortion {
        let (skin, map) = self.areas.iter().fold((0.0, 0.0), |(a, b), x| (a + x.0, b + x.1));
        let (mut area_mean, mut area_max) = (0.0, 0.0_f64);
        for &(a, b) in &self.areas {
            let ratio = (b / map) / (a / skin);
            let either_way = ratio.max(1.0 / ratio).min(LARGEST);
            area_mean += a / skin * either_way;
            area_max = area_max.max(either_way);
        }
        Distortion {
            flips,
            crossings,
            qc_mean: self.qc / skin,
            qc_max: self.qc_max,
            area_mean,
            area_max,
            symmetric_dirichlet: if flips > 0 { f64::INFINITY } else { self.dirichlet.energy() },
        }
    }
}
