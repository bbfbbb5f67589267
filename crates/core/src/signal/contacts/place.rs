//! Force, centre of pressure and principal axes of a region.
//!
//! The mean of positions on a curved skin is below it, so the centre of pressure is the nearest point of the
//! triangles around the region.

use std::f64::consts::FRAC_PI_2;

use glam::{DVec2, DVec3};

use crate::body::BodyTaxel;
use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::{MapLevel, PatchMap};
use crate::mesh::{SurfacePoint, VertexCorners, closest_point};
use crate::pyramid::LevelId;
use crate::signal::Quantity;
use crate::signal::contacts::ContactRegion;
use crate::signal::contacts::joined::Joined;
use crate::skin::PatchId;

/// The readings of the taxels of one patch, and those of all patches.
pub(super) struct Pressed<'a> {
    pub(super) patch: &'a PatchMap,
    pub(super) around: &'a VertexCorners,
    pub(super) values: &'a [f64],
    pub(super) quantity: Quantity,
    pub(super) patches: &'a IdVec<PatchId, PatchMap>,
    pub(super) joined: &'a Joined,
    pub(super) all: &'a IdVec<VertexId, f64>,
}

impl Pressed<'_> {
    /// Computes all properties of a region from its taxels.
    pub(super) fn measure(&self, region: &mut ContactRegion) {
        let level = &self.patch.levels[LevelId::new(0)];
        let positions = &level.level.mesh.positions;
        let (mut area, mut force, mut moment) = (0.0, 0.0, DVec3::ZERO);
        let (mut peak_taxel, mut peak) = (VertexId::default(), f64::NEG_INFINITY);
        for &taxel in &region.taxels {
            area += self.patch.taxels.areas[taxel];
            force += self.force(taxel);
            moment += self.force(taxel) * positions[taxel];
            let value = self.values[taxel.index()];
            if value > peak {
                (peak_taxel, peak) = (taxel, value);
            }
        }
        for &at in &region.beyond {
            area += self.patches[at.patch].taxels.areas[at.taxel];
            force += self.force_beyond(at);
            moment += self.force_beyond(at) * self.position(at, region.patch);
        }
        let mean = moment / force;
        (region.link, region.area, region.force) = (self.patch.link, area, force);
        (region.peak_taxel, region.peak) = (peak_taxel, peak);
        let normals = &self.patch.taxels.normals;
        let place = self.nearest(level, &region.taxels, mean);
        (region.centre, region.map, region.normal) = match &place {
            Some(at) => {
                let corners = || level.level.mesh.triangles[at.face].into_iter().zip(at.barycentric);
                let normal = corners().map(|(v, w)| w * normals[v]).sum::<DVec3>().try_normalize();
                (level.level.mesh.point(at), level.uv_at(at), normal.unwrap_or(normals[peak_taxel]))
            }
            // A taxel without triangles.
            None => (positions[peak_taxel], level.uv[PlaceId::first_of(peak_taxel)], normals[peak_taxel]),
        };
        let along = self.axes(level, region, mean);
        region.angle = place.map_or(0.0, |at| angle_on_map(level, at.face, along));
    }

    /// Force on a taxel, in units of the channel, times m^2 if it is intensive.
    fn force(&self, taxel: VertexId) -> f64 {
        self.quantity.weight(self.patch.taxels.areas[taxel]) * self.values[taxel.index()]
    }

    /// As [`Self::force`], on a taxel of any patch.
    fn force_beyond(&self, at: BodyTaxel) -> f64 {
        self.quantity.weight(self.patches[at.patch].taxels.areas[at.taxel]) * self.all[self.joined.number(at)]
    }

    /// Where a taxel of any patch is, in the frame of the link of a patch, as the links are at rest.
    fn position(&self, at: BodyTaxel, patch: PatchId) -> DVec3 {
        let level = &self.patches[at.patch].levels[LevelId::new(0)].level;
        self.joined.moved(level.mesh.positions[at.taxel], [at.patch, patch])
    }

    /// The point of the triangles around these taxels that is nearest to `at`; of several the first.
    fn nearest(&self, level: &MapLevel, taxels: &[VertexId], at: DVec3) -> Option<SurfacePoint> {
        let mesh = &level.level.mesh;
        let (mut best, mut least) = (None, f64::INFINITY);
        for &taxel in taxels {
            for face in self.around.faces(taxel) {
                let corners = mesh.triangles[face];
                // Visits every face once, with the first of its corners in the region.
                if corners.iter().any(|&v| v < taxel && taxels.binary_search(&v).is_ok()) {
                    continue;
                }
                let found = closest_point(at, mesh.corners(face), corners);
                if found.squared < least {
                    least = found.squared;
                    best = Some(SurfacePoint { face, barycentric: found.barycentric });
                }
            }
        }
        best
    }

    /// Standard deviations along the principal axes in the tangent plane of the centre; returns the
    /// direction of the longer one.
    fn axes(&self, level: &MapLevel, region: &mut ContactRegion, mean: DVec3) -> DVec3 {
        let (x_axis, y_axis) = region.normal.any_orthonormal_pair();
        let [mut xx, mut xy, mut yy] = [0.0; 3];
        let own = region.taxels.iter().map(|&v| (level.level.mesh.positions[v], self.force(v)));
        let beyond = region.beyond.iter().map(|&at| (self.position(at, region.patch), self.force_beyond(at)));
        for (position, force) in own.chain(beyond) {
            let offset = position - mean;
            let (x, y) = (offset.dot(x_axis), offset.dot(y_axis));
            let share = force / region.force;
            xx += share * x * x;
            xy += share * x * y;
            yy += share * y * y;
        }
        let (middle, half) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        region.major = (middle + half).sqrt();
        region.minor = (middle - half).max(0.0).sqrt();
        let turn = 0.5 * (2.0 * xy).atan2(xx - yy);
        x_axis * turn.cos() + y_axis * turn.sin()
    }
}

/// Angle on the map of a line along a direction on a face: above -pi/2 and at most pi/2. 0 if the face has no
/// area.
fn angle_on_map(level: &MapLevel, face: FaceId, along: DVec3) -> f64 {
    let [a, b, c] = level.level.mesh.corners(face);
    let [p, q, r] = level.uv_of(face);
    let (ab, ac) = (b - a, c - a);
    let (bb, bc, cc) = (ab.length_squared(), ab.dot(ac), ac.length_squared());
    let (along_b, along_c) = (along.dot(ab), along.dot(ac));
    // The direction in terms of the two edges, times the determinant of their products.
    let (s, t) = (cc * along_b - bc * along_c, bb * along_c - bc * along_b);
    let direction: DVec2 = s * (q - p) + t * (r - p);
    let angle = direction.y.atan2(direction.x);
    if angle > FRAC_PI_2 {
        angle - 2.0 * FRAC_PI_2
    } else if angle <= -FRAC_PI_2 {
        angle + 2.0 * FRAC_PI_2
    } else {
        angle
    }
}
