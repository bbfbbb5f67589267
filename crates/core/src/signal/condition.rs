//! Makes raw readings comparable: removes offset, gain and spikes, and splits slow and fast components.
//!
//! In this order, for each taxel and channel: the baseline is subtracted, which is the mean of the first
//! frames; the rest is multiplied by the taxel's gain, becomes a pressure by its response, and is clipped; on request a first-order low pass splits
//! it into a slow and a fast component, as slow- and fast-adapting receptors do. The filter is exact for
//! readings that are constant between frames: `slow += (1 - exp(-2 pi f dt)) (x - slow)` with `dt` the time
//! since that taxel's last reading.

use std::collections::{HashMap, HashSet};
use std::f64::consts::TAU;

use crate::id::IdVec;
use crate::map::SkinMap;
use crate::signal::zero::{ZeroReport, ZeroTracker};
use crate::signal::{
    Channel, ChannelKind, Clock, Frame, Quantity, Response, Scale, SignalError, Stage, TaxelResponse, Tick,
    main_channel, unit_ratio,
};
use crate::skin::{PatchId, TaxelId};

/// Largest memory of the frames of a baseline, in bytes.
const MAX_BASELINE_BYTES: usize = 1 << 30;

/// Where the zero of readings is, the reading of a taxel that nothing touches. It is subtracted in the
/// [channels of touch](crate::signal::ChannelKind::is_of_touch); others stay as they are.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Zero {
    /// At 0.
    #[default]
    Taken,
    /// At this number for every taxel.
    At(f64),
    /// At the mean of this many first frames, in which nothing may touch the skin.
    First(usize),
    /// It drifts, and is followed where nothing touches ([`ZeroTracker`]).
    Follow,
    /// At the zeros of the [response](ConditionOptions::response), in the channels that it is of: tangential ones stay
    /// as they are.
    Stored,
}

impl Zero {
    /// Nothing is subtracted, also of readings whose [response](ConditionOptions::response) has other zeros: for a pass that learns
    /// before zeros are known.
    pub const AS_READ: Self = Self::At(0.0);
}

/// Options of conditioning.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ConditionOptions {
    /// What is subtracted.
    pub zero: Zero,
    /// Then readings of touch are multiplied by these factors; 1 for other ids.
    pub gains: Vec<(TaxelId, f64)>,
    /// Then readings of touch, other than tangential ones, become pressures by the response of each taxel: those of the
    /// channel that it names, if there is one of this name, else of all. Those of a
    /// taxel whose gain is not known where others are, are masked. Without an exponent a response is linear. A faulty
    /// taxel is masked in all channels.
    pub response: Option<Response>,
    /// Then readings are clipped to these bounds, in the unit of the channel.
    pub clip: Option<[f64; 2]>,
    /// Cut-off frequency that splits each channel into `NAME.slow` and `NAME.fast`, in Hz. The two add up to
    /// the reading, up to rounding.
    pub split_hz: Option<f64>,
}

/// The effects of conditioning.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ConditionReport {
    /// Readings that were clipped.
    pub clipped: u64,
    /// Readings beyond the range of 32-bit floats, the type of images and arrays; they are masked.
    pub too_large: u64,
    /// Frames whose time is before that of the previous frame, or not a number; filters advance by the usual step.
    pub backwards: u64,
    /// Readings without a baseline, summed over channels of touch, since they are missing in all frames of the
    /// baseline; they are masked from then on.
    pub without_baseline: usize,
    /// Gains whose id no taxel has.
    pub unknown_gains: usize,
    /// Taxels of the map that the response calls faulty; they are masked.
    pub faulty: usize,
    /// Other taxels whose gain the response does not know; they are masked.
    pub without_gain: usize,
    /// What happened to zeros that are followed.
    pub zero: ZeroReport,
}

