//! The rows of a table of touches, and how they become a log: poses and readings may be in files of their own.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DAffine3, DQuat, DVec3};

use crate::calib::{Pose, TouchJoint};
use crate::id::IdVec;
use crate::numeric::median;
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
    /// The times (s) at which poses are known, ascending, where the motion has others between them, as that of a robot has; `None`: those
    /// of the motion.
    pub pose_times: Option<&'a [f64]>,
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
    /// Rows in a pause of the poses, in which a link moved: where it was then is not known.
    pub unposed: usize,
}

/// Rows without a number of a touch that are farther apart than so many usual steps are two touches.
const MOST_STEPS_OF_TOUCH: f64 = 10.0;

/// A row that is farther than so many usual steps from the poses before and after it is in a pause of them.
const MOST_STEPS_OF_POSES: f64 = 3.0;

/// A link that moves less over a pause, in m and rad, stands still.
const STILL: [f64; 2] = [1e-4, 1e-3];

/// Taxels that are above the threshold in this share of the frames are so at rest.
const ALWAYS: f64 = 0.8;

/// Makes a log of rows. Rows without a number of a touch belong to the touch of the row above them, unless taxels were
/// silent between, or rows of another link or a pause of ten usual steps are between them. Rows in a pause of the poses in which the
/// link moved are left out.
///
/// # Errors
/// The first row whose link has no pose, whose time is missing or not one of the poses or the readings, whose time is before that of
/// another touch above while poses or readings are found by it, with readings of
/// some taxels only, or with taxels of its own next to a recording; several links, of which none is chosen; a recording with a
/// taxel twice, or in which most taxels are active most of the time.
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
    sources.readings.map_or(Ok(()), TouchReadings::validate)?;
    let period = sources.readings.and_then(|readings| usual_step(readings.times.iter().copied()));
    let longest = usual_step(rows.iter().filter(|row| row.link == link).filter_map(|row| row.time))
        .map(|step| MOST_STEPS_OF_TOUCH * step);
    let mut pauses = Pauses { sources, known: BTreeMap::new() };
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
            was_silent = true;
            continue;
        }
        let felt = felt(row, sources, made.log.has_readings, period.unwrap_or(0.0))?;
        if felt.is_empty() {
            made.silent += 1;
            was_silent = true;
            continue;
        }
        if pauses.have(row) {
            made.unposed += 1;
            continue;
        }
        let last = made.log.frames.last();
        let gap = last.and_then(|last| Some(row.time? - last.time?));
        let is_apart = gap.zip(longest).is_some_and(|(gap, longest)| gap > longest);
        touch += u64::from((was_silent || is_apart) && last.is_some());
        was_silent = false;
        let number = row.touch.unwrap_or(touch);
        if let Some((last, gap)) = last.zip(gap)
            && gap < 0.0
            && last.touch != number
            && sources.are_timed(row)
        {
            let time = row.time.unwrap_or_default();
            return Err(TouchesError::ClockRestarts { row: row.row, time, earlier: time - gap });
        }
        let pose = pose_of(row, &row.link, row.pose, sources)?;
        let (body, body_rotation) = body_of(row, sources)?;
        let by_joints = sources.joints.map(|joints| by_joints(row, &pose, &body, joints)).transpose()?;
        made.log.frames.push(TouchFrame {
            row: row.row,
            time: row.time,
            touch: number,
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

/// The median of the steps between times that ascend, in s.
fn usual_step(times: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut last = None;
    let steps = times.into_iter().filter_map(|time| Some(time - last.replace(time)?));
    median(steps.filter(|step| *step > 0.0).collect::<Vec<_>>().into_iter())
}

impl RowSources<'_> {
    /// Whether the pose of a row or of its body, or its readings, are found by its time.
    fn are_timed(&self, row: &TouchRow) -> bool {
        let moves =
            self.motion.and_then(|(motion, _)| motion.times()).is_some_and(|[first, last]| first < last);
        self.readings.is_some() || moves && (row.pose.is_none() || row.body_link.is_some())
    }
}

/// The pauses of the poses of links.
struct Pauses<'s> {
    sources: &'s RowSources<'s>,
    /// The times of the poses of each link, and their usual step; empty for one that does not move.
    known: BTreeMap<String, (Vec<f64>, f64)>,
}

