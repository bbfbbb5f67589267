//! A seam with its map: how far from an isometry it is, and where.

use glam::DVec2;

use crate::cut::seam_graph::{SeamEdges, SeamGraph};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{FlatTriangle, SingularValues, SymmetricDirichlet, TriMesh};

/// Map positions, in m.
type Uv = IdVec<VertexId, DVec2>;

/// Flattens a cut mesh (m). A map that is likely to have more excess energy than the number may be returned
/// early. `None` if there is no map.
pub(crate) type TrialMap<'a> = dyn Fn(&TriMesh, f64) -> Option<Uv> + Sync + 'a;

/// How good the map of a surface cut along a seam is.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    /// Length of the seam over the square root of the area.
    pub(super) length: f64,
    /// Symmetric Dirichlet energy after the best scale, less that of an isometry; infinite without
    /// a map.
    pub(super) excess: f64,
    /// Largest ratio between the areas of a face on the map and on the skin, either way, after both
    /// total areas are made equal; infinite without a map.
    pub(super) area_ratio: f64,
    /// Map positions at that scale, in m; empty without a map.
    pub(super) uv: Uv,
}

impl Trial {
    /// Maps the mesh of `graph` cut along `seam`. Where the excess is likely to stay above `most`, it is not
    /// exact.
    pub(super) fn new(graph: &SeamGraph<'_>, seam: &SeamEdges, map: &TrialMap<'_>, most: f64) -> Self {
        let mesh = graph.cut(seam).mesh(&graph.mesh.positions);
        let mut trial = Self {
            length: graph.length(seam),
            excess: f64::INFINITY,
            area_ratio: f64::INFINITY,
            uv: IdVec::default(),
        };
        if let Some(uv) = map(&mesh, most) {
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
        self.excess = excess.max(0.0);
        let mean = on_map / area;
        self.area_ratio = (ratios[1] / mean).max(mean / ratios[0]);
        self.uv = uv.map(|&p| p * scale);
    }
}
