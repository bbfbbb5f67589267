//! How late the clock of the readings is, and a log with poses at the times of its readings. `border` estimates it.

use std::borrow::Cow;

use crate::calib::Pose;
use crate::touches::TouchesError;
use crate::touches::log::{TouchBody, TouchFrame, TouchLog};

/// How late the clock of the readings is, next to that of the poses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LogDelay {
    /// As the touches say, in s; below 0 the readings are early.
    pub seconds: f64,
    /// Its standard deviation, in s.
    pub sigma: f64,
    /// What was taken off before the contacts were found, in s.
    pub removed: f64,
}

impl LogDelay {
    /// Whether the touches say that there is one.
    pub fn is_significant(&self) -> bool {
        self.seconds.abs() > LEAST_SIGMAS * self.sigma
    }

    /// Whether what is left of a delay, of which `removed` is taken off, is to be taken off as well.
    pub(super) fn is_worth_removing(&self, removed: f64) -> bool {
        if removed == 0.0 { self.is_significant() } else { self.seconds.abs() > SMALL_SHARE * self.sigma }
    }

    /// The whole delay, of which this is what is left.
    pub(super) fn after(self, removed: f64) -> Self {
        Self { seconds: removed + self.seconds, sigma: self.sigma, removed }
    }
}

/// Most fits of a late log, and the share of its standard deviation below which what is left of a delay stays: each fit leaves a
/// fifth of the delay or less.
pub(super) const DELAY_ROUNDS: usize = 3;
const SMALL_SHARE: f64 = 0.3;

/// A delay is one beyond so many standard deviations.
const LEAST_SIGMAS: f64 = 5.0;

/// Longest delay, in s.
pub(super) const MOST_DELAY: f64 = 1.0;

/// A log whose readings are late by `delay`, with the poses of the time at which they were read. Frames whose pose would be
/// before the first or after the last of their touch are left out; a touch of one frame stays.
///
/// # Errors
/// If a frame has no time.
pub(super) fn without_delay(log: &TouchLog, delay: f64) -> Result<Cow<'_, TouchLog>, TouchesError> {
    if delay == 0.0 {
        return Ok(Cow::Borrowed(log));
    }
    let mut frames = Vec::with_capacity(log.frames.len());
    for touch in log.frames.chunk_by(|a, b| a.touch == b.touch) {
        match touch {
            [alone] => frames.push(alone.clone()),
            touch => frames.extend(at_other_times(touch, -delay)?),
        }
    }
    Ok(Cow::Owned(TouchLog { frames, has_readings: log.has_readings, joints: log.joints.clone() }))
}

/// Frames with the poses of a time so much later, interpolated within their touch. Those before the first pose of a touch and
/// after the last are left out.
pub(super) fn at_other_times(frames: &[TouchFrame], later: f64) -> Result<Vec<TouchFrame>, TouchesError> {
    let mut all = Vec::new();
    for touch in frames.chunk_by(|a, b| a.touch == b.touch) {
        let time = |frame: &TouchFrame| {
            let (what, needed) = ("the time", "a time in each row, for a late clock");
            frame.time.ok_or(TouchesError::InvalidFrame { row: frame.row, what, needed })
        };
        let times = touch.iter().map(time).collect::<Result<Vec<f64>, _>>()?;
        let moved = touch.iter().zip(&times).filter_map(|(frame, time)| {
            let (before, after, share) = around(&times, time + later)?;
            Some(between(frame, &touch[before], &touch[after], share))
        });
        all.extend(moved);
    }
    Ok(all)
}

/// The frames before and after a time, and how far it is from the one to the other.
fn around(times: &[f64], time: f64) -> Option<(usize, usize, f64)> {
    let after = times.partition_point(|other| *other < time);
    let until = *times.get(after)?;
    if until == time {
        return Some((after, after, 0.0));
    }
    let before = after.checked_sub(1)?;
    Some((before, after, (time - times[before]) / (until - times[before])))
}

/// A frame with the poses between those of two others.
fn between(frame: &TouchFrame, before: &TouchFrame, after: &TouchFrame, share: f64) -> TouchFrame {
    let link = Pose {
        position: before.link.position.lerp(after.link.position, share),
        rotation: before.link.rotation.slerp(after.link.rotation, share).normalize(),
    };
    let body = match (before.body, after.body) {
        (TouchBody::Sphere { centre, .. }, TouchBody::Sphere { centre: next, .. }) => {
            TouchBody::Sphere { centre: centre.lerp(next, share), radius: frame.body.radius() }
        }
        (TouchBody::Plane { point, normal }, TouchBody::Plane { point: next, normal: turned }) => {
            let normal = normal.lerp(turned, share).try_normalize().unwrap_or(normal);
            TouchBody::Plane { point: point.lerp(next, share), normal }
        }
        _ => frame.body,
    };
    let rotations = before.body_rotation.zip(after.body_rotation);
    let body_rotation = rotations.map(|(a, b)| a.slerp(b, share).normalize()).or(frame.body_rotation);
    let columns = before.by_joints.iter().zip(&after.by_joints);
    let by_joints = columns.map(|(a, b)| a.lerp(*b, share)).collect();
    TouchFrame { link, body, body_rotation, by_joints, ..frame.clone() }
}
