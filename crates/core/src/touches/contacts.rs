//! The contacts of each touch: its terms in the normal equations of its taxel, or the mean of where the body was.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};

use crate::calib::{
    ContactMeasurement, ContactObservation, Information, Observations, TaxelVariable, TouchJoint, TouchRow,
    TouchingBody, outer,
};
use crate::id::VertexId;
use crate::numeric::symmetric_eigen;
use crate::skin::TaxelId;
use crate::touches::delay::LogDelay;
use crate::touches::estimate::{Estimates, LEAST_SAMPLES};
use crate::touches::fit::{Estimate, Noise, Residual};
use crate::touches::gather::{Sample, Samples};
use crate::touches::log::{TouchFrame, TouchLog};
use crate::touches::options::{ARM_NOISE, TAXEL_RADIUS, TouchesOptions};
use crate::touches::sides::outwards;
use crate::touches::spikes::LeftOutReading;

/// What one touch says about one taxel.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchContact {
    /// The taxel.
    pub taxel: TaxelId,
    /// The number of the touch in the log.
    pub touch: u64,
    /// The number of its contact in the log, if it has one.
    pub contact: Option<u64>,
    /// The time of the last frame of the touch with the taxel, in s, if the log has times.
    pub time: Option<f64>,
    /// Where the taxel is, in the frame of the link, in m.
    pub position: DVec3,
    /// Its information (inverse covariance), in 1/m^2. Directions about which the touch says nothing have none.
    pub information: Information<3>,
    /// How much it counts in the mean of its touch: its share of the readings, times the number of taxels.
    pub weight: f64,
    /// The orientation of the body in the frame of the link, if the log has it: the mean over the touch.
    pub body_rotation: Option<DQuat>,
    /// The body in the frame of the link: its mean over the touch, weighted by the sum of the readings. `None` for a plane.
    pub body: Option<TouchingBody>,
    /// The direction in which the readings of the touch fell as the body moved, which is outwards; its length is in standard
    /// deviations, 0 where the touch does not tell. `None` if the log has no readings.
    pub outward: Option<DVec3>,
    /// The path of the body in the touch, in the frame of the link: the direction along which its positions differ most, its length
    /// their standard deviation, in m. `None` if the log has no readings.
    pub path: Option<DVec3>,
    /// The velocity of the body in the frame of the link, in m/s: the mean over the touch, weighted by the readings. `None` if frames have no time,
    /// or the delay of the readings is given.
    pub velocity: Option<DVec3>,
    /// How the body moves, in the frame of the link, with the value of each of [`TouchContacts::joints`]: the mean over the touch;
    /// empty if the log does not know it.
    pub by_joints: Vec<DVec3>,
}

/// Contacts, and how they were found.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchContacts {
    /// By touch in the order of the log, then by taxel.
    pub contacts: Vec<TouchContact>,
    /// The joints with which touches move, if the log knows it.
    pub joints: Vec<TouchJoint>,
    /// Numbers for messages.
    pub summary: TouchesSummary,
}

impl TouchContacts {
    /// What [`calibrate()`](crate::calib::calibrate()) takes: the same as the table of contacts, without times.
    pub fn observations(&self) -> Observations {
        let mut observations = Observations { joints: self.joints.clone(), ..Observations::default() };
        let mut vertices: BTreeMap<TaxelId, VertexId> =
            self.contacts.iter().map(|contact| (contact.taxel, VertexId::default())).collect();
        for (&id, vertex) in &mut vertices {
            *vertex = observations.taxels.push(TaxelVariable { id, initial: None, fixed: false });
        }
        for contact in &self.contacts {
            let TouchContact { position, information, .. } = *contact;
            let measurement = ContactMeasurement::Position { position, information };
            let taxel = vertices.get(&contact.taxel).copied().unwrap_or_default();
            observations.contacts.push(ContactObservation { taxel, measurement });
            observations.touches.push(TouchRow {
                touch: Some(contact.touch),
                contact: contact.contact,
                weight: contact.weight,
                probe: contact.body_rotation,
                body: contact.body,
                outward: contact.outward,
                path: contact.path,
                velocity: contact.velocity,
                by_joints: contact.by_joints.clone(),
            });
        }
        observations
    }
}