impl ConditionReport {
    /// The effects on frames after those of another report, of the same taxels and options.
    #[doc(hidden)]
    pub fn after(&self, before: &Self) -> Self {
        Self {
            clipped: before.clipped + self.clipped,
            too_large: before.too_large + self.too_large,
            backwards: before.backwards + self.backwards,
            without_baseline: before.without_baseline.max(self.without_baseline),
            zero: ZeroReport {
                retaken: before.zero.retaken + self.zero.retaken,
                replaced: before.zero.replaced + self.zero.replaced,
            },
            ..self.clone()
        }
    }
}

/// Conditions frames one by one; a `recording::Recording` does this with those of a file.
///
/// It learns from the first frames if there is a baseline, and allocates nothing after that.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, ConditionOptions, Conditioner, Frame, Stage, Zero},
///     skin::PatchId,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(2, 2, 0.004), 1e-3);
/// let options = ConditionOptions { zero: Zero::First(1), split_hz: Some(5.0), ..ConditionOptions::default() };
/// let mut conditioner = Conditioner::new(&map, &[Channel::default()], &options)?;
/// assert_eq!(conditioner.channels()[1].name, "pressure.fast");
/// let frame = Frame::new(&map, 1);
/// conditioner.learn(&frame);
/// conditioner.settle();
/// assert_eq!(conditioner.apply(&frame).values[PatchId::new(0)].len(), 2);
/// # Ok::<(), dermatome::signal::SignalError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Conditioner {
    channels: Vec<Channel>,
    report: ConditionReport,
    /// The kinds of the input channels.
    kinds: Vec<ChannelKind>,
    /// Which of them the response is of.
    becomes_pressure: Vec<bool>,
    /// One number per taxel, patch after patch.
    gains: IdVec<PatchId, Vec<f64>>,
    curves: Option<Curves>,
    tracker: Option<Box<ZeroTracker>>,
    baseline: Baseline,
    clip: Option<[f64; 2]>,
    filter: Option<LowPass>,
    clock: Clock,
    /// Time that never goes back, in s.
    now: f64,
    out: Frame,
}

/// How readings become pressures.
#[derive(Debug, Clone)]
struct Curves {
    /// One for each taxel, patch after patch.
    taxels: IdVec<PatchId, Vec<Curve>>,
    scale: Option<Scale>,
}

/// A gain, NaN for a taxel that is masked, and an exponent if it is known.
#[derive(Debug, Clone, Copy)]
struct Curve {
    gain: f64,
    exponent: Option<f64>,
    is_faulty: bool,
}

/// One number per patch, channel and taxel, in this order.
#[derive(Debug, Clone)]
struct Baseline {
    frames: usize,
    /// Sums until it is known, then means.
    values: Vec<f64>,
    counts: Vec<u32>,
}

/// The slow components, one per patch, channel and taxel, in this order.
#[derive(Debug, Clone)]
struct LowPass {
    hz: f64,
    slow: Vec<f64>,
    /// The time of the last reading of each.
    times: Vec<f64>,
}

