//! What is wrong with a log of touches, and what it cannot tell, before a skin is made of it.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::numeric::median;
use crate::skin::TaxelId;
use crate::skin::sentence::{count, first_few};
use crate::touches::log::{TouchBody, TouchFrame, TouchLog};
use crate::touches::{LeftOutReading, LogDelay, TouchesError, TouchesOptions, contacts_of_touches};

/// A body that stays within this of one place in the frame of the link touches one place, or its poses stand still, in m.
const STILL: f64 = 2e-3;

/// Positions that spread over more than this are not in metres, in m: a skin is smaller.
const MOST_SPREAD: f64 = 5.0;

/// Below this angle, in rad, between the orientations of the link the offset of the probe is one with the mount.
const LEAST_TURN: f64 = 0.35;

/// A taxel with fewer touches has no check.
const LEAST_TOUCHES: usize = 3;

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
/// As [`contacts_of_touches`]; an outside that nothing determines is a finding.
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
    let middle = places.iter().sum::<DVec3>() / places.len().max(1) as f64;
    let spread = places.iter().map(|place| place.distance(middle)).fold(0.0, f64::max);
    if spread > MOST_SPREAD {
        say(
            LogFindingKind::Unit,
            true,
            format!("touches are up to {spread:.0} m from their middle; give lengths in m"),
        );
    } else if touches.len() > 1 && spread < STILL {
        let message = format!(
            "all touches are within {:.2} mm of one place of the link; record the pose of the link and the position of the body in each frame",
            1e3 * spread
        );
        say(LogFindingKind::Still, true, message);
    }
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
        }
        Err(TouchesError::NoOutside { .. }) => say(
            LogFindingKind::Side,
            false,
            "without a drawing nothing says on which side of the skin the sphere is; record readings while it presses and leaves".into(),
        ),
        Err(other) => return Err(other),
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
            "{} the touch before, and would count as new evidence; number contacts in a column `contact`",
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

/// The mean position of the body in a touch, in the frame of the link.
fn place(touch: &[TouchFrame]) -> DVec3 {
    let places = touch.iter().map(|frame| frame.link.inverse().apply(frame.body.point()));
    places.sum::<DVec3>() / touch.len() as f64
}

/// The angle between the orientations of the body in the frame of the link in two frames, in rad.
fn turn(first: &TouchFrame, frame: &TouchFrame) -> f64 {
    let [a, b] = [first, frame].map(|f| f.link.rotation.conjugate() * f.body_rotation.unwrap_or_default());
    a.angle_between(b)
}

/// How many touches without a number of a contact are where the touch before was, with the same taxels.
fn repeats(touches: &[&[TouchFrame]], places: &[DVec3]) -> usize {
    let ids = |touch: &[TouchFrame]| -> BTreeSet<TaxelId> {
        touch.iter().flat_map(|frame| &frame.felt).map(|felt| felt.0).collect()
    };
    let is_repeat = |k: &usize| {
        let [before, touch] = [touches[k - 1], touches[*k]];
        touch[0].contact.is_none() && places[*k].distance(places[k - 1]) < REPEAT && ids(before) == ids(touch)
    };
    (1..touches.len()).filter(is_repeat).count()
}
