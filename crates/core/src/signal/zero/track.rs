//! The zeros of one channel: which taxels are active, and how zeros move.

use std::{iter, mem};

use crate::numeric::{Csr, median_of, storable};
use crate::signal::clock::SAME_S;
use crate::signal::zero::common::{Common, limited};
use crate::signal::{QUANTISATION, RunningNoise};

/// Excess over `sigma` from which a taxel is active or below its zero, and below which it is not active any more.
const ACTIVE: f64 = 5.0;
const RELEASED: f64 = 2.5;

/// The same of a share of the peak of the touch.
const RELEASED_SHARE: f64 = 0.12;

/// A touch with a peak of this many `sigma` is followed by a time in which the sensor recovers, in s; what is left of
/// it is at most this share of the peak, and decays with this time constant, in s.
const STRONG: f64 = 10.0;
const RECOVERY_S: f64 = 1.0;
const RECOVERY_SHARE: f64 = 0.15;
const RECOVERY_TIME_S: f64 = 0.35;

/// Time constant of the zero of an untouched taxel, in s, and the age up to which it is a mean.
const FOLLOW_S: f64 = 5.0;
const YOUNG_S: f64 = 5.0;

/// Excess over `sigma` that moves a zero, at most.
const LIMIT: f64 = 2.0;

/// Frames in which differences are limited by the median noise, because that of a taxel is not known yet.
const FIRST_NOISE_FRAMES: u32 = 50;

/// Frames below zero after which a zero is taken again.
const BELOW_FRAMES: u32 = 5;

/// A module was replaced where this many untouched taxels, each at most two edges from another one, jump by [`JUMP`]
/// `sigma`, and this many to as far below their zero. Neighbours that move by [`SHIFT`] `sigma` belong to it.
const MODULE_TAXELS: usize = 6;
const MODULE_BELOW: usize = 2;
const JUMP: f64 = 8.0;
const SHIFT: f64 = 3.0;

/// How often coefficients are estimated, in s.
const COEFFICIENTS_S: f64 = 5.0;

/// A coefficient is 1 give or take 0.3 before anything is known; zeros are known to 0.6 `sigma`. The square of
/// the ratio, over `sigma^2`.
const PRIOR: f64 = 4.0;

/// Coefficients lie between these.
const COEFFICIENTS: [f64; 2] = [-1.0, 3.0];

/// What happened to zeros.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ZeroReport {
    /// Zeros that were taken in contact, and again when the contact ended.
    pub retaken: u64,
    /// Groups of connected taxels that jumped at once, as those of a replaced module: their zeros were taken again.
    pub replaced: u64,
}

/// The zeros of one channel.
#[derive(Debug, Clone)]
pub(super) struct Track {
    is_signed: bool,
    start: (f64, usize),
    taxels: Vec<Taxel>,
    /// Excess of each taxel over its zero in this frame; NaN without a reading.
    pub(super) excess: Vec<f64>,
    is_blocked: Vec<bool>,
    /// The active ones.
    active: Vec<u32>,
    /// Connected taxels that jumped, and those that are in such a group.
    group: Vec<usize>,
    is_seen: Vec<bool>,
    scratch: Vec<f64>,
    frames: u32,
    /// Since the first frame, in s.
    now: f64,
    estimated: f64,
    /// The smallest difference of two readings of a taxel; infinite before there is any.
    quantum: f64,
    /// The common drift of each patch, and of all.
    patches: Vec<Common>,
    all: Common,
    pub(super) report: ZeroReport,
}

#[derive(Debug, Clone)]
struct Taxel {
    zero: f64,
    noise: RunningNoise,
    /// The noise, and at least that of rounding.
    sigma: f64,
    last: f64,
    peak: f64,
    recovers_until: f64,
    below_sum: f64,
    coefficient: f64,
    /// The zero and the common drift at the end of its youth.
    anchor: [f64; 2],
    zero_since: f64,
    free_since: f64,
    /// Frames since the zero was taken.
    age: u32,
    below: u32,
    is_active: bool,
    has_jumped: bool,
    has_shifted: bool,
}

