//! Faults of real logs, applied to a clean one: a late clock, wrong ids, wrong positions, a wrong radius, joints with offsets and play.
//!
//! Each fault draws from a stream of its own, so that
//! one more fault changes nothing that the others do.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::numeric::Random;
use crate::skin::TaxelId;
use crate::touches::TouchesError;
use crate::touches::delay::at_other_times;
use crate::touches::elbow_arm::{arm_joint_values, pose_of};
use crate::touches::log::{TouchBody, TouchFrame, TouchLog};

/// What is wrong with a log. The default is nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LogFaults {
    /// How late the clock of the readings is, in s: each frame has the readings of this much earlier. Negative: it is early.
    pub late: f64,
    /// Share of the touches whose ids are those of other taxels, by a permutation that each touch draws.
    pub wrong_ids: f64,
    /// Share of the touches at a wrong position: that of the link is off by a normal number of 12 mm along each axis, the same
    /// in all frames of the touch.
    pub wrong_places: f64,
    /// By how much the stated radius of the sphere is off, over the radius.
    pub radius_off: f64,
    /// Standard deviation of constant offsets of the joints of the simulated arm, in rad: what the log believes is off by one normal number
    /// for each joint.
    pub joint_offsets: f64,
    /// Play of these joints, in rad: what the log believes is half of it behind in the direction in which the joint turns.
    pub play: f64,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// A log with faults, and where they are.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FaultyLog {
    /// The log.
    pub log: TouchLog,
    /// The touches with wrong ids.
    pub wrong_ids: BTreeSet<u64>,
    /// The touches at wrong positions.
    pub wrong_places: BTreeSet<u64>,
    /// The offsets of the joints, in rad: what the log believes less what is true.
    pub joint_offsets: [f64; 6],
}

/// The standard deviation of a wrong position, per axis, in m.
const WRONG_PLACE: f64 = 12e-3;

/// Streams of random numbers, after those of the arm.
mod stream {
    pub(crate) const IDS: u64 = 4;
    pub(crate) const PLACES: u64 = 5;
    pub(crate) const JOINTS: u64 = 6;
}

impl LogFaults {
    /// Applies the faults to a log.
    ///
    /// With a late clock, poses are interpolated between the frames of a touch; its frames whose readings would be at
    /// a pose before the first or after the last one are left out. So the noise of the arm is smaller by up to a factor
    /// of 1.4 where a pose is between two frames.
    ///
    /// ```
    /// use dermatome::touches::{ArmOptions, LogFaults, simulate_arm};
    ///
    /// let clean = simulate_arm(&ArmOptions { taxels: 50, ..ArmOptions::default() })?.log;
    /// let faulty = LogFaults { wrong_ids: 0.2, seed: 1, ..LogFaults::default() }.apply(&clean)?;
    /// let changed = clean.frames.iter().zip(&faulty.log.frames).filter(|(a, b)| a != b);
    /// assert!(changed.into_iter().all(|(_, frame)| faulty.wrong_ids.contains(&frame.touch)));
    /// # Ok::<(), dermatome::touches::TouchesError>(())
    /// ```
    ///
    /// # Errors
    /// If a number is out of its range: 1 s, a share from 0 to 1, a radius from half to twice the true one, 0.1 rad; if joints are off and the
    /// simulated arm does not reach a pose; if the clock is late and a frame has no time, or no touch is as long as the clock is late.
    pub fn apply(&self, log: &TouchLog) -> Result<FaultyLog, TouchesError> {
        self.validate()?;
        let mut log = log.clone();
        let mut ids = Random::new(self.seed, stream::IDS);
        let wrong_ids = some_touches(&log, self.wrong_ids, &mut ids);
        exchange_ids(&mut log, &wrong_ids, &mut ids);
        let mut places = Random::new(self.seed, stream::PLACES);
        let wrong_places = some_touches(&log, self.wrong_places, &mut places);
        move_places(&mut log, &wrong_places, &mut places);
        if self.radius_off != 0.0 {
            for frame in &mut log.frames {
                if let TouchBody::Sphere { radius, .. } = &mut frame.body {
                    *radius *= 1.0 + self.radius_off;
                }
            }
        }
        let mut joints = Random::new(self.seed, stream::JOINTS);
        let joint_offsets = std::array::from_fn(|_| self.joint_offsets * joints.normal());
        if self.joint_offsets != 0.0 || self.play != 0.0 {
            move_joints(&mut log, &joint_offsets, self.play)?;
        }
        if self.late != 0.0 {
            log.frames = late_frames(&log.frames, self.late)?;
        }
        Ok(FaultyLog { log, wrong_ids, wrong_places, joint_offsets })
    }

