//! What is wrong with a log of touches, and what it cannot tell, before a skin is made of it.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::numeric::median;
use crate::skin::TaxelId;
use crate::skin::sentence::{count, first_few};
use crate::touches::log::{TouchBody, TouchFrame, TouchLog};
use crate::touches::unfit::{LEAST_TOUCHES, STILL, check_lengths, place, spread_of};
use crate::touches::{LeftOutReading, LogDelay, TouchesError, TouchesOptions, contacts_of_touches};

/// Below this angle, in rad, between the orientations of the link the offset of the probe is one with the mount.
const LEAST_TURN: f64 = 0.35;

/// Frames farther apart than so many usual steps within a touch have others missing between them.
const MOST_STEPS: f64 = 3.5;

/// Touches with the same taxels within this distance repeat a contact, in m.
const REPEAT: f64 = 0.5e-3;

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
pub enum LogFindingKind {
    /// The body stays at one place of the link.
    Still,
    /// Lengths are not in m.
    Unit,
    /// It is not known on which side of the skin the sphere is.
    Side,
    /// There are no times, frames are missing, or the readings are late.
    Clock,
    /// There is no radius of the body.
    Radius,
    /// There are no readings.
    Readings,
    /// The link does not turn about the body.
    Turns,
    /// Taxels have few touches.
    Coverage,
    /// Touches repeat a contact, and do not say so.
    Repeats,
    /// Readings are not what their taxel gives.
    Spikes,
    /// Readings have no active neighbour.
    Lone,
}

/// A finding about a log.
#[derive(Debug, Clone, PartialEq)]
pub struct LogFinding {
    /// What was found.
    pub kind: LogFindingKind,
    /// Whether no skin follows from the log.
    pub is_error: bool,
    /// The finding in a sentence, with what to record instead.
    pub message: String,
}

/// What a log has.
#[derive(Debug, Clone, PartialEq)]
pub struct LogReport {
    /// Number of frames, of touches and of taxels.
    pub counts: [usize; 3],
    /// Median number of touches of a taxel.
    pub touches_per_taxel: f64,
    /// Frames per second within touches, in Hz, if the log has times.
    pub rate: Option<f64>,
    /// What was found, errors first.
    pub findings: Vec<LogFinding>,
}

