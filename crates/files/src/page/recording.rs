//! The readings, contacts and events of a recording, as a page plays them.

use base64::{Engine, engine::general_purpose::STANDARD};
use serde::Serialize;

use crate::body::BodyTaxel;
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::numeric::narrow;
use crate::page::events::{EventRecorder, EventRow};
use crate::page::pack::Packer;
use crate::recording::Step;
use crate::signal::{Channel, Clock, ContactEvent, ContactRegion, ContactTracker, Quantity, SignalError};
use crate::skin::PatchId;

/// Most readings of a page: a quarter of a gigabyte while it is made.
const MAX_READINGS: usize = 1 << 26;

#[derive(Debug)]
pub(super) struct Recorder<'m> {
    map: &'m SkinMap,
    channel: Channel,
    shown: usize,
    /// Threshold of contacts, if it is known.
    pub(super) threshold: Option<f64>,
    clock: Clock,
    times: Vec<f64>,
    cuts: Vec<usize>,
    totals: Vec<f64>,
    contacts: Vec<ContactRow>,
    parts: Vec<PartRow>,
    events: EventRecorder,
    /// Readings of each patch, taxel after taxel, frame after frame.
    values: IdVec<PatchId, Vec<f32>>,
    readings: usize,
}

#[derive(Debug, Serialize)]
pub(super) struct RecordingHeader {
    channel: String,
    unit: String,
    is_amount: bool,
    lo: f64,
    hi: f64,
    force: bool,
    times: Vec<f64>,
    /// The frames before which times go back or frames are missing.
    cuts: Vec<usize>,
    /// Sum of the readings of each frame.
    totals: Vec<f64>,
    /// Array of each patch, frame after frame: 0 where nothing is known, 1 to 255 from `lo` to `hi`.
    values: Vec<usize>,
    contacts: Vec<ContactRow>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    parts: Vec<PartRow>,
    /// None of a live page, which gets them as they end, and where frames have no times.
    events: Vec<EventRow>,
    threshold: Option<f64>,
    /// Whether frames arrive while the page is open.
    is_live: bool,
}

/// Frame, track, event, patch, taxels, area, force, u, v, and the taxel of the largest reading.
type ContactRow = (usize, u64, u8, usize, usize, f64, Option<f64>, f64, f64, u32);

/// What of a contact is on another patch: frame, track, patch, area, and the taxel of the largest reading.
type PartRow = (usize, u64, usize, f64, u32);

impl<'m> Recorder<'m> {
    pub(super) fn new(map: &'m SkinMap, channel: &Channel, shown: usize) -> Result<Self, SignalError> {
        Ok(Self {
            map,
            channel: channel.clone(),
            shown,
            threshold: None,
            clock: Clock::new(),
            times: Vec::new(),
            cuts: Vec::new(),
            totals: Vec::new(),
            contacts: Vec::new(),
            parts: Vec::new(),
            events: EventRecorder::new(map)?,
            values: map.patches.map(|_| Vec::new()),
            readings: 0,
        })
    }

    pub(super) fn frames(&self) -> usize {
        self.times.len()
    }

    pub(super) fn record(&mut self, step: &Step<'_>) -> Result<(), SignalError> {
        let (frame, number) = (step.frame, self.times.len());
        let taxels: usize = self.map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        self.readings += taxels;
        if self.readings > MAX_READINGS {
            return Err(SignalError::TooLong {
                frames: number + 1,
                taxels,
                most: MAX_READINGS / taxels.max(1),
            });
        }
        // The tracker has read ahead: it also knows a first step that is a gap.
        let own = self.clock.see(frame.time);
        if step.tracker.map_or(own, ContactTracker::tick).is_cut() {
            self.cuts.push(number);
        }
        self.times.push(time_of(frame.time, self.times.last().copied(), &self.clock));
        let mut total = 0.0;
        for (values, of) in self.values.iter_mut().zip(&frame.values) {
            let read = &of[self.shown];
            total += read.iter().filter(|x| x.is_finite()).sum::<f64>();
            values.extend(read.iter().map(|&x| narrow(x)));
        }
        self.totals.push(total);
        self.contacts.extend(step.contacts.iter().map(|region| contact_row(number, region)));
        let areas = |at: BodyTaxel| self.map.patches[at.patch].taxels.areas[at.taxel];
        self.parts.extend(part_rows(number, step, self.shown, areas));
        self.events.record(step, &self.times)
    }

    pub(super) fn finish(self, packer: &mut Packer) -> RecordingHeader {
        let known = || self.values.iter().flatten().copied().filter(|x| x.is_finite()).map(f64::from);
        let (lo, hi) = (known().fold(f64::INFINITY, f64::min), known().fold(f64::NEG_INFINITY, f64::max));
        let (lo, hi) = match lo < hi {
            true => (lo, hi),
            false if lo.is_finite() => (lo, lo + 1.0),
            false => (0.0, 1.0),
        };
        let byte = |&x: &f32| -> u32 {
            if x.is_finite() {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 255")]
                let step = (1.0 + 254.0 * (f64::from(x) - lo) / (hi - lo)).round() as u32;
                step
            } else {
                0
            }
        };
        let values = self.values.iter().map(|of| packer.bytes(of.iter().map(byte).collect())).collect();
        RecordingHeader {
            unit: self.channel.unit.clone(),
            is_amount: self.channel.quantity == Quantity::Extensive,
            lo,
            hi,
            force: self.channel.newtons().is_some(),
            events: self.events.finish(&self.times),
            times: self.times,
            cuts: self.cuts,
            totals: self.totals,
            values,
            contacts: self.contacts,
            parts: self.parts,
            threshold: self.threshold,
            is_live: false,
            channel: self.channel.name,
        }
    }
}

