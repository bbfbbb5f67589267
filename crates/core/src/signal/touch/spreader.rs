//! From contacts to readings: the force of a contact is spread over the taxels that it touches.
//!
//! A taxel senses on a disc around it `(cannata)`. A sphere gives each disc a share of its force by the volume
//! of skin that it displaces under the disc, as in [`TouchSimulation`](crate::signal::TouchSimulation); a
//! point by the weights of the face that it touches. Taxels that do not work get nothing: their share goes to
//! the others.

use crate::contact::{ContactError, ContactIndex, FieldHit, ON_SKIN_SPACINGS, Query};
use crate::id::VertexId;
use crate::pyramid::LevelId;
use crate::signal::touch::sphere::Sphere;
use crate::signal::{Frame, SignalError};
use crate::skin::{PatchId, Presence};

/// A point or sphere that presses on the skin with a force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Press {
    /// The point that presses, or the centre of the sphere.
    pub at: Query,
    /// The radius of the sphere, in m; 0 for a point.
    pub radius: f64,
    /// Its force, in N.
    pub force: f64,
}

/// Spreads the forces of contacts over taxels, for simulators and tests.
///
/// ```
/// use dermatome::{
///     contact::{ContactIndex, IndexOptions, Query},
///     map::SkinMap, mesh::shapes, signal::{Press, Spreader}, skin::PatchId,
/// };
/// use glam::DVec3;
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let options = IndexOptions { fields: true, ..IndexOptions::default() };
/// let index = ContactIndex::with_options(&map, &options)?;
/// let spreader = Spreader { disc: 0.002, max_distance: None };
/// let mut frame = spreader.frame(&index, 0.0);
/// let at = Query::from(DVec3::new(0.05, 0.03, 0.009));
/// let press = Press { at, radius: 0.01, force: 1.5 };
/// assert!(spreader.add(&index, &press, &mut frame)?, "it touches");
/// let felt: f64 = frame.values[PatchId::new(0)][0].iter().sum();
/// assert!((felt - 1.5).abs() < 1e-12);
/// # Ok::<_, dermatome::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spreader {
    /// Radius of the discs on which taxels sense, in m.
    pub disc: f64,
    /// Distance from the skin up to which a point presses, in m; `None`: [`ON_SKIN_SPACINGS`] spacings of its
    /// patch.
    pub max_distance: Option<f64>,
}

/// The share of a force that a taxel gets.
struct Share {
    patch: PatchId,
    taxel: VertexId,
    /// Relative to those of the other taxels.
    weight: f64,
}

impl Spreader {
    /// A frame of the taxels of an index at a time (s) without any force, NaN for taxels that do not work.
    pub fn frame(&self, index: &ContactIndex, time: f64) -> Frame {
        let force = |p: &Presence| if *p == Presence::Present { 0.0 } else { f64::NAN };
        Frame {
            time,
            values: index.presence().map(|patch| vec![patch.map(force)]).collect(),
            ..Frame::default()
        }
    }

