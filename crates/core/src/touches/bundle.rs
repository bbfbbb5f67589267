//! All taxels and all frames together: the bundle adjustment.
//!
//! The arm is often less exact than the readings: where a frame truly was follows from the readings of all its taxels.
//! Unknown are, for each taxel, its position `x` and the logarithm of its gain; for each frame the true position `c`
//! of the sphere. Minimised is the sum of `|c - p|^2 / a^2` and of the squared distances of [`fit`](super::fit), now
//! from `c`, with the noise of readings alone. Gauss and Newton with damping; frames are eliminated (Schur complement),
//! which leaves a sparse system of the taxels, and the marginal covariance of each by selected inversion `(triggs2000)`.

use glam::{DMat3, DVec3};

use crate::id::{IdVec, VertexId};
use crate::parallel::par_map;
use crate::run::Run;
use crate::sparse::{BlockFactor, BlockMatrix, BlockSlot, BlockSystem, Pattern, SparseError};
use crate::touches::TouchesError;
use crate::touches::delay::LogDelay;
use crate::touches::fit::{Estimate, GainPrior, HUBER, Noise, Residual, Taxel};
use crate::touches::gather::{Sample, Samples};
use crate::touches::log::TouchFrame;

/// The rms step of positions in m at which it ends.
const SMALL_STEP: f64 = 1e-6;

/// Additional weight on the diagonal where the system needs it, over that of the readings.
const LEAST_DAMPING: f64 = 1e-8;
const MOST_DAMPING: f64 = 1e-2;

/// Largest step of the logarithm of a gain. That of a position is the radius of a contact.
const LARGEST_GAIN_STEP: f64 = 1.0;

/// The noise of readings falls at most by this factor in a step: from afar the readings are not as linear as they are exact.
const LEAST_FACTOR: f64 = 0.3;

/// Unknowns of a taxel.
pub(super) const SIZE: usize = 4;

/// A frame whose position is off by more standard deviations of the arm counts less: 99 % of three normal numbers.
pub(super) const HUBER_OF_ARM: f64 = 3.4;

/// What is known of all taxels.
pub(super) struct Bundle<'a> {
    pub(super) taxels: IdVec<VertexId, Option<Taxel<'a>>>,
    pub(super) estimates: IdVec<VertexId, Option<Estimate>>,
    pub(super) noise: Noise,
    pub(super) gains: GainPrior,
    /// First guesses of positions, and their standard deviation: the radius of a contact.
    pub(super) guesses: IdVec<VertexId, DVec3>,
    pub(super) guess_sigma: f64,
    pub(super) frames: Vec<Frame>,
}

/// The unknown position of one frame, and the taxels that felt it.
#[derive(Clone)]
pub(super) struct Frame {
    /// As the arm says, and as it is estimated, in m.
    pub(super) believed: DVec3,
    pub(super) centre: DVec3,
    pub(super) felt: Vec<(VertexId, Sample)>,
    pub(super) touch: u64,
    pub(super) time: Option<f64>,
}

/// What is left of a frame when its position is eliminated.
pub(super) struct Reduced {
    pub(super) inverse: DMat3,
    pub(super) gradient: DVec3,
    /// The weight of the position that the arm says.
    pub(super) arm: f64,
    pub(super) felt: Vec<Term>,
    /// Of the readings of the frame: what of their freedom its position does not take, and their sum of squares.
    freedom: f64,
    squares: f64,
}

/// One reading in the normal equations.
pub(super) struct Term {
    pub(super) taxel: VertexId,
    pub(super) weight: f64,
    /// The derivative of its distance with respect to the position of the frame; that of the taxel's is the opposite.
    pub(super) outward: DVec3,
    by_gain: f64,
    pub(super) distance: f64,
}

impl Term {
    pub(super) fn row(&self) -> [f64; SIZE] {
        [-self.outward.x, -self.outward.y, -self.outward.z, self.by_gain]
    }
}

/// Where a frame was, by the arm and as estimated.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) believed: DVec3,
    pub(super) centre: DVec3,
}

/// A solution: the estimates, their covariances, and the frames by their number in the log.
pub(super) struct Adjusted {
    pub(super) estimates: IdVec<VertexId, Option<Estimate>>,
    pub(super) covariances: IdVec<VertexId, DMat3>,
    pub(super) places: Vec<Option<Place>>,
    pub(super) noise: Noise,
    /// How late the readings are, if the touches tell.
    pub(super) delay: Option<LogDelay>,
}

