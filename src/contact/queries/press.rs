//! Contacts to readings: the force of a contact, spread over the taxels that it touches.
//!
//! A taxel feels on a disc around it (cannata). A sphere gives each disc a share of its force by the
//! volume that it takes of the skin under the disc, as in the simulation of
//! [`TouchSimulation`](crate::signal::TouchSimulation); a point by the weights of the face that it touches.
//! Taxels that do not work feel nothing: their share goes to the others.

use crate::{
    contact::{ContactError, ContactIndex, FieldHit, Query},
    id::VertexId,
    map::{PatchMap, SkinMap},
    pyramid::LevelId,
    signal::{Frame, Sphere},
    skin::{PatchId, Presence},
};

/// Up to this many [spacings](ContactIndex::spacing) of its taxels a point is on the skin, unless a
/// distance is given.
pub const ON_SKIN_SPACINGS: f64 = 10.0;

/// Something that presses on the skin with a force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Press {
    /// The point that presses, or the centre of the sphere.
    pub at: Query,
    /// The radius of the sphere, in m; 0 for a point.
    pub radius: f64,
    /// Its force, in N.
    pub force: f64,
}

/// Spreads the forces of contacts over the taxels of a map, for simulators and tests.
///
/// ```
/// use dermatome::{
///     contact::{ContactIndex, IndexOptions, Press, Query, Spreader},
///     map::SkinMap, mesh::shapes, skin::PatchId,
/// };
/// use glam::DVec3;
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let index = ContactIndex::with(&map, &IndexOptions { fields: true, ..IndexOptions::default() })?;
/// let spreader = Spreader { map: &map, disc: 0.002, max_distance: None };
/// let mut frame = spreader.frame(0.0);
/// let at = Query::from(DVec3::new(0.05, 0.03, 0.009));
/// let press = Press { at, radius: 0.01, force: 1.5 };
/// assert!(spreader.add(&index, &press, &mut frame)?, "it touches");
/// let felt: f64 = frame.values[PatchId::new(0)][0].iter().sum();
/// assert!((felt - 1.5).abs() < 1e-12);
/// # Ok::<_, dermatome::contact::ContactError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Spreader<'a> {
    /// The map of the taxels.
    pub map: &'a SkinMap,
    /// Radius of the discs on which they feel, in m.
    pub disc: f64,
    /// Distance from the skin up to which a point presses, in m; `None`: [`ON_SKIN_SPACINGS`] spacings of its
    /// patch.
    pub max_distance: Option<f64>,
}

impl Spreader<'_> {
    /// A frame at a time (s) without any force, NaN for taxels that do not work.
    #[must_use]
    pub fn frame(&self, time: f64) -> Frame {
        let values = self.map.patches.map(|patch| {
            vec![patch.taxels.presence.map(|p| if *p == Presence::Present { 0.0 } else { f64::NAN })]
        });
        Frame { time, values }
    }

    /// Adds a force to the readings of the taxels that it touches, in N; the sum of what is added is
    /// the force, exactly. False if nothing is touched, then nothing is added. `index` is one of the same map,
    /// with [fields](crate::contact::IndexOptions::fields), posed as the robot is.
    ///
    /// # Errors
    /// As [`ContactIndex::locate`] and [`ContactIndex::fields_within`], if the force or a radius is not finite,
    /// or if a radius or the largest distance is negative or not a number.
    pub fn add(&self, index: &ContactIndex, press: &Press, frame: &mut Frame) -> Result<bool, ContactError> {
        let Press { at, radius, force } = *press;
        let is_radius = |length: &f64| *length >= 0.0 && length.is_finite();
        let wrong = [self.disc, radius].into_iter().find(|length| !is_radius(length));
        let is_negative = |length: &f64| *length < 0.0 || length.is_nan();
        if let Some(distance) = wrong.or(self.max_distance.filter(is_negative)) {
            return Err(ContactError::NoDistance { distance });
        }
        if !force.is_finite() {
            return Err(ContactError::NoForce { force });
        }
        let mut shares = if radius > 0.0 { self.under(index, at, radius)? } else { Vec::new() };
        if shares.is_empty() {
            // A point, or a sphere between the discs or on taxels that do not work.
            let reach = if radius > 0.0 { Some(radius) } else { self.max_distance };
            shares = self.at_point(index, at, reach)?;
        }
        let sum: f64 = shares.iter().map(|(.., share)| share).sum();
        let Some(largest) = (0..shares.len()).max_by(|&a, &b| shares[a].2.total_cmp(&shares[b].2)) else {
            return Ok(false);
        };
        let grain = last_bit(force);
        let mut left = force;
        for (k, &(patch, taxel, share)) in shares.iter().enumerate() {
            if k != largest {
                let part = (force * (share / sum) / grain).round() * grain;
                left -= part;
                frame.values[patch][0][taxel] += part;
            }
        }
        // What rounding leaves is the largest share's.
        let (patch, taxel, _) = shares[largest];
        frame.values[patch][0][taxel] += left;
        Ok(true)
    }

    /// The working taxels of the face nearest to a point within `reach` (m), by its weights; the nearest
    /// working taxel of the patch if none of them works.
    fn at_point(
        &self,
        index: &ContactIndex,
        query: Query,
        reach: Option<f64>,
    ) -> Result<Vec<(PatchId, VertexId, f64)>, ContactError> {
        let hit = index.locate(query)?;
        let spacing = index.spacing(hit.patch).unwrap_or(0.0);
        if hit.distance.abs() > reach.unwrap_or(ON_SKIN_SPACINGS * spacing) {
            return Ok(Vec::new());
        }
        let patch = &self.map.patches[hit.patch];
        let mesh = &patch.levels[LevelId::new(0)].level.mesh;
        let corners = mesh.triangles[hit.point.face].into_iter().zip(hit.point.barycentric);
        let mut shares: Vec<_> = corners
            .filter(|(v, weight)| *weight > 0.0 && works(patch, *v))
            .map(|(v, weight)| (hit.patch, v, weight))
            .collect();
        if shares.is_empty() {
            let here = mesh.point(&hit.point);
            let away = |v: &VertexId| mesh.positions[*v].distance_squared(here);
            let working = mesh.positions.ids().filter(|&v| works(patch, v));
            let nearest = working.min_by(|a, b| away(a).total_cmp(&away(b)));
            shares.extend(nearest.map(|v| (hit.patch, v, 1.0)));
        }
        Ok(shares)
    }

    /// The working taxels whose disc a sphere touches, and the volume that it takes of the skin under each.
    fn under(
        &self,
        index: &ContactIndex,
        centre: Query,
        radius: f64,
    ) -> Result<Vec<(PatchId, VertexId, f64)>, ContactError> {
        let sphere = Sphere { centre: centre.point, radius };
        let found = index.fields_within(centre, radius + self.disc, LevelId::new(0))?;
        let working = found.into_iter().filter(|hit| works(&self.map.patches[hit.patch], hit.field));
        let share = |hit: FieldHit| {
            (hit.patch, hit.field, sphere.volume_under_disc(hit.position, hit.normal, self.disc))
        };
        Ok(working.map(share).filter(|(.., share)| *share > 0.0).collect())
    }
}

/// The value of the last bit of a number: sums of its multiples are exact up to the number, in any order.
fn last_bit(number: f64) -> f64 {
    number.abs().next_up() - number.abs()
}

fn works(patch: &PatchMap, taxel: VertexId) -> bool {
    patch.taxels.presence[taxel] == Presence::Present
}
