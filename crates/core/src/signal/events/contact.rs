//! One contact from its begin to its end: its dates, its force and its word.

use glam::DVec3;

use crate::body::BodyTaxel;
use crate::id::VertexId;
use crate::signal::ContactRegion;
use crate::signal::clock::SAME_S;
use crate::signal::events::bridges::Bridges;
use crate::signal::events::history::{Edge, History, Stretch};
use crate::signal::events::path::{Motion, Path};
use crate::signal::events::{Event, EventContact, EventOptions, EventPlace, Phase, Word};
use crate::skin::{LinkId, PatchId};

/// Begin and end are dated from the taxels of the first and the last time of this length, in s, and moved by no more than
/// this, in s.
const EDGE_S: f64 = 0.2;
const DATED_MOST_S: f64 = 1.0;

/// How long after its begin a contact is dated again, in s: until the body is as deep as it will be.
const RISE_S: f64 = 1.0;

/// A stroke has the word of a direction within 35 degrees.
const WORD_COSINE: f64 = 0.819_152_044_288_991_8;

/// What is the same for all contacts of a patch: the smallest length of a stroke, in m, and the number of taxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatchLimits {
    pub(super) stroke: f64,
    pub(super) taxels: usize,
}

/// A contact, over one or several tracks.
#[derive(Debug, Clone)]
pub(super) struct Followed {
    pub(super) number: u64,
    /// The track that it is now.
    pub(super) track: u64,
    /// That of its patch in its last frame.
    pub(super) link: LinkId,
    /// The patch in its last frame, and the one that its path is in the frame of.
    patch_now: PatchId,
    frame: PatchId,
    /// All its patches, ascending.
    patches: Vec<PatchId>,
    pub(super) onset: f64,
    /// Before this time its first peak read nothing: it had not begun.
    possible: f64,
    /// The last frame that had it.
    pub(super) last: f64,
    pub(super) centre: DVec3,
    pub(super) normal: DVec3,
    pub(super) force: f64,
    /// What was reported last; `None` before anything was.
    pub(super) word: Option<Word>,
    /// Smallest length of a stroke on this patch.
    stroke: f64,
    frames: usize,
    path: Path,
    /// When it began and ended, dated.
    begin: f64,
    end: f64,
    /// Whether `begin` is that by its last frame.
    is_dated: bool,
    /// The taxels of its first time, with the peak then, and those of this time and the one before.
    first: Stretch,
    last_stretches: [Stretch; 2],
    force_sum: f64,
    force_peak: f64,
    force_peak_time: f64,
    impulse: f64,
    area: f64,
    /// The patch, the taxels, those on other patches, and the peak when it was largest.
    patch: PatchId,
    taxels: Vec<VertexId>,
    beyond: Vec<BodyTaxel>,
    peak: f64,
    peak_taxel: VertexId,
}

impl Followed {
    /// A contact that begins; it has room for this many taxels.
    pub(super) fn new(
        number: u64,
        time: f64,
        possible: f64,
        region: &ContactRegion,
        PatchLimits { stroke, taxels }: PatchLimits,
    ) -> Self {
        let stretch = || Stretch { taxels: Vec::with_capacity(taxels), ..Stretch::default() };
        Self {
            number,
            track: region.track,
            link: region.link,
            patch_now: region.patch,
            frame: region.patch,
            patches: Vec::new(),
            onset: time,
            possible,
            last: time,
            centre: region.centre,
            normal: region.normal,
            force: region.force,
            word: None,
            stroke,
            frames: 0,
            path: Path::new(),
            begin: time,
            end: time,
            is_dated: false,
            first: stretch(),
            last_stretches: [stretch(), stretch()],
            force_sum: 0.0,
            force_peak: f64::NAN,
            force_peak_time: time,
            impulse: 0.0,
            area: 0.0,
            patch: region.patch,
            taxels: Vec::with_capacity(taxels),
            beyond: Vec::new(),
            peak: f64::NEG_INFINITY,
            peak_taxel: region.peak_taxel,
        }
    }

