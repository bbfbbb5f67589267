//! How simulated taxels are read: gains, drift and noise of each, and faults.
//!
//! In this order: readings of swapped taxels and turned modules change places, and leak where there is crosstalk
//! (`faults`); a taxel turns pressure into its reading (the inverse of [`TaxelResponse`]); zeros drift, by themselves, together with temperature, and as `1/f`
//! noise, a sum of first-order processes with one time constant for each decade; then come noise, limits and jumps.
//! *Heuristic*: sizes of faults are those of the real recordings of CySkin that have some.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};

use crate::id::{IdVec, VertexId};
use crate::mesh::Adjacency;
use crate::numeric::Random;
use crate::signal::touch::TouchOptions;
use crate::signal::touch::faults::{FaultCounts, Faults};
use crate::signal::{Frame, Quantity, Response, Scale, SignalError, TaxelResponse, TaxelState};
use crate::skin::{PatchId, Presence, Skin, TaxelId};

/// How the readings of taxels differ, and how many are faulty.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    /// Share of the pressure on a taxel that leaks into the other one of a pair with crosstalk.
    pub leak: f64,
}

impl Default for ReadoutOptions {
    /// All taxels are alike, and none is faulty.
    fn default() -> Self {
        Self {
            gain_spread: 0.0,
            exponent_spread: 0.0,
            warming: 0.0,
            flicker: 0.0,
            is_inverted: false,
            faults: FaultCounts::default(),
            leak: 0.5,
        }
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

/// Share of the pressure that a silent taxel reads.
const SILENT: f64 = 0.02;
/// Noise of noisy taxels over that of others, or over the pressure of a press if there is none.
const NOISY: f64 = 5.0;
const NOISY_SHARE: f64 = 0.05;
/// Height of jumps, of steps of modules and of limits, over the pressure of a press.
const JUMP: f64 = 1.25;
const STEP: f64 = 0.75;
const LIMIT: f64 = 0.5;
/// Standard deviation of the coefficients of temperature.
const COEFFICIENT_SPREAD: f64 = 0.3;
/// Time constants of `1/f` noise, in s.
const FLICKER_S: [f64; 5] = [0.1, 1.0, 10.0, 100.0, 1000.0];

#[derive(Debug, Clone)]
pub(super) struct Readout {
    taxels: Vec<TaxelReadout>,
    faults: Faults,
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
    reading: f64,
    /// Its reading of pressure alone, which lags by the hysteresis.
    shown: f64,
}

impl Readout {
    pub(super) fn new(
        skin: &Skin,
        adjacency: &IdVec<PatchId, Adjacency>,
        options: &TouchOptions,
        frames: usize,
    ) -> Result<Self, SignalError> {
        let [mut dead, mut drift, mut spread, chooser] =
            [stream::DEAD, stream::DRIFT, stream::READOUT, stream::FAULTS]
                .map(|stream| Random::new(options.seed, stream));
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
                    reading: 0.0,
                    shown: 0.0,
                });
            }
        }
        if taxels.is_empty() {
            return Err(SignalError::NoTaxels);
        }
        let unit = options.quantity.extent(options.taxel_area());
        let places: Vec<_> = taxels.iter().map(|own: &TaxelReadout| (own.patch, own.taxel)).collect();
        let faults = Faults::choose(skin, adjacency, &places, options, frames, chooser)?;
        let mut all = Self {
            felt: vec![0.0; taxels.len()],
            taxels,
            faults,
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
        all.truth = all.response(skin, options.quantity);
        Ok(all)
    }

    /// What was done to which taxel.
    pub(super) fn truth(&self) -> &Response {
        &self.truth
    }

    fn response(&self, skin: &Skin, quantity: Quantity) -> Response {
        let id = |own: &TaxelReadout| skin.patches[own.patch].taxels.ids[own.taxel];
        let Faults { states, sources, leaks, .. } = &self.faults;
        let mut others: Vec<_> = (0..).zip(sources).map(|(k, &of)| Some(of).filter(|of| *of != k)).collect();
        leaks.iter().for_each(|&[a, b]| others[b] = Some(a));
        let sign = if self.options.is_inverted { -1.0 } else { 1.0 };
        let of_taxel =
            |((own, &state), other): ((&TaxelReadout, &TaxelState), &Option<usize>)| TaxelResponse {
                zero: Some(0.0),
                gain: Some(sign * self.press.powf(1.0 - own.exponent) / own.sensitivity),
                exponent: Some(own.exponent),
                drift: Some(own.coefficient),
                state,
                other: other.map(|other| id(&self.taxels[other])),
                ..TaxelResponse::unknown(id(own))
            };
        // A response names an id once: where several patches have it, numbers that differ are not known.
        let (mut live, mut places) = (Vec::<TaxelResponse>::new(), HashMap::<TaxelId, usize>::new());
        for entry in self.taxels.iter().zip(states).zip(&others).map(of_taxel) {
            match places.entry(entry.taxel) {
                Entry::Occupied(place) => live[*place.get()].join(&entry),
                Entry::Vacant(place) => {
                    place.insert(live.len());
                    live.push(entry);
                }
            }
        }
        let is_live: HashSet<_> = self.live().collect();
        let mut dead = Vec::new();
        for (patch, about) in skin.patches.enumerate() {
            for (taxel, &id) in about.taxels.ids.enumerate() {
                let is_present = about.taxels.presence[taxel] == Presence::Present;
                if !is_present || is_live.contains(&(patch, taxel)) {
                    continue;
                }
                match places.get(&id) {
                    Some(&place) => live[place].state = TaxelState::Dead,
                    None => {
                        dead.push(TaxelResponse { state: TaxelState::Dead, ..TaxelResponse::unknown(id) })
                    }
                }
            }
        }
        let mut seen = HashSet::new();
        dead.retain(|entry| seen.insert(entry.taxel));
        Response {
            unit: if quantity == Quantity::Extensive { "N" } else { "Pa" }.into(),
            scale: (quantity == Quantity::Intensive).then_some(Scale::Pascals),
            method: "simulated".into(),
            taxels: dead.into_iter().chain(live).collect(),
            ..Response::default()
        }
    }

    /// The taxels that are read, which feel pressure.
    pub(super) fn live(&self) -> impl Iterator<Item = (PatchId, VertexId)> {
        self.taxels.iter().map(|own| (own.patch, own.taxel))
    }

    /// Turns the true values of a frame into readings.
    pub(super) fn read(&mut self, number: usize, frame: &mut Frame) {
        let Self { taxels, felt, options, press, unit, hysteresis, faults, .. } = self;
        for (x, &source) in felt.iter_mut().zip(&faults.sources) {
            let source = &taxels[source];
            *x = frame.values[source.patch][0][source.taxel];
        }
        for &[a, b] in &faults.leaks {
            felt[b] += options.leak * felt[a];
        }
        let interval = frame.time - self.last;
        self.last = frame.time;
        let sign = if options.is_inverted { -1.0 } else { 1.0 };
        let of_taxels = taxels.iter_mut().zip(felt.iter()).zip(&faults.states).zip(&faults.events);
        for (((own, &x), &state), events) in of_taxels {
            let x = if state == TaxelState::Silent { SILENT * x } else { x };
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
            let is_noisy = state == TaxelState::Noisy;
            let sigma = match (is_noisy, self.noise_sigma > 0.0) {
                (true, false) => NOISY_SHARE * *press / *unit,
                (true, true) => NOISY * self.noise_sigma,
                _ => self.noise_sigma,
            };
            if sigma > 0.0 {
                x += *unit * sigma * self.noise.normal();
            }
            let happens = events.iter().any(|&[from, to]| (from..to).contains(&number));
            match state {
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
