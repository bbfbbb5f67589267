//! Gain and exponent of each taxel from steps of a pressure that is the same everywhere, as under a bag of air.
//!
//! Of each step the middle half counts; of the last one, where no row ends it, all but its beginning. For each taxel a line is fitted to `ln(reading)` over `ln(pressure)`; its slope
//! is the reciprocal of the exponent. Slopes of one kind of taxel differ little, and are known badly from a few steps: each
//! is shrunk towards their median by as much as its own error requires (an estimator of James and Stein). Where the
//! bag is put on the skin several times, the differences between these placements show how evenly it presses.

use crate::id::{IdVec, VertexId};
use crate::numeric::median_of;
use crate::response::ResponseError;
use crate::signal::Frame;
use crate::skin::{PatchId, Skin};

/// Pressures of a bag, in Pa: others are in another unit.
const PRESSURES: [f64; 2] = [10.0, 1e8];

/// The share of a step before and after which readings do not count: they settle.
const SETTLES: f64 = 0.25;

/// Length of the last step, in s, of which [`SETTLES`] is a share, where no step has an end.
const OPEN_LENGTH: f64 = 4.0;

/// Steps whose pressures differ by less than this share are one.
const SAME: f64 = 0.02;

/// How unevenly a bag presses, relative: of one placement, from which it cannot be seen.
const UNEVEN: f64 = 0.03;

/// A reading is pressed above this share of the largest of its taxel, and of what three of four taxels read less than.
const LEAST_SHARE: f64 = 0.02;

/// A taxel feels a step whose mean reading is above this many standard deviations of its noise in this step: what a bag does
/// not touch reads less, and has no slope. Of 1 / 2 / 3, with a bag on 54 of 225 taxels and ten frames of each step, 8 / 0 / 0
/// of 1539 readings of the others count, the largest of which is 1.9.
const NOISE: f64 = 3.0;

/// Residuals of the logarithm of readings (rms) from which steps and readings do not belong to each other, and the slope
/// that they belong to each other above: of one taxel, or the median of all.
const MOST_RESIDUAL: f64 = 0.5;
const LEAST_SLOPE: f64 = 0.1;

/// A gain is not known to less than this share.
const MOST_SIGMA: f64 = 0.2;

/// Error of a gain that no step shows.
const LEAST_SIGMA: f64 = 0.01;

/// One step of a pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    from: f64,
    to: f64,
    /// The times whose readings count.
    counted: [f64; 2],
    pressure: f64,
    /// The bag was put on the skin this often before.
    placement: usize,
}

/// What readings of one taxel in a step are.
#[derive(Debug, Clone, Copy)]
struct Seen {
    sum: f64,
    count: f64,
    range: [f64; 2],
    /// The last reading, and the sum of the squares of the differences of successive ones.
    last: f64,
    squares: f64,
}

impl Seen {
    const NOTHING: Self = Self {
        sum: 0.0,
        count: 0.0,
        range: [f64::INFINITY, f64::NEG_INFINITY],
        last: f64::NAN,
        squares: 0.0,
    };

    fn see(&mut self, x: f64) {
        self.sum += x;
        self.range = [self.range[0].min(x), self.range[1].max(x)];
        if self.count > 0.0 {
            self.squares += (x - self.last).powi(2);
        }
        self.count += 1.0;
        self.last = x;
    }

    /// The standard deviation of its noise; 0 where a single reading shows none.
    fn noise(&self) -> f64 {
        (0.5 * self.squares / (self.count - 1.0).max(1.0)).sqrt()
    }
}

/// Estimates gains and exponents from recordings under a pressure that is the same everywhere.
pub struct StepEstimator<'s> {
    skin: &'s Skin,
    steps: Vec<Step>,
    /// Step after step, taxel after taxel.
    seen: Vec<Seen>,
    taxels: usize,
    times: [f64; 2],
    /// Whether times went back, so that a step is of several stretches of the recording.
    goes_back: bool,
}

