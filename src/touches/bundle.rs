//! All taxels and all frames together: the bundle adjustment.
//!
//! The arm is often less exact than the readings: where a frame truly was follows from the readings of all its taxels.
//! Unknown are, for each taxel, its position `x` and the logarithm of its gain; for each frame the true position `c`
//! of the sphere. Minimised is the sum of `|c - p|^2 / a^2` and of the squared distances of [`fit`](super::fit), now
//! from `c`, with the noise of readings alone, which is learned from step to step. Frames are eliminated (Schur complement),
//! which leaves a sparse system of the taxels, and the marginal covariance of each by selected inversion `(triggs2000)`.

use glam::{DMat3, DVec3};

use crate::id::{IdVec, VertexId};
use crate::least_squares::{Descent, LossFunction, Options, Problem, Schedule, Step, minimise};
use crate::parallel::par_map;
use crate::run::Run;
use crate::sparse::{BlockFactor, BlockMatrix, BlockSlot, BlockSystem, Pattern, SparseError};
use crate::touches::TouchesError;
use crate::touches::fit::{Estimate, GainPrior, HUBER, Noise, Residual, Taxel};
use crate::touches::gather::{Sample, Samples};

/// The rms step of positions in m at which it ends.
const SMALL_STEP: f64 = 1e-6;

/// Additional weight on the diagonal where the system needs it, over that of the readings.
const LEAST_DAMPING: f64 = 1e-8;
const MOST_DAMPING: f64 = 1e-2;

/// The noise of readings falls at most by this factor in a step: from afar the readings are not as linear as they are exact.
const LEAST_FACTOR: f64 = 0.3;

/// Unknowns of a taxel.
const SIZE: usize = 4;

/// The noise is found when a step lowers it by less than a tenth.
const FOUND: f64 = 0.9;

/// A frame whose position is off by more than 3.4 standard deviations of the arm counts less: 99 % of three normal numbers.
const HUBER_OF_ARM: LossFunction = LossFunction::Huber { c2: 3.4 * 3.4 };

/// What is known of all taxels.
pub(super) struct Bundle<'a> {
    taxels: IdVec<VertexId, Option<Taxel<'a>>>,
    noise: Noise,
    gains: GainPrior,
    /// First guesses of positions, and their standard deviation: the radius of a contact.
    guesses: IdVec<VertexId, DVec3>,
    guess_sigma: f64,
    frames: Vec<Frame>,
    /// Number of taxels that are estimated.
    estimated: f64,
    system: BlockSystem,
}

/// One frame: the taxels that felt it, and where the arm says it was, in m.
struct Frame {
    believed: DVec3,
    felt: Vec<(VertexId, Sample)>,
}

/// All unknowns: the taxels, and where frames were, in m; and what is left of the frames there.
pub(super) struct At {
    estimates: IdVec<VertexId, Option<Estimate>>,
    centres: Vec<DVec3>,
    reduced: Vec<Reduced>,
}

/// What is left of a frame when its position is eliminated.
struct Reduced {
    inverse: DMat3,
    gradient: DVec3,
    felt: Vec<Term>,
    /// Of the readings of the frame: what of their freedom its position does not take, and their sum of squares.
    freedom: f64,
    squares: f64,
}

/// One reading in the normal equations.
struct Term {
    taxel: VertexId,
    weight: f64,
    /// The derivative of its distance with respect to the position of the frame; that of the taxel's is the opposite.
    outward: DVec3,
    by_gain: f64,
    distance: f64,
}

impl Term {
    fn row(&self) -> [f64; SIZE] {
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
}

impl<'a> Bundle<'a> {
    pub(super) fn new(
        samples: &Samples,
        frames: usize,
        estimates: &IdVec<VertexId, Option<Estimate>>,
        taxels: IdVec<VertexId, Option<Taxel<'a>>>,
        (noise, gains, guesses, guess_sigma): (Noise, GainPrior, IdVec<VertexId, DVec3>, f64),
    ) -> Result<Self, TouchesError> {
        let mut felt: Vec<Vec<(VertexId, Sample)>> = vec![Vec::new(); frames];
        for (v, of) in samples.of.enumerate().filter(|(v, _)| estimates[*v].is_some()) {
            of.iter().filter(|s| s.radius > 0.0).for_each(|sample| felt[sample.frame].push((v, *sample)));
        }
        let frame = |felt: Vec<(VertexId, Sample)>| Frame {
            believed: felt.first().map_or(DVec3::ZERO, |(_, sample)| sample.centre),
            felt,
        };
        let frames: Vec<Frame> = felt.into_iter().map(frame).collect();
        let system = BlockSystem::new(pattern(&frames, estimates.len()), SIZE)?;
        let estimated = estimates.iter().flatten().count() as f64;
        Ok(Self { taxels, noise, gains, guesses, guess_sigma, frames, estimated, system })
    }

