//! One contact from its begin to its end: its path, its force and its word.

use glam::{DVec2, DVec3};

use crate::id::VertexId;
use crate::numeric::median_of;
use crate::signal::ContactRegion;
use crate::signal::events::history::{Edge, History, Stretch};
use crate::signal::events::{Event, EventContact, EventOptions, EventPlace, Phase, Word};
use crate::skin::{LinkId, PatchId};

/// Centres of pressure are averaged over blocks of this time, in s; when there are more than [`BLOCKS`], of twice the time.
const BLOCK_S: f64 = 0.02;
const BLOCKS: usize = 256;

/// Blocks with less than this share of the largest load do not count: their centres are noise.
const LOADED: f64 = 0.25;

/// Steps of a path, in m, and the cosine of the angle from which one turns.
const STEP: f64 = 0.004;
const TURN_COSINE: f64 = -0.5;

/// Share of the first and the last blocks whose median is an end of the path, and the quantile of its reach.
const END: usize = 8;
const REACH: f64 = 0.95;

/// Begin and end are dated from the taxels of the first and the last time of this length, in s, and moved by no more than
/// this, in s.
const EDGE_S: f64 = 0.2;
const DATED_MOST_S: f64 = 1.0;

/// How long after its begin a contact is dated again, in s: until the body is as deep as it will be.
const RISE_S: f64 = 1.0;

/// A stroke has the word of a direction within 35 degrees.
const WORD_COSINE: f64 = 0.819_152_044_288_991_8;

/// The mean of the frames of a block.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    begin: f64,
    frames: f64,
    /// Sums over the frames: the load, and centres times load.
    load: f64,
    point: DVec3,
    map: DVec2,
}

/// What is the same for all contacts of a patch: the smallest length of a stroke, in m, and the number of taxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatchLimits {
    pub(super) stroke: f64,
    pub(super) taxels: usize,
}

/// How a contact has moved.
#[derive(Debug, Clone, Copy, Default)]
struct Motion {
    from: EventPlace,
    to: EventPlace,
    net: f64,
    reach: f64,
}

/// A contact, over one or several tracks.
#[derive(Debug, Clone)]
pub(super) struct Followed {
    pub(super) number: u64,
    /// The track that it is now; `None` after its end, until nothing can continue it.
    pub(super) track: Option<u64>,
    pub(super) patch: PatchId,
    pub(super) link: LinkId,
    pub(super) onset: f64,
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
    block_s: f64,
    blocks: Vec<Block>,
    motion: Motion,
    anchor: Option<DVec3>,
    last_step: DVec3,
    path: f64,
    turns: usize,
    /// When it began and ended, dated.
    begin: f64,
    end: f64,
    /// The taxels of its first time, with the peak then, and those of this time and the one before.
    first: Stretch,
    last_stretches: [Stretch; 2],
    force_sum: f64,
    force_peak: f64,
    force_peak_time: f64,
    impulse: f64,
    area: f64,
    taxels: Vec<VertexId>,
    peak: f64,
    peak_taxel: VertexId,
    scratch: Vec<f64>,
}

impl Followed {
    /// A contact that begins; it has room for this many taxels.
    pub(super) fn new(
        number: u64,
        time: f64,
        region: &ContactRegion,
        PatchLimits { stroke, taxels }: PatchLimits,
    ) -> Self {
        let stretch = || Stretch { taxels: Vec::with_capacity(taxels), ..Stretch::default() };
        Self {
            number,
            track: Some(region.track),
            patch: region.patch,
            link: region.link,
            onset: time,
            last: time,
            centre: region.centre,
            normal: region.normal,
            force: region.force,
            word: None,
            stroke,
            frames: 0,
            block_s: BLOCK_S,
            blocks: Vec::with_capacity(BLOCKS + 1),
            motion: Motion::default(),
            anchor: None,
            last_step: DVec3::ZERO,
            path: 0.0,
            turns: 0,
            begin: time,
            end: time,
            first: stretch(),
            last_stretches: [stretch(), stretch()],
            force_sum: 0.0,
            force_peak: f64::NAN,
            force_peak_time: time,
            impulse: 0.0,
            area: 0.0,
            taxels: Vec::with_capacity(taxels),
            peak: f64::NEG_INFINITY,
            peak_taxel: region.peak_taxel,
            scratch: Vec::with_capacity(BLOCKS + 1),
        }
    }