impl Conditioner {
    /// A conditioner of frames with these channels.
    ///
    /// # Errors
    /// If a gain, the bounds or the frequency are not usable, the baseline has too many frames, or no channel is of touch
    /// for a zero, gains or a response.
    pub fn new(map: &SkinMap, channels: &[Channel], options: &ConditionOptions) -> Result<Self, SignalError> {
        let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let numbers = taxels * channels.len();
        let most = MAX_BASELINE_BYTES / (numbers.max(1) * size_of::<f64>());
        let frames = if let Zero::First(frames) = options.zero { frames } else { 0 };
        if frames > most {
            let needed = format!("at most {most}, which of this skin are kept in memory,");
            return Err(SignalError::option("the number of frames of the baseline", frames as f64, needed));
        }
        if let Some(&(taxel, gain)) = options.gains.iter().find(|(_, gain)| !gain.is_finite()) {
            return Err(SignalError::option(format!("the gain of taxel {taxel}"), gain, "a finite number"));
        }
        if let Some([low, high]) =
            options.clip.filter(|[low, high]| low.is_nan() || high.is_nan() || low >= high)
        {
            let needed = format!("a number above the lower one, {low},");
            return Err(SignalError::option("the upper bound of readings", high, needed));
        }
        if let Some(hz) = options.split_hz.filter(|hz| !(hz.is_finite() && *hz > 0.0)) {
            return Err(SignalError::option("the cut-off frequency in Hz", hz, "a positive number"));
        }
        let kinds: Vec<ChannelKind> = channels.iter().map(|channel| channel.kind).collect();
        let has_zero = options.zero != Zero::AS_READ && !matches!(options.zero, Zero::Taken | Zero::First(0));
        let response = options.response.as_ref();
        let becomes_pressure = of_response(channels, response);
        let needs_pressure =
            options.zero == Zero::Stored || response.is_some_and(|response| response.has_gains());
        if (has_zero || !options.gains.is_empty()) && !kinds.iter().any(|kind| kind.is_of_touch())
            || needs_pressure && !becomes_pressure.contains(&true)
        {
            return Err(SignalError::NoTouch { known: channels.iter().map(|c| c.name.clone()).collect() });
        }
        let gain_of: HashMap<TaxelId, f64> = options.gains.iter().copied().collect();
        let ids: HashSet<TaxelId> = map.patches.iter().flat_map(|p| p.taxels.ids.iter().copied()).collect();
        let unknown_gains = gain_of.keys().filter(|id| !ids.contains(id)).count();
        let gain = |id: &TaxelId| gain_of.get(id).copied().unwrap_or(1.0);
        let tracker = (options.zero == Zero::Follow).then(|| Box::new(ZeroTracker::new(map, channels)));
        let mut report = ConditionReport { unknown_gains, ..ConditionReport::default() };
        let curves =
            response.map(|response| Curves::new(map, channels, &becomes_pressure, response, &mut report));
        let curves = curves.transpose()?;
        let stored = match options.zero {
            Zero::Stored => stored_zeros(map, &becomes_pressure, response)?,
            _ => Vec::new(),
        };
        let read = channels.iter().enumerate();
        let channels = read.map(|(k, channel)| match &curves {
            Some(curves) if becomes_pressure[k] => curves.channel(channel, channels),
            _ => channel.clone(),
        });
        let channels: Vec<Channel> = match options.split_hz {
            Some(_) => channels.flat_map(|channel| parts(&channel)).collect(),
            None => channels.collect(),
        };
        let values = match options.zero {
            Zero::First(frames) if frames > 0 => vec![0.0; numbers],
            Zero::At(zero) if !zero.is_finite() => {
                return Err(SignalError::option("the zero of the readings", zero, "a finite number"));
            }
            Zero::At(zero) => {
                let sizes = map.patches.iter().map(|patch| patch.taxels.ids.len());
                of_entries(sizes, &kinds).map(|kind| if kind.is_of_touch() { zero } else { 0.0 }).collect()
            }
            Zero::Stored => stored,
            _ => Vec::new(),
        };
        Ok(Self {
            gains: map.patches.map(|patch| patch.taxels.ids.iter().map(gain).collect()),
            curves,
            tracker,
            baseline: Baseline { frames, counts: vec![0; if frames > 0 { values.len() } else { 0 }], values },
            clip: options.clip,
            filter: options.split_hz.map(|hz| LowPass {
                hz,
                slow: vec![f64::NAN; numbers],
                times: vec![f64::NAN; numbers],
            }),
            clock: Clock::new(),
            now: 0.0,
            out: Frame::new(map, channels.len()),
            kinds,
            becomes_pressure,
            channels,
            report,
        })
    }

    /// The zero of each taxel in the [main](main_channel) channel, patch after patch, as far as it is known by now; NaN
    /// where it is not.
    #[doc(hidden)]
    pub fn zeros(&self) -> Vec<f64> {
        let taxels = self.gains.iter().map(Vec::len);
        if let Some(tracker) = &self.tracker {
            return tracker.zeros();
        }
        let main = main_channel(self.kinds.iter().copied());
        let mut start = 0;
        let of_patch = |count: usize| {
            start += main * count;
            let values = (0..count).map(|k| self.baseline.values.get(start + k).copied().unwrap_or(0.0));
            let values: Vec<f64> = values.collect();
            start += count * (self.kinds.len() - main);
            values
        };
        taxels.flat_map(of_patch).collect()
    }

