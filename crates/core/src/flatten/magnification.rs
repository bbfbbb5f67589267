//! The area that each face of the map aims at, from the densities and acuities of the taxels, and the weight
//! of its distortion.

use crate::flatten::{FlattenError, Method};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::pyramid::Level;
use crate::skin::{Patch, Taxels};

/// Largest area factor, and its inverse the smallest: beyond, neighbouring faces could not meet
/// without extreme angles.
const LARGEST_FACTOR: f64 = 1e3;

/// Least weight of a face over the mean: a face of weight 0 must not flip either, so it needs some energy.
const LEAST_WEIGHT: f64 = 1e-3;

/// One number per vertex, where there is one.
type Values = Option<IdVec<VertexId, f64>>;

/// Wanted ratio of the area on the map to that on the skin, `a^2 (rho / mean rho)^gamma` with the acuity `a`,
/// as the cortex gives densely innervated skin a larger share; and the weight of distortion.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Magnification {
    /// Densities `rho` of the vertices, in 1/m^2, unless `gamma = 0`.
    densities: Values,
    /// The exponent.
    gamma: f64,
    /// Squares of the acuities.
    shares: Values,
    weights: Values,
}

impl Magnification {
    /// From the properties of the taxels and their receptive areas `areas` (m^2), which replace densities
    /// where there are none.
    pub(crate) fn new(
        method: Method,
        taxels: Option<&Taxels>,
        areas: &IdVec<VertexId, f64>,
    ) -> Result<Self, FlattenError> {
        let Method::Intrinsic { magnify: gamma, .. } = method else { return Ok(Self::default()) };
        taxels.map_or(Ok(()), |taxels| taxels.check_demands(areas.len()))?;
        let densities = taxels.and_then(|taxels| taxels.densities.clone());
        let densities = (gamma != 0.0).then(|| densities.unwrap_or_else(|| areas.map(|a| a.recip())));
        let is_wrong = |r: &f64| !(r.is_finite() && *r > 0.0);
        let wrong = densities.iter().flat_map(IdVec::enumerate).find(|(_, r)| is_wrong(r));
        if let Some((vertex, &found)) = wrong {
            return Err(FlattenError::Density { vertex, found });
        }
        let shares = taxels.and_then(|taxels| Some(taxels.acuities.as_ref()?.map(|a| a * a)));
        // Only ratios matter: the largest is 1, so that no sum of weights overflows.
        let weights = taxels.and_then(|taxels| taxels.weights.as_ref()).map(|weights| {
            let most = weights.iter().copied().fold(0.0, f64::max);
            weights.map(|w| w / most)
        });
        Ok(Self { densities, gamma, shares, weights })
    }

    /// Applies a function to the values at the vertices.
    fn map(&self, values: impl Fn(&IdVec<VertexId, f64>) -> IdVec<VertexId, f64>) -> Self {
        let map = |of: &Values| of.as_ref().map(&values);
        let Self { densities, gamma, shares, weights } = self;
        Self { densities: map(densities), gamma: *gamma, shares: map(shares), weights: map(weights) }
    }

    /// The magnification of a coarser level: each field has the mean of its taxels, weighted with their
    /// areas.
    pub(crate) fn restricted(&self, level: &Level, areas: &IdVec<VertexId, f64>) -> Self {
        let Some(to_finest) = &level.to_finest else { return self.clone() };
        let served = to_finest.restrict(areas);
        self.map(|values| {
            let sums = to_finest.restrict(&areas.iter().zip(values).map(|(a, x)| a * x).collect());
            let own = |v: VertexId| values[level.origins[v]];
            sums.enumerate().map(|(v, sum)| if served[v] > 0.0 { sum / served[v] } else { own(v) }).collect()
        })
    }

    /// The magnification of a mesh of these vertices.
    pub(crate) fn of_vertices(&self, vertices: &[VertexId]) -> Self {
        self.map(|values| vertices.iter().map(|&v| values[v]).collect())
    }

    /// The area factor of each face, so that the whole map keeps its area; `None` where all are 1.
    pub(crate) fn area_factors(&self, mesh: &TriMesh) -> Option<IdVec<FaceId, f64>> {
        let mean =
            |values: &IdVec<VertexId, f64>| values.iter().map(|x| x.ln()).sum::<f64>() / values.len() as f64;
        let bound = LARGEST_FACTOR.ln();
        let raw = self.log_factors(mesh, mean)?.map(|log| log.clamp(-bound, bound).exp());
        Some(with_mean_one(mesh, raw))
    }

