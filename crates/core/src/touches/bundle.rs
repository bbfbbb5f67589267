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

/// Additional weight on the diagonal where the system needs it, over the diagonal. Without rounding it needs none; from the largest on
/// entries next to the diagonal are smaller than it.
const LEAST_DAMPING: f64 = 1e-8;
const MOST_DAMPING: f64 = 1e4;

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
///
/// Its rows `A`, three of the arm and one for each reading, are times the roots of their weights, and `A = Q R` with orthonormal
/// columns `Q`. What is left is `1 - Q Q'`, exact to rounding: readings may be a million times as exact as the arm, and the
/// difference of two sums with the inverse of `A'A` would be wrong by more than all that the arm says.
pub(super) struct Reduced {
    /// The inverse of `R`.
    pub(super) root: DMat3,
    /// `Q'r` of the residuals `r`.
    pub(super) along: DVec3,
    /// The weight of the position that the arm says.
    pub(super) arm: f64,
    pub(super) felt: Vec<Term>,
    /// Of the readings of the frame: what of their freedom its position does not take, and their sum of squares.
    freedom: f64,
    squares: f64,
}

impl Reduced {
    /// The step of its position if taxels stay.
    pub(super) fn step(&self) -> DVec3 {
        -(self.root * self.along)
    }

    /// The covariance of its position if taxels stay.
    pub(super) fn covariance(&self) -> DMat3 {
        self.root * self.root.transpose()
    }
}

/// One reading in the normal equations.
pub(super) struct Term {
    pub(super) taxel: VertexId,
    /// Times the root of its weight: the derivative of its distance with respect to the position and the gain of the taxel.
    pub(super) row: [f64; SIZE],
    /// Its row of `Q`.
    pub(super) q: DVec3,
    /// Times the root of its weight: its distance, of which the frame takes what it can.
    pub(super) left: f64,
}

/// Makes the columns of these rows orthonormal, and returns the triangular matrix that gives the rows back: Gram and Schmidt, twice.
fn orthonormal(rows: &mut [DVec3]) -> DMat3 {
    let mut triangle = DMat3::ZERO;
    for k in 0..3 {
        for _ in 0..2 {
            for j in 0..k {
                let both: f64 = rows.iter().map(|row| row[j] * row[k]).sum();
                triangle.col_mut(k)[j] += both;
                rows.iter_mut().for_each(|row| row[k] -= both * row[j]);
            }
        }
        let length = rows.iter().map(|row| row[k] * row[k]).sum::<f64>().sqrt();
        triangle.col_mut(k)[k] = length;
        rows.iter_mut().for_each(|row| row[k] /= length);
    }
    triangle
}