    /// The channels of conditioned frames: the input channels, or the slow and fast component of each.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Those that are pressures by the response, if it has gains.
    #[doc(hidden)]
    pub fn pressures(&self) -> impl Iterator<Item = &Channel> {
        let curves = self.curves.as_ref().filter(|curves| curves.scale.is_some());
        let parts = self.channels.len() / self.kinds.len().max(1);
        let is_one = move |k: usize| curves.is_some() && self.becomes_pressure[k / parts.max(1)];
        self.channels.iter().enumerate().filter(move |(k, _)| is_one(*k)).map(|(_, channel)| channel)
    }

    /// The frame that was passed on last.
    #[doc(hidden)]
    pub fn latest(&self) -> &Frame {
        &self.out
    }

    /// The effects so far.
    pub fn report(&self) -> &ConditionReport {
        &self.report
    }
}

impl Stage for Conditioner {
    /// The frames of the baseline.
    fn frames_to_learn(&self) -> usize {
        self.baseline.frames
    }

    fn learn(&mut self, frame: &Frame) {
        self.baseline.add(frame);
    }

    fn settle(&mut self) {
        let kinds = of_entries(self.gains.iter().map(Vec::len), &self.kinds);
        self.report.without_baseline = self.baseline.divide(kinds);
    }

    /// The conditioned frame.
    fn apply<'f>(&'f mut self, frame: &'f Frame) -> &'f Frame {
        assert_eq!(frame.values.len(), self.gains.len(), "one entry per patch");
        let frame = match &mut self.tracker {
            Some(tracker) => {
                tracker.apply(frame);
                self.report.zero = tracker.report();
                tracker.latest()
            }
            None => frame,
        };
        let tick = self.clock.see(frame.time);
        self.report.backwards += u64::from(matches!(tick, Tick::Back | Tick::Untimed));
        self.now += self.clock.elapsed(tick);
        self.out.time = frame.time;
        let mut start = 0;
        let patches = frame.values.iter().zip(&self.gains).zip(self.out.values.iter_mut());
        for (patch, ((read, gains), out)) in patches.enumerate() {
            assert_eq!(read.len(), self.kinds.len(), "one array per channel");
            for ((channel, read), kind) in read.iter().enumerate().zip(&self.kinds) {
                assert_eq!(read.len(), gains.len(), "one reading per taxel");
                let range = start..start + gains.len();
                start = range.end;
                let out = match self.filter {
                    Some(_) => &mut out[2 * channel..2 * channel + 2],
                    None => &mut out[channel..=channel],
                };
                let amplified = out[0].iter_mut().zip(read).zip(gains);
                match self.baseline.values.get(range.clone()) {
                    _ if *kind == ChannelKind::Other => {
                        out[0].as_mut_slice().copy_from_slice(read.as_slice());
                    }
                    Some(baseline) => amplified
                        .zip(baseline)
                        .for_each(|(((out, &x), gain), offset)| *out = gain * (x - offset)),
                    None => amplified.for_each(|((out, &x), gain)| *out = gain * x),
                }
                if let Some(curves) = &self.curves {
                    let taxels = out[0].iter_mut().zip(&curves.taxels[PatchId::new(patch)]);
                    if self.becomes_pressure[channel] {
                        taxels.for_each(|(x, curve)| *x = curve.pressure(*x));
                    } else {
                        taxels.filter(|(_, curve)| curve.is_faulty).for_each(|(x, _)| *x = f64::NAN);
                    }
                }
                self.report.too_large += mask_too_large(out[0].as_mut_slice(), read.as_slice());
                if let Some([low, high]) = self.clip.filter(|_| kind.is_of_touch()) {
                    for x in out[0].iter_mut().filter(|x| **x < low || **x > high) {
                        *x = x.clamp(low, high);
                        self.report.clipped += 1;
                    }
                }
                if let (Some(filter), [slow, fast]) = (&mut self.filter, out) {
                    filter.split(range, self.now, slow.as_mut_slice(), fast.as_mut_slice());
                    self.report.too_large += mask_too_large(fast.as_mut_slice(), read.as_slice());
                }
            }
        }
        &self.out
    }
}

