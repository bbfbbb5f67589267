//! Columns assigned to taxels such that those with alike signals are near each other: a quadratic assignment problem,
//! which steps of Frank and Wolfe `(vogelstein2015)` solve nearly, from several starts.

use glam::{DMat2, DVec2};

use crate::numeric::{Csr, assign, median};
use crate::parallel::par_rows;
use crate::run::{Cancelled, Run};
use crate::signal::order::align::Start;
use crate::signal::order::likeness::Likeness;
use crate::signal::order::surface::Surface;

/// Smaller likenesses, and values of the kernel, are left out.
const LEAST_LIKENESS: f64 = 0.05;
const LEAST_KERNEL: f64 = 0.03;

/// The length of the likeness is that of pairs more alike than this; without any, this many spacings.
const ALIKE: f64 = 0.3;
const LENGTH: f64 = 1.3;

/// The first start: how wide it is, in spacings, the share of it that is spread, and steps from it.
const WIDTH: f64 = 2.0;
const SPREAD: f64 = 0.7;
const STEPS: usize = 40;
const CHANGE: f64 = 1e-6;

/// Further starts around the best assignment so far: their widths, in spacings, and steps from each.
const WIDTHS: [f64; 6] = [3.0, 2.0, 1.5, 2.5, 1.5, 1.0];
const FURTHER_STEPS: usize = 30;
const FURTHER_CHANGE: f64 = 1e-5;

/// Rounds of further starts, which go on while one of them raises the objective by this.
const FURTHER_ROUNDS: usize = 4;
const PROGRESS: f64 = 0.002;

/// Steps that make the sums of rows and columns 1.
const BALANCED: usize = 15;

/// An assignment of columns to taxels.
#[derive(Debug, Clone)]
pub(super) struct Answer {
    /// The cosine of the likeness and the kernel, over all pairs of columns.
    pub(super) objective: f64,
    pub(super) taxels: Vec<usize>,
}

pub(super) struct Matching<'a> {
    surface: &'a Surface,
    /// The map of the taxels.
    targets: &'a [DVec2],
    likeness: Csr<(u32, f64)>,
    kernel: Csr<(u32, f64)>,
    /// The length `l` of the kernel `exp(-d^2 / 2 l^2)`, in m.
    length: f64,
    /// Sum of the squares of likenesses.
    squares: f64,
}

impl<'a> Matching<'a> {
    /// The problem whose kernel has the length that fits a first assignment.
    pub(super) fn new(
        likeness: &Likeness,
        surface: &'a Surface,
        targets: &'a [DVec2],
        taxels: &[usize],
    ) -> Self {
        let count = likeness.len();
        let pairs = (0..count).flat_map(|a| (0..count).map(move |b| (a, b))).filter(|(a, b)| a != b);
        let pairs = pairs.map(|(a, b)| (a, b, likeness.row(a)[b]));
        let square = |(a, b, cosine): (usize, usize, f64)| {
            let d = surface.distance(taxels[a], taxels[b]);
            (cosine > ALIKE && d > 0.0).then(|| d * d / (-2.0 * cosine.min(0.999).ln()))
        };
        let length = median(pairs.clone().filter_map(square)).map_or(LENGTH * surface.spacing, f64::sqrt);
        let kept = pairs.filter(|(.., cosine)| *cosine > LEAST_LIKENESS);
        let likeness = Csr::from_pairs(count, kept.map(|(a, b, cosine)| (a, (index(b), cosine))));
        let all = (0..surface.len()).flat_map(|a| (0..surface.len()).map(move |b| (a, b)));
        let near = all.filter(|(a, b)| a != b).filter_map(|(a, b)| {
            let kernel = (-0.5 * (surface.distance(a, b) / length).powi(2)).exp();
            (kernel > LEAST_KERNEL).then(|| (a, (index(b), kernel)))
        });
        let kernel = Csr::from_pairs(surface.len(), near.collect::<Vec<_>>().into_iter());
        let squares = likeness.items().iter().map(|(_, x)| x * x).sum();
        Self { surface, targets, likeness, kernel, length, squares }
    }

