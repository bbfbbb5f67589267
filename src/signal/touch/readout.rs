//! How simulated taxels are read: gains, drift and noise of each, and faults.
//!
//! In this order: readings of swapped taxels are exchanged, and leak where there is crosstalk; a taxel turns pressure into
//! its reading (the inverse of [`TaxelResponse`]); zeros drift, by themselves, together with temperature, and as `1/f`
//! noise, a sum of first-order processes with one time constant for each decade; then come noise, limits and jumps.
//! *Heuristic*: sizes and times of faults are those of the real recordings of CySkin that have some.

use std::collections::HashSet;

use crate::id::VertexId;
use crate::numeric::{Random, argsort};
use crate::signal::touch::TouchOptions;
use crate::signal::{Frame, Quantity, Response, Scale, SignalError, TaxelResponse, TaxelState};
use crate::skin::{PatchId, Presence, Skin};

/// How the readings of taxels differ, and how many are faulty.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReadoutOptions {
    /// Standard deviation of the logarithm of the gains.
    pub gain_spread: f64,
    /// Standard deviation of the logarithm of the exponents, whose median is [`TouchOptions::exponent`].
    pub exponent_spread: f64,
    /// Drift of all zeros with temperature, in Pa/s; each taxel has a coefficient of its own, 1 give or take 0.3.
    pub warming: f64,
    /// `1/f` noise of each zero: its standard deviation in each decade of time, in Pa.
    pub flicker: f64,
    /// Whether pressure lowers readings.
    pub is_inverted: bool,
    /// Faulty taxels.
    pub faults: FaultCounts,
}

/// How many taxels have each fault: single ones, pairs of them (swapped, crosstalk) or groups of twelve (module steps).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultCounts([usize; SIMULATED.len()]);

/// The faults that are simulated, in the order in which taxels are chosen for them.
const SIMULATED: [TaxelState; 10] = [
    TaxelState::Dead,
    TaxelState::Silent,
    TaxelState::Stuck,
    TaxelState::Noisy,
    TaxelState::Jumping,
    TaxelState::Chattering,
    TaxelState::Saturated,
    TaxelState::Swapped,
    TaxelState::Crosstalk,
    TaxelState::ModuleStep,
];

impl FaultCounts {
    /// The faults that are simulated.
    pub fn kinds() -> &'static [TaxelState] {
        &SIMULATED
    }

    /// With this many of a fault; others than [`Self::kinds`] are not simulated, and nothing changes.
    #[must_use]
    pub fn with(mut self, fault: TaxelState, count: usize) -> Self {
        let known = SIMULATED.iter().position(|known| *known == fault);
        known.into_iter().for_each(|k| self.0[k] = count);
        self
    }
}

/// Streams of random numbers: one for each source, so that noise does not change the positions.
pub(super) mod stream {
    pub(crate) const PLACES: u64 = 0;
    pub(crate) const DEAD: u64 = 1;
    pub(crate) const DRIFT: u64 = 2;
    pub(crate) const NOISE: u64 = 3;
    pub(crate) const READOUT: u64 = 4;
    pub(crate) const FLICKER: u64 = 5;
    pub(crate) const FAULTS: u64 = 6;
    pub(crate) const BODIES: u64 = 7;
    pub(crate) const BAG: u64 = 8;
}

/// Share of the pressure that leaks into another taxel.
const LEAK: f64 = 0.5;
/// Share of the pressure that a silent taxel reads.
const SILENT: f64 = 0.02;
/// Noise of noisy taxels over that of others, or over the pressure of a press if there is none.
const NOISY: f64 = 5.0;
const NOISY_SHARE: f64 = 0.05;
/// Height of jumps, of steps of modules and of limits, over the pressure of a press.
const JUMP: f64 = 1.25;
const STEP: f64 = 0.75;
const LIMIT: f64 = 0.5;
/// How many jumps there are in a recording, and how long they last at most, in presses.
const JUMPS: usize = 6;
const JUMP_PRESSES: f64 = 3.0;
/// How many jumps of one frame a chattering taxel has.
const CHATTERS: usize = 40;
/// Taxels of a module.
const MODULE: usize = 12;
/// Standard deviation of the coefficients of temperature.
const COEFFICIENT_SPREAD: f64 = 0.3;
/// Time constants of `1/f` noise, in s.
const FLICKER_S: [f64; 5] = [0.1, 1.0, 10.0, 100.0, 1000.0];

