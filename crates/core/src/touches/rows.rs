//! The rows of a table of touches, and how they become a log: poses and readings may be in files of their own.

use std::collections::BTreeSet;

use glam::{DAffine3, DQuat, DVec3};

use crate::calib::{Pose, TouchJoint};
use crate::id::IdVec;
use crate::signal::{Channel, Quantity};
use crate::skin::{Link, LinkId, Motion, TaxelId};
use crate::touches::TouchesError;
use crate::touches::log::{TouchBody, TouchFrame, TouchLog};

/// One row of a table of touches, as it is written.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchRow {
    /// Its line in the file.
    pub row: usize,
    /// Its time in s.
    pub time: Option<f64>,
    /// The number of its touch.
    pub touch: Option<u64>,
    /// The number of its contact.
    pub contact: Option<u64>,
    /// The link that carries the skin; may be empty.
    pub link: String,
    /// The pose of that link.
    pub pose: Option<Pose>,
    /// The body that touches, in the frame of `body_link`, or without one in that of the pose.
    pub body: TouchBody,
    /// The orientation of the body, in the same frame.
    pub body_rotation: Option<DQuat>,
    /// The link that carries the body, if its position is in the frame of a link.
    pub body_link: Option<String>,
    /// Active taxels and their readings; `None`: they are in a recording.
    pub felt: Option<Vec<(TaxelId, Option<f64>)>>,
}

/// Frames of a recording of readings.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TouchReadings {
    /// Times in s, ascending.
    pub times: Vec<f64>,
    /// The taxel of each column.
    pub ids: Vec<TaxelId>,
    /// Frame after frame; NaN: no reading.
    pub values: Vec<f64>,
    /// A reading above it is one of an active taxel.
    pub threshold: f64,
}

/// The derivative of a point (m) in the frame of a link of this name, on another link or in the world, by the value of each joint, at
/// a time (s); `None`: no such link.
pub type ByJointsAt<'a> = dyn Fn(f64, &str, Option<&str>, DVec3) -> Option<Vec<DVec3>> + 'a;

/// How bodies move with the joints of a robot.
pub struct JointSource<'a> {
    /// The joints.
    pub joints: Vec<TouchJoint>,
    /// Whether there are values of each.
    pub given: Vec<bool>,
    /// How a body moves with each of them.
    pub by_joints: Box<ByJointsAt<'a>>,
    /// The first and the last time of the values, in s, where they change.
    pub times: Option<[f64; 2]>,
}

/// Where the poses and readings of rows without their own come from.
#[derive(Default)]
pub struct RowSources<'a> {
    /// How links move, and the links: [`links_of_rows`]. A link whose name several have, or that does not move, has no pose.
    pub motion: Option<(&'a Motion, &'a IdVec<LinkId, Link>)>,
    /// Readings.
    pub readings: Option<&'a TouchReadings>,
    /// The radius of the body where rows do not give it, in m.
    pub radius: Option<f64>,
    /// Which link is used; `None`: the only one.
    pub link: Option<&'a str>,
    /// How bodies move with joints; the log has the joints that move them.
    pub joints: Option<&'a JointSource<'a>>,
}

/// The links of rows and those of these names, in the world: what their motion is read for.
pub fn links_of_rows(rows: &[TouchRow], names: impl IntoIterator<Item = String>) -> IdVec<LinkId, Link> {
    let own = rows.iter().flat_map(|row| [Some(&row.link), row.body_link.as_ref()]).flatten().cloned();
    let names: BTreeSet<String> = own.chain(names).collect();
    names.into_iter().map(|name| Link { name, parent: None, pose: DAffine3::IDENTITY }).collect()
}

/// A log of rows, and how many rows were not used.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LogOfRows {
    /// The log.
    pub log: TouchLog,
    /// Rows in which no taxel was active.
    pub silent: usize,
    /// Rows of other links.
    pub others: usize,
}

/// Makes a log of rows. Rows without a number of a touch belong to the touch of the row above them, unless taxels were
/// silent between or the link is another one.
///
/// # Errors
/// The first row whose link has no pose, whose time is missing or not one of the poses or the readings, with readings of
/// some taxels only, or with taxels of its own next to a recording; several links, of which none is chosen.
pub fn log_of_rows(rows: &[TouchRow], sources: &RowSources<'_>) -> Result<LogOfRows, TouchesError> {
    let mut made = LogOfRows::default();
    let first =
        rows.iter().map(|row| &*row.link).find(|link| sources.link.is_none_or(|wanted| wanted == *link));
    let Some(link) = first else {
        let found = rows.iter().map(|row| row.link.clone()).next().unwrap_or_default();
        return Err(TouchesError::NoLink { wanted: sources.link.unwrap_or_default().to_owned(), found });
    };
    made.log.has_readings = sources.readings.is_some()
        || rows.iter().filter_map(|row| row.felt.as_ref()).flatten().any(|(_, reading)| reading.is_some());
    let (mut touch, mut was_silent) = (0, false);
    for row in rows {
        if row.link != link {
            if sources.link.is_none() {
                return Err(TouchesError::SeveralLinks {
                    row: row.row,
                    first: link.to_owned(),
                    second: row.link.clone(),
                });
            }
            made.others += 1;
            continue;
        }
        let felt = felt(row, sources, made.log.has_readings)?;
        if felt.is_empty() {
            made.silent += 1;
            was_silent = true;
            continue;
        }
        touch += u64::from(was_silent && !made.log.frames.is_empty());
        was_silent = false;
        let pose = pose_of(row, &row.link, row.pose, sources)?;
        let (body, body_rotation) = body_of(row, sources)?;
        let by_joints = sources.joints.map(|joints| by_joints(row, &pose, &body, joints)).transpose()?;
        made.log.frames.push(TouchFrame {
            row: row.row,
            time: row.time,
            touch: row.touch.unwrap_or(touch),
            contact: row.contact,
            link: pose,
            body,
            body_rotation,
            felt,
            by_joints: by_joints.unwrap_or_default(),
        });
    }
    if let Some(joints) = sources.joints {
        keep_moving_joints(&mut made.log, joints, link)?;
    }
    if made.log.frames.is_empty() {
        return Err(TouchesError::NothingFelt { frames: rows.len() });
    }
    Ok(made)
}