/// The response curve of a taxel: pressure in Pa is `gain` times its reading to the power of `exponent`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaxelCurve {
    /// NaN where no step was felt.
    pub gain: f64,
    /// NaN where all steps have one pressure; the gain is then that of an exponent of 1.
    pub exponent: f64,
    /// The standard deviation of the logarithm of the pressure, in the middle of the steps.
    pub sigma: f64,
    /// Whether its reading never changed, although those of others have noise.
    pub is_dead: bool,
}

/// How curves were found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Steps of pressure, and placements of the bag.
    pub steps: usize,
    /// See [`Self::steps`].
    pub placements: usize,
    /// The lowest and the highest pressure, in Pa.
    pub pressures: [f64; 2],
    /// How unevenly the bag presses, relative; NaN after a single placement.
    pub uneven: f64,
    /// The median exponent.
    pub exponent: f64,
}

/// The curves of all taxels, and how they were found.
pub type Curves = (IdVec<PatchId, IdVec<VertexId, TaxelCurve>>, StepReport);

impl<'s> StepEstimator<'s> {
    /// An estimator for steps of pressure: rows of a time in s, and the pressure in Pa from then on. The last row ends
    /// the step before it, or lasts to the end of the recording.
    ///
    /// # Errors
    /// If there is no step, times do not grow, or a pressure is negative, not a number, or no pressure of a bag in Pa.
    pub fn new(skin: &'s Skin, rows: &[[f64; 2]]) -> Result<Self, ResponseError> {
        skin.validate()?;
        let mut steps: Vec<Step> = Vec::new();
        let mut placement = 0;
        for (k, &[time, pressure]) in rows.iter().enumerate() {
            if !time.is_finite() || (k > 0 && time <= rows[k - 1][0]) {
                return Err(ResponseError::StepTime { row: k + 1, found: time });
            }
            if !(pressure == 0.0 || (PRESSURES[0]..=PRESSURES[1]).contains(&pressure)) {
                return Err(ResponseError::StepPressure { row: k + 1, found: pressure });
            }
            let to = rows.get(k + 1).map_or(f64::INFINITY, |next| next[0]);
            if pressure == 0.0 {
                placement += usize::from(!steps.is_empty());
                continue;
            }
            match steps.last_mut() {
                Some(last) if last.to == time && (pressure / last.pressure - 1.0).abs() < SAME => {
                    last.to = to
                }
                _ => steps.push(Step { from: time, to, counted: [time, to], pressure, placement }),
            }
        }
        // Zeros at the beginning and the end, and twice in a row, are no further placements.
        let mut numbers: Vec<usize> = steps.iter().map(|step| step.placement).collect();
        numbers.dedup();
        for step in &mut steps {
            step.placement = numbers.iter().position(|&n| n == step.placement).unwrap_or(0);
        }
        if steps.is_empty() {
            return Err(ResponseError::NoSteps { rows: rows.len() });
        }
        let mut lengths: Vec<f64> =
            steps.iter().map(|step| step.to - step.from).filter(|length| length.is_finite()).collect();
        let open_length = median_of(&mut lengths).unwrap_or(OPEN_LENGTH);
        for step in &mut steps {
            let length = step.to - step.from;
            let margin = SETTLES * if length.is_finite() { length } else { open_length };
            step.counted = [step.from + margin, step.to - margin];
        }
        let taxels = skin.patches.iter().map(|patch| patch.mesh.positions.len()).sum();
        let seen = vec![Seen::NOTHING; steps.len() * taxels];
        Ok(Self { skin, steps, seen, taxels, times: [f64::INFINITY, f64::NEG_INFINITY], goes_back: false })
    }