    /// Solves for everything, in this number of steps; `places` are those of an earlier solution.
    pub(super) fn adjust(
        &mut self,
        estimates: IdVec<VertexId, Option<Estimate>>,
        places: &[Option<Place>],
        steps: usize,
        run: Run<'_>,
    ) -> Result<Adjusted, TouchesError> {
        let centre = |(k, frame): (usize, &Frame)| {
            places.get(k).copied().flatten().map_or(frame.believed, |place| place.centre)
        };
        let start = self.at(estimates, self.frames.iter().enumerate().map(centre).collect());
        let limits = Options { max_iterations: steps, small_step: SMALL_STEP, ..Options::DEFAULT };
        let (at, _) = minimise(self, start, &limits, run)?;
        let At { estimates, centres, reduced } = self.at(at.estimates, at.centres);
        let (factor, _) = self.factored(&estimates, &reduced)?;
        let inverse = factor.selected_inverse();
        let block = |v: VertexId| {
            let rows = inverse.diagonal::<SIZE>(v.index());
            DMat3::from_cols_array_2d(&std::array::from_fn(|i| std::array::from_fn(|j| rows[i][j])))
        };
        let covariances = estimates.ids().map(block).collect();
        let places = self.frames.iter().zip(centres).map(|(frame, centre)| {
            (!frame.felt.is_empty()).then_some(Place { believed: frame.believed, centre })
        });
        Ok(Adjusted { places: places.collect(), estimates, covariances, noise: self.noise })
    }

    /// A point, with the frames eliminated under the noise of now.
    fn at(&self, estimates: IdVec<VertexId, Option<Estimate>>, centres: Vec<DVec3>) -> At {
        let frames: Vec<(&Frame, DVec3)> = self.frames.iter().zip(centres.iter().copied()).collect();
        let reduced = par_map(&frames, |&(frame, centre)| self.reduce(frame, centre, &estimates));
        At { estimates, centres, reduced }
    }

    /// Eliminates the position of a frame.
    fn reduce(&self, frame: &Frame, centre: DVec3, estimates: &IdVec<VertexId, Option<Estimate>>) -> Reduced {
        let noise = Noise { arm: 0.0, ..self.noise };
        let (off, arm) = (centre - frame.believed, self.noise.arm.powi(-2));
        let arm = HUBER_OF_ARM.weight(arm * off.length_squared()) * arm;
        let (mut matrix, mut gradient) = (DMat3::from_diagonal(DVec3::splat(arm)), -arm * off);
        let (mut felt, mut squares) = (Vec::with_capacity(frame.felt.len()), 0.0);
        for (v, sample) in &frame.felt {
            let here = Sample { centre, ..*sample };
            let taxel = self.taxels[*v].as_ref().zip(estimates[*v].as_ref());
            let Some(residual) = taxel.and_then(|(taxel, at)| taxel.residual(&here, at)) else { continue };
            let weight = residual.weight(noise);
            squares += residual.square(noise).min(HUBER.bound2());
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
        Reduced { inverse, gradient, felt, freedom, squares }
    }

    /// The system of the taxels, factored, and its right side. Where few readings determine a taxel, the system is positive
    /// definite only with more weight on the diagonal, which makes the step shorter.
    fn factored(
        &self,
        estimates: &IdVec<VertexId, Option<Estimate>>,
        reduced: &[Reduced],
    ) -> Result<(BlockFactor<'_>, Vec<f64>), TouchesError> {
        let mut damping = 0.0;
        loop {
            let (matrix, right) = self.assemble(estimates, reduced, damping);
            match matrix.factor() {
                Err(SparseError::NotPositiveDefinite { .. }) if damping < MOST_DAMPING => {
                    damping = if damping == 0.0 { LEAST_DAMPING } else { 100.0 * damping };
                }
                factor => return Ok((factor?, right)),
            }
        }
    }

    /// The system of the taxels, and its right side.
    fn assemble(
        &self,
        estimates: &IdVec<VertexId, Option<Estimate>>,
        reduced: &[Reduced],
        damping: f64,
    ) -> (BlockMatrix<'_>, Vec<f64>) {
        let mut matrix = self.system.zero();
        let mut right = vec![0.0; SIZE * estimates.len()];
        let (guess, gain) = (self.guess_sigma.powi(-2), self.gains.sigma.powi(-2));
        for (v, estimate) in estimates.enumerate() {
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
                    let Some(slot) = self.system.slot(high.taxel.index(), low.taxel.index()) else {
                        continue;
                    };
                    let both = -term.weight * other.weight * other.outward.dot(eliminated);
                    let (high, low) = (high.row(), low.row());
                    matrix.add(slot, |a, b| both * high[a] * low[b]);
                }
            }
        }
        (matrix, right)
    }