impl Pauses<'_> {
    /// Whether a row needs the pose of a link in a pause in which it moved.
    fn have(&mut self, row: &TouchRow) -> bool {
        let own = Some(&row.link).filter(|_| row.pose.is_none());
        own.into_iter().chain(&row.body_link).any(|link| row.time.is_some_and(|time| self.has(link, time)))
    }

    fn has(&mut self, name: &str, time: f64) -> bool {
        let Some((motion, links)) = self.sources.motion else { return false };
        if !self.known.contains_key(name) {
            let link = links.enumerate().find(|(_, link)| link.name == name).map(|(id, _)| id);
            let track = motion.tracks().find(|(id, _)| Some(*id) == link).map(|(_, track)| track);
            let times = track.map_or_else(Vec::new, |track| match self.sources.pose_times {
                Some(times) => times.to_vec(),
                None => track.translation.times.clone(),
            });
            let step = usual_step(times.iter().copied()).unwrap_or(0.0);
            self.known.insert(name.to_owned(), (times, step));
        }
        let Some((times, step)) = self.known.get(name) else { return false };
        let after = times.partition_point(|&t| t < time);
        let Some((&start, &end)) = after.checked_sub(1).and_then(|k| times.get(k)).zip(times.get(after))
        else {
            return false;
        };
        let [from, to] = [start, end].map(|time| pose_in_motion(motion, links, name, time));
        (time - start).min(end - time) > MOST_STEPS_OF_POSES * step
            && from.zip(to).is_some_and(|(from, to)| {
                from.position.distance(to.position) > STILL[0]
                    || from.rotation.angle_between(to.rotation) > STILL[1]
            })
    }
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
    period: f64,
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
            let frame = readings.frame_at(row.time, period).map_err(|span| TouchesError::OffClock {
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

    /// Checks that each taxel has one column, and that most are below the threshold where nothing touches.
    ///
    /// # Errors
    /// [`TouchesError::ColumnTwice`], [`TouchesError::AlwaysActive`].
    fn validate(&self) -> Result<(), TouchesError> {
        let mut seen = BTreeSet::new();
        let mut known = self.ids.iter().filter(|id| !TaxelId::PLACEHOLDERS.contains(id));
        if let Some(&id) = known.find(|id| !seen.insert(**id)) {
            return Err(TouchesError::ColumnTwice { id });
        }
        let (taxels, frames) = (self.ids.len(), self.times.len());
        let times_active = |column: usize| {
            self.values.iter().skip(column).step_by(taxels.max(1)).filter(|x| **x > self.threshold).count()
        };
        let is_always = |column: &usize| times_active(*column) as f64 > ALWAYS * frames as f64;
        let active = (0..taxels).filter(is_always).count();
        if 2 * active > taxels {
            return Err(TouchesError::AlwaysActive { active, taxels, threshold: self.threshold });
        }
        Ok(())
    }

    /// Sets the threshold to the given one, or else to the one that the readings state, or to five times the noise.
    ///
    /// # Errors
    /// [`TouchesError::NotOfTouch`] if the channel does not measure touches.
    pub fn set_threshold(
        &mut self,
        channel: &Channel,
        given: Option<f64>,
        stated: Option<f64>,
    ) -> Result<(), TouchesError> {
        if !channel.kind.is_of_touch() {
            return Err(TouchesError::NotOfTouch { channel: channel.name.clone() });
        }
        self.threshold = given.or(stated).unwrap_or_else(|| self.above_noise());
        Ok(())
    }

    /// The frame nearest to a time; an error with the span of the times if it is farther than half of the usual time between
    /// frames, `period`.
    fn frame_at(&self, time: Option<f64>, period: f64) -> Result<usize, [f64; 2]> {
        let [first, last] = [self.times.first(), self.times.last()].map(|t| t.copied().unwrap_or(0.0));
        let Some(time) = time else { return Err([first, last]) };
        let after = self.times.partition_point(|&t| t < time);
        let near =
            [after.checked_sub(1), Some(after)].into_iter().flatten().filter(|&k| k < self.times.len());
        let found =
            near.min_by(|&a, &b| (self.times[a] - time).abs().total_cmp(&(self.times[b] - time).abs()));
        // Clocks of one recording agree to less than half of a frame.
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