/// How contacts were found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TouchesSummary {
    /// Number of frames of the log.
    pub frames: usize,
    /// Number of touches with an active taxel that is not left out.
    pub touches: usize,
    /// How many of these have no contact.
    pub empty_touches: usize,
    /// How many of these do not have the radius of the body.
    pub touches_without_radius: usize,
    /// Number of taxels with a contact.
    pub taxels: usize,
    /// Taxels of the log without a contact, though they are not left out by the options.
    pub lost_taxels: usize,
    /// Number of readings of taxels that are not left out by the options.
    pub readings: usize,
    /// How many of them were found from the profile of their readings; the others are means of positions.
    pub fitted: usize,
    /// Readings that were left out since no neighbour of their taxel was active.
    pub lone: usize,
    /// Readings that were left out since their taxel does not give them, by row and taxel.
    pub spikes: Vec<LeftOutReading>,
    /// Frames that were left out since the log has no pose at their time: the readings are late by more.
    pub untimed: usize,
    /// How late the readings are; `None` if the touches do not tell.
    pub delay: Option<LogDelay>,
    /// Standard deviation of the position of the arm, per axis, in m, as estimated or given.
    pub arm_noise: f64,
    /// Standard deviation of readings, in their unit, if they were fitted.
    pub reading_noise: Option<f64>,
    /// Whether readings differ by more than twice the usual largest one from what spheres of the radii give: a radius or poses are wrong,
    /// or the noise of the arm is some millimetres.
    pub unlike_spheres: bool,
    /// Distance of neighbouring taxels, in m, if there are several.
    pub spacing: Option<f64>,
    /// Rows in which the centre of the sphere is inside the skin as drawn.
    pub inside: Vec<usize>,
}

/// The velocity of the body in the frame of the link in each frame, in m/s, from the frames before and after in its touch; zero where
/// these are far apart in time. `None` if a frame has no time.
fn velocities(frames: &[TouchFrame]) -> Option<Vec<DVec3>> {
    /// In s.
    const LONGEST: f64 = 0.5;
    let mut all = Vec::with_capacity(frames.len());
    for touch in frames.chunk_by(|a, b| a.touch == b.touch) {
        let at = |frame: &TouchFrame| Some((frame.time?, frame.link.inverse().apply(frame.body.point())));
        let places = touch.iter().map(at).collect::<Option<Vec<(f64, DVec3)>>>()?;
        for k in 0..places.len() {
            let ((start, from), (end, to)) =
                (places[k.saturating_sub(1)], places[(k + 1).min(places.len() - 1)]);
            let is_near = end > start && end - start <= LONGEST;
            all.push(if is_near { (to - from) / (end - start) } else { DVec3::ZERO });
        }
    }
    Some(all)
}

/// The samples of one taxel in one touch.
struct Group<'a> {
    taxel: VertexId,
    touch: usize,
    samples: &'a [Sample],
}

/// Sums over the readings of a touch.
#[derive(Debug, Clone, Default)]
struct TouchMean {
    weight: f64,
    centre: DVec3,
    /// The columns of the sum of `c c^T`, `c` the centre.
    squares: [DVec3; 3],
    /// The sum of the radii that are known, and of the readings of these frames.
    radius: [f64; 2],
    rotation: Option<DQuat>,
    is_plane: bool,
    outward: DVec3,
    /// The sum of the velocities; `None` if a frame has no time.
    velocity: Option<DVec3>,
    /// Sums of how the body moves with joints.
    by_joints: Vec<DVec3>,
}

impl TouchMean {
    fn body(&self) -> Option<TouchingBody> {
        let is_known = !self.is_plane && self.weight > 0.0;
        let share = self.weight.recip();
        let [radii, of] = self.radius;
        let radius = if of > 0.0 { radii / of } else { 0.0 };
        is_known.then(|| TouchingBody { centre: share * self.centre, radius })
    }

    /// The direction along which the centres differ most, and their standard deviation.
    fn path(&self) -> DVec3 {
        let c = self.centre / self.weight;
        let spread: [[f64; 3]; 3] =
            std::array::from_fn(|k| (self.squares[k] / self.weight - c[k] * c).to_array());
        let (values, vectors) = symmetric_eigen(&spread);
        let along =
            |k: usize| values[k].max(0.0).sqrt() * DVec3::from_array([0, 1, 2].map(|row| vectors[row][k]));
        let longer = |a: DVec3, b: DVec3| if a.length_squared() < b.length_squared() { b } else { a };
        longer(longer(along(0), along(1)), along(2))
    }
}

/// What all touches together say about a taxel.
struct Fitted {
    at: Estimate,
    /// The information about its position, in which gain and frames are unknown.
    information: DMat3,
    /// The gain that fits best moves by this when the position moves by one.
    gain_per_position: DVec3,
    /// Turns the information of one touch, in which the frames are known, into its part of `information`.
    share: DMat3,
    /// How much of the errors of the arm is left in the position.
    arm_scale: f64,
}