    /// Takes the contact in a frame.
    pub(super) fn see(&mut self, time: f64, region: &ContactRegion) {
        if self.frames > 0 {
            self.impulse += 0.5 * (time - self.last) * (self.force + region.force);
        }
        (self.patch, self.last, self.centre) = (region.patch, time, region.centre);
        (self.normal, self.force) = (region.normal, region.force);
        self.frames += 1;
        self.force_sum += region.force;
        if self.force_peak.is_nan() || region.force > self.force_peak {
            (self.force_peak, self.force_peak_time) = (region.force, time);
        }
        self.area = self.area.max(region.area);
        if region.peak > self.peak {
            (self.peak, self.peak_taxel) = (region.peak, region.peak_taxel);
            self.taxels.clear();
            self.taxels.extend_from_slice(&region.taxels);
        }
        self.keep_edges(time, region);
        self.add_to_block(time, region);
    }

    fn add_to_block(&mut self, time: f64, region: &ContactRegion) {
        let load = region.peak.max(f64::MIN_POSITIVE);
        let is_new = self.blocks.last().is_none_or(|block| time - block.begin >= self.block_s - 1e-9);
        if is_new {
            if !self.blocks.is_empty() {
                self.complete_block();
            }
            self.blocks.push(Block { begin: time, ..Block::default() });
        }
        if let Some(block) = self.blocks.last_mut() {
            block.frames += 1.0;
            block.load += load;
            block.point += load * region.centre;
            block.map += load * region.map;
        }
    }

    /// Updates path and motion with the last block, and joins blocks if there are too many.
    fn complete_block(&mut self) {
        let largest = self.blocks.iter().map(Block::mean).fold(0.0, f64::max);
        if let Some(block) = self.blocks.last().filter(|block| block.mean() >= LOADED * largest) {
            let at = block.place().point;
            match self.anchor {
                None => self.anchor = Some(at),
                Some(anchor) if at.distance(anchor) >= STEP => {
                    let step = at - anchor;
                    self.path += step.length();
                    let cosine = step.normalize_or_zero().dot(self.last_step);
                    self.turns += usize::from(cosine < TURN_COSINE);
                    (self.last_step, self.anchor) = (step.normalize_or_zero(), Some(at));
                }
                Some(_) => {}
            }
        }
        self.measure(largest);
        if self.blocks.len() >= BLOCKS {
            for k in 0..BLOCKS / 2 {
                let (a, b) = (self.blocks[2 * k], self.blocks[2 * k + 1]);
                self.blocks[k] = Block {
                    begin: a.begin,
                    frames: a.frames + b.frames,
                    load: a.load + b.load,
                    point: a.point + b.point,
                    map: a.map + b.map,
                };
            }
            self.blocks.truncate(BLOCKS / 2);
            self.block_s *= 2.0;
        }
    }

    /// Measures the motion over all blocks.
    fn measure(&mut self, largest: f64) {
        let Self { blocks, scratch, .. } = self;
        let loaded = || blocks.iter().filter(|block| block.mean() >= LOADED * largest).map(Block::place);
        let count = loaded().count();
        if count == 0 {
            return;
        }
        let end = (count / END).max(1);
        let mut median = |skip: usize, take: usize, of: &dyn Fn(EventPlace) -> f64| {
            scratch.clear();
            scratch.extend(loaded().skip(skip).take(take).map(of));
            median_of(scratch).unwrap_or(0.0)
        };
        let mut place = |skip: usize, take: usize| EventPlace {
            point: DVec3::new(
                median(skip, take, &|p| p.point.x),
                median(skip, take, &|p| p.point.y),
                median(skip, take, &|p| p.point.z),
            ),
            map: DVec2::new(median(skip, take, &|p| p.map.x), median(skip, take, &|p| p.map.y)),
        };
        let (from, to, middle) = (place(0, end), place(count - end, end), place(0, count));
        scratch.clear();
        scratch.extend(loaded().map(|p| p.point.distance(middle.point)));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
        let at = (REACH * (count - 1) as f64) as usize;
        let reach = *scratch.select_nth_unstable_by(at, f64::total_cmp).1;
        self.motion = Motion { from, to, net: from.point.distance(to.point), reach };
    }

    /// Whether it lasts long enough to be reported.
    pub(super) fn is_lasting(&self, options: &EventOptions) -> bool {
        self.frames >= 2 && self.last - self.onset >= options.least_s - 1e-9
    }

