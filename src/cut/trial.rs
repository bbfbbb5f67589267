//! A seam with its map: how far from an isometry it is, and where.

use glam::DVec2;

use crate::{
    cut::{
        CutMesh, PlaceId,
        seam_graph::{SeamEdges, SeamGraph},
    },
    id::{FaceId, IdVec, VertexId},
    mesh::{FlatTriangle, SingularValues, SymmetricDirichlet, TriMesh},
};

/// Map positions, in m.
type Uv = IdVec<VertexId, DVec2>;

/// The vertices of the uncut mesh that those of a cut one are.
type Unsplit = IdVec<PlaceId, VertexId>;

/// Flattens a cut mesh (m). Takes the mesh, its unsplit vertices, a map of the same faces to start from, and
/// an excess energy: a map that is likely to stay above it may be returned early. `None` if there is no map.
pub(crate) type TrialMap<'a> = dyn Fn(&TriMesh, &Unsplit, Option<&Uv>, f64) -> Option<Uv> + Sync + 'a;

/// By this factor an optional cut must lower the excess energy, for each seam length of the square root of
/// the area.
pub(super) const FALL: f64 = 4.0;

/// A seam and how good the map of the surface cut along it is.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    pub(super) seam: SeamEdges,
    /// Length of the seam over the square root of the area.
    pub(super) length: f64,
    /// Symmetric Dirichlet energy after the best scale, less that of an isometry; infinite without
    /// a map.
    pub(super) excess: f64,
    /// Largest ratio between the areas of a face on the map and on the skin, either way, after both
    /// total areas are made equal; infinite without a map.
    pub(super) area_ratio: f64,
    /// Symmetric Dirichlet energy of each face at that scale; empty without a map.
    pub(super) faces: IdVec<FaceId, f64>,
    pub(super) cut: CutMesh,
    /// Map positions at that scale, in m.
    pub(super) uv: Uv,
}

impl Trial {
    /// Maps the mesh of `graph` cut along `seam`.
    pub(super) fn new(graph: &SeamGraph<'_>, seam: SeamEdges, map: &TrialMap<'_>) -> Self {
        Self::after(graph, None, seam, map, f64::INFINITY)
    }

    /// As [`Self::new`], starting from the map before the last cut, on which the new boundary is still
    /// closed. Where the excess is likely to stay above `most`, it is not exact.
    pub(super) fn after(
        graph: &SeamGraph<'_>,
        before: Option<&Self>,
        seam: SeamEdges,
        map: &TrialMap<'_>,
        most: f64,
    ) -> Self {
        let cut = graph.cut(&seam);
        let start = before.filter(|before| !before.uv.is_empty()).map(|before| {
            let mut uv = Uv::filled(DVec2::ZERO, cut.unsplit.len());
            for (corners, places) in cut.triangles.iter().zip(&before.cut.triangles) {
                corners.iter().zip(places).for_each(|(v, place)| uv[v.opened()] = before.uv[place.opened()]);
            }
            uv
        });
        let mesh = cut.mesh(&graph.mesh.positions);
        let mut trial = Self {
            length: graph.length(&seam),
            seam,
            excess: f64::INFINITY,
            area_ratio: f64::INFINITY,
            faces: IdVec::default(),
            cut,
            uv: IdVec::default(),
        };
        if let Some(uv) = map(&mesh, &trial.cut.unsplit, start.as_ref(), most) {
            trial.measure(&mesh, uv);
        }
        trial
    }

    fn measure(&mut self, mesh: &TriMesh, uv: Uv) {
        let stretch = |face: FaceId| {
            let flat = FlatTriangle::new(mesh.corners(face));
            let s = SingularValues::of(&flat.jacobian(mesh.triangles[face].map(|v| uv[v])));
            (flat.area(), s.s1, s.s2)
        };
        // Faces without area on the skin have no singular values.
        let (mut sums, mut area, mut on_map) = (SymmetricDirichlet::default(), 0.0, 0.0);
        let mut ratios = [f64::INFINITY, 0.0_f64];
        for (a, s1, s2) in mesh.triangles.ids().map(stretch).filter(|x| x.0 > 0.0) {
            sums.add(a, s1, s2);
            area += a;
            on_map += a * (s1 * s2);
            ratios = [ratios[0].min(s1 * s2), ratios[1].max(s1 * s2)];
        }
        let is_flipped = ratios[0] <= 0.0;
        let excess = sums.energy() - SymmetricDirichlet::ISOMETRY;
        if is_flipped || !excess.is_finite() {
            return;
        }
        let scale = sums.scale();
        let energy = |face| match stretch(face) {
            (a, s1, s2) if a > 0.0 => {
                (s1 * s1 + s2 * s2) * scale * scale + (1.0 / (s1 * s1) + 1.0 / (s2 * s2)) / (scale * scale)
            }
            _ => SymmetricDirichlet::ISOMETRY,
        };
        self.excess = excess.max(0.0);
        let mean = on_map / area;
        self.area_ratio = (ratios[1] / mean).max(mean / ratios[0]);
        self.faces = mesh.triangles.ids().map(energy).collect();
        self.uv = uv.map(|&p| p * scale);
    }

    /// The excess energy, times four for each seam length of the square root of the area: the trial of
    /// least cost pays best.
    pub(super) fn cost(&self) -> f64 {
        self.excess * FALL.powf(self.length)
    }

    /// The fall of the excess energy from `before` as a logarithm to the base four, over the length of seam
    /// that it costs, in square roots of the area.
    pub(super) fn rate(&self, before: &Self) -> f64 {
        /// An isometry but for rounding.
        const NOTHING: f64 = 1e-12;
        let fall = (before.excess / self.excess.max(NOTHING)).log(FALL);
        let rate = fall / (self.length - before.length).max(1e-9);
        if rate.is_nan() { f64::NEG_INFINITY } else { rate }
    }
}