    /// Takes the contact in a frame.
    pub(super) fn see(&mut self, time: f64, region: &ContactRegion, bridges: &Bridges) {
        for patch in region.beyond.iter().map(|at| at.patch).chain([region.patch]) {
            if let Err(place) = self.patches.binary_search(&patch) {
                self.patches.insert(place, patch);
            }
        }
        (self.link, self.patch_now) = (region.link, region.patch);
        if self.frames > 0 {
            self.impulse += 0.5 * (time - self.last) * (self.force + region.force);
        }
        (self.last, self.centre) = (time, region.centre);
        (self.normal, self.force) = (region.normal, region.force);
        self.frames += 1;
        self.force_sum += region.force;
        if self.force_peak.is_nan() || region.force > self.force_peak {
            (self.force_peak, self.force_peak_time) = (region.force, time);
        }
        self.area = self.area.max(region.area);
        if region.peak > self.peak {
            (self.patch, self.peak, self.peak_taxel) = (region.patch, region.peak, region.peak_taxel);
            self.taxels.clear();
            self.taxels.extend_from_slice(&region.taxels);
            self.beyond.clear();
            self.beyond.extend_from_slice(&region.beyond);
        }
        self.keep_edges(time, region);
        self.path.add(time, region, bridges.moved(region.centre, [region.patch, self.frame]));
        if time - self.onset <= RISE_S + SAME_S {
            self.is_dated = false;
        }
    }

    /// Whether it lasts long enough to be reported.
    pub(super) fn is_lasting(&self, options: &EventOptions) -> bool {
        self.frames >= 2 && self.last - self.onset >= options.least_s - SAME_S
    }

    /// Keeps the taxels of its first and its latest time.
    fn keep_edges(&mut self, time: f64, region: &ContactRegion) {
        if self.frames == 1 {
            self.first.begin = time;
            self.last_stretches[1].begin = time;
        }
        if time - self.first.begin <= EDGE_S + SAME_S {
            self.first.add(region);
        }
        let [before, now] = &mut self.last_stretches;
        if time - now.begin > 0.5 * EDGE_S + SAME_S {
            std::mem::swap(before, now);
            now.taxels.clear();
            (now.begin, now.peak) = (time, 0.0);
        }
        now.add(region);
        self.end = time;
    }

    /// Dates its begin from the history up to its last frame, while that may change.
    pub(super) fn date_begin(&mut self, history: &mut History) {
        if !self.is_dated {
            self.is_dated = true;
            let taxels = &self.first.taxels;
            let span = [self.onset, self.last];
            let found = history.date(Edge::Begin, taxels, span, self.last - self.onset).unwrap_or(self.onset);
            self.begin = found.max(self.possible).clamp(self.onset - DATED_MOST_S, self.onset);
        }
    }

    /// Whether its next frame, at this time, can move its begin no more.
    pub(super) fn is_risen(&self, time: f64) -> bool {
        time - self.onset > RISE_S + SAME_S
    }

    /// Whether it can be a hold by now, if it began as early as it may have.
    pub(super) fn may_be_hold(&self, options: &EventOptions) -> bool {
        self.last - self.onset + DATED_MOST_S >= options.hold_s - SAME_S
    }

    /// Dates its end.
    pub(super) fn date_end(&mut self, history: &mut History) {
        let [before, now] = &self.last_stretches;
        let Stretch { begin, taxels, .. } = if before.taxels.is_empty() { now } else { before };
        let found =
            history.date(Edge::End, taxels, [*begin, self.last], self.last - self.onset).unwrap_or(self.last);
        let latest = history.latest().unwrap_or(self.last).max(self.last);
        self.end = found.clamp(self.last, latest.min(self.last + DATED_MOST_S));
    }

    /// When it began, dated back to the noise.
    pub(super) fn begin(&self) -> f64 {
        self.begin
    }

    /// When it ended, dated likewise.
    pub(super) fn end(&self) -> f64 {
        self.end
    }

    /// Whether its word can become a later one of [`Word`] while it goes on: of those the last is a rub.
    pub(super) fn may_be_more_than(&self, word: Word, options: &EventOptions) -> bool {
        word < Word::Stroke || (word == Word::Stroke && self.path.turns >= options.rub_turns)
    }

    /// The word by now: its duration so far is that until its last frame, or until its end.
    pub(super) fn word_now(&mut self, options: &EventOptions, has_ended: bool) -> Word {
        let begin = self.begin();
        let duration = if has_ended { self.end() - begin } else { self.last - begin };
        if self.path.is_longer(self.stroke) {
            let is_rub = self.path.turns >= options.rub_turns
                && self.path.length > options.rub_ratio * self.path.motion().net;
            return if is_rub { Word::Rub } else { Word::Stroke };
        }
        let is_hit = options.hit_n.is_some_and(|force| self.force_peak > force)
            && self.force_peak_time - begin < options.hit_s - SAME_S;
        match (has_ended, is_hit) {
            (true, true) => Word::Hit,
            _ if duration >= options.hold_s - SAME_S => Word::Hold,
            (false, _) => Word::Touch,
            (true, false) if duration < options.tap_s - SAME_S => Word::Tap,
            (true, false) => Word::Press,
        }
    }