#[derive(Debug, Clone)]
pub(super) struct Readout {
    taxels: Vec<TaxelReadout>,
    /// Numbers of taxels that are exchanged, and of those from which and into which readings leak.
    swapped: Vec<[usize; 2]>,
    leaks: Vec<[usize; 2]>,
    truth: Response,
    noise: Random,
    flicker: Random,
    /// Readings of a press, in their unit; the unit over Pa.
    press: f64,
    unit: f64,
    options: ReadoutOptions,
    hysteresis: f64,
    noise_sigma: f64,
    last: f64,
    felt: Vec<f64>,
}

#[derive(Debug, Clone)]
struct TaxelReadout {
    patch: PatchId,
    taxel: VertexId,
    sensitivity: f64,
    exponent: f64,
    /// Of its own, in Pa/s.
    drift: f64,
    coefficient: f64,
    flicker: [f64; FLICKER_S.len()],
    state: TaxelState,
    /// Frames from which on and before which it jumps, is stuck or has a step.
    events: Vec<[usize; 2]>,
    reading: f64,
    /// Its reading of pressure alone, which lags by the hysteresis.
    shown: f64,
}

impl Readout {
    pub(super) fn new(skin: &Skin, options: &TouchOptions, frames: usize) -> Result<Self, SignalError> {
        let [mut dead, mut drift, mut spread] =
            [stream::DEAD, stream::DRIFT, stream::READOUT].map(|stream| Random::new(options.seed, stream));
        let mut taxels = Vec::new();
        for (patch, about) in skin.patches.enumerate() {
            let present = about.taxels.presence.enumerate().filter(|(_, p)| **p == Presence::Present);
            for (taxel, _) in present {
                let rate = options.drift * drift.normal();
                let [gain, exponent, coefficient] = [(); 3].map(|()| spread.normal());
                if dead.uniform() < options.dead {
                    continue;
                }
                taxels.push(TaxelReadout {
                    patch,
                    taxel,
                    sensitivity: (options.readout.gain_spread * gain).exp(),
                    exponent: options.exponent * (options.readout.exponent_spread * exponent).exp(),
                    drift: rate,
                    coefficient: 1.0 + COEFFICIENT_SPREAD * coefficient,
                    flicker: [0.0; FLICKER_S.len()],
                    state: TaxelState::Ok,
                    events: Vec::new(),
                    reading: 0.0,
                    shown: 0.0,
                });
            }
        }
        if taxels.is_empty() {
            return Err(SignalError::NoTaxels);
        }
        let unit = if options.quantity == Quantity::Extensive { options.taxel_area() } else { 1.0 };
        let mut all = Self {
            felt: vec![0.0; taxels.len()],
            taxels,
            swapped: Vec::new(),
            leaks: Vec::new(),
            truth: Response::default(),
            noise: Random::new(options.seed, stream::NOISE),
            flicker: Random::new(options.seed, stream::FLICKER),
            press: unit * options.stiffness * 0.5 * (options.depths[0] + options.depths[1]),
            unit,
            options: options.readout,
            hysteresis: options.hysteresis,
            noise_sigma: options.noise,
            last: 0.0,
        };
        let press_frames = JUMP_PRESSES * (options.duration + options.pause) * options.rate;
        all.choose_faults(skin, options.seed, frames, press_frames)?;
        all.truth = all.response(skin, options.quantity);
        Ok(all)
    }

    /// What was done to which taxel.
    pub(super) fn truth(&self) -> &Response {
        &self.truth
    }

