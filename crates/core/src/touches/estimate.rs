//! All taxels together: first guesses, then positions, normals, gains and noise in turn.

use glam::{DMat3, DVec3};

use crate::id::{IdVec, VertexId};
use crate::numeric::{median, nth_smallest};
use crate::parallel::par_ids;
use crate::run::Run;
use crate::touches::TouchesError;
use crate::touches::bundle::{Bundle, Place};
use crate::touches::delay::LogDelay;
use crate::touches::fit::{Estimate, GainPrior, Guess, Noise, Taxel};
use crate::touches::gather::{Sample, Samples};
use crate::touches::log::{TouchFrame, TouchLog};
use crate::touches::profile::Profile;
use crate::touches::sides;
use crate::touches::spikes::{LeftOutReading, drop_gross, drop_unfit, usual_largest};
use crate::touches::surface;

/// Rounds in which noise and gains follow from each taxel on its own.
const FIRST_ROUNDS: usize = 3;

/// Rounds of the bundle adjustment, before each of which normals follow from the positions of the round before.
const ROUNDS: usize = 4;

/// Steps of the first of these rounds, and of each other one.
const FIRST_STEPS: usize = 9;
const STEPS: usize = 3;

/// A taxel with fewer samples is not fitted: there are four unknowns.
pub(super) const LEAST_SAMPLES: usize = 6;

/// Noise of readings at the start of the bundle adjustment, in typical readings: a large one keeps frames near the arm until
/// taxels are near their positions.
const START_READING: f64 = 0.1;

/// Least standard deviation of the arm, in m: the table of the profile and the disc are no better.
const LEAST_ARM: f64 = 1e-5;

/// Noise in the first round: in spacings, and in typical readings.
const FIRST_ARM: f64 = 0.05;
const FIRST_READING: f64 = 0.02;

/// Readings are never more exact than this share of a typical one.
const LEAST_READING: f64 = 1e-3;

/// The share of the usual largest reading from which on a sample counts for the first guess.
const STRONG: f64 = 0.5;

/// Samples farther from the first guess than this many reaches of a contact are not of this taxel.
const FARTHEST_REACHES: f64 = 1.6;

/// Least spread of the logarithms of gains.
const LEAST_GAIN_SPREAD: f64 = 1e-3;

/// What is known before.
pub(super) struct Known {
    /// Distance of neighbours in a drawing, in m.
    pub(super) spacing: Option<f64>,
    /// Normals from a drawing of the skin, one for each taxel.
    pub(super) normals: Option<IdVec<VertexId, DVec3>>,
    /// Neighbours from a drawing.
    pub(super) neighbours: Option<IdVec<VertexId, Vec<VertexId>>>,
    pub(super) taxel_radius: f64,
    /// Readings over mean depths, in 1/m.
    pub(super) gain: Option<f64>,
    pub(super) arm_noise: Option<f64>,
}

/// What the samples say about all taxels.
pub(super) struct Estimates {
    /// Distance of neighbours, in m, if there are several taxels.
    pub(super) spacing: Option<f64>,
    pub(super) profiles: Vec<Profile>,
    pub(super) normals: IdVec<VertexId, Option<DVec3>>,
    /// The weighted means of the body's positions.
    pub(super) centres: IdVec<VertexId, DVec3>,
    /// Those of taxels that could be fitted.
    pub(super) fits: IdVec<VertexId, Option<Estimate>>,
    /// Covariances of the positions of these, in m^2.
    pub(super) covariances: IdVec<VertexId, DMat3>,
    /// Where the body was in each frame, if a fitted taxel felt it.
    pub(super) places: Vec<Option<Place>>,
    pub(super) noise: Noise,
    pub(super) gains: GainPrior,
    /// The depth of a contact (m) and the radius of its area (m), as far as they are known: 0 without a radius.
    pub(super) depth: f64,
    pub(super) contact: f64,
    /// Whether the normals have a side.
    pub(super) has_outside: bool,
    pub(super) lone: usize,
    /// Readings that their taxel does not give.
    pub(super) spikes: Vec<LeftOutReading>,
    /// How late the readings are, if the touches tell.
    pub(super) delay: Option<LogDelay>,
}