    /// Completes the path.
    pub(super) fn close(&mut self) {
        self.path.complete_block();
    }

    /// What is known of it.
    pub(super) fn contact(&mut self, word: Word, options: &EventOptions, bridges: &Bridges) -> EventContact {
        let Motion { from, to, net, .. } = self.path.motion();
        let way = (to.point - from.point).normalize_or_zero();
        let is_moving = matches!(word, Word::Stroke | Word::Rub);
        let cosine = |direction: DVec3| direction.normalize_or_zero().dot(way);
        // The path is in the frame of the link that it began on.
        let link = bridges.link(self.frame);
        let words = options.words.iter().enumerate().filter(|(_, word)| word.link == link);
        let in_own = |place: EventPlace| EventPlace {
            point: bridges.moved(place.point, [self.frame, place.patch]),
            ..place
        };
        // Of equal ones the first.
        let nearest = words.map(|(k, word)| (k, cosine(word.direction)));
        let nearest = nearest.fold(None, |best: Option<(usize, f64)>, now| match best {
            Some(best) if best.1 >= now.1 => Some(best),
            _ => Some(now),
        });
        EventContact {
            patch: self.patch,
            link: bridges.link(self.patch),
            patches: self.patches.clone(),
            force_peak: self.force_peak,
            force_mean: self.force_sum / self.frames as f64,
            impulse: self.impulse,
            area: self.area,
            from: in_own(from),
            to: in_own(to),
            length: self.path.length.max(net),
            // Maps of two patches have no direction in common.
            direction: (is_moving && from.patch == to.patch).then(|| {
                let way = to.map - from.map;
                way.y.atan2(way.x)
            }),
            body_word: nearest.filter(|(_, cos)| word == Word::Stroke && *cos > WORD_COSINE).map(|(k, _)| k),
            taxels: self.taxels.clone(),
            beyond: self.beyond.clone(),
            peak_taxel: self.peak_taxel,
        }
    }

    pub(super) fn event(
        &mut self,
        word: Word,
        phase: Phase,
        time: f64,
        (options, bridges): (&EventOptions, &Bridges),
    ) -> Event {
        let begin = self.begin();
        let until = if phase == Phase::End { self.end() } else { self.last };
        Event {
            word,
            phase,
            contacts: vec![self.number],
            time,
            begin,
            duration: until - begin,
            contact: Some(self.contact(word, options, bridges)),
        }
    }
}

/// A contact whose track has ended: a new one may continue it for some time.
#[derive(Debug, Clone)]
pub(super) struct Waiting(Followed);

impl Waiting {
    pub(super) fn new(contact: Followed) -> Self {
        Self(contact)
    }

    pub(super) fn contact(&self) -> &Followed {
        &self.0
    }

    /// Whether a track that begins at this time may continue it.
    pub(super) fn may_go_on(&self, time: f64, options: &EventOptions) -> bool {
        time - self.0.last <= options.join_s + SAME_S
    }

    /// How far a region is that may continue it, in m, and its number.
    pub(super) fn distance(
        &self,
        time: f64,
        region: &ContactRegion,
        options: &EventOptions,
        bridges: &Bridges,
    ) -> Option<(f64, u64)> {
        let ends = [self.0.patch_now, region.patch];
        let distance = bridges.moved(self.0.centre, ends).distance(region.centre);
        let is_near = match bridges.gap(ends) {
            Some(width) => distance <= options.join_m + width,
            None => self.0.link == region.link && distance <= options.join_m,
        };
        (is_near && self.may_go_on(time, options)).then_some((distance, self.0.number))
    }

    /// It, continued by a region.
    pub(super) fn go_on(mut self, time: f64, region: &ContactRegion, bridges: &Bridges) -> Followed {
        self.0.track = region.track;
        self.0.see(time, region, bridges);
        self.0
    }

    /// It, to be ended.
    pub(super) fn end(&mut self) -> &mut Followed {
        &mut self.0
    }
}
