//! From frames to presses: when one body touches the skin, and which frames show that best.
//!
//! A taxel is *hot* above 4.5 times its noise, which is estimated from successive readings all along. A press lasts from
//! the first frame with hot taxels next to each other to the last; of its frames up to eight are kept in which one
//! group of hot taxels has nearly all of the sum. Memory does not depend on how long a press lasts: of a long one every
//! second frame is dropped as often as necessary.

use crate::id::VertexId;
use crate::mesh::neighbours;
use crate::numeric::Csr;
use crate::response::press::{Foot, HOT, Press, PressFrame, Surface, confirmed, least_noise, median_noise};
use crate::signal::{Frame, RunningNoise};
use crate::skin::{Patch, Skin};

/// Frames from which noise is learned before a touch is seen.
const START_FRAMES: u64 = 10;

/// A press ends after this many frames without a touch.
const GAP: usize = 3;

/// Hot taxels that a usable frame has at least, and the share of the sum that one group of them has.
const LEAST_HOT: usize = 3;
const ONE_BODY: f64 = 0.9;

/// Frames that are kept of a press, and the share of its largest sum that they have.
const FRAMES: usize = 8;
const SHARE: f64 = 0.35;

/// Most frames of a press in memory before every second one is dropped.
const MOST_FRAMES: usize = 128;

/// Most presses; more would add nothing to a precision of a per cent.
const MOST_PRESSES: usize = 5000;

/// A reading is saturated at the largest value of its taxel if that came this often, and twice in a row.
const SATURATED: u32 = 5;

/// A reading is a spike if it is this many times larger than its threshold, than those around it and than the one
/// before it. *Heuristic*: a body that three taxels feel is felt next to its peak by a third of it and more.
const SPIKE: f64 = 10.0;

/// Gathers the presses of recordings.
pub(super) struct Collector<'s> {
    patches: Vec<OnePatch<'s>>,
    channel: Vec<Channel>,
    /// The current press: the number of its patch, and its frames.
    frames: Vec<Kept>,
    stride: usize,
    seen: usize,
    quiet: usize,
    largest: f64,
    count: u64,
    /// The readings of this frame without spikes, and those before it.
    read: Vec<f64>,
    last: Vec<f64>,
    /// Spikes of this frame, if the next readings fall.
    fresh: Vec<(usize, f64)>,
    recording: usize,
    frame: usize,
    pub(super) presses: Vec<Press>,
    pub(super) tally: Tally,
}

/// What became of touches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Tally {
    /// Touches in all, and those of several bodies at once or on too few taxels.
    pub(super) touches: usize,
    pub(super) several: usize,
    pub(super) small: usize,
    /// Readings of touched taxels, and how many of these are saturated.
    pub(super) hot: usize,
    pub(super) saturated: usize,
    /// Readings that were left out, each far larger than those around it and before and after it; and the first.
    pub(super) spikes: usize,
    pub(super) first_spike: Option<Spike>,
}

/// A reading that was left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Spike {
    /// The number of the taxel, patch after patch.
    pub taxel: usize,
    /// The number of the recording and of the frame in it, each counted from 0.
    pub recording: usize,
    /// See [`Self::recording`].
    pub frame: usize,
}

struct OnePatch<'s> {
    surface: Surface<'s>,
    /// The number of its first taxel.
    first: usize,
    neighbours: Csr<u32>,
    count: usize,
}

/// What is known of the readings of a taxel.
#[derive(Debug, Clone, Copy)]
struct Channel {
    noise: RunningNoise,
    most: f64,
    at_most: u32,
    was_at_most: bool,
    is_stuck_at_most: bool,
}

/// A frame of a press: a patch, the sum of one body, its hot taxels, and all readings of the patch.
struct Kept {
    patch: usize,
    sum: f64,
    hot: Vec<u32>,
    readings: Vec<f64>,
}