    /// Takes the next frame: the first channel, with zeros subtracted.
    ///
    /// # Panics
    /// If it does not have the patches and taxels of the skin.
    pub fn see(&mut self, frame: &Frame) {
        let time = frame.time;
        self.goes_back |= time < self.times[1];
        self.times = [self.times[0].min(time), self.times[1].max(time)];
        let inside = |step: &Step| (step.counted[0]..=step.counted[1]).contains(&time);
        let read = frame.values.iter().flat_map(|channels| channels[0].iter());
        let Some(step) = self.steps.iter().position(inside) else { return };
        let seen = self.seen[step * self.taxels..].iter_mut().zip(read);
        seen.filter(|(_, x)| x.is_finite()).for_each(|(seen, &x)| seen.see(x));
    }

    /// The curves of all taxels.
    ///
    /// # Errors
    /// If the recording does not last as long as the steps, its times go back, or its readings do not follow the steps.
    pub fn solve(self) -> Result<Curves, ResponseError> {
        if self.goes_back {
            return Err(ResponseError::StepClocks);
        }
        let felt = (0..self.steps.len()).filter(|&k| self.row(k).iter().any(|seen| seen.count > 0.0));
        let (found, needed) = (felt.count(), self.steps.len());
        if found < needed {
            let steps = [self.steps[0].from, self.steps[needed - 1].from];
            return Err(ResponseError::StepsOutside { found, needed, steps, recording: self.times });
        }
        let usual: Vec<f64> = (0..needed).map(|step| self.usual(step)).collect();
        let points: Vec<Vec<(Step, f64)>> =
            (0..self.taxels).map(|taxel| self.points(taxel, &usual)).collect();
        let pressures = self.steps.iter().map(|step| step.pressure);
        let range = [pressures.clone().fold(f64::INFINITY, f64::min), pressures.fold(0.0, f64::max)];
        let has_one_pressure = range[1] < range[0] * (1.0 + SAME);
        let mut lines: Vec<Option<Line>> =
            points.iter().map(|points| Line::through(points, has_one_pressure)).collect();
        let middle = |lines: &[Option<Line>], of: fn(&Line) -> f64| {
            median_of(&mut lines.iter().flatten().map(of).collect::<Vec<f64>>()).unwrap_or(f64::NAN)
        };
        let (slope, residual) = (middle(&lines, |line| line.slope), middle(&lines, |line| line.residual));
        if !(slope > LEAST_SLOPE && residual < MOST_RESIDUAL) {
            return Err(ResponseError::StepsDoNotFit { slope, residual });
        }
        // A taxel that falls under pressure, or rises and falls, has no curve.
        for line in &mut lines {
            *line = line.take().filter(|line| line.slope > LEAST_SLOPE && line.residual < MOST_RESIDUAL);
        }
        shrink(&mut lines, has_one_pressure);
        let slope = middle(&lines, |line| line.slope);
        let placements = self.steps.last().map_or(0, |step| step.placement + 1);
        let uneven = unevenness(&lines, &points, placements);
        let bag = if uneven.is_nan() { UNEVEN } else { uneven } / (placements as f64).sqrt();
        const UNKNOWN: TaxelCurve =
            TaxelCurve { gain: f64::NAN, exponent: f64::NAN, sigma: f64::NAN, is_dead: false };
        let mut noises: Vec<f64> = self.seen.iter().map(|seen| seen.range[1] - seen.range[0]).collect();
        let has_noise = median_of(&mut noises).is_some_and(|noise| noise > 0.0);
        let mut next = lines.iter().zip(0_usize..);
        let mut curve = || {
            let Some((line, taxel)) = next.next() else { return UNKNOWN };
            let Some(line) = line else {
                return TaxelCurve { is_dead: has_noise && self.is_dead(taxel, &usual), ..UNKNOWN };
            };
            let exponent = line.slope.recip();
            let own = exponent * line.residual / line.count.sqrt();
            let (gain, sigma) = ((-line.offset * exponent).exp(), bag.hypot(own).hypot(LEAST_SIGMA));
            // What no file can hold, or nobody can use, is not known.
            let is_known = own < MOST_SIGMA && gain.is_normal();
            if !is_known {
                return UNKNOWN;
            }
            let exponent = if has_one_pressure { f64::NAN } else { exponent };
            TaxelCurve { gain, exponent, sigma, is_dead: false }
        };
        let curves = self.skin.patches.map(|patch| patch.mesh.positions.ids().map(|_| curve()).collect());
        let (steps, exponent) = (needed, if has_one_pressure { f64::NAN } else { slope.recip() });
        Ok((curves, StepReport { steps, placements, pressures: range, uneven, exponent }))
    }