/// Estimates everything; drops samples that are not of their taxel.
pub(super) fn estimate(
    samples: &mut Samples,
    known: &Known,
    log: &TouchLog,
    run: Run<'_>,
) -> Result<Estimates, TouchesError> {
    let (has_readings, frames) = (log.has_readings, log.frames.len());
    let spikes = if has_readings { drop_gross(samples, log) } else { Vec::new() };
    let mut centres = samples.of.map(|of| strong_centre(of.as_slice()));
    let spacing_of =
        |centres: &IdVec<VertexId, DVec3>| known.spacing.or_else(|| surface::spacing_of_guesses(centres));
    let mut spacing = spacing_of(&centres);
    let mut alone = samples.of.map(|_| Vec::new());
    if has_readings && samples.of.len() > 1 {
        let near;
        let neighbours = match (&known.neighbours, spacing) {
            (Some(known), _) => known,
            (None, spacing) => {
                near = surface::neighbours(&centres, 2.0 * spacing.unwrap_or(0.0).max(f64::MIN_POSITIVE));
                &near
            }
        };
        alone = samples.take_lone(neighbours);
        centres = samples
            .of
            .enumerate()
            .map(|(v, of)| if of.is_empty() { centres[v] } else { strong_centre(of) })
            .collect();
        spacing = spacing_of(&centres);
    }
    let radii = radii(samples);
    let profiles: Vec<Profile> =
        radii.iter().map(|&radius| Profile::new(radius, known.taxel_radius)).collect();
    let (normals, has_outside) = normals_of(samples, &centres, spacing, (known, frames));
    let (depth, contact) = typical_contact(samples, &centres, &normals, known.taxel_radius);
    let reach = FARTHEST_REACHES * (contact + known.taxel_radius);
    let lone = if profiles.is_empty() {
        alone.iter().map(Vec::len).sum()
    } else {
        samples.keep_near(&alone, &centres, reach.max(spacing.unwrap_or(0.0)))
    };
    let mut all = Estimates {
        spacing,
        profiles,
        fits: centres.map(|_| None),
        covariances: centres.map(|_| DMat3::ZERO),
        places: Vec::new(),
        noise: Noise {
            arm: known.arm_noise.unwrap_or(FIRST_ARM * spacing.unwrap_or(0.0)).max(LEAST_ARM),
            reading: 0.0,
            least_reading: 0.0,
        },
        gains: GainPrior { log_gain: 0.0, sigma: f64::INFINITY },
        normals,
        depth,
        contact,
        centres,
        has_outside,
        lone,
        spikes,
        delay: None,
    };
    if !has_readings || all.profiles.is_empty() {
        return Ok(all);
    }
    all.start(samples, known);
    for _ in 0..FIRST_ROUNDS {
        all.fit(samples);
        all.learn(samples, known);
    }
    all.noise.reading = all.noise.reading.max(START_READING / LEAST_READING * all.noise.least_reading);
    for round in 0..ROUNDS {
        if known.normals.is_none() {
            all.update_normals();
        }
        let spikes = all.adjust(samples, &log.frames, if round == 0 { FIRST_STEPS } else { STEPS }, run)?;
        if round + 1 < ROUNDS {
            all.spikes.extend(drop_unfit(samples, log, &spikes));
        }
    }
    all.spikes.sort_by_key(|spike| (spike.row, spike.taxel));
    Ok(all)
}

impl Estimates {
    /// The first guess of a position.
    pub(super) fn guess(&self, v: VertexId) -> DVec3 {
        let radius = self.profiles.first().map_or(0.0, |profile| profile.radius);
        self.centres[v] - (radius - self.depth).max(0.0) * self.normals[v].unwrap_or(DVec3::ZERO)
    }

    /// First noise and gain: the depth in the middle of a contact gives the largest readings.
    fn start(&mut self, samples: &Samples, known: &Known) {
        let Some(profile) = self.profiles.first() else { return };
        let middle = profile.at(0.0, profile.radius - self.depth).depth;
        // The median over taxels is robust; the usual largest reading of each would be too small.
        let largest = |of: &Vec<Sample>| of.iter().map(|sample| sample.reading).fold(0.0, f64::max);
        let typical = median(samples.of.iter().map(largest).filter(|&x| x > 0.0)).unwrap_or(1.0);
        self.noise.reading = FIRST_READING * typical;
        self.noise.least_reading = LEAST_READING * typical;
        self.gains.log_gain = libm::log(typical / middle.max(f64::MIN_POSITIVE));
        if let Some(gain) = known.gain {
            self.gains = GainPrior { log_gain: libm::log(gain), sigma: LEAST_GAIN_SPREAD };
        }
        self.fits = self
            .centres
            .enumerate()
            .map(|(v, _)| {
                let enough = samples.of[v].len() >= LEAST_SAMPLES && self.normals[v].is_some();
                enough.then(|| Estimate { position: self.guess(v), log_gain: self.gains.log_gain })
            })
            .collect();
    }