impl<'s> Collector<'s> {
    pub(super) fn new(skin: &'s Skin) -> Self {
        let mut first = 0;
        let patch = |patch: &'s Patch| {
            let count = patch.mesh.positions.len();
            let neighbours = neighbours([&patch.mesh]);
            first += count;
            OnePatch { surface: Surface::new(patch), first: first - count, neighbours, count }
        };
        let patches: Vec<_> = skin.patches.iter().map(patch).collect();
        const UNKNOWN: Channel = Channel {
            noise: RunningNoise::UNKNOWN,
            most: f64::NEG_INFINITY,
            at_most: 0,
            was_at_most: false,
            is_stuck_at_most: false,
        };
        Self {
            patches,
            channel: vec![UNKNOWN; first],
            frames: Vec::new(),
            stride: 1,
            seen: 0,
            quiet: 0,
            largest: 0.0,
            count: 0,
            read: Vec::new(),
            last: vec![f64::NAN; first],
            fresh: Vec::new(),
            recording: 0,
            frame: 0,
            presses: Vec::new(),
            tally: Tally::default(),
        }
    }

    /// Takes the next frame of the first channel, of readings without their zeros.
    pub(super) fn see(&mut self, frame: &Frame) {
        let mut read = std::mem::take(&mut self.read);
        read.clear();
        read.extend(frame.values.iter().flat_map(|channels| channels[0].iter().copied()));
        let median = self.median_noise();
        self.leave_out_spikes(&mut read, median);
        self.largest = self.largest.max(confirmed(&read, |k| self.around(&read, k)));
        self.learn_noise(&read, median);
        if self.count > START_FRAMES {
            self.find_press(&read);
        }
        self.read = read;
    }

    /// The largest reading next to a taxel; 0 if none is above it.
    fn around(&self, read: &[f64], taxel: usize) -> f64 {
        let at = self.patches.partition_point(|patch| patch.first <= taxel) - 1;
        let patch = &self.patches[at];
        let near = patch.neighbours[taxel - patch.first].iter().map(|&v| read[patch.first + v as usize]);
        near.fold(0.0, f64::max)
    }

    fn leave_out_spikes(&mut self, read: &mut [f64], median: f64) {
        for (taxel, x) in std::mem::take(&mut self.fresh) {
            if read[taxel] < x / SPIKE {
                self.tally.spikes += 1;
                let spike = Spike { taxel, recording: self.recording, frame: self.frame - 1 };
                self.tally.first_spike.get_or_insert(spike);
            }
        }
        let is_spike = |k: usize| {
            let least = HOT * least_noise(&self.channel[k].noise, median, self.largest);
            let is_above = |other: f64| read[k] > SPIKE * other.max(least);
            self.count > START_FRAMES
                && self.last[k].is_finite()
                && is_above(self.last[k])
                && is_above(self.around(read, k))
        };
        let fresh: Vec<(usize, f64)> =
            (0..read.len()).filter(|&k| is_spike(k)).map(|k| (k, read[k])).collect();
        self.last.copy_from_slice(read);
        fresh.iter().for_each(|&(k, _)| read[k] = f64::NAN);
        self.fresh = fresh;
        self.frame += 1;
    }

    fn find_press(&mut self, read: &[f64]) {
        let median = self.median_noise();
        let mut best: Option<Kept> = None;
        let mut total = 0.0;
        for (number, patch) in self.patches.iter().enumerate() {
            let values = &read[patch.first..][..patch.count];
            let is_hot: Vec<bool> = values
                .iter()
                .zip(&self.channel[patch.first..])
                .map(|(x, channel)| *x > HOT * least_noise(&channel.noise, median, self.largest))
                .collect();
            for group in patch.groups(&is_hot) {
                let sum = group.iter().map(|&v| values[v as usize]).sum::<f64>();
                total += sum;
                if group.len() >= LEAST_HOT && best.as_ref().is_none_or(|best| best.sum < sum) {
                    let readings = values.to_vec();
                    best = Some(Kept { patch: number, sum, hot: group, readings });
                }
            }
        }
        let Some(best) = best else {
            self.quiet += 1;
            if self.quiet >= GAP {
                self.end_press();
            }
            return;
        };
        self.quiet = 0;
        self.seen += 1;
        if best.sum < ONE_BODY * total || !self.seen.is_multiple_of(self.stride) {
            return;
        }
        if self.frames.len() == MOST_FRAMES {
            let mut is_odd = false;
            self.frames.retain(|_| {
                is_odd = !is_odd;
                is_odd
            });
            self.stride *= 2;
        }
        self.frames.push(best);
    }

    /// Ends an episode of a recording: the frame that comes next is not the one after the last.
    pub(super) fn end_episode(&mut self) {
        self.end_press();
        self.last.fill(f64::NAN);
        self.fresh.clear();
    }

    /// Ends a recording.
    pub(super) fn end_recording(&mut self) {
        self.end_episode();
        (self.recording, self.frame) = (self.recording + 1, 0);
    }

    /// Ends a press, also at the end of a recording.
    pub(super) fn end_press(&mut self) {
        let frames = std::mem::take(&mut self.frames);
        let seen = std::mem::take(&mut self.seen);
        self.stride = 1;
        if seen == 0 {
            return;
        }
        self.tally.touches += 1;
        let Some(most) = frames.iter().map(|kept| kept.sum).max_by(f64::total_cmp) else {
            self.tally.several += 1;
            return;
        };
        // A body that leaves a patch in the middle of a press counts where it pressed most.
        let on = frames.iter().find(|kept| kept.sum == most).map_or(0, |kept| kept.patch);
        let usable: Vec<&Kept> =
            frames.iter().filter(|kept| kept.patch == on && kept.sum > SHARE * most).collect();
        let count = usable.len().min(FRAMES);
        let chosen: Vec<&Kept> = (0..count)
            .map(|k| usable[(k * (usable.len() - 1) + (count - 1) / 2) / (count - 1).max(1)])
            .collect();
        match self.press(on, &chosen) {
            Some(press) if self.presses.len() < MOST_PRESSES => self.presses.push(press),
            Some(_) => {}
            None => self.tally.small += 1,
        }
    }

    fn press(&self, on: usize, frames: &[&Kept]) -> Option<Press> {
        let patch = &self.patches[on];
        let mut is_in = vec![false; patch.count];
        for &v in frames.iter().flat_map(|kept| &kept.hot) {
            is_in[v as usize] = true;
            patch.neighbours[v as usize].iter().for_each(|&w| is_in[w as usize] = true);
        }
        let taxels: Vec<VertexId> = (0..patch.count).filter(|&v| is_in[v]).map(VertexId::new).collect();
        let foot = |kept: &&Kept| -> Option<Foot> {
            let weight = |&v: &u32| (VertexId::from(v), kept.readings[v as usize]);
            patch.surface.foot(kept.hot.iter().map(weight))
        };
        let feet: Vec<Foot> = frames.iter().map(foot).collect::<Option<_>>()?;
        let views = patch.surface.views(&feet, &taxels);
        let readings = |kept: &Kept| taxels.iter().map(|v| kept.readings[v.index()]).collect();
        let frames =
            frames.iter().zip(views).map(|(kept, views)| PressFrame { views, readings: readings(kept) });
        let number = |v: &VertexId| u32::try_from(patch.first + v.index()).unwrap_or(u32::MAX);
        Some(Press { taxels: taxels.iter().map(number).collect(), frames: frames.collect() })
    }

    /// Ends the last press, masks saturated readings, and gives the noise of each taxel.
    pub(super) fn finish(mut self) -> (Vec<Press>, Vec<f64>, Tally) {
        self.end_press();
        let median = self.median_noise();
        let noise: Vec<f64> =
            self.channel.iter().map(|channel| least_noise(&channel.noise, median, self.largest)).collect();
        // What no press changes has no gain that could be found: the steps of its logarithm would never end.
        let mut is_felt = vec![false; noise.len()];
        self.presses
            .iter()
            .flat_map(|press| press.hot_taxels(&noise))
            .for_each(|taxel| is_felt[taxel] = true);
        for press in &mut self.presses {
            for (k, &taxel) in press.taxels.iter().enumerate() {
                let channel = &self.channel[taxel as usize];
                if !is_felt[taxel as usize] {
                    press.frames.iter_mut().for_each(|frame| frame.readings[k] = f64::NAN);
                    continue;
                }
                let is_saturated = channel.is_stuck_at_most && channel.at_most >= SATURATED;
                for frame in &mut press.frames {
                    let reading = &mut frame.readings[k];
                    self.tally.hot += usize::from(*reading > HOT * noise[taxel as usize]);
                    if is_saturated && *reading >= channel.most {
                        self.tally.saturated += 1;
                        *reading = f64::NAN;
                    }
                }
            }
        }
        (self.presses, noise, self.tally)
    }

    fn learn_noise(&mut self, read: &[f64], median: f64) {
        self.count += 1;
        for (channel, &x) in self.channel.iter_mut().zip(read) {
            if !x.is_finite() {
                channel.noise.interrupt();
                channel.was_at_most = false;
                continue;
            }
            channel.noise.see(x, if median > 0.0 { median } else { f64::NAN });
            if x > channel.most {
                (channel.most, channel.at_most, channel.is_stuck_at_most) = (x, 0, false);
            }
            let is_at_most = x == channel.most;
            channel.at_most += u32::from(is_at_most);
            channel.is_stuck_at_most |= is_at_most && channel.was_at_most;
            channel.was_at_most = is_at_most;
        }
    }

    fn median_noise(&self) -> f64 {
        median_noise(self.channel.iter().map(|channel| &channel.noise))
    }
}

impl OnePatch<'_> {
    /// Groups of hot taxels that are at most two edges apart: one without a reading does not part them.
    fn groups(&self, is_hot: &[bool]) -> Vec<Vec<u32>> {
        let mut is_seen = vec![false; self.count];
        let mut groups = Vec::new();
        for start in (0..self.count).filter(|&v| is_hot[v]) {
            if std::mem::replace(&mut is_seen[start], true) {
                continue;
            }
            let mut group = vec![u32::try_from(start).unwrap_or(u32::MAX)];
            let mut next = 0;
            while next < group.len() {
                let around = &self.neighbours[group[next] as usize];
                next += 1;
                let far = around.iter().flat_map(|&w| &self.neighbours[w as usize]);
                for &w in around.iter().chain(far) {
                    if is_hot[w as usize] && !std::mem::replace(&mut is_seen[w as usize], true) {
                        group.push(w);
                    }
                }
            }
            group.sort_unstable();
            groups.push(group);
        }
        groups
    }
}