    /// Keeps the taxels of its first and its latest time.
    fn keep_edges(&mut self, time: f64, region: &ContactRegion) {
        if self.frames == 1 {
            self.first.begin = time;
            self.last_stretches[1].begin = time;
        }
        if time - self.first.begin <= EDGE_S {
            self.first.add(region);
        }
        let [before, now] = &mut self.last_stretches;
        if time - now.begin > 0.5 * EDGE_S {
            std::mem::swap(before, now);
            now.taxels.clear();
            (now.begin, now.peak) = (time, 0.0);
        }
        now.add(region);
        self.end = time;
    }

    /// Dates its begin, while that may change.
    pub(super) fn date_begin(&mut self, history: &mut History) {
        if self.last - self.onset <= RISE_S {
            let Stretch { patch, taxels, .. } = &self.first;
            let span = [self.onset, self.last];
            let found =
                history.date(Edge::Begin, *patch, taxels, span, self.last - self.onset).unwrap_or(self.onset);
            self.begin = found.clamp(self.onset - DATED_MOST_S, self.onset);
        }
    }

    /// Dates its end.
    pub(super) fn date_end(&mut self, history: &mut History) {
        let [before, now] = &self.last_stretches;
        let Stretch { begin, patch, taxels, .. } = if before.taxels.is_empty() { now } else { before };
        let found = history
            .date(Edge::End, *patch, taxels, [*begin, self.last], self.last - self.onset)
            .unwrap_or(self.last);
        self.end = found.clamp(self.last, self.last + DATED_MOST_S);
    }

    /// When it began, dated back to the noise.
    pub(super) fn begin(&self) -> f64 {
        self.begin
    }

    /// When it ended, dated likewise.
    pub(super) fn end(&self) -> f64 {
        self.end
    }

    /// The word by now: its duration so far is that until its last frame, or until its end.
    pub(super) fn word_now(&self, options: &EventOptions, has_ended: bool) -> Word {
        let Motion { net, reach, .. } = self.motion;
        let begin = self.begin();
        let duration = if has_ended { self.end() - begin } else { self.last - begin };
        if net > self.stroke || reach > self.stroke {
            let is_rub = self.path > options.rub_ratio * net && self.turns >= options.rub_turns;
            return if is_rub { Word::Rub } else { Word::Stroke };
        }
        let is_hit = options.hit_n.is_some_and(|force| self.force_peak > force)
            && self.force_peak_time - begin < options.hit_s;
        match (has_ended, is_hit) {
            (true, true) => Word::Hit,
            _ if duration >= options.hold_s => Word::Hold,
            (false, _) => Word::Touch,
            (true, false) if duration < options.tap_s => Word::Tap,
            (true, false) => Word::Press,
        }
    }

    /// Completes the path.
    pub(super) fn close(&mut self) {
        self.complete_block();
    }

    /// What is known of it.
    pub(super) fn contact(&self, word: Word, options: &EventOptions) -> EventContact {
        let Motion { from, to, .. } = self.motion;
        let way = (to.point - from.point).normalize_or_zero();
        let is_moving = matches!(word, Word::Stroke | Word::Rub);
        let cosine = |direction: DVec3| direction.normalize_or_zero().dot(way);
        let words = options.words.iter().enumerate().filter(|(_, word)| word.link == self.link);
        // Of equal ones the first.
        let nearest = words.map(|(k, word)| (k, cosine(word.direction)));
        let nearest = nearest.fold(None, |best: Option<(usize, f64)>, now| match best {
            Some(best) if best.1 >= now.1 => Some(best),
            _ => Some(now),
        });
        EventContact {
            patch: self.patch,
            link: self.link,
            force_peak: self.force_peak,
            force_mean: self.force_sum / self.frames as f64,
            impulse: self.impulse,
            area: self.area,
            from,
            to,
            length: self.path.max(self.motion.net),
            direction: is_moving.then(|| {
                let way = to.map - from.map;
                way.y.atan2(way.x)
            }),
            body_word: nearest.filter(|(_, cos)| word == Word::Stroke && *cos > WORD_COSINE).map(|(k, _)| k),
            taxels: self.taxels.clone(),
            peak_taxel: self.peak_taxel,
        }
    }

    pub(super) fn event(&self, word: Word, phase: Phase, time: f64, options: &EventOptions) -> Event {
        let begin = self.begin();
        let until = if phase == Phase::End { self.end() } else { self.last };
        Event {
            word,
            phase,
            contacts: vec![self.number],
            time,
            begin,
            duration: until - begin,
            contact: Some(self.contact(word, options)),
        }
    }
}

impl Block {
    fn mean(&self) -> f64 {
        self.load / self.frames.max(1.0)
    }

    fn place(&self) -> EventPlace {
        EventPlace { point: self.point / self.load, map: self.map / self.load }
    }
}