/// How the body of a row moves, in the frame of its link, with all joints.
fn by_joints(
    row: &TouchRow,
    link: &Pose,
    body: &TouchBody,
    joints: &JointSource<'_>,
) -> Result<Vec<DVec3>, TouchesError> {
    let time = match (row.time, joints.times) {
        (time, None) => time.unwrap_or(0.0),
        (Some(time), Some([first, last])) if (first..=last).contains(&time) => time,
        (found, Some(span)) => {
            let what = "values of the joints";
            return Err(TouchesError::OffClock { row: row.row, found, what, span });
        }
    };
    let point = link.inverse().apply(body.point());
    (joints.by_joints)(time, &row.link, row.body_link.as_deref(), point).ok_or_else(|| {
        let other =
            row.body_link.clone().filter(|_| (joints.by_joints)(time, &row.link, None, point).is_some());
        TouchesError::NoRobotLink { row: row.row, link: other.unwrap_or_else(|| row.link.clone()) }
    })
}

/// Keeps the joints that move the body of a frame against the link.
fn keep_moving_joints(log: &mut TouchLog, joints: &JointSource<'_>, link: &str) -> Result<(), TouchesError> {
    let moves = |k: usize| log.frames.iter().any(|frame| frame.by_joints[k] != DVec3::ZERO);
    let moving: Vec<usize> = (0..joints.joints.len()).filter(|&k| moves(k)).collect();
    if moving.is_empty() {
        return Err(TouchesError::NoMovingJoint { link: link.to_owned() });
    }
    if let Some(&k) = moving.iter().find(|&&k| !joints.given[k]) {
        let (joint, link) = (joints.joints[k].name.clone(), link.to_owned());
        return Err(TouchesError::NoJointValues { joint, link });
    }
    log.joints = moving.iter().map(|&k| joints.joints[k].clone()).collect();
    for frame in &mut log.frames {
        frame.by_joints = moving.iter().map(|&k| frame.by_joints[k]).collect();
    }
    Ok(())
}

/// The pose of a link in a motion of links at a time (s), in the world; `None` if there is none of this name, or several, or it
/// does not move. Links without a parent are in the world.
fn pose_in_motion(motion: &Motion, links: &IdVec<LinkId, Link>, name: &str, time: f64) -> Option<Pose> {
    let mut named = links.enumerate().filter(|(_, link)| link.name == name);
    let (Some((link, _)), None) = (named.next(), named.next()) else { return None };
    let (_, pose) = motion.pose(link, time)?;
    Some(Pose { position: pose.translation, rotation: DQuat::from_mat3(&pose.matrix3).normalize() })
}

/// The pose of a link: that of the row, or that of the sources at the time of the row.
fn pose_of(
    row: &TouchRow,
    link: &str,
    own: Option<Pose>,
    sources: &RowSources<'_>,
) -> Result<Pose, TouchesError> {
    if let Some(pose) = own {
        return Ok(pose);
    }
    let missing = || TouchesError::NoPose { row: row.row, link: link.to_owned() };
    let (motion, links) = sources.motion.ok_or_else(missing)?;
    let time = match (row.time, motion.times().filter(|[first, last]| first < last)) {
        (time, None) => time.unwrap_or(0.0),
        (Some(time), Some([first, last])) if (first..=last).contains(&time) => time,
        (found, Some(span)) => {
            return Err(TouchesError::OffClock { row: row.row, found, what: "poses", span });
        }
    };
    pose_in_motion(motion, links, link, time).ok_or_else(missing)
}

/// The body in the frame of the poses.
fn body_of(row: &TouchRow, sources: &RowSources<'_>) -> Result<(TouchBody, Option<DQuat>), TouchesError> {
    let frame = match &row.body_link {
        None => Pose::default(),
        Some(link) => pose_of(row, link, None, sources)?,
    };
    let body = match row.body {
        TouchBody::Sphere { centre, radius } => TouchBody::Sphere {
            centre: frame.apply(centre),
            radius: if radius > 0.0 { radius } else { sources.radius.unwrap_or(0.0) },
        },
        TouchBody::Plane { point, normal } => {
            TouchBody::Plane { point: frame.apply(point), normal: frame.rotation * normal }
        }
    };
    Ok((body, row.body_rotation.map(|q| (frame.rotation * q).normalize())))
}