impl<'a> Bundle<'a> {
    pub(super) fn new(
        samples: &Samples,
        (frames, places): (&[TouchFrame], &[Option<Place>]),
        taxels: IdVec<VertexId, Option<Taxel<'a>>>,
        estimates: IdVec<VertexId, Option<Estimate>>,
        noise: Noise,
        gains: GainPrior,
        (guesses, guess_sigma): (IdVec<VertexId, DVec3>, f64),
    ) -> Self {
        let mut felt: Vec<Vec<(VertexId, Sample)>> = vec![Vec::new(); frames.len()];
        for (v, of) in samples.of.enumerate().filter(|(v, _)| estimates[*v].is_some()) {
            of.iter().filter(|s| s.radius > 0.0).for_each(|sample| felt[sample.frame].push((v, *sample)));
        }
        let frame = |(k, felt): (usize, Vec<(VertexId, Sample)>)| {
            let believed = felt.first().map_or(DVec3::ZERO, |(_, sample)| sample.centre);
            let centre = places.get(k).copied().flatten().map_or(believed, |place| place.centre);
            let TouchFrame { touch, time, .. } = frames[k];
            Frame { believed, centre, felt, touch, time }
        };
        let frames = felt.into_iter().enumerate().map(frame).collect();
        Self { taxels, estimates, noise, gains, guesses, guess_sigma, frames }
    }

    /// Solves for everything, in this number of steps.
    pub(super) fn adjust(&mut self, steps: usize, run: Run<'_>) -> Result<Adjusted, TouchesError> {
        let system = BlockSystem::new(self.pattern(), SIZE)?;
        let mut reduced = self.reduced();
        for _ in 0..steps {
            run.check()?;
            let (factor, mut change) = self.factored(&system, &reduced)?;
            factor.solve(&mut change, 1)?;
            let moved = self.apply(&reduced, &change);
            reduced = self.reduced();
            let known = self.noise.reading;
            self.learn(&reduced);
            if moved < SMALL_STEP && self.noise.reading > 0.9 * known {
                break;
            }
        }
        reduced = self.reduced();
        let (factor, right) = self.factored(&system, &reduced)?;
        let delay = self.delay(&reduced, &right, |column| factor.solve(column, 1))?;
        let inverse = factor.selected_inverse();
        let block = |v: VertexId| {
            let rows = inverse.diagonal::<SIZE>(v.index());
            DMat3::from_cols_array_2d(&std::array::from_fn(|i| std::array::from_fn(|j| rows[i][j])))
        };
        let covariances = self.estimates.ids().map(block).collect();
        let places = self.frames.iter().map(|frame| {
            let place = Place { believed: frame.believed, centre: frame.centre };
            (!frame.felt.is_empty()).then_some(place)
        });
        let (estimates, noise) = (self.estimates.clone(), self.noise);
        Ok(Adjusted { places: places.collect(), estimates, covariances, noise, delay })
    }

    /// Taxels that feel a frame together are joined.
    fn pattern(&self) -> Pattern {
        let pairs = self.frames.iter().flat_map(|frame| {
            let of = |k: usize| frame.felt[k].0.index();
            (0..frame.felt.len()).flat_map(move |a| (0..a).map(move |b| (of(a).max(of(b)), of(a).min(of(b)))))
        });
        let mut pairs: Vec<(usize, usize)> = pairs.collect();
        pairs.sort_unstable();
        pairs.dedup();
        Pattern::new(self.estimates.len(), pairs)
    }

    fn reduced(&self) -> Vec<Reduced> {
        par_map(&self.frames, |frame| self.reduce(frame))
    }

    fn residual(&self, v: VertexId, sample: &Sample, centre: DVec3) -> Option<Residual> {
        let here = Sample { centre, ..*sample };
        self.taxels[v].as_ref()?.residual(&here, self.estimates[v].as_ref()?)
    }

    /// Eliminates the position of a frame.
    pub(super) fn reduce(&self, frame: &Frame) -> Reduced {
        let noise = Noise { arm: 0.0, ..self.noise };
        let off = frame.centre - frame.believed;
        let sigmas = off.length() / self.noise.arm;
        let arm = (HUBER_OF_ARM / sigmas).min(1.0) / (self.noise.arm * self.noise.arm);
        let (mut matrix, mut gradient) = (DMat3::from_diagonal(DVec3::splat(arm)), -arm * off);
        let (mut felt, mut squares) = (Vec::with_capacity(frame.felt.len()), 0.0);
        for (v, sample) in &frame.felt {
            let Some(residual) = self.residual(*v, sample, frame.centre) else { continue };
            let (weight, sigmas) =
                (residual.weight(noise), residual.distance.abs() / residual.variance(noise).sqrt());
            squares += sigmas.min(HUBER).powi(2);
            let outward = -residual.by_position;
            matrix +=
                weight * DMat3::from_cols(outward.x * outward, outward.y * outward, outward.z * outward);
            gradient -= weight * residual.distance * outward;
            let Residual { by_gain, distance, .. } = residual;
            felt.push(Term { taxel: *v, weight, outward, by_gain, distance });
        }
        let inverse = matrix.inverse();
        // The trace of the share of the readings in what is known about the position.
        let taken = 3.0 - arm * (inverse.x_axis.x + inverse.y_axis.y + inverse.z_axis.z);
        let freedom = felt.len() as f64 - taken;
        Reduced { inverse, gradient, arm, felt, freedom, squares }
    }

