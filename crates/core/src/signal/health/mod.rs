//! Which taxels can be trusted, as recordings of ordinary touches show: dead, stuck, noisy, jumping, chattering,
//! saturated, silent and swapped ones, crosstalk, steps of modules and turned modules.
//!
//! Three passes over the same recordings, each a set of sums, so that their length does not matter:
//!
//! 1. `survey`: range, noise and repetitions of each taxel's readings as they come. It judges dead, stuck, noisy and
//!    saturated taxels, and finds the threshold of touches.
//! 2. `touches`, `pairs` and `modules`, on readings less their zeros. Of each touch of a taxel: do its neighbours on the
//!    mesh (its *ring*) feel it? Of each touch around a taxel: does it react? Of each two taxels: how alike are their
//!    signals? A taxel is swapped if its touches are away from its ring, and its signals are at least three times as like
//!    those around another place; silent if it does not react where touched neighbours surround it.
//! 3. `leaks`: where nothing touches around a taxel, its readings are regressed on those of a taxel far away.
//!
//! A taxel that was not touched often enough is untested, which is a count and never a fault. *Heuristic*; measured on
//! simulated recordings of 400 presses on a cover of 642 taxels (`tests/library/health`): at most one false finding in 20
//! recordings without faults. Swaps and crosstalk within two edges of the mesh are not found.

pub(in crate::signal) mod around;
mod judge;
mod leaks;
mod modules;
pub(in crate::signal) mod pairs;
mod report;
pub(in crate::signal) mod survey;
mod touches;
mod window;

use std::collections::BTreeMap;

use crate::map::SkinMap;
use crate::numeric::Csr;
use crate::signal::health::around::{Around, readings};
use crate::signal::health::leaks::{LEAST_FRAMES, Leaks};
use crate::signal::health::modules::Module;
use crate::signal::health::pairs::Pairs;
use crate::signal::health::survey::Survey;
use crate::signal::health::touches::Touches;
use crate::signal::health::window::{View, Window};
use crate::signal::{Frame, SignalError, Zero};
use crate::skin::{PatchId, TaxelId};

pub use report::{HealthFinding, HealthReport};

/// The ring of a taxel is quiet below this many standard deviations of the median noise, or this share of the threshold,
/// in this number of frames before and after.
const QUIET: f64 = 4.0;
const QUIET_THRESHOLD: f64 = 0.5;
const QUIET_FRAMES: usize = 2;

/// A taxel reacts alone from this many standard deviations of its noise on, and from this share of the threshold; from
/// more of them on that counts as its own signal.
const REACTS: f64 = 3.5;
const REACTS_THRESHOLD: f64 = 0.25;
const SIGNAL: f64 = 4.0;

/// Options of [`Health`].
#[derive(Debug, Clone, PartialEq)]
pub struct HealthOptions {
    /// Where the zeros of readings are.
    pub zero: Zero,
    /// A reading above it, less its zero, is a touch; `None`: four times the noise.
    pub threshold: Option<f64>,
    /// The module of each taxel, by its name; without them no module is judged. Of an id that several patches have, each
    /// patch has a module of this name.
    pub modules: Vec<(TaxelId, String)>,
}

impl Default for HealthOptions {
    /// Zeros are followed.
    fn default() -> Self {
        Self { zero: Zero::Follow, threshold: None, modules: Vec::new() }
    }
}

/// Judges taxels by recordings, which are passed three times; `recording::examine` does that.
#[derive(Debug, Clone)]
pub struct Health {
    options: HealthOptions,
    channel: usize,
    around: Around,
    /// Taxels that a recording has a column of.
    is_read: Vec<bool>,
    pass: usize,
    survey: Survey,
    window: Window,
    sight: Sight,
    frames: usize,
    recordings: usize,
}

/// The sums of the second and third pass.
#[derive(Debug, Clone)]
struct Sight {
    touches: Vec<Touches>,
    pairs: Pairs,
    modules: Vec<Module>,
    /// What each taxel reads alone.
    energy: Vec<f64>,
    likeness: Csr<(u32, f64)>,
    leaks: Leaks,
    is_hot: Vec<bool>,
    hot: Vec<(u32, f64)>,
    lone: Vec<u32>,
}

impl Health {
    /// How often the recordings are passed.
    pub const PASSES: usize = 3;