    /// Adds a force to the readings of the taxels that it touches, in N; the sum of the added readings is
    /// exactly the force. Returns `false`, and adds nothing, if nothing is touched. The index must have
    /// [fields](crate::contact::IndexOptions::fields) and the pose of the robot.
    ///
    /// # Errors
    /// As [`ContactIndex::locate`] and [`ContactIndex::fields_within`], if the force or a radius is not finite,
    /// if a radius or the largest distance is negative or not a number, or if the frame is not one of the
    /// taxels of the index.
    pub fn add(&self, index: &ContactIndex, press: &Press, frame: &mut Frame) -> Result<bool, SignalError> {
        let Press { at, radius, force } = *press;
        let is_radius = |length: &f64| *length >= 0.0 && length.is_finite();
        let wrong = [self.disc, radius].into_iter().find(|length| !is_radius(length));
        let is_negative = |length: &f64| *length < 0.0 || length.is_nan();
        if let Some(distance) = wrong.or(self.max_distance.filter(is_negative)) {
            return Err(ContactError::NoDistance { distance }.into());
        }
        if !force.is_finite() {
            return Err(SignalError::option("the force in N", force, "a finite number"));
        }
        check(index, frame)?;
        let mut shares = if radius > 0.0 { self.under(index, at, radius)? } else { Vec::new() };
        if shares.is_empty() {
            // A point, or a sphere between the discs or on taxels that do not work.
            let reach = if radius > 0.0 { Some(radius) } else { self.max_distance };
            shares = at_point(index, at, reach)?;
        }
        let sum: f64 = shares.iter().map(|share| share.weight).sum();
        let largest = (0..shares.len()).max_by(|&a, &b| shares[a].weight.total_cmp(&shares[b].weight));
        let Some(largest) = largest else { return Ok(false) };
        let grain = last_bit(force);
        let mut left = force;
        for (_, share) in shares.iter().enumerate().filter(|(k, _)| *k != largest) {
            let part = (force * (share.weight / sum) / grain).round() * grain;
            left -= part;
            frame.values[share.patch][0][share.taxel] += part;
        }
        // The rounding error goes to the largest share.
        frame.values[shares[largest].patch][0][shares[largest].taxel] += left;
        Ok(true)
    }

    /// The working taxels whose disc a sphere touches, by the volume of skin that it displaces under each.
    fn under(&self, index: &ContactIndex, centre: Query, radius: f64) -> Result<Vec<Share>, ContactError> {
        let sphere = Sphere { centre: centre.point, radius };
        let found = index.fields_within(centre, radius + self.disc, LevelId::new(0))?;
        let share = |hit: &FieldHit| {
            let weight = sphere.volume_under_disc(hit.position, hit.normal, self.disc);
            Share { patch: hit.patch, taxel: hit.field, weight }
        };
        let works = |hit: &&FieldHit| index.works(hit.patch, hit.field);
        Ok(found.iter().filter(works).map(share).filter(|share| share.weight > 0.0).collect())
    }
}

/// The working taxels of the face nearest to a point within `reach` (m), by its weights; the nearest
/// working taxel of the patch if none of them works.
fn at_point(index: &ContactIndex, query: Query, reach: Option<f64>) -> Result<Vec<Share>, ContactError> {
    let hit = index.locate(query)?;
    let patch = hit.patch;
    let spacing = index.spacing(patch).unwrap_or(0.0);
    if hit.distance.abs() > reach.unwrap_or(ON_SKIN_SPACINGS * spacing) {
        return Ok(Vec::new());
    }
    let mesh = index.mesh(patch);
    let corners = mesh.triangles[hit.point.face].into_iter().zip(hit.point.barycentric);
    let works = |taxel: VertexId| index.works(patch, taxel);
    let mut shares: Vec<_> = corners
        .filter(|(taxel, weight)| *weight > 0.0 && works(*taxel))
        .map(|(taxel, weight)| Share { patch, taxel, weight })
        .collect();
    if shares.is_empty() {
        let here = mesh.point(&hit.point);
        let away = |v: &VertexId| mesh.positions[*v].distance_squared(here);
        let working = mesh.positions.ids().filter(|&v| works(v));
        let nearest = working.min_by(|a, b| away(a).total_cmp(&away(b)));
        shares.extend(nearest.map(|taxel| Share { patch, taxel, weight: 1.0 }));
    }
    Ok(shares)
}

/// Refuses a frame without a channel with a value for each taxel.
fn check(index: &ContactIndex, frame: &Frame) -> Result<(), SignalError> {
    let needed = index.presence().map(|patch| patch.len());
    let found = frame.values.iter().map(|channels| channels.first().map_or(0, |values| values.len()));
    if needed.clone().eq(found.clone()) {
        return Ok(());
    }
    Err(SignalError::ForeignFrame { found: found.collect(), needed: needed.collect() })
}

/// The value of the last bit of a number: sums of its multiples are exact up to the number, in any order.
fn last_bit(number: f64) -> f64 {
    number.abs().next_up() - number.abs()
}