const UNKNOWN: Taxel = Taxel {
    zero: f64::NAN,
    noise: RunningNoise::UNKNOWN,
    sigma: f64::NAN,
    last: f64::NAN,
    peak: 0.0,
    recovers_until: f64::NEG_INFINITY,
    below_sum: 0.0,
    coefficient: 1.0,
    anchor: [f64::NAN, 0.0],
    zero_since: 0.0,
    free_since: 0.0,
    age: 0,
    below: 0,
    is_active: false,
    has_jumped: false,
    has_shifted: false,
};

impl Track {
    /// `start`: the first zero is the mean of the frames of this time, in s, and of this many at least.
    /// `patches`: the number of taxels of each.
    pub(super) fn new(patches: impl Iterator<Item = usize>, is_signed: bool, start: (f64, usize)) -> Self {
        let patches: Vec<_> = patches.map(Common::of).collect();
        let taxels = patches.iter().map(|patch| patch.taxels).sum();
        Self {
            is_signed,
            start,
            taxels: vec![UNKNOWN; taxels],
            excess: vec![f64::NAN; taxels],
            is_blocked: vec![false; taxels],
            active: Vec::with_capacity(taxels),
            group: Vec::with_capacity(taxels),
            is_seen: vec![false; taxels],
            scratch: Vec::with_capacity(taxels),
            frames: 0,
            now: 0.0,
            estimated: 0.0,
            quantum: f64::INFINITY,
            patches,
            all: Common::default(),
            report: ZeroReport::default(),
        }
    }

    /// The zeros by now.
    pub(super) fn zeros(&self) -> impl Iterator<Item = f64> {
        self.taxels.iter().map(|taxel| taxel.zero)
    }

    /// The noise of untouched taxels.
    pub(super) fn noise(&self) -> impl Iterator<Item = f64> {
        self.taxels.iter().filter(|taxel| !taxel.is_active).map(|taxel| taxel.sigma)
    }

    /// Takes the readings of a frame: noise, excess, and which taxels are active.
    pub(super) fn see(&mut self, read: impl Iterator<Item = f64>, interval: f64) {
        let median_noise = if self.frames < FIRST_NOISE_FRAMES { self.median_noise() } else { f64::NAN };
        self.now += if self.frames == 0 { 0.0 } else { interval };
        self.frames += 1;
        let recovered = 1.0 - (-interval / RECOVERY_TIME_S).exp();
        self.active.clear();
        for (k, ((taxel, excess), c)) in (0..).zip(self.taxels.iter_mut().zip(&mut self.excess).zip(read)) {
            // What no file stores is no reading.
            if !storable(c).is_finite() {
                *excess = f64::NAN;
                (taxel.is_active, taxel.has_jumped, taxel.has_shifted) = (false, false, false);
                continue;
            }
            if taxel.zero.is_nan() {
                *taxel = Taxel { zero: c, zero_since: self.now, free_since: self.now, ..UNKNOWN };
            }
            taxel.last = c;
            let d = taxel.noise.see(c, if median_noise.is_nan() { taxel.sigma } else { median_noise });
            if d != 0.0 {
                self.quantum = self.quantum.min(d.abs());
            }
            taxel.sigma = taxel.noise.sigma;
            if self.quantum.is_finite() && taxel.sigma.is_finite() {
                taxel.sigma = taxel.sigma.max(QUANTISATION * self.quantum);
            }
            let sigma = taxel.sigma;
            let x = c - taxel.zero;
            *excess = x;
            let height = if self.is_signed { x.abs() } else { x };
            let was_active = taxel.is_active;
            taxel.has_jumped = !was_active && d.abs() > JUMP * sigma;
            taxel.has_shifted = !was_active && d.abs() > SHIFT * sigma;
            let is_starting = height > ACTIVE * sigma && self.now >= taxel.recovers_until - SAME_S;
            taxel.is_active =
                is_starting || (was_active && height > (RELEASED * sigma).max(RELEASED_SHARE * taxel.peak));
            if taxel.is_active {
                taxel.peak = taxel.peak.max(height);
                self.active.push(k);
            } else if was_active && taxel.peak > STRONG * sigma {
                taxel.recovers_until = self.now + RECOVERY_S;
            } else if self.now < taxel.recovers_until - SAME_S {
                if height.abs() < RECOVERY_SHARE * taxel.peak {
                    taxel.zero += recovered * x;
                    *excess = c - taxel.zero;
                }
            } else {
                taxel.peak = 0.0;
            }
        }
    }

