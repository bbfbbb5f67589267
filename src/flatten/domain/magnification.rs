//! Magnification: the area that each face aims at, from the densities of the taxels.

use crate::{
    flatten::{FlattenError, Method},
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
    pyramid::Level,
};

/// Largest area factor, and its inverse the smallest: beyond, neighbouring faces could not meet
/// without extreme angles.
const LARGEST_FACTOR: f64 = 1e3;

/// How many times larger than on the skin each part of the map should be: `(rho / mean rho)^gamma`,
/// as the cortex gives densely innervated skin a larger share.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Magnification {
    /// `gamma = 0`: areas as they are.
    None,
    /// Densities `rho` of the vertices, in 1/m^2, and the exponent.
    Density(IdVec<VertexId, f64>, f64),
}

impl Magnification {
    /// From the densities of the vertices, or else their receptive areas.
    pub(crate) fn new(
        method: Method,
        densities: Option<&IdVec<VertexId, f64>>,
        areas: &IdVec<VertexId, f64>,
    ) -> Result<Self, FlattenError> {
        let gamma = match method {
            Method::Intrinsic { magnify, .. } if magnify != 0.0 => magnify,
            _ => return Ok(Self::None),
        };
        let rho = match densities {
            Some(given) if given.len() != areas.len() => {
                return Err(FlattenError::Densities { found: given.len(), needed: areas.len() });
            }
            Some(given) => given.clone(),
            None => areas.map(|a| a.recip()),
        };
        if let Some((vertex, &found)) = rho.enumerate().find(|(_, r)| !(r.is_finite() && **r > 0.0)) {
            return Err(FlattenError::Density { vertex, found });
        }
        Ok(Self::Density(rho, gamma))
    }

    /// The same on a coarser level: each field has the mean density of its taxels, weighted with
    /// their areas.
    pub(crate) fn restricted(&self, level: &Level, areas: &IdVec<VertexId, f64>) -> Self {
        match (self, &level.to_finest) {
            (Self::Density(rho, gamma), Some(to_finest)) => {
                let taxels = to_finest.restrict(&areas.iter().zip(rho).map(|(a, r)| a * r).collect());
                let served = to_finest.restrict(areas);
                Self::Density(taxels.iter().zip(&served).map(|(t, a)| t / a).collect(), *gamma)
            }
            _ => self.clone(),
        }
    }

    /// The same for a mesh of some of the vertices.
    pub(crate) fn of_vertices(&self, vertices: &[VertexId]) -> Self {
        match self {
            Self::None => Self::None,
            Self::Density(rho, gamma) => Self::Density(vertices.iter().map(|&v| rho[v]).collect(), *gamma),
        }
    }

    /// The factor of each face, so that the whole map keeps its area.
    pub(crate) fn of_faces(&self, mesh: &TriMesh) -> IdVec<FaceId, f64> {
        let Self::Density(rho, gamma) = self else {
            return IdVec::filled(1.0, mesh.triangles.len());
        };
        let mean_of_logs = rho.iter().map(|r| r.ln()).sum::<f64>() / rho.len() as f64;
        let bound = LARGEST_FACTOR.ln();
        let raw: IdVec<FaceId, f64> = mesh
            .triangles
            .iter()
            .map(|t| {
                let log = t.map(|v| rho[v].ln() - mean_of_logs).iter().sum::<f64>() / 3.0;
                (gamma * log).clamp(-bound, bound).exp()
            })
            .collect();
        let (mut area, mut magnified) = (0.0, 0.0);
        for (face, factor) in raw.enumerate() {
            area += mesh.face_area(face);
            magnified += mesh.face_area(face) * factor;
        }
        let same_area = area / magnified;
        raw.map(|f| f * if same_area.is_finite() && same_area > 0.0 { same_area } else { 1.0 })
    }
}
