//! Tests of taxels and modules whose errors are independent, as white noise: chi-square tests where the standard deviation
//! is stated, F tests where it is estimated from the link.
//!
//! With weights `w = 1 / sigma^2`, a difference `d` of one taxel has `w |d|^2` of 3 degrees of freedom. A module has that
//! of its mean difference, 3, and that of its rigid turn `g^T M^+ g`, with `g = sum of w q x d`, `M = sum of
//! w (|q|^2 I - q q^T)` and `q` the places halfway between both files about their mean, of as many as `M` has positive
//! eigenvalues. Halfway between two places of equal noise is independent of their difference, so both laws hold for any
//! noise, however large over the module, and a turn by any angle below 180 degrees counts whole (Cayley). Half a turn
//! leaves all places halfway on its axis: so the part of the squares that the best rigid motion explains counts, too. It is
//! less than all of them, which have 3 degrees of freedom for each taxel.

use glam::{DMat3, DVec3};

use crate::calib::{Pose, outer};
use crate::diff::comparison::{Comparison, LEAST, Test};
use crate::diff::modules::{Module, members_of_modules};
use crate::numeric::{chi_square_tail, f_tail, median, quantile, symmetric_eigen};

/// Eigenvalues below this share of the largest are rounding noise.
const ROUNDING: f64 = 1e-9;

/// The relative standard deviation of the median of `m` chi-square variables of 3 degrees of freedom is this over the
/// root of `m`; from two of them on, modules spread more than their taxels say.
const DEVIATION_OF_CHI_SQUARE_MEDIAN: f64 = 1.12;

/// Fewer modules do not say how they spread.
const LEAST_MODULES: usize = 8;

/// The mean and the turn of a module, as chi-squares with their degrees of freedom.
type Sizes = [(f64, f64); 2];

impl<'p> Comparison<'p> {
    /// Whether errors count as independent: the options state their standard deviation, or neighbours share none.
    pub(super) fn is_independent(&self) -> bool {
        self.options.sigma.is_some() || self.is_white()
    }

    /// Standard deviation of the difference of a taxel along an axis, in m, and of how many degrees of freedom it is an
    /// estimate; infinitely many where it is known.
    fn deviation(&self, k: usize) -> (f64, f64) {
        let stated = self.stated[k];
        match self.total.filter(|_| self.options.sigma.is_none()) {
            Some(total) if total.sigma * stated > LEAST => (total.sigma * stated, total.degrees),
            Some(_) => (LEAST, f64::INFINITY),
            None => (self.sigma(stated, None), f64::INFINITY),
        }
    }

    /// Whether the difference of a taxel is more than noise.
    pub(super) fn test_of_taxel(&self, k: usize, difference: DVec3) -> Test {
        let (sigma, degrees) = self.deviation(k);
        test(difference.length_squared() / (sigma * sigma), 3.0, degrees)
    }