    fn row(&self, step: usize) -> &[Seen] {
        &self.seen[step * self.taxels..][..self.taxels]
    }

    /// What three of four taxels read less than in a step, on average: a bag covers a quarter of the skin at least.
    fn usual(&self, step: usize) -> f64 {
        let means = self.row(step).iter().filter(|seen| seen.count > 0.0).map(|seen| seen.sum / seen.count);
        let mut means: Vec<f64> = means.collect();
        means.sort_unstable_by(f64::total_cmp);
        means.get(means.len() * 3 / 4).copied().unwrap_or(0.0)
    }

    /// Whether a taxel reads the same in all steps, up to rounding, although others have noise.
    fn is_dead(&self, taxel: usize, usual: &[f64]) -> bool {
        /// Spread of the readings of a dead taxel over the usual largest reading: far below any step of a converter.
        const DEAD_SPREAD: f64 = 1e-9;
        let all = || (0..self.steps.len()).map(|k| self.seen[k * self.taxels + taxel]);
        let [least, most] = all().fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], seen| {
            [least.min(seen.range[0]), most.max(seen.range[1])]
        });
        least <= most && most - least <= DEAD_SPREAD * usual.iter().copied().fold(0.0, f64::max)
    }

    /// The mean readings of a taxel in the steps that it feels, above its noise, without those at its limit. `usual` are those of all.
    fn points(&self, taxel: usize, usual: &[f64]) -> Vec<(Step, f64)> {
        let at = |k: usize| &self.seen[k * self.taxels + taxel];
        let most = (0..self.steps.len()).map(|k| at(k).range[1]).fold(f64::NEG_INFINITY, f64::max);
        let is_at_most = |k: usize| at(k).range == [most; 2];
        let pressure = |k: usize| self.steps[k].pressure;
        let limits = || (0..self.steps.len()).filter(|&k| is_at_most(k)).map(pressure);
        let lowest = limits().fold(f64::INFINITY, f64::min);
        // The same reading at quite different pressures is a limit.
        let is_limited = limits().any(|pressure| pressure > 1.1 * lowest);
        let steps = (0..self.steps.len()).filter(|&k| at(k).count > 0.0 && !(is_limited && is_at_most(k)));
        let points = steps.map(|k| (k, at(k).sum / at(k).count));
        let is_felt = |(k, reading): &(usize, f64)| {
            *reading > NOISE * at(*k).noise() && *reading > LEAST_SHARE * most.max(usual[*k]).max(0.0)
        };
        points.filter(is_felt).map(|(k, reading)| (self.steps[k], reading)).collect()
    }
}

/// `ln(reading) = offset + slope ln(pressure)`.
struct Line {
    offset: f64,
    slope: f64,
    /// The means of both logarithms, and the sum of the squares of that of pressure about its mean.
    means: [f64; 2],
    spread: f64,
    residual: f64,
    count: f64,
}

impl Line {
    fn through(points: &[(Step, f64)], has_one_pressure: bool) -> Option<Self> {
        let count = points.len() as f64;
        let logs = || points.iter().map(|(step, reading)| (step.pressure.ln(), reading.ln()));
        let (x, y) = logs().fold((0.0, 0.0), |(x, y), (p, c)| (x + p / count, y + c / count));
        let spread = logs().map(|(p, _)| (p - x).powi(2)).sum::<f64>();
        if points.is_empty() || (spread < SAME * SAME && !has_one_pressure) {
            return None;
        }
        let slope =
            if has_one_pressure { 1.0 } else { logs().map(|(p, c)| (p - x) * (c - y)).sum::<f64>() / spread };
        Some(
            Self { offset: y - slope * x, slope, means: [x, y], spread, residual: 0.0, count }
                .measured(points),
        )
    }