    /// The noise of readings from what the solution leaves; weights follow in the next step.
    fn learn(&mut self, reduced: &[Reduced]) {
        let squares: f64 = reduced.iter().map(|frame| frame.squares).sum();
        let freedom = reduced.iter().map(|frame| frame.freedom).sum::<f64>() - SIZE as f64 * self.estimated;
        if freedom > 1.0 {
            let factor = (squares / freedom).sqrt().clamp(LEAST_FACTOR, LEAST_FACTOR.recip());
            self.noise.reading = (factor * self.noise.reading).max(self.noise.least_reading);
        }
    }
}

/// Taxels that feel a frame together are joined.
fn pattern(frames: &[Frame], taxels: usize) -> Pattern {
    let pairs = frames.iter().flat_map(|frame| {
        let of = |k: usize| frame.felt[k].0.index();
        (0..frame.felt.len()).flat_map(move |a| (0..a).map(move |b| (of(a).max(of(b)), of(a).min(of(b)))))
    });
    let mut pairs: Vec<(usize, usize)> = pairs.collect();
    pairs.sort_unstable();
    pairs.dedup();
    Pattern::new(taxels, pairs)
}

/// The unknowns of taxel `v` in a step.
fn of_taxel(step: &[f64], v: VertexId) -> [f64; SIZE] {
    std::array::from_fn(|k| step[SIZE * v.index() + k])
}

impl Problem for Bundle<'_> {
    type Point = At;
    type Linear = ();
    type Error = TouchesError;

    fn unknowns(&self) -> usize {
        SIZE * self.system.blocks()
    }

    /// The noise is learned from step to step, so that costs are not compared.
    fn descent(&self) -> Descent {
        Descent::Free
    }

    fn cost(&self, _at: &At) -> f64 {
        0.0
    }

    fn linearise(&self, _at: &At) -> Result<(), TouchesError> {
        Ok(())
    }

    fn solve(&self, at: &At, (): &(), _damping: f64) -> Result<Option<Vec<f64>>, TouchesError> {
        let (factor, mut step) = self.factored(&at.estimates, &at.reduced)?;
        factor.solve(&mut step, 1)?;
        Ok(Some(step))
    }

    fn predicted_decrease(&self, (): &(), _step: &[f64], _damping: f64) -> f64 {
        0.0
    }

    fn moved(&self, at: &At, (): &(), step: &[f64]) -> At {
        let mut centres = at.centres.clone();
        for (centre, reduced) in centres.iter_mut().zip(&at.reduced) {
            let mut gradient = reduced.gradient;
            for term in &reduced.felt {
                let along: f64 = term.row().iter().zip(of_taxel(step, term.taxel)).map(|(a, b)| a * b).sum();
                gradient -= term.weight * along * term.outward;
            }
            *centre += reduced.inverse * gradient;
        }
        let estimate = |(v, estimate): (VertexId, &Option<Estimate>)| {
            let [x, y, z, gain] = of_taxel(step, v);
            let at = (*estimate)?;
            Some(Estimate { position: at.position + DVec3::new(x, y, z), log_gain: at.log_gain + gain })
        };
        self.at(at.estimates.enumerate().map(estimate).collect(), centres)
    }

    /// The rms step of the positions, in m.
    fn size(&self, (): &(), step: &[f64]) -> f64 {
        let squares = step.chunks_exact(SIZE).map(|step| DVec3::from_slice(step).length_squared());
        (squares.sum::<f64>() / self.estimated.max(1.0)).sqrt()
    }

    fn after_step(&mut self, at: &mut At, (): (), _step: &Step) -> Result<Schedule, TouchesError> {
        let known = self.noise.reading;
        self.learn(&at.reduced);
        Ok(if self.noise.reading > FOUND * known { Schedule::Settled } else { Schedule::Open })
    }
}
