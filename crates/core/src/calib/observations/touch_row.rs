//! Which touch a contact belongs to: the columns of a table of contacts that the fit of rigid bodies uses.

use glam::{DQuat, DVec3};

use crate::calib::pose::is_unit;
use crate::calib::{CalibError, ContactObservationId, Observations};
use crate::mesh::is_within_reach;

/// The touch of a contact, one for each row of a table.
///
/// A touch that several taxels feel has a row for each of them; all its rows observe one point of contact.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchRow {
    /// Rows with the same number are one touch; `None`: a touch of its own.
    pub touch: Option<u64>,
    /// Touches with the same number repeat one contact, and count once together; `None`: a contact of its own.
    pub contact: Option<u64>,
    /// Weight of the taxel in the mean of its touch, above 0.
    pub weight: f64,
    /// Orientation of the probe's frame in the frame of the contacts, a unit quaternion.
    pub probe: Option<DQuat>,
    /// The body that touched, if it is known.
    pub body: Option<TouchingBody>,
    /// The direction in which the readings fell as the body moved, its length in standard deviations of that, if known.
    pub outward: Option<DVec3>,
    /// The path of the body in the touch, if known: the direction along which its positions differ most, its length their standard
    /// deviation, in m, all in the frame of the contacts.
    pub path: Option<DVec3>,
    /// The velocity of the body in the touch, in the frame of the contacts, in m/s: the mean, weighted by the readings, if known.
    pub velocity: Option<DVec3>,
    /// How the body moves, in the frame of the contacts, with the value of each of [`Observations::joints`], in m per rad, or
    /// without a unit where the joint slides; empty if it is not known.
    pub by_joints: Vec<DVec3>,
}

/// A joint of the robot that moves what touches against the skin.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct TouchJoint {
    /// Its name.
    pub name: String,
    /// How it moves.
    pub motion: JointMotion,
}

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum JointMotion {
    /// It turns: its value is in rad.
    Turns,
    /// It slides: its value is in m.
    Slides,
}

/// A sphere that touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchingBody {
    /// Its centre, in the frame of the contacts, in m.
    pub centre: DVec3,
    /// Its radius, in m; 0: a point, or a body of unknown size around its origin.
    pub radius: f64,
}

impl Default for TouchRow {
    fn default() -> Self {
        Self {
            touch: None,
            contact: None,
            weight: 1.0,
            probe: None,
            body: None,
            outward: None,
            path: None,
            velocity: None,
            by_joints: Vec::new(),
        }
    }
}

impl Observations {
    /// The touch of a contact; the default where the observations have none.
    #[doc(hidden)]
    pub fn touch_of(&self, contact: ContactObservationId) -> TouchRow {
        self.touches.get(contact).cloned().unwrap_or_default()
    }

    /// Refuses touches that are not one for each contact, and numbers that no table may have.
    pub(super) fn check_touches(&self) -> Result<(), CalibError> {
        if !self.touches.is_empty() && self.touches.len() != self.contacts.len() {
            let (found, needed) = (self.touches.len(), self.contacts.len());
            return Err(CalibError::UnequalTouches { found, needed });
        }
        for (contact, row) in self.touches.enumerate() {
            let invalid = |reason| {
                let id = self.taxels[self.contacts[contact].taxel].id;
                Err(CalibError::InvalidContact { contact, id, reason })
            };
            if !(row.weight > 0.0 && row.weight.is_finite()) {
                return invalid("its weight is not a number above 0");
            }
            // Also refuses NaN.
            if row.probe.is_some_and(|q| !is_unit(q)) {
                return invalid("the orientation of its probe is not a quaternion of unit length");
            }
            if !row.by_joints.is_empty() && row.by_joints.len() != self.joints.len() {
                return invalid("how it moves with joints is not known of each joint, or of none");
            }
            if row.by_joints.iter().any(|column| !is_within_reach(*column)) {
                return invalid("how it moves with a joint is not within 1e12 m");
            }
            let is_body =
                |body: TouchingBody| is_within_reach(body.centre) && (0.0..=1e3).contains(&body.radius);
            if row.outward.is_some_and(|outward| !outward.is_finite()) {
                return invalid("the direction in which its readings fell is not finite");
            }
            if row.path.is_some_and(|path| !is_within_reach(path)) {
                return invalid("the path of its body is not within 1e12 m");
            }
            if row.velocity.is_some_and(|velocity| !is_within_reach(velocity)) {
                return invalid("the velocity of its body is not within 1e12 m/s");
            }
            if row.body.is_some_and(|body| !is_body(body)) {
                return invalid("the body has no centre within 1e12 m, or no radius from 0 to 1000 m");
            }
        }
        Ok(())
    }
}
