//! Events: contacts joined over time, and words for what they do that are true by definition, in physical units.
//!
//! | word | definition, with the limits of [`EventOptions::default`] |
//! |---|---|
//! | `touch` | a contact that has begun; what it will be is not known yet |
//! | `tap` | a contact of less than 0.3 s that stays in its place: net and reach of at most 12 mm |
//! | `press` | the same, 0.3 to 2 s |
//! | `hold` | the same, from 2 s on |
//! | `stroke` | net or reach over 12 mm and 1.5 distances between taxels |
//! | `rub` | a stroke with a path of more than 3 times its net, and two turns or more |
//! | `hit` | the largest force reached in less than 50 ms and above a limit, which has no default |
//! | `pat` | three taps or more within 15 mm, each less than 0.6 s after the one before |
//! | `grasp` | two contacts or more on a link at once for 0.3 s, breaks that a contact outlasts aside, whose normals differ by more than 90 degrees |
//! | `gap` | times that go back, for 0 s, or frames that are missing (`clock`): contacts end before it |
//!
//! A contact here is one or several tracks of a [`ContactTracker`](crate::signal::ContactTracker): noise breaks one touch
//! into many tracks. A track that begins at most 0.15 s after another has ended, and within 15 mm of its last centre,
//! continues it; two at once are never one. Contacts of one frame, or of less than 30 ms, are dropped. Begin and end are
//! dated back to where the readings of its taxels were zero (`history`), but not to before the first frame, nor to where its first
//! peak still read nothing.
//!
//! A contact goes on over a gap ([`body`](crate::body)): the distance from a last centre on the other side is then at most 15 mm
//! more than the gap is wide. Its path is measured along the body, with the links at rest.
//!
//! Of the centres of pressure in the frame of the link, those with less than a quarter of the largest force aside, *from*
//! and *to* are the medoids of the first and the last eighth (of their places the one nearest to all others), *net* is their distance, and *reach* the length along the
//! direction in which they differ most, without the outermost 5 %. *Path* is the length of the way in steps of at least 4 mm, so that noise does not
//! lengthen it; a turn is a step more than 120 degrees away from the one before.

mod bridges;
mod contact;
mod detector;
mod groups;
mod history;
mod path;

use glam::{DVec2, DVec3};

use crate::body::BodyTaxel;
use crate::id::VertexId;
use crate::signal::SignalError;
use crate::skin::{LinkId, PatchId};

pub use detector::EventDetector;

/// Limits of the words, and of what is one contact.
#[derive(Debug, Clone, PartialEq)]
pub struct EventOptions {
    /// A contact lasts this long at least, in s; others are dropped.
    pub least_s: f64,
    /// A track continues a contact that has ended at most this long before, in s.
    pub join_s: f64,
    /// And at most this far away, in m.
    pub join_m: f64,
    /// A tap is shorter than this, in s.
    pub tap_s: f64,
    /// A press becomes a hold after this time, in s.
    pub hold_s: f64,
    /// Net or reach of a stroke are larger, in m.
    pub stroke_m: f64,
    /// And larger than this number of mean distances between taxels.
    pub stroke_spacings: f64,
    /// The path of a rub is more than this many times its net.
    pub rub_ratio: f64,
    /// Turns of a rub.
    pub rub_turns: usize,
    /// Number of taps of a pat.
    pub pat_taps: usize,
    /// A tap of a pat begins at most this long after the end of the one before, in s.
    pub pat_s: f64,
    /// And at most this far from it, in m.
    pub pat_m: f64,
    /// Contacts of a grasp are there at once for this time, in s.
    pub grasp_s: f64,
    /// The largest angle between their normals is larger, in rad.
    pub grasp_rad: f64,
    /// A hit has a larger force, in N; `None`: there are no hits.
    pub hit_n: Option<f64>,
    /// It is reached in less than this time, in s.
    pub hit_s: f64,
    /// Names of directions on links.
    pub words: Vec<BodyWord>,
}

impl Default for EventOptions {
    fn default() -> Self {
        Self {
            least_s: 0.03,
            join_s: 0.15,
            join_m: 0.015,
            tap_s: 0.3,
            hold_s: 2.0,
            stroke_m: 0.012,
            stroke_spacings: 1.5,
            rub_ratio: 3.0,
            rub_turns: 2,
            pat_taps: 3,
            pat_s: 0.6,
            pat_m: 0.015,
            grasp_s: 0.3,
            grasp_rad: 90_f64.to_radians(),
            hit_n: None,
            hit_s: 0.05,
            words: Vec::new(),
        }
    }
}

/// A name of a direction on a link: a stroke within 35 degrees of it has this word.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyWord {
    /// The link.
    pub link: LinkId,
    /// The direction in its frame; of any length but 0.
    pub direction: DVec3,
    /// The word.
    pub word: String,
}