/// Examines a log as [`contacts_of_touches`] would use it without a drawing.
///
/// # Errors
/// As [`contacts_of_touches`]; an outside that nothing determines, another unit, and a log that is mostly left out are findings.
pub fn examine_log(log: &TouchLog) -> Result<LogReport, TouchesError> {
    log.validate()?;
    let mut findings = Vec::new();
    let mut say = |kind, is_error, message: String| findings.push(LogFinding { kind, is_error, message });
    let touches: Vec<&[TouchFrame]> = log.frames.chunk_by(|a, b| a.touch == b.touch).collect();
    let mut taxels: BTreeMap<TaxelId, BTreeSet<u64>> = BTreeMap::new();
    for frame in &log.frames {
        frame.felt.iter().for_each(|(id, _)| {
            taxels.entry(*id).or_default().insert(frame.touch);
        });
    }
    let places: Vec<DVec3> = touches.iter().map(|touch| place(touch)).collect();
    let spread = spread_of(&places);
    let is_misread = match check_lengths(log) {
        Ok(()) => false,
        Err(error) => {
            let is_unit = matches!(error, TouchesError::Lengths { .. });
            say(if is_unit { LogFindingKind::Unit } else { LogFindingKind::Radius }, true, error.to_string());
            true
        }
    };
    let within = within_touches(&touches);
    if !is_misread && touches.len() > 1 && spread < STILL {
        let message = format!(
            "all touches are within {:.2} mm of one place of the link; record the pose of the link and the position of the body in each frame",
            1e3 * spread
        );
        say(LogFindingKind::Still, true, message);
    } else if log.has_readings && within.is_some_and(|most| most == 0.0) {
        let message = "the body does not move within any touch, though the readings do: record the pose of the link and the position of the \
                       body in each frame";
        say(LogFindingKind::Still, true, message.into());
    }
    if !is_misread {
        match contacts_of_touches(log, &TouchesOptions::default()) {
        Ok(found) => {
            let at = |spike: &LeftOutReading| format!("taxel {} in line {}", spike.taxel, spike.row);
            let spikes: Vec<String> = found.summary.spikes.iter().map(at).collect();
            if !spikes.is_empty() {
                let readings = count(spikes.len(), "reading is", "readings are");
                say(LogFindingKind::Spikes, false, format!("{readings} not what the taxel gives there: {}", first_few(&spikes)));
            }
            if let Some(late) = found.summary.delay.filter(LogDelay::is_significant).and_then(|d| d.remark()) {
                say(LogFindingKind::Clock, false, late);
            }
            if found.summary.lone > 0 {
                let readings = count(found.summary.lone, "reading is", "readings are");
                say(LogFindingKind::Lone, false, format!("{readings} without an active neighbour"));
            }
            if found.summary.lost_taxels > 0 {
                let taxels = count(found.summary.lost_taxels, "taxel gives", "taxels give");
                say(LogFindingKind::Coverage, false, format!("{taxels} no contact"));
            }
        }
        Err(error @ TouchesError::Profile { .. }) => say(LogFindingKind::Readings, true, error.to_string()),
        Err(error @ TouchesError::MostLeftOut { .. }) => say(LogFindingKind::Coverage, true, error.to_string()),
        Err(TouchesError::NoOutside { .. }) => say(
            LogFindingKind::Side,
            true,
            "without a drawing nothing says on which side of the skin the sphere is; record readings while it presses and leaves".into(),
        ),
        Err(other) => return Err(other),
    }
    }
    let steps = log.frames.windows(2).filter(|pair| pair[0].touch == pair[1].touch);
    let steps: Vec<(usize, f64)> =
        steps.filter_map(|pair| Some((pair[1].row, pair[1].time? - pair[0].time?))).collect();
    let step = median(steps.iter().map(|step| step.1)).filter(|step| *step > 0.0);
    if log.frames.iter().any(|frame| frame.time.is_none()) {
        say(
            LogFindingKind::Clock,
            false,
            "frames have no time: a late clock cannot be found; record one".into(),
        );
    } else if let Some(step) = step {
        let gaps: Vec<String> = steps
            .iter()
            .filter(|(_, dt)| *dt > MOST_STEPS * step)
            .map(|(row, _)| format!("line {row}"))
            .collect();
        if !gaps.is_empty() {
            let message = format!("frames are missing in touches before {}", first_few(&gaps));
            say(LogFindingKind::Clock, false, message);
        }
    }
    if log.frames.iter().any(|frame| matches!(frame.body, TouchBody::Sphere { radius: 0.0, .. })) {
        say(
            LogFindingKind::Radius,
            false,
            "the radius of the body is not known: contacts are where the body was; record it".into(),
        );
    }
    if !log.has_readings {
        say(
            LogFindingKind::Readings,
            false,
            "there are no readings: contacts are as exact as taxels are apart".into(),
        );
    }
    let turn = log.frames.iter().map(|frame| turn(&log.frames[0], frame)).fold(0.0, f64::max);
    if touches.len() > 1 && turn < LEAST_TURN {
        let message = format!(
            "the link turns by at most {:.0} degrees about the body: an offset of the probe is one with the mount; touch from other directions",
            turn.to_degrees()
        );
        say(LogFindingKind::Turns, false, message);
    }
    let few: Vec<TaxelId> =
        taxels.iter().filter(|(_, touches)| touches.len() < LEAST_TOUCHES).map(|(id, _)| *id).collect();
    if !few.is_empty() {
        let message = format!(
            "{} fewer than {LEAST_TOUCHES} touches: {}",
            count(few.len(), "taxel has", "taxels have"),
            first_few(&few)
        );
        say(LogFindingKind::Coverage, false, message);
    }
    let repeats = repeats(&touches, &places);
    if repeats > 0 {
        let message = format!(
            "{} an earlier touch, and would count as new evidence; number contacts in a column `contact`",
            count(repeats, "touch repeats", "touches repeat")
        );
        say(LogFindingKind::Repeats, false, message);
    }
    findings.sort_by_key(|finding| !finding.is_error);
    Ok(LogReport {
        counts: [log.frames.len(), touches.len(), taxels.len()],
        touches_per_taxel: median(taxels.values().map(|touches| touches.len() as f64)).unwrap_or(0.0),
        rate: step.map(f64::recip),
        findings,
    })
}

/// The angle between the orientations of the body in the frame of the link in two frames, in rad.
fn turn(first: &TouchFrame, frame: &TouchFrame) -> f64 {
    let [a, b] = [first, frame].map(|f| f.link.rotation.conjugate() * f.body_rotation.unwrap_or_default());
    a.angle_between(b)
}

/// How many touches without a number of a contact are where an earlier one was, with the same taxels.
fn repeats(touches: &[&[TouchFrame]], places: &[DVec3]) -> usize {
    let ids = |touch: &[TouchFrame]| -> BTreeSet<TaxelId> {
        touch.iter().flat_map(|frame| &frame.felt).map(|felt| felt.0).collect()
    };
    let mut earlier: BTreeMap<BTreeSet<TaxelId>, Vec<DVec3>> = BTreeMap::new();
    let mut repeats = 0;
    for (touch, place) in touches.iter().zip(places) {
        let same = earlier.entry(ids(touch)).or_default();
        repeats += usize::from(
            touch[0].contact.is_none() && same.iter().any(|other| other.distance(*place) < REPEAT),
        );
        same.push(*place);
    }
    repeats
}

/// The largest distance between two positions of the body that follow each other in a touch, in the frame of the link, in m; `None`
/// without a touch of several frames.
fn within_touches(touches: &[&[TouchFrame]]) -> Option<f64> {
    let at = |frame: &TouchFrame| frame.link.inverse().apply(frame.body.point());
    let steps =
        touches.iter().flat_map(|touch| touch.windows(2)).map(|pair| at(&pair[0]).distance(at(&pair[1])));
    steps.reduce(f64::max)
}