    fn choose_faults(
        &mut self,
        skin: &Skin,
        seed: u64,
        frames: usize,
        press_frames: f64,
    ) -> Result<(), SignalError> {
        let FaultCounts(counts) = self.options.faults;
        let of_a_fault = |fault: TaxelState| match fault {
            TaxelState::Swapped | TaxelState::Crosstalk => 2,
            TaxelState::ModuleStep => MODULE,
            _ => 1,
        };
        let sizes =
            SIMULATED.iter().zip(counts).map(|(&fault, count)| count.saturating_mul(of_a_fault(fault)));
        let needed = sizes.fold(0, usize::saturating_add);
        let most = self.taxels.len();
        if needed > most {
            let limit = format!("at most {most}, the number of working taxels,");
            return Err(SignalError::option("the number of faulty taxels", needed as f64, limit));
        }
        let mut random = Random::new(seed, stream::FAULTS);
        let mut order: Vec<usize> = (0..most).collect();
        for k in (1..most).rev() {
            order.swap(k, random.below(k + 1));
        }
        let mut order = order.into_iter();
        for (&fault, count) in SIMULATED.iter().zip(counts) {
            for _ in 0..count {
                let Some(k) = order.find(|&k| self.taxels[k].state == TaxelState::Ok) else { break };
                self.taxels[k].state = fault;
                let mut begin = || random.below(frames);
                match fault {
                    TaxelState::Stuck => self.taxels[k].events = vec![[frames / 2, frames]],
                    TaxelState::Chattering => {
                        self.taxels[k].events = (0..CHATTERS).map(|_| begin()).map(|f| [f, f + 1]).collect();
                    }
                    TaxelState::Jumping => {
                        #[expect(
                            clippy::cast_possible_truncation,
                            clippy::cast_sign_loss,
                            reason = "at most 1e7"
                        )]
                        let most = press_frames as usize;
                        let events = (0..JUMPS).map(|_| [begin(), begin()]);
                        let events =
                            events.map(|[from, to]| [from.min(to), from.max(to).min(from.min(to) + most)]);
                        self.taxels[k].events = events.collect();
                    }
                    TaxelState::Swapped | TaxelState::Crosstalk => {
                        let Some(other) = order.find(|&k| self.taxels[k].state == TaxelState::Ok) else {
                            break;
                        };
                        let pairs =
                            if fault == TaxelState::Swapped { &mut self.swapped } else { &mut self.leaks };
                        pairs.push([other, k]);
                        if fault == TaxelState::Swapped {
                            self.taxels[other].state = fault;
                        }
                    }
                    TaxelState::ModuleStep => {
                        let from = frames / 3 + random.below(frames / 3);
                        for member in self.module_around(skin, k) {
                            self.taxels[member].state = fault;
                            self.taxels[member].events = vec![[from, frames]];
                        }
                    }
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// The nearest taxels without a fault on the same patch as one, and itself.
    fn module_around(&self, skin: &Skin, seed: usize) -> Vec<usize> {
        let place = |k: usize| {
            let TaxelReadout { patch, taxel, .. } = self.taxels[k];
            skin.patches[patch].mesh.positions[taxel]
        };
        let is_free = |&k: &usize| {
            self.taxels[k].patch == self.taxels[seed].patch
                && (k == seed || self.taxels[k].state == TaxelState::Ok)
        };
        let near: Vec<usize> = (0..self.taxels.len()).filter(is_free).collect();
        let distances: Vec<f64> = near.iter().map(|&k| place(k).distance_squared(place(seed))).collect();
        argsort(&distances).into_iter().take(MODULE).map(|k| near[k]).collect()
    }

    fn response(&self, skin: &Skin, quantity: Quantity) -> Response {
        let id = |own: &TaxelReadout| skin.patches[own.patch].taxels.ids[own.taxel];
        let mut others = vec![None; self.taxels.len()];
        for &[a, b] in &self.swapped {
            (others[a], others[b]) = (Some(b), Some(a));
        }
        self.leaks.iter().for_each(|&[a, b]| others[b] = Some(a));
        let sign = if self.options.is_inverted { -1.0 } else { 1.0 };
        let of_taxel = |(own, other): (&TaxelReadout, &Option<usize>)| TaxelResponse {
            zero: Some(0.0),
            gain: Some(sign * self.press.powf(1.0 - own.exponent) / own.sensitivity),
            exponent: Some(own.exponent),
            drift: Some(own.coefficient),
            state: own.state,
            other: other.map(|other| id(&self.taxels[other])),
            ..TaxelResponse::unknown(id(own))
        };
        let mut seen = HashSet::new();
        let live = self.taxels.iter().zip(&others).map(of_taxel);
        let live: Vec<_> = live.filter(|entry| seen.insert(entry.taxel)).collect();
        let all = skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter().zip(&patch.taxels.presence));
        let dead = all.filter(|(id, presence)| **presence == Presence::Present && seen.insert(**id));
        let dead = dead
            .map(|(&taxel, _)| TaxelResponse { state: TaxelState::Dead, ..TaxelResponse::unknown(taxel) });
        Response {
            unit: if quantity == Quantity::Extensive { "N" } else { "Pa" }.into(),
            scale: (quantity == Quantity::Intensive).then_some(Scale::Pascals),
            method: "simulated".into(),
            taxels: dead.chain(live.iter().copied()).collect(),
        }
    }

    /// The taxels that are read, which feel pressure.
    pub(super) fn live(&self) -> impl Iterator<Item = (PatchId, VertexId)> {
        self.taxels.iter().map(|own| (own.patch, own.taxel))
    }

    /// Turns the true values of a frame into readings.
    pub(super) fn read(&mut self, number: usize, frame: &mut Frame) {
        let Self { taxels, felt, options, press, unit, hysteresis, .. } = self;
        for (x, own) in felt.iter_mut().zip(taxels.iter()) {
            *x = frame.values[own.patch][0][own.taxel];
        }
        self.swapped.iter().for_each(|&[a, b]| felt.swap(a, b));
        for &[a, b] in &self.leaks {
            felt[b] += LEAK * felt[a];
        }
        let interval = frame.time - self.last;
        self.last = frame.time;
        let sign = if options.is_inverted { -1.0 } else { 1.0 };
        for (own, &x) in taxels.iter_mut().zip(felt.iter()) {
            let x = if own.state == TaxelState::Silent { SILENT * x } else { x };
            let mut x = *press * (x * own.sensitivity / *press).max(0.0).powf(own.exponent.recip());
            own.shown = own.shown.clamp(x * (1.0 - 0.5 * *hysteresis), x * (1.0 + 0.5 * *hysteresis));
            x = own.shown;
            let drift = own.drift + options.warming * own.coefficient;
            x += *unit * drift * frame.time;
            if options.flicker > 0.0 {
                for (slow, tau) in own.flicker.iter_mut().zip(FLICKER_S) {
                    let kept = if number == 0 { 0.0 } else { (-interval / tau).exp() };
                    *slow =
                        kept * *slow + options.flicker * (1.0 - kept * kept).sqrt() * self.flicker.normal();
                    x += *unit * *slow;
                }
            }
            let is_noisy = own.state == TaxelState::Noisy;
            let sigma = match (is_noisy, self.noise_sigma > 0.0) {
                (true, false) => NOISY_SHARE * *press / *unit,
                (true, true) => NOISY * self.noise_sigma,
                _ => self.noise_sigma,
            };
            if sigma > 0.0 {
                x += *unit * sigma * self.noise.normal();
            }
            let happens = own.events.iter().any(|&[from, to]| (from..to).contains(&number));
            match own.state {
                TaxelState::Dead => x = 0.0,
                TaxelState::Saturated => x = x.min(LIMIT * *press),
                TaxelState::Stuck if happens => x = own.reading,
                TaxelState::Jumping | TaxelState::Chattering if happens => x += JUMP * *press,
                TaxelState::ModuleStep if happens => x += STEP * *press,
                _ => {}
            }
            own.reading = x;
            frame.values[own.patch][0][own.taxel] = sign * x;
        }
    }
}