impl EventOptions {
    /// Checks every number, and that limits do not contradict each other.
    fn validate(&self) -> Result<(), SignalError> {
        let bad = |option: &str, found: f64, needed: &str| {
            Err(SignalError::option(format!("{option} of events"), found, needed))
        };
        for (option, number) in [
            ("the shortest contact in s", self.least_s),
            ("the time that tracks are joined over in s", self.join_s),
            ("the distance that tracks are joined over in m", self.join_m),
            ("the distances between taxels of a stroke", self.stroke_spacings),
            ("the time between taps of a pat in s", self.pat_s),
            ("the time of a grasp in s", self.grasp_s),
        ] {
            if !(number.is_finite() && number >= 0.0) {
                return bad(option, number, "0 or a positive number");
            }
        }
        for (option, number) in [
            ("the length of a stroke in m", self.stroke_m),
            ("the path over the net of a rub", self.rub_ratio),
            ("the distance between taps of a pat in m", self.pat_m),
            ("the time in which a hit reaches its force in s", self.hit_s),
            ("the force of a hit in N", self.hit_n.unwrap_or(1.0)),
        ] {
            if !(number.is_finite() && number > 0.0) {
                return bad(option, number, "a positive number");
            }
        }
        if !(self.tap_s.is_finite() && self.tap_s > self.least_s) {
            return bad("the time of a tap in s", self.tap_s, "a number above that of the shortest contact");
        }
        if !(self.hold_s.is_finite() && self.hold_s > self.tap_s) {
            return bad("the time of a hold in s", self.hold_s, "a number above that of a tap");
        }
        if self.pat_taps < 2 {
            return bad("the number of taps of a pat", self.pat_taps as f64, "2 or more");
        }
        if self.pat_s <= self.join_s {
            let needed = "a number above the time that tracks are joined over";
            return bad("the time between taps of a pat in s", self.pat_s, needed);
        }
        if !(0.0..std::f64::consts::PI).contains(&self.grasp_rad) {
            return bad("the angle of a grasp in rad", self.grasp_rad, "0 to less than pi");
        }
        for word in &self.words {
            if word.direction.try_normalize().is_none() {
                return bad("the length of a direction", word.direction.length(), "a positive number");
            }
        }
        Ok(())
    }
}

/// What happens, by definition; see the table of the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[expect(missing_docs, reason = "the table of the module defines them")]
pub enum Word {
    Touch,
    Tap,
    Press,
    Hold,
    Stroke,
    Rub,
    Hit,
    Pat,
    Grasp,
    Gap,
}

/// When an event is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum Phase {
    /// It has begun.
    Begin,
    /// It goes on, and the word is another.
    Change,
    /// It has ended, and the word is final.
    End,
}

/// A place on the skin.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EventPlace {
    /// The patch.
    pub patch: PatchId,
    /// In the frame of the link of the patch, in m.
    pub point: DVec3,
    /// On the map of the patch, in m.
    pub map: DVec2,
}

/// Something that happens on the skin, as far as it is known at its time.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// What it is.
    pub word: Word,
    /// Whether it begins, changes or ends.
    pub phase: Phase,
    /// Numbers of its contacts, ascending, from 0 on: one, all of a pat or a grasp, none of a gap.
    pub contacts: Vec<u64>,
    /// Time of the frame in which it is known, in s.
    pub time: f64,
    /// When it began, in s, dated back.
    pub begin: f64,
    /// How long it has lasted, in s; dated at both ends when it has ended.
    pub duration: f64,
    /// Where, and how strong; `None` of a gap.
    pub contact: Option<EventContact>,
}

/// Where a contact is, how strong, and how it moves; of a pat or a grasp its last or its strongest contact.
#[derive(Debug, Clone, PartialEq)]
pub struct EventContact {
    /// The patch of its taxels; its ends may be on others.
    pub patch: PatchId,
    /// All patches that it was on, ascending.
    pub patches: Vec<PatchId>,
    /// Its link.
    pub link: LinkId,
    /// The largest force and the mean over the frames, in N; of a grasp of all its contacts together. NaN if the unit of
    /// the channel is neither one of force nor of pressure.
    pub force_peak: f64,
    /// See there.
    pub force_mean: f64,
    /// The integral of the force, in N s.
    pub impulse: f64,
    /// The largest area, in m^2.
    pub area: f64,
    /// Where it began.
    pub from: EventPlace,
    /// Where it is, or ended.
    pub to: EventPlace,
    /// Length of the path, in m.
    pub length: f64,
    /// Angle of the way from begin to end on the map, in rad; of strokes and rubs whose ends are on one patch.
    pub direction: Option<f64>,
    /// The name of the direction, as a number in [`EventOptions::words`]; of strokes.
    pub body_word: Option<usize>,
    /// The taxels on its patch when it was largest, ascending.
    pub taxels: Vec<VertexId>,
    /// Those on other patches then, ascending.
    pub beyond: Vec<BodyTaxel>,
    /// The one with the largest reading then.
    pub peak_taxel: VertexId,
}