    /// The best assignment that is found near a start.
    pub(super) fn solve(&self, start: &Start, run: Run<'_>) -> Result<Answer, Cancelled> {
        let mut soft = self.around(&start.points, WIDTH);
        soft.iter_mut().for_each(|x| *x *= SPREAD);
        for (k, &taxel) in start.taxels.iter().enumerate() {
            soft[k * self.surface.len() + taxel] += 1.0 - SPREAD;
        }
        let mut best = self.climb(soft, STEPS, CHANGE, run)?;
        for _ in 0..FURTHER_ROUNDS {
            let before = best.objective;
            for width in WIDTHS {
                let soft = self.around(&self.smoothed(&best.taxels), width);
                let answer = self.climb(soft, FURTHER_STEPS, FURTHER_CHANGE, run)?;
                if answer.objective > best.objective {
                    best = answer;
                }
            }
            if best.objective - before < PROGRESS {
                break;
            }
        }
        Ok(best)
    }

    /// How much the likeness of each column fits its neighbourhood: the cosine of its row and that of the kernel.
    pub(super) fn supports(&self, taxels: &[usize]) -> Vec<f64> {
        let kernel = |a: usize, b: usize| {
            (-0.5 * (self.surface.distance(taxels[a], taxels[b]) / self.length).powi(2)).exp()
        };
        let support = |(a, row): (usize, &[(u32, f64)])| {
            let product: f64 = row.iter().map(|&(b, x)| x * kernel(a, b as usize)).sum();
            let own: f64 = row.iter().map(|(_, x)| x * x).sum();
            let other: f64 = (0..taxels.len()).filter(|&b| b != a).map(|b| kernel(a, b).powi(2)).sum();
            product / (own * other).sqrt().max(f64::MIN_POSITIVE)
        };
        self.likeness.iter().enumerate().map(support).collect()
    }

    /// The objective of an assignment.
    pub(super) fn objective(&self, taxels: &[usize]) -> f64 {
        let mut columns = vec![usize::MAX; self.surface.len()];
        taxels.iter().enumerate().for_each(|(column, &taxel)| columns[taxel] = column);
        let (mut product, mut squares) = (0.0, 0.0);
        let mut near = vec![0.0; taxels.len()];
        for (a, row) in self.likeness.iter().enumerate() {
            near.fill(0.0);
            for &(taxel, kernel) in &self.kernel[taxels[a]] {
                if let Some(x) = near.get_mut(columns[taxel as usize]) {
                    *x = kernel;
                    squares += kernel * kernel;
                }
            }
            product += row.iter().map(|&(b, x)| x * near[b as usize]).sum::<f64>();
        }
        product / (self.squares * squares).sqrt().max(f64::MIN_POSITIVE)
    }

    /// Shares of each column on the taxels around a point, such that taxels have at most one column in all.
    fn around(&self, points: &[DVec2], width: f64) -> Vec<f64> {
        /// Added to each share, so that no taxel is impossible for a column.
        const LEAST: f64 = 1e-9;
        let count = self.surface.len();
        let square = 2.0 * (width * self.surface.spacing).powi(2);
        let mut shares: Vec<f64> = Vec::with_capacity(points.len() * count);
        for x in points {
            shares.extend(self.targets.iter().map(|y| (-x.distance_squared(*y) / square).exp() + LEAST));
        }
        // What is left of each taxel, as if columns without a signal shared it.
        let free = (count - points.len()) as f64;
        let mut rest = vec![1.0 / count as f64 * free; count];
        let mut sums = vec![0.0; count];
        for _ in 0..=BALANCED {
            for row in shares.chunks_exact_mut(count) {
                let sum: f64 = row.iter().sum();
                row.iter_mut().for_each(|x| *x /= sum);
            }
            if free > 0.0 {
                let factor = free / rest.iter().sum::<f64>();
                rest.iter_mut().for_each(|x| *x *= factor);
            }
            sums.copy_from_slice(&rest);
            for row in shares.chunks_exact(count) {
                sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
            }
            for row in shares.chunks_exact_mut(count) {
                row.iter_mut().zip(&sums).for_each(|(x, sum)| *x /= sum);
            }
            rest.iter_mut().zip(&sums).for_each(|(x, sum)| *x /= sum);
        }
        for row in shares.chunks_exact_mut(count) {
            let sum: f64 = row.iter().sum();
            row.iter_mut().for_each(|x| *x /= sum);
        }
        shares
    }