    fn measured(mut self, points: &[(Step, f64)]) -> Self {
        let left = |(step, c): &(Step, f64)| (c.ln() - self.offset - self.slope * step.pressure.ln()).powi(2);
        self.residual = (points.iter().map(left).sum::<f64>() / (self.count - 2.0).max(1.0)).sqrt();
        self
    }
}

/// Moves slopes towards their median, as far as their error says.
fn shrink(lines: &mut [Option<Line>], has_one_pressure: bool) {
    if has_one_pressure {
        return;
    }
    let mut slopes: Vec<f64> = lines.iter().flatten().map(|line| line.slope).collect();
    let mut residuals: Vec<f64> = lines.iter().flatten().map(|line| line.residual).collect();
    let mut spreads: Vec<f64> = lines.iter().flatten().map(|line| line.spread).collect();
    let (Some(residual), Some(spread)) = (median_of(&mut residuals), median_of(&mut spreads)) else { return };
    let Some(middle) = median_of(&mut slopes) else { return };
    let variance = slopes.iter().map(|slope| (slope - middle).powi(2)).sum::<f64>() / slopes.len() as f64;
    let own = (variance - residual * residual / spread).max(1e-5);
    for line in lines.iter_mut().flatten() {
        let error = residual * residual / line.spread;
        line.slope = middle + (line.slope - middle) * own / (own + error);
        line.offset = line.means[1] - line.slope * line.means[0];
    }
}

/// The standard deviation of pressures between placements at one taxel, relative; NaN with fewer than two.
fn unevenness(lines: &[Option<Line>], points: &[Vec<(Step, f64)>], placements: usize) -> f64 {
    if placements < 2 {
        return f64::NAN;
    }
    let (mut sum, mut count) = (0.0, 0.0);
    for (line, points) in lines.iter().zip(points) {
        let Some(line) = line else { continue };
        let mean = |placement: usize| {
            let of = points.iter().filter(|(step, _)| step.placement == placement);
            let left = of.map(|(step, c)| (c.ln() - line.offset) / line.slope - step.pressure.ln());
            let (sum, count) = left.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
            (count > 0.0).then(|| sum / count)
        };
        let means: Vec<f64> = (0..placements).filter_map(mean).collect();
        let middle = means.iter().sum::<f64>() / means.len() as f64;
        if means.len() > 1 {
            sum += means.iter().map(|x| (x - middle).powi(2)).sum::<f64>();
            count += means.len() as f64 - 1.0;
        }
    }
    if count > 0.0 { f64::sqrt(sum / count) } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::id::IdVec;
    use crate::mesh::shapes;

    /// Readings follow a step of pressure slowly: what they are in its first quarter changes no curve, be it the last
    /// step, which no row ends.
    #[test]
    fn the_beginning_of_a_step_does_not_count() {
        let skin = Skin::from_mesh("pad", shapes::lattice(3, 3, 0.01));
        let rows = [[0.0, 1e4], [4.0, 2e4], [8.0, 4e4], [12.0, 8e4]];
        let curve = |slow: f64| {
            let mut estimator = StepEstimator::new(&skin, &rows).unwrap();
            for frame in 0..160 {
                let time = 0.1 * f64::from(frame);
                let [from, pressure] = *rows.iter().rev().find(|row| row[0] <= time).unwrap();
                let reading = pressure / 100.0 * if time - from < 0.9 { slow } else { 1.0 };
                let values = IdVec::from(vec![vec![(0..9).map(|_| reading).collect()]]);
                estimator.see(&Frame { time, values, ..Frame::default() });
            }
            estimator.solve().unwrap().0.iter().flatten().next().copied()
        };
        assert_eq!(curve(1.0), curve(0.5));
    }
}