    fn validate(&self) -> Result<(), TouchesError> {
        for (option, range, found) in [
            ("the delay of the readings in s", [-1.0, 1.0], self.late),
            ("the share of touches with wrong ids", [0.0, 1.0], self.wrong_ids),
            ("the share of touches at wrong positions", [0.0, 1.0], self.wrong_places),
            ("the error of the radius, over the radius,", [-0.5, 1.0], self.radius_off),
            ("the offsets of joints in rad", [0.0, 0.1], self.joint_offsets),
            ("the play of joints in rad", [0.0, 0.1], self.play),
        ] {
            if !(range[0]..=range[1]).contains(&found) {
                return Err(TouchesError::BadOption { option, found, range });
            }
        }
        Ok(())
    }
}

/// A share of the touches of a log, rounded to whole touches.
fn some_touches(log: &TouchLog, share: f64, random: &mut Random) -> BTreeSet<u64> {
    let mut touches: Vec<u64> = log.frames.iter().map(|frame| frame.touch).collect();
    touches.dedup();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let count = (share * touches.len() as f64).round() as usize;
    shuffle(&mut touches, random);
    touches.into_iter().take(count).collect()
}

/// Fisher and Yates's shuffle.
fn shuffle<T>(all: &mut [T], random: &mut Random) {
    for last in (1..all.len()).rev() {
        all.swap(last, random.below(last + 1));
    }
}

fn exchange_ids(log: &mut TouchLog, touches: &BTreeSet<u64>, random: &mut Random) {
    let ids: BTreeSet<TaxelId> =
        log.frames.iter().flat_map(|frame| frame.felt.iter().map(|felt| felt.0)).collect();
    let ids: Vec<TaxelId> = ids.into_iter().collect();
    for touch in log.frames.chunk_by_mut(|a, b| a.touch == b.touch) {
        if !touches.contains(&touch[0].touch) {
            continue;
        }
        let mut others = ids.clone();
        shuffle(&mut others, random);
        let other: BTreeMap<TaxelId, TaxelId> = ids.iter().copied().zip(others).collect();
        for frame in touch {
            frame.felt.iter_mut().for_each(|(id, _)| *id = other.get(id).copied().unwrap_or(*id));
            frame.felt.sort_by_key(|felt| felt.0);
        }
    }
}

fn move_places(log: &mut TouchLog, touches: &BTreeSet<u64>, random: &mut Random) {
    for touch in log.frames.chunk_by_mut(|a, b| a.touch == b.touch) {
        if touches.contains(&touch[0].touch) {
            let off: DVec3 = random.vector(WRONG_PLACE);
            touch.iter_mut().for_each(|frame| frame.link.position += off);
        }
    }
}

/// How many frames before and after one say in which direction its joints turn.
const AROUND: usize = 5;

/// Moves the poses of the link to where the simulated arm believes it, with offsets and play of its joints.
fn move_joints(log: &mut TouchLog, offsets: &[f64; 6], play: f64) -> Result<(), TouchesError> {
    let values = arm_joint_values(log)?;
    let mut first = 0;
    for touch in log.frames.chunk_by_mut(|a, b| a.touch == b.touch) {
        let (own, last) = (&values[first..][..touch.len()], touch.len() - 1);
        for (k, frame) in touch.iter_mut().enumerate() {
            let [before, after] = [k.saturating_sub(AROUND), (k + AROUND).min(last)];
            let believed = std::array::from_fn(|joint| {
                let turned = own[after][joint] - own[before][joint];
                let behind = if turned == 0.0 { 0.0 } else { 0.5 * play * turned.signum() };
                own[k][joint] + offsets[joint] - behind
            });
            frame.link = pose_of(&believed);
        }
        first += touch.len();
    }
    Ok(())
}