    /// Where columns are according to those that are alike: weighted means, which an affine map frees from their
    /// shrinking.
    fn smoothed(&self, taxels: &[usize]) -> Vec<DVec2> {
        /// The weight of where a column is now; with 1 no column moves.
        const OWN: f64 = 0.35;
        let places: Vec<DVec2> = taxels.iter().map(|&taxel| self.targets[taxel]).collect();
        let mut points = places.clone();
        for _ in 0..2 {
            let mean = |(k, row): (usize, &[(u32, f64)])| {
                let sum: f64 = row.iter().map(|(_, x)| x).sum();
                let mean = row.iter().map(|&(b, x)| x * points[b as usize]).sum::<DVec2>() / sum;
                if sum > 0.0 { OWN * points[k] + (1.0 - OWN) * mean } else { points[k] }
            };
            points = self.likeness.iter().enumerate().map(mean).collect();
        }
        affine(&points, &places)
    }

    /// Steps of Frank and Wolfe from shares of columns on taxels, and the assignment nearest to where they end.
    fn climb(
        &self,
        mut shares: Vec<f64>,
        steps: usize,
        change: f64,
        run: Run<'_>,
    ) -> Result<Answer, Cancelled> {
        let count = self.surface.len();
        let rows: Vec<u32> = (0..=index(self.likeness.len())).map(|k| k * index(count)).collect();
        let mixed = par_rows(&rows, |k, out: &mut [f64]| {
            for (b, &share) in shares[k * count..][..count].iter().enumerate().filter(|(_, x)| **x > 1e-12) {
                self.kernel[b].iter().for_each(|&(c, kernel)| out[c as usize] += share * kernel);
            }
        });
        // The gradient is twice this.
        let mut slopes = par_rows(&rows, |k, out: &mut [f64]| {
            for &(b, x) in &self.likeness[k] {
                let row = &mixed[b as usize * count..][..count];
                out.iter_mut().zip(row).for_each(|(sum, y)| *sum += x * y);
            }
        });
        let mut value: f64 = slopes.iter().zip(&shares).map(|(x, y)| x * y).sum();
        for _ in 0..steps {
            run.step()?;
            let costs: Vec<f64> = slopes.iter().map(|x| -x).collect();
            let taxels = assign(&costs, count);
            let new = par_rows(&rows, |k, out: &mut [f64]| {
                for &(b, x) in &self.likeness[k] {
                    let near = &self.kernel[taxels[b as usize]];
                    near.iter().for_each(|&(c, kernel)| out[c as usize] += x * kernel);
                }
            });
            let at = |values: &[f64]| -> f64 {
                taxels.iter().enumerate().map(|(k, &t)| values[k * count + t]).sum()
            };
            let (own, cross) = (at(&new), at(&slopes));
            let (bend, slope) = (own - 2.0 * cross + value, 2.0 * (cross - value));
            let step = if bend >= 0.0 { 1.0 } else { (-slope / (2.0 * bend)).clamp(0.0, 1.0) };
            for (x, y) in slopes.iter_mut().zip(&new) {
                *x += step * (y - *x);
            }
            for (row, &taxel) in shares.chunks_exact_mut(count).zip(&taxels) {
                row.iter_mut().for_each(|x| *x *= 1.0 - step);
                row[taxel] += step;
            }
            let size = cross.abs();
            value += step * slope + step * step * bend;
            if step * slope < change * size {
                break;
            }
        }
        let costs: Vec<f64> = shares.iter().map(|x| -x).collect();
        let taxels = assign(&costs, count);
        Ok(Answer { objective: self.objective(&taxels), taxels })
    }
}

/// Points moved by the affine map that is nearest to targets.
fn affine(points: &[DVec2], targets: &[DVec2]) -> Vec<DVec2> {
    /// Points on a line have no affine map: their determinant is below this share of the square of their trace.
    const DEGENERATE: f64 = 1e-12;
    let n = points.len() as f64;
    let [from, to] = [points, targets].map(|all| all.iter().sum::<DVec2>() / n);
    let (mut square, mut cross) = (DMat2::ZERO, DMat2::ZERO);
    for (x, y) in points.iter().zip(targets) {
        let (x, y) = (*x - from, *y - to);
        square += DMat2::from_cols(x * x.x, x * x.y);
        cross += DMat2::from_cols(y * x.x, y * x.y);
    }
    let trace = square.x_axis.x + square.y_axis.y;
    if square.determinant() <= DEGENERATE * trace * trace {
        return points.to_vec();
    }
    let map = cross * square.inverse();
    points.iter().map(|x| to + map * (*x - from)).collect()
}

fn index(k: usize) -> u32 {
    u32::try_from(k).unwrap_or(u32::MAX)
}