    pub(super) fn taxel<'a>(&'a self, samples: &'a Samples, v: VertexId) -> Option<Taxel<'a>> {
        let guess = Guess { position: self.guess(v), sigma: self.contact };
        Some(Taxel { normal: self.normals[v]?, guess, samples: &samples.of[v], profiles: &self.profiles })
    }

    fn fit(&mut self, samples: &Samples) {
        let fitted = |v: VertexId| {
            let start = self.fits[v]?;
            Some(self.taxel(samples, v)?.fit(start, self.noise, self.gains))
        };
        self.fits = par_ids(self.fits.len(), fitted);
    }

    /// Normals of the surface through the taxels.
    fn update_normals(&mut self) {
        let Some(spacing) = self.spacing else { return };
        let points: IdVec<VertexId, DVec3> =
            self.fits.enumerate().map(|(v, fit)| fit.map_or(self.guess(v), |fit| fit.position)).collect();
        let found = surface::normals(&points, spacing);
        for (normal, new) in self.normals.iter_mut().zip(found) {
            if let (Some(old), Some(new)) = (*normal, new) {
                *normal = Some(if new.dot(old) < 0.0 { -new } else { new });
            }
        }
    }

    /// All taxels and frames together; returns the spikes of each frame.
    fn adjust(
        &mut self,
        samples: &Samples,
        frames: &[TouchFrame],
        steps: usize,
        run: Run<'_>,
    ) -> Result<Vec<Vec<VertexId>>, TouchesError> {
        let guesses = self.fits.ids().map(|v| self.guess(v)).collect();
        let taxels = self.fits.ids().map(|v| self.taxel(samples, v)).collect();
        let fits = self.fits.clone();
        let (noise, gains, sigma) = (self.noise, self.gains, self.contact);
        let mut bundle =
            Bundle::new(samples, (frames, &self.places), taxels, fits, noise, gains, (guesses, sigma));
        let adjusted = bundle.adjust(steps, run)?;
        let spikes = bundle.spikes();
        self.fits = adjusted.estimates;
        self.covariances = adjusted.covariances;
        self.places = adjusted.places;
        self.noise = adjusted.noise;
        self.delay = adjusted.delay;
        Ok(spikes)
    }

    /// Noise from the residuals, and what gains have in common.
    fn learn(&mut self, samples: &Samples, known: &Known) {
        let mut moments = Moments::default();
        let mut gains = Vec::new();
        for (v, fit) in self.fits.enumerate() {
            let (Some(fit), Some(taxel)) = (fit, self.taxel(samples, v)) else { continue };
            let count = samples.of[v].len() as f64;
            // Four numbers were fitted to the distances.
            let freedom = count / (count - 4.0).max(1.0);
            for (_, residual) in taxel.residuals(fit) {
                let variance = residual.variance(self.noise);
                let square = (freedom * residual.distance.powi(2)).min(9.0 * variance);
                moments.add(square, residual.per_reading.powi(2), variance.powi(-2));
            }
            let information = taxel.normal_equations(fit, self.noise, self.gains).gain_information();
            gains.push((fit.log_gain, information));
        }
        let (arm, reading) = moments.solve(known.arm_noise.map(|arm| arm * arm));
        self.noise = Noise {
            arm: arm.sqrt().max(LEAST_ARM),
            reading: reading.sqrt().max(self.noise.least_reading),
            ..self.noise
        };
        if known.gain.is_none() && gains.len() > 2 {
            self.gains = common_gain(&gains);
        }
    }
}

/// The mean and the spread of gains, each with its information.
fn common_gain(gains: &[(f64, f64)]) -> GainPrior {
    let Some(middle) = median(gains.iter().map(|gain| gain.0)) else {
        return GainPrior { log_gain: 0.0, sigma: f64::INFINITY };
    };
    // Robust: the median of squares of a normal distribution is 0.455 of its variance.
    let square = median(gains.iter().map(|gain| (gain.0 - middle).powi(2))).unwrap_or(0.0) / 0.455;
    let explained = median(gains.iter().filter(|g| g.1 > 0.0).map(|gain| gain.1.recip())).unwrap_or(0.0);
    let spread = (square - explained).max(0.0).sqrt().max(0.3 * square.sqrt()).max(LEAST_GAIN_SPREAD);
    GainPrior { log_gain: middle, sigma: spread }
}