/// What one touch says about a taxel.
struct Part {
    information: DMat3,
    /// How far it is off the estimate by the readings, and by the arm, in m.
    by_readings: DVec3,
    by_arm: DVec3,
}

/// The contacts of a log.
pub(super) struct Rows<'a> {
    pub(super) log: &'a TouchLog,
    pub(super) samples: &'a Samples,
    pub(super) estimates: &'a Estimates,
    pub(super) options: &'a TouchesOptions,
}

impl Rows<'_> {
    pub(super) fn collect(&self) -> TouchContacts {
        let Self { log, samples, estimates, .. } = self;
        let (mut contacts, means) = (Vec::new(), self.means());
        let mut fitted = 0;
        for (taxel, of) in samples.of.enumerate() {
            let groups: Vec<Group<'_>> = of
                .chunk_by(|a, b| a.touch == b.touch)
                .map(|samples| Group { taxel, touch: samples[0].touch, samples })
                .collect();
            let fit = self.fitted(taxel);
            fitted += usize::from(fit.is_some());
            let found = match fit {
                Some(fit) => self.shares(&groups, &fit),
                None => groups.iter().map(|group| self.mean(group)).collect(),
            };
            let rows = groups.iter().zip(found);
            contacts.extend(rows.map(|(group, (at, information))| {
                (group.touch, self.row(group, at, information, &means[group.touch]))
            }));
        }
        contacts.sort_by_key(|(touch, contact): &(usize, TouchContact)| (*touch, contact.taxel));
        let mut contacts: Vec<TouchContact> = contacts.into_iter().map(|(_, contact)| contact).collect();
        for touch in contacts.chunk_by_mut(|a, b| a.touch == b.touch) {
            let mean = touch.iter().map(|contact| contact.weight).sum::<f64>() / touch.len() as f64;
            touch.iter_mut().for_each(|contact| contact.weight /= mean);
        }
        let used = contacts.chunk_by(|a, b| a.touch == b.touch).count();
        let summary = TouchesSummary {
            frames: log.frames.len(),
            touches: samples.touches.len(),
            empty_touches: samples.touches.len() - used,
            touches_without_radius: means
                .iter()
                .filter(|m| !m.is_plane && m.weight > 0.0 && m.radius[1] == 0.0)
                .count(),
            taxels: samples.of.iter().filter(|of| !of.is_empty()).count(),
            lost_taxels: samples.of.iter().filter(|of| of.is_empty()).count(),
            readings: samples.of.iter().map(Vec::len).sum::<usize>()
                + estimates.lone
                + estimates.spikes.len(),
            fitted,
            lone: estimates.lone,
            spikes: estimates.spikes.clone(),
            untimed: 0,
            delay: estimates.delay,
            arm_noise: self.arm_noise(),
            reading_noise: (fitted > 0).then_some(estimates.noise.reading),
            unlike_spheres: false,
            spacing: estimates.spacing,
            inside: self.options.rows_inside(log),
        };
        TouchContacts { contacts, joints: log.joints.clone(), summary }
    }

    /// Where the body was in each touch.
    fn means(&self) -> Vec<TouchMean> {
        let mut means = vec![TouchMean::default(); self.samples.touches.len()];
        let velocities = velocities(&self.log.frames);
        for sample in self.samples.of.iter().flatten() {
            let (mean, frame) = (&mut means[sample.touch], &self.log.frames[sample.frame]);
            mean.weight += sample.reading;
            mean.centre += sample.reading * sample.centre;
            for (column, x) in mean.squares.iter_mut().zip(sample.centre.to_array()) {
                *column += sample.reading * x * sample.centre;
            }
            if sample.radius > 0.0 {
                mean.radius =
                    [mean.radius[0] + sample.reading * sample.radius, mean.radius[1] + sample.reading];
            }
            mean.velocity = velocities
                .as_ref()
                .map(|all| mean.velocity.unwrap_or(DVec3::ZERO) + sample.reading * all[sample.frame]);
            mean.is_plane |= sample.plane.is_some();
            mean.by_joints.resize(self.log.joints.len(), DVec3::ZERO);
            for (sum, column) in mean.by_joints.iter_mut().zip(&frame.by_joints) {
                *sum += sample.reading * *column;
            }
            if let Some(q) = frame.body_rotation {
                let turned = (frame.link.rotation.conjugate() * q).normalize();
                // Opposite quaternions are one rotation.
                let sign = if mean.rotation.is_some_and(|sum| sum.dot(turned) < 0.0) { -1.0 } else { 1.0 };
                let sum = mean.rotation.unwrap_or(turned * 0.0);
                mean.rotation = Some(sum + turned * (sign * sample.reading));
            }
        }
        let pieces = outwards(self.samples, self.log.frames.len());
        for touch in pieces.chunk_by(|a, b| a.touch == b.touch) {
            let told =
                touch.iter().map(|piece| piece.direction).filter(|direction| *direction != DVec3::ZERO);
            let count = told.clone().count().max(1) as f64;
            means[touch[0].touch].outward = told.sum::<DVec3>() / count.sqrt();
        }
        means
    }

    fn row(&self, group: &Group<'_>, position: DVec3, information: DMat3, mean: &TouchMean) -> TouchContact {
        let frame = &self.log.frames[group.samples[0].frame];
        let columns = information.to_cols_array_2d();
        let symmetric =
            std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (columns[i][j] + columns[j][i])));
        let total = group.samples.iter().map(|sample| sample.reading).sum::<f64>();
        TouchContact {
            taxel: self.samples.ids[group.taxel],
            touch: frame.touch,
            contact: frame.contact,
            time: group.samples.last().and_then(|sample| self.log.frames[sample.frame].time),
            position,
            information: Information(symmetric),
            weight: total,
            body_rotation: mean.rotation.map(DQuat::normalize),
            body: mean.body(),
            outward: self.log.has_readings.then_some(mean.outward),
            path: self.log.has_readings.then(|| mean.path()),
            velocity: mean.velocity.filter(|_| self.options.delay.is_none()).map(|sum| sum / mean.weight),
            by_joints: mean.by_joints.iter().map(|sum| *sum / mean.weight).collect(),
        }
    }

    /// What all touches together say about a taxel; `None` if that is not more than where they were.
    fn fitted(&self, v: VertexId) -> Option<Fitted> {
        let Estimates { contact, noise, gains, .. } = *self.estimates;
        let at = self.estimates.fits[v]?;
        let samples = &self.samples.of[v];
        let covariance = self.estimates.covariances[v];
        let (variances, _) = symmetric_eigen(&covariance.to_cols_array_2d());
        let most = variances.into_iter().fold(0.0, f64::max);
        if samples.len() < LEAST_SAMPLES || most > (0.5 * contact).powi(2) {
            return None;
        }
        let (mut both, mut gain) = (DVec3::ZERO, gains.sigma.powi(-2));
        for (weight, residual) in self.terms(v, samples, &at) {
            both += weight * residual.by_gain * residual.by_position;
            gain += weight * residual.by_gain * residual.by_gain;
        }
        let gain_per_position = both / gain;
        let whole = self.normal_equations(v, samples, &at, gain_per_position).0;
        let information = covariance.inverse();
        let share = power(information, 0.5)? * power(whole, -0.5)?;
        let expected = noise.arm / (samples.len() as f64).sqrt();
        let trace = variances.into_iter().sum::<f64>();
        let arm_scale = ((trace / 3.0).sqrt() / expected).min(1.0);
        Some(Fitted { at, information, gain_per_position, share, arm_scale })
    }

    /// The residuals of some samples, with the true positions of the body, and their weights.
    fn terms(&self, v: VertexId, samples: &[Sample], at: &Estimate) -> impl Iterator<Item = (f64, Residual)> {
        let noise = Noise { arm: 0.0, ..self.estimates.noise };
        samples.iter().filter_map(move |sample| {
            let place = self.estimates.places.get(sample.frame).copied().flatten()?;
            let sample = Sample { centre: place.centre, ..*sample };
            let residual = self.estimates.taxel(self.samples, v)?.residual(&sample, at)?;
            Some((residual.weight(noise), residual))
        })
    }

    /// Information and gradient of some samples. What a change of the gain would explain as well says nothing about the
    /// position.
    fn normal_equations(
        &self,
        v: VertexId,
        samples: &[Sample],
        at: &Estimate,
        gain_per_position: DVec3,
    ) -> (DMat3, DVec3) {
        let (mut information, mut gradient) = (DMat3::ZERO, DVec3::ZERO);
        for (weight, residual) in self.terms(v, samples, at) {
            let row = residual.by_position - residual.by_gain * gain_per_position;
            information += weight * outer(row, row);
            gradient -= weight * residual.distance * row;
        }
        (information, gradient)
    }

    /// The mean error of the arm in some samples, in m, weighted by the readings.
    fn arm_error(&self, samples: &[Sample]) -> DVec3 {
        let total = samples.iter().map(|sample| sample.reading).sum::<f64>();
        let error = |sample: &Sample| {
            let place = self.estimates.places.get(sample.frame).copied().flatten();
            place.map_or(DVec3::ZERO, |place| sample.reading * (place.believed - place.centre))
        };
        samples.iter().map(error).sum::<DVec3>() / total
    }

    /// The terms of each touch. Their information adds up to that of the taxel, and their weighted mean is its position. A
    /// touch differs from the others by its residuals, and by the error of its arm as far as it is left in the position, so
    /// that a touch that does not fit shows.
    fn shares(&self, groups: &[Group<'_>], fit: &Fitted) -> Vec<(DVec3, DMat3)> {
        let reach = self.estimates.contact + self.options.taxel_radius.unwrap_or(TAXEL_RADIUS);
        // Along directions about which a touch says nothing it stays with the others.
        let stay = DMat3::from_diagonal(DVec3::splat(reach.powi(-2)));
        let back = fit.share.transpose().inverse();
        let part = |group: &Group<'_>| {
            let (own, gradient) =
                self.normal_equations(group.taxel, group.samples, &fit.at, fit.gain_per_position);
            Part {
                information: fit.share * own * fit.share.transpose(),
                by_readings: back * ((own + stay).inverse() * gradient),
                by_arm: fit.arm_scale * self.arm_error(group.samples),
            }
        };
        let parts: Vec<Part> = groups.iter().map(part).collect();
        let off = |part: &Part| part.by_readings + part.by_arm;
        let mean =
            fit.information.inverse() * parts.iter().map(|part| part.information * off(part)).sum::<DVec3>();
        parts.iter().map(|part| (fit.at.position + off(part) - mean, part.information)).collect()
    }

    /// The mean of the positions of the body in a touch.
    fn mean(&self, group: &Group<'_>) -> (DVec3, DMat3) {
        let Estimates { depth, contact, spacing, .. } = *self.estimates;
        let (mut centre, mut weights, mut radius) = (DVec3::ZERO, 0.0, 0.0);
        let mut plane = DVec3::ZERO;
        let largest = group.samples.iter().map(|sample| sample.reading).fold(0.0, f64::max);
        for sample in group.samples {
            let weight = if self.log.has_readings { (sample.reading / largest).powi(2) } else { 1.0 };
            centre += weight * sample.centre;
            radius += weight * sample.radius;
            plane += weight * sample.plane.unwrap_or(DVec3::ZERO);
            weights += weight;
        }
        (centre, radius) = (centre / weights, radius / weights);
        let arm = self.arm_noise().max(LEAST_NOISE);
        // Of a taxel without neighbours, a point of it: half the radius of a disc is the deviation along each axis.
        let alone = 0.5 * self.options.taxel_radius.unwrap_or(TAXEL_RADIUS);
        let across = (0.5 * contact).max(spacing.map_or(alone, |spacing| spacing / 12_f64.sqrt())).max(arm);
        if let Some(outward) = plane.try_normalize() {
            // A plane says how high the skin is, not where along it.
            let along = (arm * arm + depth * depth).powf(-1.0);
            let n = outward;
            return (centre, along * outer(n, n));
        }
        let isotropic = DMat3::from_diagonal(DVec3::splat(across.powi(-2)));
        let Some(n) = self.estimates.normals[group.taxel].filter(|_| radius > 0.0) else {
            return (centre, isotropic);
        };
        let depth = depth.min(radius);
        let along = (arm * arm + depth * depth).recip() - across.powi(-2);
        (centre - (radius - depth) * n, isotropic + along * outer(n, n))
    }

    fn arm_noise(&self) -> f64 {
        let is_fitted = self.estimates.fits.iter().any(Option::is_some);
        self.options.arm_noise.unwrap_or(if is_fitted { self.estimates.noise.arm } else { ARM_NOISE })
    }
}

/// Least noise of an arm (m) in a contact without a fit: that of one said to be exact, whose information is finite.
const LEAST_NOISE: f64 = 1e-6;

/// A power of a positive definite matrix; `None` if it is not one.
fn power(matrix: DMat3, exponent: f64) -> Option<DMat3> {
    let (values, vectors) = symmetric_eigen(&matrix.to_cols_array_2d());
    let mut sum = DMat3::ZERO;
    for (k, value) in values.into_iter().enumerate() {
        if !(value > 0.0 && value.is_finite()) {
            return None;
        }
        let v = DVec3::from_array([0, 1, 2].map(|row| vectors[row][k]));
        sum += value.powf(exponent) * outer(v, v);
    }
    Some(sum)
}