    /// The system of the taxels, factored, and its right side. Where few readings determine a taxel, the system is positive
    /// definite only with more weight on the diagonal, which makes the step shorter.
    fn factored<'s>(
        &self,
        system: &'s BlockSystem,
        reduced: &[Reduced],
    ) -> Result<(BlockFactor<'s>, Vec<f64>), TouchesError> {
        let mut damping = 0.0;
        loop {
            let (matrix, right) = self.assemble(system, reduced, damping);
            match matrix.factor() {
                Err(SparseError::NotPositiveDefinite { .. }) if damping < MOST_DAMPING => {
                    damping = if damping == 0.0 { LEAST_DAMPING } else { 100.0 * damping };
                }
                factor => return Ok((factor?, right)),
            }
        }
    }

    /// The system of the taxels, and its right side.
    fn assemble<'s>(
        &self,
        system: &'s BlockSystem,
        reduced: &[Reduced],
        damping: f64,
    ) -> (BlockMatrix<'s>, Vec<f64>) {
        let mut matrix = system.zero();
        let mut right = vec![0.0; SIZE * self.estimates.len()];
        let (guess, gain) = (self.guess_sigma.powi(-2), self.gains.sigma.powi(-2));
        for (v, estimate) in self.estimates.enumerate() {
            let right = &mut right[SIZE * v.index()..][..SIZE];
            let known = if estimate.is_some() { [guess, guess, guess, gain.max(1e-6)] } else { [1.0; SIZE] };
            matrix.add(BlockSlot::diagonal(v.raw()), |a, b| if a == b { known[a] } else { 0.0 });
            if let Some(at) = estimate {
                let off = guess * (self.guesses[v] - at.position);
                right.copy_from_slice(&[off.x, off.y, off.z, gain * (self.gains.log_gain - at.log_gain)]);
            }
        }
        for frame in reduced {
            let shift = frame.inverse * frame.gradient;
            for (k, term) in frame.felt.iter().enumerate() {
                let row = term.row();
                let eliminated = frame.inverse * term.outward;
                let left = term.weight * (term.distance + term.outward.dot(shift));
                let right = &mut right[SIZE * term.taxel.index()..][..SIZE];
                right.iter_mut().zip(row).for_each(|(cell, a)| *cell -= left * a);
                let own = term.weight * (1.0 - term.weight * term.outward.dot(eliminated));
                let damped = own + damping * term.weight;
                matrix.add(BlockSlot::diagonal(term.taxel.raw()), |a, b| {
                    (if a == b { damped } else { own }) * row[a] * row[b]
                });
                for other in &frame.felt[..k] {
                    let (low, high) = if other.taxel < term.taxel { (other, term) } else { (term, other) };
                    let Some(slot) = system.slot(high.taxel.index(), low.taxel.index()) else { continue };
                    let both = -term.weight * other.weight * other.outward.dot(eliminated);
                    let (high, low) = (high.row(), low.row());
                    matrix.add(slot, |a, b| both * high[a] * low[b]);
                }
            }
        }
        (matrix, right)
    }

    /// Moves taxels and frames; returns the rms step of the taxels in m.
    fn apply(&mut self, reduced: &[Reduced], change: &[f64]) -> f64 {
        let of = |v: VertexId| &change[SIZE * v.index()..][..SIZE];
        for (frame, reduced) in self.frames.iter_mut().zip(reduced) {
            let mut gradient = reduced.gradient;
            for term in &reduced.felt {
                let along: f64 = term.row().iter().zip(of(term.taxel)).map(|(a, b)| a * b).sum();
                gradient -= term.weight * along * term.outward;
            }
            frame.centre += reduced.inverse * gradient;
        }
        let (mut squares, mut count) = (0.0, 0.0);
        for (v, estimate) in self.estimates.iter_mut().enumerate() {
            let Some(at) = estimate else { continue };
            let &[x, y, z, gain] = of(VertexId::new(v)) else { continue };
            let step = DVec3::new(x, y, z).clamp_length_max(self.guess_sigma);
            at.position += step;
            at.log_gain += gain.clamp(-LARGEST_GAIN_STEP, LARGEST_GAIN_STEP);
            squares += step.length_squared();
            count += 1.0;
        }
        (squares / f64::max(count, 1.0)).sqrt()
    }

    /// The noise of readings from what the solution leaves; weights follow in the next step.
    fn learn(&mut self, reduced: &[Reduced]) {
        let squares: f64 = reduced.iter().map(|frame| frame.squares).sum();
        let taxels = self.estimates.iter().flatten().count() as f64;
        let freedom = reduced.iter().map(|frame| frame.freedom).sum::<f64>() - SIZE as f64 * taxels;
        if freedom > 1.0 {
            let factor = (squares / freedom).sqrt().clamp(LEAST_FACTOR, LEAST_FACTOR.recip());
            self.noise.reading = (factor * self.noise.reading).max(self.noise.least_reading);
        }
    }
}
