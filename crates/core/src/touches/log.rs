//! Logs of touches: where the robot and the touching body were, and what the taxels felt, frame by frame.

use glam::{DQuat, DVec3};

use crate::calib::{Pose, TouchJoint};
use crate::mesh::is_within_reach;
use crate::skin::TaxelId;
use crate::touches::TouchesError;

/// A log of touches of one link.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TouchLog {
    /// Its frames; those of a touch follow each other.
    pub frames: Vec<TouchFrame>,
    /// Whether taxels have readings. Without, all active taxels of a frame count alike.
    pub has_readings: bool,
    /// The joints that move the body against the link, if it is known how ([`TouchFrame::by_joints`]).
    pub joints: Vec<TouchJoint>,
}

/// One frame of a log. Positions and orientations are in one frame for the link and the body, such as the world or
/// the base of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchFrame {
    /// Its row, for messages: the line of a table, or its number.
    pub row: usize,
    /// Its time in s, if it is known.
    pub time: Option<f64>,
    /// The number of the touch to which it belongs.
    pub touch: u64,
    /// The number of the contact of which the touch is one of several repeats; `None`: the touch is a contact of
    /// its own.
    pub contact: Option<u64>,
    /// The pose of the link that carries the skin.
    pub link: Pose,
    /// The body that touches it.
    pub body: TouchBody,
    /// The orientation of the body's frame, if it is known.
    pub body_rotation: Option<DQuat>,
    /// The active taxels and their readings, which are positive: forces on discs of one size, or numbers
    /// that are proportional to it.
    pub felt: Vec<(TaxelId, f64)>,
    /// How the body moves, in the frame of the link, with the value of each of [`TouchLog::joints`], in m per rad, or without a unit
    /// where the joint slides; empty if it is not known.
    pub by_joints: Vec<DVec3>,
}

/// A body that touches a skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TouchBody {
    /// A sphere, or a point.
    Sphere {
        /// Its centre, in m.
        centre: DVec3,
        /// Its radius, in m; 0: a point, or a body of unknown size around its origin.
        radius: f64,
    },
    /// A plane.
    Plane {
        /// A point of it, in m.
        point: DVec3,
        /// The unit normal to the side on which the skin is.
        normal: DVec3,
    },
}

impl TouchBody {
    /// Its point that the log names, in m.
    pub(super) fn point(&self) -> DVec3 {
        match *self {
            Self::Sphere { centre, .. } => centre,
            Self::Plane { point, .. } => point,
        }
    }

    /// The radius of a sphere, 0 for all else.
    pub(super) fn radius(&self) -> f64 {
        match *self {
            Self::Sphere { radius, .. } => radius,
            Self::Plane { .. } => 0.0,
        }
    }
}

impl TouchLog {
    /// Checks the numbers of all frames, and their order.
    ///
    /// # Errors
    /// The first row with a number that is not finite, a pose or a normal that is not one, a radius or a reading that
    /// is negative, a taxel twice, a time before that of the row above in the same touch, or a touch that
    /// continues after another one.
    pub fn validate(&self) -> Result<(), TouchesError> {
        let mut ended = std::collections::BTreeSet::new();
        let mut last: Option<&TouchFrame> = None;
        for frame in &self.frames {
            frame.validate()?;
            let invalid = |needed| {
                Err(TouchesError::InvalidFrame {
                    row: frame.row,
                    what: "how the body moves with joints",
                    needed,
                })
            };
            if ![0, self.joints.len()].contains(&frame.by_joints.len()) {
                return invalid("a vector for each joint of the log, or none");
            }
            if frame.by_joints.iter().any(|column| !is_within_reach(*column)) {
                return invalid("vectors within 1e12 m");
            }
            let row = frame.row;
            match last {
                Some(before) if before.touch == frame.touch => {
                    if let (Some(earlier), Some(time)) = (before.time, frame.time)
                        && time < earlier
                    {
                        return Err(TouchesError::OutOfOrder { row, time, earlier });
                    }
                    if before.contact != frame.contact {
                        return Err(TouchesError::SeveralContacts { row, touch: frame.touch });
                    }
                }
                _ => {
                    ended.extend(last.map(|before| before.touch));
                    if ended.contains(&frame.touch) {
                        return Err(TouchesError::Resumed { row, touch: frame.touch });
                    }
                }
            }
            last = Some(frame);
        }
        Ok(())
    }
}

/// Readings are between this and its inverse, in any unit: beyond it their squares are not numbers.
const LEAST_READING: f64 = 1e-100;

impl TouchFrame {
    fn validate(&self) -> Result<(), TouchesError> {
        let row = self.row;
        let invalid =
            |what: &'static str, needed: &'static str| Err(TouchesError::InvalidFrame { row, what, needed });
        if !self.link.is_valid() {
            return invalid("the pose of the link", "a position within 1e12 m and a unit quaternion");
        }
        if self.body_rotation.is_some_and(|q| !(q.length_squared() - 1.0).abs().le(&1e-6)) {
            return invalid("the orientation of the body", "a unit quaternion");
        }
        if !is_within_reach(self.body.point()) {
            return invalid("the position of the body", "a position within 1e12 m");
        }
        match self.body {
            TouchBody::Sphere { radius, .. } if !(0.0..=1e3).contains(&radius) => {
                return invalid("the radius of the body", "0 to 1000 m");
            }
            TouchBody::Plane { normal, .. } if !(normal.length_squared() - 1.0).abs().le(&1e-6) => {
                return invalid("the normal of the plane", "a unit vector");
            }
            _ => {}
        }
        if self.time.is_some_and(|time| !time.is_finite()) {
            return invalid("the time", "a finite number of seconds");
        }
        let mut ids: Vec<TaxelId> = self.felt.iter().map(|(id, _)| *id).collect();
        ids.sort_unstable();
        if let Some(twice) = ids.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(TouchesError::TaxelTwice { row, id: twice[0] });
        }
        // Also refuses NaN.
        match self.felt.iter().find(|(_, reading)| !(LEAST_READING..=LEAST_READING.recip()).contains(reading))
        {
            Some(&(id, reading)) => Err(TouchesError::BadReading { row, id, reading }),
            None => Ok(()),
        }
    }
}