    fn median_noise(&mut self) -> f64 {
        self.scratch.clear();
        self.scratch.extend(self.taxels.iter().map(|taxel| taxel.sigma).filter(|sigma| sigma.is_finite()));
        median_of(&mut self.scratch).unwrap_or(f64::NAN)
    }

    /// Moves the zeros, after [`Self::see`].
    pub(super) fn follow(&mut self, neighbours: &Csr<u32>, interval: f64) {
        if self.now < self.start.0 - SAME_S || self.frames as usize <= self.start.1 {
            for (taxel, excess) in self.taxels.iter_mut().zip(&mut self.excess).filter(|(_, x)| x.is_finite())
            {
                taxel.age += 1;
                let step = *excess / f64::from(taxel.age);
                taxel.zero += step;
                *excess -= step;
                (taxel.is_active, taxel.peak) = (false, 0.0);
                taxel.anchor = [taxel.zero, 0.0];
            }
            return;
        }
        self.is_blocked.fill(false);
        for &k in &self.active {
            self.is_blocked[k as usize] = true;
            neighbours[k as usize].iter().for_each(|&other| self.is_blocked[other as usize] = true);
        }
        if !self.is_signed {
            self.take_zeros_below();
            self.take_zeros_of_modules(neighbours);
        }
        let is_estimated = self.now - self.estimated >= COEFFICIENTS_S - SAME_S;
        if is_estimated {
            self.estimated = self.now;
        }
        self.follow_common(neighbours, interval);
        let share = 1.0 - (-interval / FOLLOW_S).exp();
        let drift = self.patches.iter().flat_map(|patch| iter::repeat_n(patch.drift, patch.taxels));
        let of_taxel = self.taxels.iter_mut().zip(&mut self.excess).zip(&self.is_blocked).zip(drift);
        for (((taxel, excess), &is_blocked), drift) in of_taxel {
            if !excess.is_finite() {
                continue;
            }
            taxel.age += 1;
            let is_young = self.now - taxel.zero_since < YOUNG_S - SAME_S;
            if is_blocked {
                taxel.free_since = self.now;
            } else {
                let share = if is_young { share.max(f64::from(taxel.age).recip()) } else { share };
                let step = share * limited(*excess, LIMIT * taxel.sigma);
                taxel.zero += step;
                *excess -= step;
            }
            if is_young {
                taxel.anchor = [taxel.zero, drift];
            } else if is_estimated && !is_blocked && self.now - taxel.free_since >= YOUNG_S - SAME_S {
                let (own, common) = (taxel.zero - taxel.anchor[0], drift - taxel.anchor[1]);
                let prior = PRIOR * taxel.sigma * taxel.sigma;
                let found = (own * common + prior) / (common * common + prior);
                if found.is_finite() {
                    taxel.coefficient = found.clamp(COEFFICIENTS[0], COEFFICIENTS[1]);
                }
            }
        }
    }

    /// Moves the zeros of all taxels by the common drift of the untouched ones of their patch, times their coefficients; by
    /// that of all patches where a patch has too few.
    fn follow_common(&mut self, neighbours: &Csr<u32>, interval: f64) {
        let (taxels, excess, is_signed) = (&self.taxels, &self.excess, self.is_signed);
        let height = |x: f64| if is_signed { x.abs() } else { x };
        // A touch that is too weak for each of its taxels is no common drift.
        let is_raised = |k: usize| {
            if height(excess[k]) <= taxels[k].sigma {
                return false;
            }
            let (mut sum, mut variance) = (0.0, 0.0);
            for k in neighbours[k].iter().map(|&k| k as usize).chain([k]) {
                if excess[k].is_finite() {
                    sum += excess[k];
                    variance += taxels[k].sigma.powi(2);
                }
            }
            height(sum) > ACTIVE * variance.sqrt()
        };
        let (mut first, mut all) = (0, self.all.start());
        for patch in &mut self.patches {
            *patch = patch.start();
            for k in first..first + patch.taxels {
                let (taxel, x) = (&taxels[k], excess[k]);
                let is_known = x.is_finite() && taxel.sigma.is_finite();
                if is_known && !self.is_blocked[k] && !is_raised(k) {
                    patch.take(limited(x, LIMIT * taxel.sigma), taxel.coefficient, taxel.sigma);
                }
            }
            first += patch.taxels;
            all.add(patch);
        }
        self.all = all;
        let of_all = self.all.step(interval).unwrap_or(0.0);
        first = 0;
        for patch in &mut self.patches {
            let step = patch.step(interval).unwrap_or(of_all);
            patch.drift += step;
            let taxels = first..first + patch.taxels;
            for (taxel, excess) in self.taxels[taxels.clone()].iter_mut().zip(&mut self.excess[taxels]) {
                // Unknown where there is no reading.
                let step = taxel.coefficient * step;
                taxel.zero += step;
                *excess -= step;
            }
            first += patch.taxels;
        }
    }