/// Masks values that are too large for 32-bit floats although their reading was finite, and returns how many.
fn mask_too_large(values: &mut [f64], read: &[f64]) -> u64 {
    let is_too_large = |x: f64| x.abs() > f64::from(f32::MAX);
    // Without a branch, as there is nearly never one.
    if !values.iter().fold(false, |any, &x| any | is_too_large(x)) {
        return 0;
    }
    let too_large = values.iter_mut().zip(read).filter(|(x, read)| is_too_large(**x) && read.is_finite());
    too_large.map(|(x, _)| *x = f64::NAN).count() as u64
}

impl Curves {
    fn new(
        map: &SkinMap,
        channels: &[Channel],
        becomes_pressure: &[bool],
        response: &Response,
        report: &mut ConditionReport,
    ) -> Result<Self, SignalError> {
        for (channel, _) in channels.iter().zip(becomes_pressure).filter(|(_, is)| **is) {
            let [found, needed] = [&channel.unit, &response.unit];
            if !found.is_empty() && !needed.is_empty() && unit_ratio(found, needed) != Some(1.0) {
                let (unit, needed) = (found.clone(), needed.clone());
                return Err(SignalError::ResponseUnit { channel: channel.name.clone(), unit, needed });
            }
        }
        let known = by_taxel(map, response)?;
        let has_gains = response.has_gains();
        let mut curve = |id: &TaxelId| {
            let taxel = known.get(id);
            let is_faulty = taxel.is_some_and(|taxel| taxel.state.is_fault());
            report.faulty += usize::from(is_faulty);
            let gain = match taxel.and_then(|taxel| taxel.gain) {
                _ if is_faulty => f64::NAN,
                Some(gain) => gain,
                None if has_gains => {
                    report.without_gain += 1;
                    f64::NAN
                }
                // A response of states alone.
                None => 1.0,
            };
            Curve { gain, exponent: taxel.and_then(|taxel| taxel.exponent), is_faulty }
        };
        let taxels = map.patches.map(|patch| patch.taxels.ids.iter().map(&mut curve).collect());
        Ok(Self { taxels, scale: if has_gains { response.scale } else { None } })
    }

    /// What the pressures of a channel are: that of `force1` is `pressure1`, unless another one of the channels is called so.
    fn channel(&self, read: &Channel, channels: &[Channel]) -> Channel {
        let renamed = read.name.strip_prefix("force").map(|rest| format!("pressure{rest}"));
        let is_free = |name: &String| channels.iter().all(|other| other.name != *name);
        let name = renamed.filter(is_free).unwrap_or_else(|| read.name.clone());
        let channel = |unit: &str| Channel {
            name: name.clone(),
            unit: unit.into(),
            quantity: Quantity::Intensive,
            kind: ChannelKind::Touch,
        };
        match self.scale {
            Some(Scale::Pascals) => channel("Pa"),
            Some(Scale::Relative) => channel(""),
            None => read.clone(),
        }
    }
}

impl Curve {
    fn pressure(self, x: f64) -> f64 {
        match self.exponent {
            // `max` would turn a missing reading into zero.
            _ if x.is_nan() => x,
            Some(exponent) => self.gain.abs() * (self.gain.signum() * x).max(0.0).powf(exponent),
            None => self.gain * x,
        }
    }
}

/// Which channels a response is of: that of its name, if it is among them, else all of touch other than tangential ones.
fn of_response(channels: &[Channel], response: Option<&Response>) -> Vec<bool> {
    let is_touch = |channel: &Channel| channel.kind == ChannelKind::Touch;
    let name = response.map_or("", |response| &response.channel);
    let is_named = |channel: &Channel| is_touch(channel) && channel.name == name;
    let has_it = channels.iter().any(is_named);
    channels.iter().map(|channel| if has_it { is_named(channel) } else { is_touch(channel) }).collect()
}