/// The time of a frame; of one without, the usual step after the last, or a second where nothing is known.
fn time_of(time: f64, last: Option<f64>, clock: &Clock) -> f64 {
    match last {
        _ if time.is_finite() => time,
        None => 0.0,
        Some(last) => last + clock.usual().unwrap_or(1.0),
    }
}

fn contact_row(frame: usize, region: &ContactRegion) -> ContactRow {
    let event = match region.event {
        ContactEvent::Onset => 0,
        ContactEvent::Move => 1,
        ContactEvent::Release => 2,
    };
    let force = Some(region.force).filter(|force| force.is_finite());
    let (u, v) = region.map.into();
    let peak = region.peak_taxel.raw();
    let (patch, taxels) = (region.patch.index(), region.taxels.len() + region.beyond.len());
    (frame, region.track, event, patch, taxels, region.area, force, u, v, peak)
}

/// What of the contacts of a frame is on other patches than theirs.
fn part_rows(frame: usize, step: &Step<'_>, shown: usize, area: impl Fn(BodyTaxel) -> f64) -> Vec<PartRow> {
    let reading = |at: &BodyTaxel| step.frame.values[at.patch][shown][at.taxel];
    let mut rows = Vec::new();
    for region in step.contacts.iter().filter(|region| region.event != ContactEvent::Release) {
        for part in region.beyond.chunk_by(|a, b| a.patch == b.patch) {
            let Some(peak) = part.iter().max_by(|a, b| reading(a).total_cmp(&reading(b))) else { continue };
            let area = part.iter().map(|&at| area(at)).sum();
            rows.push((frame, region.track, peak.patch.index(), area, peak.taxel.raw()));
        }
    }
    rows
}

/// Converts arriving frames for an open page.
#[derive(Debug)]
pub struct LiveFrames {
    /// Areas of taxels, in m^2.
    areas: IdVec<PatchId, IdVec<VertexId, f64>>,
    shown: usize,
    clock: Clock,
    last: Option<f64>,
    events: EventRecorder,
}

/// What a [`LiveServer`](super::LiveServer) shows next: a frame and the events that have ended by then.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveUpdate {
    /// As JSON, without the braces.
    pub(super) frame: String,
    /// Each as JSON.
    pub(super) events: Vec<String>,
}

#[derive(Debug, Serialize)]
struct LiveFrame {
    time: f64,
    /// The readings of all taxels, patch after patch, as little-endian `f32` in base64.
    values: String,
    contacts: Vec<ContactRow>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    parts: Vec<PartRow>,
}

impl LiveFrames {
    /// A converter of frames of which one channel is shown, and the header that the page needs before the first.
    pub(super) fn new(
        map: &SkinMap,
        channel: &Channel,
        shown: usize,
    ) -> Result<(Self, RecordingHeader), SignalError> {
        let header = RecordingHeader {
            channel: channel.name.clone(),
            unit: channel.unit.clone(),
            is_amount: channel.quantity == Quantity::Extensive,
            lo: 0.0,
            hi: 1e-9,
            force: channel.newtons().is_some(),
            times: Vec::new(),
            cuts: Vec::new(),
            totals: Vec::new(),
            values: Vec::new(),
            contacts: Vec::new(),
            parts: Vec::new(),
            events: Vec::new(),
            threshold: None,
            is_live: true,
        };
        let areas = map.patches.map(|patch| patch.taxels.areas.clone());
        Ok((Self { areas, shown, clock: Clock::new(), last: None, events: EventRecorder::new(map)? }, header))
    }

    /// The next frame, for [`LiveServer::show`](super::LiveServer::show), with the events that have ended, whose limits
    /// are those of [`EventOptions::default`](crate::signal::EventOptions). From the first frame without a time on there
    /// are none.
    ///
    /// # Errors
    /// As [`EventDetector::see`](crate::signal::EventDetector::see).
    ///
    /// # Panics
    /// If the frame lacks the channel.
    pub fn next(&mut self, step: &Step<'_>) -> Result<LiveUpdate, SignalError> {
        let frame = step.frame;
        let readings = frame.values.iter().flat_map(|of| of[self.shown].iter());
        let bytes: Vec<u8> = readings.flat_map(|&x| narrow(x).to_le_bytes()).collect();
        let contacts = step.contacts.iter().map(|region| contact_row(0, region)).collect();
        let parts = part_rows(0, step, self.shown, |at| self.areas[at.patch][at.taxel]);
        self.clock.see(frame.time);
        let time = time_of(frame.time, self.last, &self.clock);
        self.last = Some(time);
        let json =
            serde_json::to_string(&LiveFrame { time, values: STANDARD.encode(bytes), contacts, parts });
        let json = json.expect("numbers and texts are JSON");
        Ok(LiveUpdate { frame: json[1..json.len() - 1].to_owned(), events: self.events.ended(step)? })
    }

    /// The events that end with the last frame, for [`LiveServer::end`](super::LiveServer::end).
    #[must_use]
    pub fn finish(mut self) -> Vec<String> {
        self.events.last()
    }
}