    /// Takes the zeros again that were taken in contact. Taxels below their zero do not follow.
    fn take_zeros_below(&mut self) {
        for ((taxel, excess), is_blocked) in
            self.taxels.iter_mut().zip(&mut self.excess).zip(&mut self.is_blocked)
        {
            // False without a reading, too.
            let is_below = *excess < -ACTIVE * taxel.sigma;
            if !is_below {
                (taxel.below, taxel.below_sum) = (0, 0.0);
                continue;
            }
            *is_blocked = true;
            taxel.below += 1;
            taxel.below_sum += *excess;
            if taxel.below >= BELOW_FRAMES {
                let step = taxel.below_sum / f64::from(taxel.below);
                taxel.take_zero(taxel.zero + step, self.now);
                *excess -= step;
                self.report.retaken += 1;
            }
        }
    }

    /// Takes the zeros of replaced modules again.
    fn take_zeros_of_modules(&mut self, neighbours: &Csr<u32>) {
        let is_below = |taxel: &Taxel, x: f64| taxel.has_jumped && x < -JUMP * taxel.sigma;
        let is_any = self.taxels.iter().zip(&self.excess).any(|(taxel, &x)| is_below(taxel, x));
        if !is_any {
            return;
        }
        let (mut group, mut is_seen) = (mem::take(&mut self.group), mem::take(&mut self.is_seen));
        is_seen.fill(false);
        for seed in 0..self.taxels.len() {
            if is_seen[seed] || !self.taxels[seed].has_jumped {
                continue;
            }
            is_seen[seed] = true;
            group.clear();
            group.push(seed);
            let mut next = 0;
            while let Some(&k) = group.get(next) {
                next += 1;
                if !self.taxels[k].has_jumped {
                    continue;
                }
                for &near in &neighbours[k] {
                    let near = near as usize;
                    if self.taxels[near].has_shifted && !mem::replace(&mut is_seen[near], true) {
                        group.push(near);
                    }
                    // A taxel of the module that stays where it was does not part the others.
                    for &far in &neighbours[near] {
                        let far = far as usize;
                        if self.taxels[far].has_jumped && !mem::replace(&mut is_seen[far], true) {
                            group.push(far);
                        }
                    }
                }
            }
            let jumped = group.iter().filter(|&&k| self.taxels[k].has_jumped).count();
            let below = group.iter().filter(|&&k| is_below(&self.taxels[k], self.excess[k])).count();
            if jumped < MODULE_TAXELS || below < MODULE_BELOW {
                continue;
            }
            // Readings of a contact that ends all fall.
            let rises = group
                .iter()
                .any(|&k| self.taxels[k].has_jumped && self.excess[k] > JUMP * self.taxels[k].sigma);
            if rises {
                self.report.replaced += 1;
            } else {
                self.report.retaken += below as u64;
            }
            for &k in &group {
                let taxel = &mut self.taxels[k];
                taxel.take_zero(taxel.last, self.now);
                (self.excess[k], self.is_blocked[k]) = (0.0, false);
            }
        }
        (self.group, self.is_seen) = (group, is_seen);
    }
}

impl Taxel {
    fn take_zero(&mut self, zero: f64, now: f64) {
        (self.zero, self.zero_since, self.free_since, self.age) = (zero, now, now, 0);
        (self.below, self.below_sum, self.is_active, self.peak) = (0, 0.0, false, 0.0);
    }
}