/// What a response says of each taxel, refused if it is of none of the map.
fn by_taxel<'r>(
    map: &SkinMap,
    response: &'r Response,
) -> Result<HashMap<TaxelId, &'r TaxelResponse>, SignalError> {
    let known: HashMap<TaxelId, &TaxelResponse> =
        response.taxels.iter().map(|taxel| (taxel.taxel, taxel)).collect();
    let mut ids = map.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
    match (response.taxels.first(), ids.clone().next()) {
        (Some(first), Some(&known_id)) if !ids.any(|id| known.contains_key(id)) => {
            let (taxels, first) = (response.taxels.len(), first.taxel);
            Err(SignalError::ForeignResponse { taxels, first, known: known_id })
        }
        _ => Ok(known),
    }
}

/// The kind of the channel of each number, patch after patch, channel after channel.
fn of_entries(
    sizes: impl Iterator<Item = usize>,
    kinds: &[ChannelKind],
) -> impl Iterator<Item = ChannelKind> {
    sizes.flat_map(move |size| kinds.iter().flat_map(move |kind| std::iter::repeat_n(*kind, size)))
}

/// The zeros of a response in the channels that it is of, NaN where they are not known, and 0 in others.
fn stored_zeros(
    map: &SkinMap,
    becomes_pressure: &[bool],
    response: Option<&Response>,
) -> Result<Vec<f64>, SignalError> {
    let Some(response) = response.filter(|response| response.taxels.iter().any(|taxel| taxel.zero.is_some()))
    else {
        return Err(SignalError::NoStoredZeros);
    };
    let known = by_taxel(map, response)?;
    let zero = |id: &TaxelId| known.get(id).and_then(|taxel| taxel.zero).unwrap_or(f64::NAN);
    let of_patch = |ids: &IdVec<_, TaxelId>| {
        let zeros: Vec<f64> = ids.iter().map(zero).collect();
        let of_channel = |&is: &bool| if is { zeros.clone() } else { vec![0.0; zeros.len()] };
        becomes_pressure.iter().flat_map(of_channel).collect::<Vec<f64>>()
    };
    Ok(map.patches.iter().flat_map(|patch| of_patch(&patch.taxels.ids)).collect())
}

fn parts(channel: &Channel) -> [Channel; 2] {
    ["slow", "fast"].map(|part| Channel { name: format!("{}.{part}", channel.name), ..channel.clone() })
}

impl Baseline {
    fn add(&mut self, frame: &Frame) {
        let entries = self.values.iter_mut().zip(&mut self.counts);
        for ((sum, count), &x) in entries.zip(frame.values.iter().flatten().flatten()) {
            if x.is_finite() {
                *sum += x;
                *count += 1;
            }
        }
    }

    /// Converts sums to means, those of other channels to 0, and returns how many had no reading: these are NaN.
    fn divide(&mut self, kinds: impl Iterator<Item = ChannelKind>) -> usize {
        let mut without = 0;
        for ((sum, count), kind) in self.values.iter_mut().zip(std::mem::take(&mut self.counts)).zip(kinds) {
            *sum = if kind.is_of_touch() { *sum / f64::from(count) } else { 0.0 };
            without += usize::from(sum.is_nan());
        }
        without
    }
}

impl LowPass {
    /// Splits the readings in `slow`.
    fn split(&mut self, range: std::ops::Range<usize>, now: f64, slow: &mut [f64], fast: &mut [f64]) {
        let states = self.slow[range.clone()].iter_mut().zip(&mut self.times[range]);
        // The last reading of almost all taxels was in the same frame.
        let (mut last, mut share) = (f64::NAN, 0.0);
        for ((slow, fast), (state, since)) in slow.iter_mut().zip(fast).zip(states) {
            let x = *slow;
            if !x.is_finite() {
                (*slow, *fast) = (f64::NAN, f64::NAN);
                continue;
            }
            if state.is_nan() {
                *state = x;
            } else {
                if *since != last {
                    last = *since;
                    share = -(-TAU * self.hz * (now - last)).exp_m1();
                }
                *state += share * (x - *state);
            }
            *since = now;
            (*slow, *fast) = (*state, x - *state);
        }
    }
}