    /// The logarithm of the area factor of each face, with values over `e^mean`; `None` where all are 1.
    fn log_factors(
        &self,
        mesh: &TriMesh,
        mean: impl Fn(&IdVec<VertexId, f64>) -> f64,
    ) -> Option<IdVec<FaceId, f64>> {
        let parts = [(&self.densities, self.gamma), (&self.shares, 1.0)];
        let mut logs: Option<IdVec<FaceId, f64>> = None;
        for (values, exponent) in parts {
            let Some(values) = values else { continue };
            let mean = mean(values);
            let log =
                |t: &[VertexId; 3]| exponent * t.map(|v| values[v].ln() - mean).iter().sum::<f64>() / 3.0;
            let all = logs.get_or_insert_with(|| mesh.triangles.map(|_| 0.0));
            all.iter_mut().zip(&mesh.triangles).for_each(|(sum, t)| *sum += log(t));
        }
        logs
    }

    /// The weight of each face, with mean 1 by area; `None` where all are 1.
    pub(crate) fn face_weights(&self, mesh: &TriMesh) -> Option<IdVec<FaceId, f64>> {
        let weights = self.weights.as_ref()?;
        let raw = mesh.triangles.map(|t| t.map(|v| weights[v]).iter().sum::<f64>() / 3.0);
        let raised = with_mean_one(mesh, raw).map(|w| w.max(LEAST_WEIGHT));
        Some(with_mean_one(mesh, raised))
    }
}

/// The scale of each patch's map, relative to a map as large as its skin, with which densities and acuities
/// are relative to their mean over all patches. All maps together stay as large as the skin. A patch whose
/// values are out of range counts as one without any.
#[doc(hidden)]
pub fn patch_scales(method: Method, patches: &[&Patch]) -> Vec<f64> {
    if patches.len() < 2 {
        return vec![1.0; patches.len()];
    }
    // Area on the skin and, where the patch has one, logarithm of the factor of every face.
    let faces = |patch: &&Patch| {
        let Patch { mesh, taxels, .. } = patch;
        let magnification = Magnification::new(method, Some(taxels), &taxels.areas);
        let is_wrong = magnification.is_err();
        let logs = magnification.ok().and_then(|magnification| magnification.log_factors(mesh, |_| 0.0));
        let log =
            |face: FaceId| if is_wrong { None } else { Some(logs.as_ref().map_or(0.0, |logs| logs[face])) };
        mesh.triangles.ids().map(|face| (mesh.face_area(face), log(face))).collect::<Vec<_>>()
    };
    let faces: Vec<Vec<(f64, Option<f64>)>> = patches.iter().map(faces).collect();
    let [mut area, mut sum] = [0.0; 2];
    for (a, log) in faces.iter().flatten().filter_map(|&(a, log)| Some((a, log?))) {
        area += a;
        sum += a * log;
    }
    let (mean, bound) = (sum / area, LARGEST_FACTOR.ln());
    let on_skin: Vec<f64> = faces.iter().map(|faces| faces.iter().map(|(a, _)| a).sum()).collect();
    let on_map = |faces: &Vec<(f64, Option<f64>)>| -> f64 {
        faces.iter().map(|(a, log)| a * log.map_or(0.0, |log| log - mean).clamp(-bound, bound).exp()).sum()
    };
    let on_map: Vec<f64> = faces.iter().map(on_map).collect();
    let whole = on_skin.iter().sum::<f64>() / on_map.iter().sum::<f64>();
    let scales = on_map.iter().zip(&on_skin).map(|(map, skin)| (map / skin * whole).sqrt());
    scales.map(|s| if s.is_finite() && s > 0.0 { s } else { 1.0 }).collect()
}

/// Factors of faces over their mean by area.
fn with_mean_one(mesh: &TriMesh, factors: IdVec<FaceId, f64>) -> IdVec<FaceId, f64> {
    let (mut area, mut sum) = (0.0, 0.0);
    for (face, factor) in factors.enumerate() {
        area += mesh.face_area(face);
        sum += mesh.face_area(face) * factor;
    }
    let mean = sum / area;
    if mean.is_finite() && mean > 0.0 { factors.map(|f| f / mean) } else { factors.map(|_| 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flatten::Energy;
    use crate::mesh::shapes;
    use crate::skin::LinkId;

    /// A wrong density is refused when its patch is mapped; the patch does not shift the scale of the others.
    #[test]
    fn a_patch_with_a_wrong_density_leaves_the_others_alone() {
        let densities = [Some(1e4), Some(1e4), Some(f64::NAN)];
        let patches = densities.map(|density| {
            let mut patch = Patch::from_mesh("p", LinkId::new(0), shapes::square());
            patch.taxels.densities = density.map(|density| patch.taxels.areas.map(|_| density));
            patch
        });
        let method = Method::Intrinsic { energy: Energy::default(), magnify: 1.0 };
        let scales = patch_scales(method, &patches.each_ref());
        assert!(scales.iter().all(|scale| (scale - 1.0).abs() < 1e-12), "{scales:?}");
    }
}