/// Weighted sums for two variances: of the arm, and of readings over their slopes.
#[derive(Debug, Default)]
struct Moments {
    ones: f64,
    slopes: f64,
    squares: f64,
    by_one: f64,
    by_slope: f64,
}

impl Moments {
    fn add(&mut self, square: f64, slope: f64, weight: f64) {
        self.ones += weight;
        self.slopes += weight * slope;
        self.squares += weight * slope * slope;
        self.by_one += weight * square;
        self.by_slope += weight * slope * square;
    }

    /// The two variances, none negative; the first may be known.
    fn solve(&self, arm: Option<f64>) -> (f64, f64) {
        let alone = |arm: f64| ((self.by_slope - arm * self.slopes) / self.squares).max(0.0);
        if let Some(arm) = arm {
            return (arm, alone(arm));
        }
        let determinant = self.ones * self.squares - self.slopes * self.slopes;
        if determinant <= 1e-9 * self.ones * self.squares {
            return (self.by_one / self.ones.max(f64::MIN_POSITIVE), 0.0);
        }
        let arm = (self.by_one * self.squares - self.by_slope * self.slopes) / determinant;
        let reading = (self.by_slope * self.ones - self.by_one * self.slopes) / determinant;
        if arm <= 0.0 {
            (0.0, alone(0.0))
        } else if reading <= 0.0 {
            (self.by_one / self.ones, 0.0)
        } else {
            (arm, reading)
        }
    }
}

/// The mean of the positions of the body with the strongest readings, weighted by the square of the reading.
fn strong_centre(samples: &[Sample]) -> DVec3 {
    let largest = usual_largest(samples);
    let strong = samples.iter().filter(|sample| sample.reading >= STRONG * largest);
    let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
    for sample in strong {
        let weight = (sample.reading / largest).min(1.0).powi(2);
        sum += weight * sample.centre;
        weights += weight;
    }
    if weights > 0.0 { sum / weights } else { DVec3::ZERO }
}

/// The radii of all spheres of the samples, ascending.
fn radii(samples: &Samples) -> Vec<f64> {
    let mut radii: Vec<f64> =
        samples.of.iter().flatten().map(|sample| sample.radius).filter(|&radius| radius > 0.0).collect();
    radii.sort_unstable_by(f64::total_cmp);
    radii.dedup();
    radii
}

fn normals_of(
    samples: &Samples,
    centres: &IdVec<VertexId, DVec3>,
    spacing: Option<f64>,
    (known, frames): (&Known, usize),
) -> (IdVec<VertexId, Option<DVec3>>, bool) {
    if let Some(normals) = &known.normals {
        return (normals.map(|n| n.try_normalize()), true);
    }
    let Some(spacing) = spacing else { return (centres.map(|_| None), false) };
    let mut felt: Vec<Option<DVec3>> = vec![None; frames];
    samples.of.iter().flatten().for_each(|sample| felt[sample.frame] = Some(sample.centre));
    let felt: IdVec<VertexId, DVec3> = felt.into_iter().flatten().collect();
    let mut normals = surface::normals_at(centres, &felt, spacing);
    let pairs = sides::joined(samples, centres, spacing);
    let touches = sides::outwards(samples, frames);
    let has_outside = sides::orient(centres, &mut normals, &pairs, &touches, spacing);
    (normals, has_outside)
}

/// The depth of a contact and the radius of its area, from how far the body is from a taxel that feels it.
fn typical_contact(
    samples: &Samples,
    centres: &IdVec<VertexId, DVec3>,
    normals: &IdVec<VertexId, Option<DVec3>>,
    disc: f64,
) -> (f64, f64) {
    /// Of the distances of a taxel this share is within the reach of a contact; the others may be noise.
    const SHARE: f64 = 0.9;
    let reach = |(v, of): (VertexId, &Vec<Sample>)| {
        let normal = normals[v]?;
        let across = of
            .iter()
            .filter(|sample| sample.radius > 0.0)
            .map(|sample| (sample.centre - centres[v]).reject_from_normalized(normal).length());
        let across: Vec<f64> = across.collect();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
        let rank = (SHARE * across.len() as f64) as usize;
        nth_smallest(across, rank)
    };
    let Some(reach) = median(samples.of.enumerate().filter_map(reach)) else { return (0.0, 0.0) };
    let all = samples.of.iter().flatten().map(|sample| sample.radius).filter(|&radius| radius > 0.0);
    let Some(radius) = median(all) else { return (0.0, 0.0) };
    let contact = (reach - disc).clamp(0.1 * radius, 0.85 * radius);
    (radius - (radius * radius - contact * contact).sqrt(), contact)
}