/// The inverse of an upper triangle.
fn inverse_of_triangle(r: DMat3) -> DMat3 {
    let [a, b, c] = [r.x_axis.x.recip(), r.y_axis.y.recip(), r.z_axis.z.recip()];
    let (xy, yz) = (-a * r.y_axis.x * b, -b * r.z_axis.y * c);
    let xz = -a * (r.y_axis.x * yz + r.z_axis.x * c);
    DMat3::from_cols(DVec3::new(a, 0.0, 0.0), DVec3::new(xy, b, 0.0), DVec3::new(xz, yz, c))
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
        let mut rows: Vec<DVec3> = DVec3::AXES.map(|axis| arm.sqrt() * axis).to_vec();
        let (mut felt, mut squares) = (Vec::with_capacity(frame.felt.len()), 0.0);
        for (v, sample) in &frame.felt {
            let Some(residual) = self.residual(*v, sample, frame.centre) else { continue };
            let (weight, sigmas) =
                (residual.weight(noise), residual.distance.abs() / residual.variance(noise).sqrt());
            squares += sigmas.min(HUBER).powi(2);
            let root = weight.sqrt();
            let by_position = root * residual.by_position;
            rows.push(-by_position);
            let row = [by_position.x, by_position.y, by_position.z, root * residual.by_gain];
            felt.push(Term { taxel: *v, row, q: DVec3::ZERO, left: root * residual.distance });
        }
        let root = inverse_of_triangle(orthonormal(&mut rows));
        let (of_arm, of_readings) = rows.split_at(3);
        let mut along: DVec3 = of_arm.iter().zip((arm.sqrt() * off).to_array()).map(|(q, r)| r * *q).sum();
        along += felt.iter().zip(of_readings).map(|(term, q)| term.left * *q).sum::<DVec3>();
        for (term, &q) in felt.iter_mut().zip(of_readings) {
            term.q = q;
            term.left -= q.dot(along);
        }
        // The trace of the share of the readings in what is known about the position.
        let taken: f64 = of_readings.iter().map(|q| q.length_squared()).sum();
        let freedom = felt.len() as f64 - taken;
        Reduced { root, along, arm, felt, freedom, squares }
    }

    /// The system of the taxels, factored, and its right side. Where rounding leaves it indefinite, it has more weight on the
    /// diagonal, which makes the step shorter.
    fn factored<'s>(
        &self,
        system: &'s BlockSystem,
        reduced: &[Reduced],
    ) -> Result<(BlockFactor<'s>, Vec<f64>), TouchesError> {
        let (mut matrix, right) = self.assemble(system, reduced);
        let diagonal = matrix.diagonal();
        let (mut damping, mut growth) = (0.0, LEAST_DAMPING);
        loop {
            match matrix.factor() {
                Err(SparseError::NotPositiveDefinite { .. }) if damping < MOST_DAMPING => {
                    matrix.add_diagonal(&diagonal.iter().map(|d| growth * d).collect::<Vec<_>>());
                    (damping, growth) = (damping + growth, 100.0 * growth);
                }
                factor => return Ok((factor?, right)),
            }
        }
    }

    /// The system of the taxels, and its right side.
    fn assemble<'s>(&self, system: &'s BlockSystem, reduced: &[Reduced]) -> (BlockMatrix<'s>, Vec<f64>) {
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
            for (k, term) in frame.felt.iter().enumerate() {
                let right = &mut right[SIZE * term.taxel.index()..][..SIZE];
                right.iter_mut().zip(term.row).for_each(|(cell, a)| *cell -= term.left * a);
                let own = (1.0 - term.q.length_squared()).max(0.0);
                matrix.add(BlockSlot::diagonal(term.taxel.raw()), |a, b| own * term.row[a] * term.row[b]);
                for other in &frame.felt[..k] {
                    let (low, high) = if other.taxel < term.taxel { (other, term) } else { (term, other) };
                    let Some(slot) = system.slot(high.taxel.index(), low.taxel.index()) else { continue };
                    let both = -term.q.dot(other.q);
                    matrix.add(slot, |a, b| both * high.row[a] * low.row[b]);
                }
            }
        }
        (matrix, right)
    }

    /// Moves taxels and frames; returns the rms step of the taxels in m.
    fn apply(&mut self, reduced: &[Reduced], change: &[f64]) -> f64 {
        let of = |v: VertexId| &change[SIZE * v.index()..][..SIZE];
        for (frame, reduced) in self.frames.iter_mut().zip(reduced) {
            let mut along = reduced.along;
            for term in &reduced.felt {
                let moved: f64 = term.row.iter().zip(of(term.taxel)).map(|(a, b)| a * b).sum();
                along += moved * term.q;
            }
            frame.centre -= reduced.root * along;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame with one reading leaves of its weight `w` what the arm's weight `a` allows, `w a / (w + a)`: where readings are a
    /// hundred million times as exact as the arm, differences of inverse matrices give a million times that, of either sign, and the
    /// system of the taxels has no factor.
    #[test]
    fn one_exact_reading_leaves_what_the_arm_allows() {
        let arm = 1e4;
        for (share, direction) in
            [(1e2, DVec3::new(0.6, -0.48, 0.64)), (1e8, DVec3::new(0.36, 0.48, -0.8)), (1e10, DVec3::Z)]
        {
            let weight: f64 = share * arm;
            let mut rows: Vec<DVec3> = DVec3::AXES.map(|axis| 100.0 * axis).to_vec();
            rows.push(weight.sqrt() * direction);
            let triangle = orthonormal(&mut rows);
            let left = weight * (1.0 - rows[3].length_squared());
            let exact = weight * arm / (weight + arm);
            assert!((left / exact - 1.0).abs() < 1e-4, "{left} for {exact} at {share}");
            // The rows are those of before.
            let back = triangle.transpose() * rows[3];
            assert!(back.distance(weight.sqrt() * direction) < 1e-12 * weight.sqrt(), "{back}");
            let unit = triangle * inverse_of_triangle(triangle);
            assert!(unit.abs_diff_eq(DMat3::IDENTITY, 1e-9), "{unit}");
        }
    }

    /// Taxels that move with their frame cost what moving the frame away from the arm does.
    #[test]
    fn taxels_and_their_frame_move_against_the_arm_alone() {
        let (arm, weight) = (1e4, 1e12_f64);
        let directions = [[0.6, 0.0, 0.8], [0.0, -0.6, 0.8], [-0.6, 0.64, 0.48], [0.0, 0.0, 1.0]];
        let mut rows: Vec<DVec3> = DVec3::AXES.map(|axis| 100.0 * axis).to_vec();
        rows.extend(directions.map(|of| weight.sqrt() * DVec3::from_array(of)));
        let by = DVec3::new(1e-3, -2e-3, 5e-4);
        let moved: Vec<f64> = rows[3..].iter().map(|row| row.dot(by)).collect();
        orthonormal(&mut rows);
        let along: DVec3 = rows[3..].iter().zip(&moved).map(|(q, x)| *x * *q).sum();
        let cost: f64 = rows[3..].iter().zip(&moved).map(|(q, x)| x * (x - q.dot(along))).sum();
        let exact = arm * by.length_squared();
        assert!((cost / exact - 1.0).abs() < 1e-5, "{cost} for {exact}");
    }
}