    /// The modules, tested against the whole link. Single taxels that moved do not count, unless most of a module did.
    pub(super) fn independent_modules(&self) -> Vec<Module<'p>> {
        let noise = self.noise();
        let is_out: Vec<bool> = (0..self.expected.len())
            .map(|k| self.test_of_taxel(k, self.differences[k]).p < self.chance_of_taxel)
            .collect();
        let named = members_of_modules(&self.link.pairs).into_iter();
        let (mut modules, mut sizes, mut explained) = (Vec::new(), Vec::new(), Vec::new());
        for ((_, name), members) in named {
            let module = self.module(name, members, noise);
            let rest: Vec<usize> = module.members.iter().copied().filter(|&k| !is_out[k]).collect();
            let counted = if 2 * rest.len() > module.members.len() { &rest } else { &module.members };
            sizes.push(self.sizes(counted));
            explained.push(self.explained(counted, &module.motion));
            modules.push(module);
        }
        let factors = [0, 1].map(|part| self.overdispersion(&sizes, part));
        for ((module, sizes), explained) in modules.iter_mut().zip(&sizes).zip(explained) {
            let degrees = module.members.first().map_or(f64::INFINITY, |&k| self.deviation(k).1);
            let test_of = |part: usize| {
                let (chi2, free) = sizes[part];
                test(chi2 / factors[part], free, degrees)
            };
            let turn = [test_of(1), test(explained.0, explained.1, degrees)];
            module.shift_test = test_of(0);
            module.turn_test = if turn[1].p < turn[0].p { turn[1] } else { turn[0] };
            module.is_changed = module.shift_test.p.min(module.turn_test.p) < self.chance;
        }
        modules
    }

    /// The sum of squares that a motion takes away, and its degrees of freedom at most.
    fn explained(&self, members: &[usize], motion: &Pose) -> (f64, f64) {
        let of = |&k: &usize| {
            let left = self.link.pairs[k].after.position - motion.apply(self.expected[k]);
            (self.differences[k].length_squared() - left.length_squared()) / self.deviation(k).0.powi(2)
        };
        (members.iter().map(of).sum::<f64>().max(0.0), 3.0 * members.len() as f64)
    }

    fn sizes(&self, members: &[usize]) -> Sizes {
        let of = |&k: &usize| {
            let sigma = self.deviation(k).0;
            (self.expected[k] + 0.5 * self.differences[k], self.differences[k], 1.0 / (sigma * sigma))
        };
        let all: Vec<(DVec3, DVec3, f64)> = members.iter().map(of).collect();
        let weight: f64 = all.iter().map(|x| x.2).sum();
        let mean =
            |of: fn(&(DVec3, DVec3, f64)) -> DVec3| all.iter().map(|x| x.2 * of(x)).sum::<DVec3>() / weight;
        let (centre, shift) = (mean(|x| x.0), mean(|x| x.1));
        let (mut torque, mut inertia) = (DVec3::ZERO, DMat3::ZERO);
        for &(at, difference, w) in &all {
            let arm = at - centre;
            torque += w * arm.cross(difference);
            inertia += w * (DMat3::from_diagonal(DVec3::splat(arm.length_squared())) - outer(arm, arm));
        }
        let (values, vectors) = symmetric_eigen(&inertia.to_cols_array_2d());
        let along = DMat3::from_cols_array_2d(&vectors) * torque;
        let most = values.iter().copied().fold(0.0, f64::max);
        let axes = (0..3).filter(|&k| most > 0.0 && values[k] > ROUNDING * most);
        let (turn, free) =
            axes.fold((0.0, 0.0), |(sum, free), k| (sum + along[k] * along[k] / values[k], free + 1.0));
        [(weight * shift.length_squared(), 3.0), (turn, free)]
    }

    /// The variance of the modules over that of independent taxels, if it is clearly above 1: the taxels of a module may
    /// share a small error. The median stays that of noise until half of the modules changed.
    fn overdispersion(&self, sizes: &[Sizes], part: usize) -> f64 {
        let over = |&(chi2, free): &(f64, f64)| (free > 0.0).then(|| chi2 / quantile(0.5, free));
        let known: Vec<f64> = sizes.iter().filter_map(|sizes| over(&sizes[part])).collect();
        let limit = 1.0 + 2.0 * DEVIATION_OF_CHI_SQUARE_MEDIAN / (known.len() as f64).sqrt();
        let is_estimated = self.options.sigma.is_none() && known.len() >= LEAST_MODULES;
        let found = if is_estimated { median(known.into_iter()) } else { None };
        found.filter(|&factor| factor > limit).unwrap_or(1.0)
    }
}

/// The chance of a sum of squares with `free` degrees of freedom, in units of a variance that is an estimate of `degrees`.
fn test(chi2: f64, free: f64, degrees: f64) -> Test {
    let p = match free {
        0.0 => 1.0,
        _ if degrees.is_infinite() => chi_square_tail(chi2, free),
        _ => f_tail(chi2 / free, free, degrees),
    };
    Test { sigmas: chi2.sqrt(), p }
}