    /// Judges taxels of a map.
    ///
    /// # Errors
    /// [`SignalError::Option`] if the threshold is not positive, or no taxel of the modules is on the skin.
    pub fn new(map: &SkinMap, options: &HealthOptions) -> Result<Self, SignalError> {
        if let Some(threshold) = options.threshold.filter(|x| !(x.is_finite() && *x > 0.0)) {
            return Err(SignalError::option("the threshold of touches", threshold, "a positive number"));
        }
        let around = Around::new(map);
        let taxels = around.len();
        let mut known = BTreeMap::<TaxelId, Vec<usize>>::new();
        around.ids.iter().zip(0..).for_each(|(id, k)| known.entry(*id).or_default().push(k));
        let mut members = BTreeMap::<&str, Vec<usize>>::new();
        for (taxel, module) in &options.modules {
            members.entry(module).or_default().extend(known.get(taxel).into_iter().flatten());
        }
        members.retain(|_, taxels| !taxels.is_empty());
        // Where patches share ids, each has a module of this name.
        let mut modules = Vec::new();
        for taxels in members.into_values() {
            if !taxels.iter().any(|&k| known[&around.ids[k]].len() > 1) {
                modules.push(taxels);
                continue;
            }
            let mut of_patches = BTreeMap::<PatchId, Vec<usize>>::new();
            taxels.into_iter().for_each(|k| of_patches.entry(around.taxels[k].0).or_default().push(k));
            modules.extend(of_patches.into_values());
        }
        if modules.is_empty() && !options.modules.is_empty() {
            let first = f64::from(options.modules[0].0.0);
            return Err(SignalError::option("the first taxel of the modules", first, "a taxel of the skin"));
        }
        let modules = modules.into_iter().map(|taxels| Module::new(taxels, &around)).collect();
        Ok(Self {
            options: options.clone(),
            channel: 0,
            is_read: vec![false; taxels],
            pass: 0,
            survey: Survey::new(taxels),
            window: Window::default(),
            sight: Sight {
                touches: vec![Touches::default(); taxels],
                pairs: Pairs::new(taxels),
                modules,
                energy: vec![0.0; taxels],
                likeness: Csr::default(),
                leaks: Leaks::new(taxels, Vec::new()),
                is_hot: vec![false; taxels],
                hot: Vec::with_capacity(taxels),
                lone: Vec::with_capacity(taxels),
            },
            frames: 0,
            recordings: 0,
            around,
        })
    }

    /// The zeros that readings must be less in the current pass.
    pub fn zero(&self) -> Zero {
        if self.pass == 0 { Zero::AS_READ } else { self.options.zero }
    }

    /// Begins a recording of which one channel is judged, with readings of these taxels, patch after patch.
    pub fn begin_recording(&mut self, channel: usize, has_readings: impl Iterator<Item = bool>) {
        self.channel = channel;
        for ((read, has), present) in self.is_read.iter_mut().zip(has_readings).zip(&self.around.is_present) {
            *read |= has && *present;
        }
        self.recordings += usize::from(self.pass == 0);
    }

    /// Sees the next frame of a recording.
    ///
    /// # Panics
    /// If it does not have the patches and taxels of the map, or not the channel.
    pub fn see(&mut self, frame: &Frame) {
        let x = readings(frame, self.channel);
        if self.pass == 0 {
            self.frames += 1;
            self.survey.see(x);
            return;
        }
        let Self { around, survey, window, sight, pass, .. } = self;
        window.push(x, around, survey, |view| sight.see(&view, around, survey, *pass));
    }

    /// Ends a recording, or an episode of one: the frame that comes next is not the one after the last.
    pub fn end_recording(&mut self) {
        let Self { around, survey, window, sight, pass, .. } = self;
        match *pass {
            0 => survey.end_recording(),
            1 => {
                window.end(|view| sight.see(&view, around, survey, 1));
                let touches = sight.touches.iter_mut().enumerate();
                touches.for_each(|(taxel, touches)| touches.end_recording(taxel, survey));
                sight.modules.iter_mut().for_each(Module::end_recording);
            }
            _ => {
                window.end(|view| sight.see(&view, around, survey, 2));
                sight.leaks.end_recording();
            }
        }
    }

    /// Ends a pass: the next recording is the first one again.
    pub fn end_pass(&mut self) {
        if self.pass == 0 {
            self.survey.settle(&self.is_read, self.options.threshold);
        } else if self.pass == 1 {
            self.sight.likeness = self.sight.pairs.likeness();
            let judged = self.judge();
            let mut pairs = self.sight.pairs.lone(LEAST_FRAMES);
            pairs.retain(|&(from, into, _)| judged.may_leak(from as usize, into as usize));
            self.sight.leaks = Leaks::new(self.around.len(), pairs);
        }
        self.pass += 1;
    }
}

impl Sight {
    /// Sees a frame, with those around it.
    fn see(&mut self, view: &View<'_>, around: &Around, survey: &Survey, pass: usize) {
        let x = view.x();
        let least = (QUIET * survey.median_sigma).max(QUIET_THRESHOLD * survey.threshold);
        let is_quiet = |taxel: usize| view.ring(taxel, QUIET_FRAMES) < least;
        self.hot.clear();
        for (k, (is_hot, &x)) in (0_u32..).zip(self.is_hot.iter_mut().zip(x)) {
            let taxel = k as usize;
            *is_hot = survey.is_ok[taxel] && x > survey.hot(taxel);
            if *is_hot {
                self.hot.push((k, x));
            }
        }
        if pass > 1 {
            self.leaks.see(&self.hot, view, is_quiet);
            return;
        }
        self.lone.clear();
        for (k, &x) in (0_u32..).zip(x) {
            let (taxel, sigma) = (k as usize, survey.sigma[k as usize]);
            if !survey.is_ok[taxel] {
                continue;
            }
            if x > (REACTS * sigma).max(REACTS_THRESHOLD * survey.threshold) && is_quiet(taxel) {
                self.lone.push(k);
                self.energy[taxel] += if x > SIGNAL * sigma { x * x } else { 0.0 };
            }
            self.touches[taxel].see(taxel, view, &self.is_hot, around, survey);
        }
        self.pairs.see(&self.hot, &self.lone, around);
        self.modules.iter_mut().for_each(|module| module.see(x, survey));
    }
}