/// The active taxels of a row.
fn felt(
    row: &TouchRow,
    sources: &RowSources<'_>,
    has_readings: bool,
) -> Result<Vec<(TaxelId, f64)>, TouchesError> {
    match (&row.felt, sources.readings) {
        (Some(felt), None) => {
            let reading = |&(id, reading): &(TaxelId, Option<f64>)| match reading {
                Some(reading) => Ok((id, reading)),
                None if has_readings => Err(TouchesError::PartlyRead { row: row.row, id }),
                None => Ok((id, 1.0)),
            };
            felt.iter().map(reading).collect()
        }
        (None, Some(readings)) => {
            let frame = readings.frame_at(row.time).map_err(|span| TouchesError::OffClock {
                row: row.row,
                found: row.time,
                what: "readings",
                span,
            })?;
            let values = &readings.values[frame * readings.ids.len()..][..readings.ids.len()];
            let active = readings.ids.iter().zip(values).filter(|(_, value)| **value > readings.threshold);
            Ok(active.map(|(id, value)| (*id, *value)).collect())
        }
        (Some(_), Some(_)) => Err(TouchesError::TwoReadings { row: row.row }),
        (None, None) => Err(TouchesError::NoReadings { row: row.row }),
    }
}

impl TouchReadings {
    /// Adds a frame of readings at a time (s).
    ///
    /// # Errors
    /// [`TouchesError::ReadingTime`] if the time is not finite or before that of the last frame.
    pub fn push(&mut self, time: f64, values: &[f64]) -> Result<(), TouchesError> {
        let last = self.times.last().copied();
        if !time.is_finite() || last.is_some_and(|last| time < last) {
            return Err(TouchesError::ReadingTime { frame: self.times.len(), time, last });
        }
        self.times.push(time);
        self.values.extend_from_slice(values);
        Ok(())
    }

    /// The frame nearest to a time; an error with the span of the times if it is farther than half of the time between
    /// frames.
    fn frame_at(&self, time: Option<f64>) -> Result<usize, [f64; 2]> {
        let [first, last] = [self.times.first(), self.times.last()].map(|t| t.copied().unwrap_or(0.0));
        let Some(time) = time else { return Err([first, last]) };
        let after = self.times.partition_point(|&t| t < time);
        let near =
            [after.checked_sub(1), Some(after)].into_iter().flatten().filter(|&k| k < self.times.len());
        let found =
            near.min_by(|&a, &b| (self.times[a] - time).abs().total_cmp(&(self.times[b] - time).abs()));
        // Clocks of one recording agree to less than half of a frame.
        let period = (last - first) / (self.times.len().max(2) - 1) as f64;
        let is_near = |&k: &usize| (self.times[k] - time).abs() <= 0.51 * period + 1e-9;
        found.filter(is_near).ok_or([first, last])
    }

    /// Turns readings of a channel, and their threshold, into forces in N on the discs of taxels, with which a stiffness is
    /// compared. Readings without a unit are forces in N.
    ///
    /// # Errors
    /// [`TouchesError::NoForce`] if the unit is neither one of force nor one of pressure.
    pub fn become_forces(&mut self, channel: &Channel, taxel_radius: f64) -> Result<(), TouchesError> {
        let newtons = match (channel.newtons(), channel.quantity) {
            (None, _) if channel.unit.is_empty() => 1.0,
            (None, _) => return Err(TouchesError::NoForce { unit: channel.unit.clone() }),
            (Some(newtons), Quantity::Extensive) => newtons,
            (Some(pascals), Quantity::Intensive) => pascals * std::f64::consts::PI * taxel_radius.powi(2),
        };
        self.values.iter_mut().chain([&mut self.threshold]).for_each(|x| *x *= newtons);
        Ok(())
    }

    /// The default threshold: five times the noise.
    pub fn above_noise(&self) -> f64 {
        /// The threshold over the noise.
        const SIGMAS: f64 = 5.0;
        SIGMAS * self.noise()
    }

    /// The noise of the readings: the median over taxels of the median absolute change between frames, over what
    /// it is for one standard deviation of a normal distribution; 0 with fewer than three frames.
    pub fn noise(&self) -> f64 {
        let width = self.ids.len();
        let changes = |column: usize| {
            let of =
                |k: usize| (self.values[k * width + column] - self.values[(k - 1) * width + column]).abs();
            crate::numeric::median((1..self.times.len()).map(of).filter(|x| x.is_finite()))
        };
        // The median of the absolute value of a normal number is 0.6745; a change has two of them.
        crate::numeric::median((0..width).filter_map(changes)).unwrap_or(0.0) / (0.6745 * 2_f64.sqrt())
    }
}

impl Default for TouchBody {
    /// A point at the origin.
    fn default() -> Self {
        Self::Sphere { centre: DVec3::ZERO, radius: 0.0 }
    }
}