/// The frames of a log whose readings are late: the readings of each frame next to the pose of the link that much later.
fn late_frames(frames: &[TouchFrame], late: f64) -> Result<Vec<TouchFrame>, TouchesError> {
    let mut all = at_other_times(frames, late)?;
    if all.is_empty() {
        let times = frames.chunk_by(|a, b| a.touch == b.touch).filter_map(|touch| {
            let [first, last] = [touch.first()?, touch.last()?].map(|frame| frame.time);
            Some(last? - first?)
        });
        let (option, longest) = ("the delay of the readings in s", times.fold(0.0, f64::max));
        return Err(TouchesError::BadOption { option, found: late, range: [-longest, longest] });
    }
    for (row, frame) in all.iter_mut().enumerate() {
        frame.row = row;
        frame.time = frame.time.map(|time| time + late);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::touches::{ArmOptions, simulate_arm};

    fn clean() -> TouchLog {
        let options = ArmOptions { taxels: 40, arm_noise: 1e-3, seed: 5, ..ArmOptions::default() };
        simulate_arm(&options).unwrap().log
    }

    fn numbers(log: &TouchLog) -> BTreeSet<u64> {
        log.frames.iter().map(|frame| frame.touch).collect()
    }

    fn readings(frame: &TouchFrame) -> Vec<f64> {
        let mut readings: Vec<f64> = frame.felt.iter().map(|felt| felt.1).collect();
        readings.sort_by(f64::total_cmp);
        readings
    }

    #[test]
    fn no_fault_changes_nothing() {
        let log = clean();
        let found = LogFaults { seed: 3, ..LogFaults::default() }.apply(&log).unwrap();
        assert_eq!(found, FaultyLog { log, ..FaultyLog::default() });
    }

    /// Wrong ids change ids in their touches alone, one for one, and no reading.
    #[test]
    fn wrong_ids_are_those_of_other_taxels() {
        let log = clean();
        let found = LogFaults { wrong_ids: 0.25, seed: 3, ..LogFaults::default() }.apply(&log).unwrap();
        let (wrong, all) = (found.wrong_ids.len() as f64, numbers(&log).len() as f64);
        assert!((wrong - 0.25 * all).abs() <= 0.5, "{wrong} of {all} touches");
        assert!(found.wrong_places.is_empty());
        let mut changed = BTreeSet::new();
        for (before, after) in log.frames.iter().zip(&found.log.frames) {
            assert_eq!(readings(before), readings(after));
            if before.felt != after.felt {
                changed.insert(before.touch);
            }
            assert_eq!(TouchFrame { felt: before.felt.clone(), ..after.clone() }, *before);
        }
        assert_eq!(changed, found.wrong_ids);
        found.log.validate().unwrap();
    }

    /// Wrong positions move the link by one vector in all frames of their touches.
    #[test]
    fn wrong_places_move_whole_touches() {
        let log = clean();
        let found = LogFaults { wrong_places: 0.5, seed: 3, ..LogFaults::default() }.apply(&log).unwrap();
        let mut moved: BTreeMap<u64, DVec3> = BTreeMap::new();
        for (before, after) in log.frames.iter().zip(&found.log.frames) {
            let off = after.link.position - before.link.position;
            let first = *moved.entry(before.touch).or_insert(off);
            assert!(first.distance(off) < 1e-12, "one vector for the touch {}", before.touch);
            assert_eq!(TouchFrame { link: before.link, ..after.clone() }, *before);
            assert_eq!(before.link.rotation, after.link.rotation);
        }
        moved.retain(|_, off| *off != DVec3::ZERO);
        assert_eq!(moved.keys().copied().collect::<BTreeSet<u64>>(), found.wrong_places);
        let squares = moved.values().map(|off| off.length_squared()).sum::<f64>();
        let sigma = (squares / (3.0 * moved.len() as f64)).sqrt();
        assert!((0.006..0.024).contains(&sigma), "{sigma} m");
    }

    /// Offsets of joints turn each of them by one number in all frames; play by half of it, against the way it turns.
    #[test]
    fn joints_are_off_by_constant_offsets_and_play() {
        let log = clean();
        let before = arm_joint_values(&log).unwrap();
        let found = LogFaults { joint_offsets: 7e-3, seed: 3, ..LogFaults::default() }.apply(&log).unwrap();
        assert!(found.joint_offsets.iter().all(|offset| *offset != 0.0));
        let off = |found: &FaultyLog| {
            let after = arm_joint_values(&found.log).unwrap();
            let less = |k: usize, joint: usize| {
                let turn: f64 = after[k][joint] - before[k][joint];
                libm::remainder(turn, std::f64::consts::TAU)
            };
            (0..after.len()).map(|k| std::array::from_fn(|joint| less(k, joint))).collect::<Vec<[f64; 6]>>()
        };
        for q in off(&found) {
            assert!(q.iter().zip(found.joint_offsets).all(|(a, b)| (a - b).abs() < 1e-9), "{q:?}");
        }
        let found = LogFaults { play: 4e-3, ..LogFaults::default() }.apply(&log).unwrap();
        let turned = off(&found);
        assert!(turned.iter().flatten().all(|q| (q.abs() - 2e-3).abs() < 1e-9), "half the play");
        assert!([-1.0, 1.0].iter().all(|sign| turned.iter().flatten().any(|q| q * sign > 0.0)));
    }

    #[test]
    fn the_radius_is_off_in_every_frame() {
        let log = clean();
        let found = LogFaults { radius_off: -0.05, ..LogFaults::default() }.apply(&log).unwrap();
        for (before, after) in log.frames.iter().zip(&found.log.frames) {
            assert!((after.body.radius() - 0.95 * before.body.radius()).abs() < 1e-15);
            assert_eq!(TouchFrame { body: before.body, ..after.clone() }, *before);
        }
    }

    /// A clock that is late by whole frames has the readings of this many frames before; one that is early the other way.
    #[test]
    fn late_readings_are_those_of_earlier_frames() {
        let log = clean();
        let longest = log.frames.chunk_by(|a, b| a.touch == b.touch).max_by_key(|touch| touch.len()).unwrap();
        for late in [0.1, -0.1] {
            let found = LogFaults { late, ..LogFaults::default() }.apply(&log).unwrap();
            found.log.validate().unwrap();
            let touch: Vec<&TouchFrame> =
                found.log.frames.iter().filter(|frame| frame.touch == longest[0].touch).collect();
            assert!(touch.len() + 3 >= longest.len() && touch.len() < longest.len());
            for frame in touch {
                let time = frame.time.unwrap();
                let at = longest.iter().find(|other| (other.time.unwrap() - time).abs() < 1e-9).unwrap();
                let read =
                    longest.iter().find(|other| (other.time.unwrap() + late - time).abs() < 1e-9).unwrap();
                assert!(
                    frame.link.position.distance(at.link.position) < 1e-9,
                    "the pose is that of its time"
                );
                assert_eq!(frame.felt, read.felt);
            }
        }
    }

    /// Between two frames the pose is between theirs.
    #[test]
    fn poses_are_interpolated() {
        let log = clean();
        let found = LogFaults { late: 0.0125, ..LogFaults::default() }.apply(&log).unwrap();
        let [first, second] = [0, 1].map(|k| log.frames[k].link.position);
        assert!(found.log.frames[0].link.position.distance(0.75 * first + 0.25 * second) < 1e-9);
        assert_eq!(found.log.frames[0].felt, log.frames[0].felt);
    }

    /// A fault does not change what another one does.
    #[test]
    fn faults_are_independent() {
        let log = clean();
        let of = |faults: LogFaults| LogFaults { seed: 3, ..faults }.apply(&log).unwrap();
        let ids = LogFaults { wrong_ids: 0.2, ..LogFaults::default() };
        let both = of(LogFaults { wrong_places: 0.3, radius_off: 0.1, ..ids });
        for (one, all) in of(ids).log.frames.iter().zip(&both.log.frames) {
            assert_eq!(one.felt, all.felt);
        }
        assert_eq!(of(ids), of(ids));
        let other = LogFaults { seed: 4, ..ids }.apply(&log).unwrap();
        assert_ne!(of(ids).wrong_ids, other.wrong_ids, "another seed");
    }

    #[test]
    fn nonsense_is_refused() {
        let mut log = clean();
        let none = LogFaults::default();
        for (faults, said) in [
            (LogFaults { late: 2.0, ..none }, "the delay of the readings in s is 2; needed: -1e0 to 1e0"),
            (LogFaults { late: f64::NAN, ..none }, "the delay of the readings in s is NaN"),
            (LogFaults { wrong_ids: 1.2, ..none }, "wrong ids is 1.2; needed: 0e0 to 1e0"),
            (LogFaults { wrong_places: -0.1, ..none }, "wrong positions is -0.1"),
            (LogFaults { radius_off: -1.0, ..none }, "over the radius, is -1; needed: -5e-1 to 1e0"),
        ] {
            let error = faults.apply(&log).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
        log.frames.truncate(2);
        let error = LogFaults { late: 0.9, ..none }.apply(&log).unwrap_err().to_string();
        assert!(error.contains("needed: -5"), "the touch is one frame long: {error}");
        log.frames[1].time = None;
        let error = LogFaults { late: 0.01, ..none }.apply(&log).unwrap_err().to_string();
        assert!(error.contains("line 1: the time is not valid"), "{error}");
    }
}
