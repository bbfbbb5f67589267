//! `touches`: from the log of a robot that touches its skin to contacts.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use dermatome::{
    Error, Skin,
    io::{
        TouchRows, file_kind, is_robot, read_draft, read_joint_values, read_link_names, read_map,
        read_motion, read_robot, read_touches, touches_from_bytes,
    },
    robot::Robot,
    signal::Channel,
    skin::TaxelId,
    touches::{
        Drawing, JointColumns, LogOfRows, RowSources, TouchContacts, TouchReadings, TouchesOptions,
        contacts_of_touches_with, links_of_rows, log_of_rows,
    },
};
use numpy::PyUntypedArrayMethods;
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arrays::{floats, one_each, one_number_each},
    errors::{bad, error},
    jobs::{Stop, run},
    map::PyMap,
    observations::PyObservations,
    options::{count, positive},
    robot::is_free,
    skin::PySkin,
};

/// A log in a file, or as the text of a table.
#[derive(FromPyObject)]
pub(crate) enum LogArg {
    Table(LogText),
    File(PathBuf),
}

/// The text of a table.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LogText {
    text: String,
}

/// Values of joints: a table, or one for each by its name.
#[derive(FromPyObject)]
pub(crate) enum JointsArg {
    Named(BTreeMap<String, f64>),
    Table(PathBuf),
}

/// Times, ids, values, name and unit of the channel, and the stated threshold; without ids of all taxels of the skin.
type ReadingsArg<'py> =
    (Bound<'py, PyAny>, Option<Bound<'py, PyAny>>, Bound<'py, PyAny>, String, String, Option<f64>);

/// What a log needs besides itself, as a dict has it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct TouchesArgs<'py> {
    skin: Option<Bound<'py, PyAny>>,
    /// The file of the skin, if it was read from one.
    drawing: Option<PathBuf>,
    readings: Option<ReadingsArg<'py>>,
    threshold: Option<f64>,
    pose: Option<PathBuf>,
    joints: Option<JointsArg>,
    fit_joints: bool,
    link: Option<String>,
    radius: Option<f64>,
    taxel_radius: f64,
    stiffness: Option<f64>,
    arm_noise: Option<f64>,
    delay: Option<f64>,
    skip: Vec<u32>,
    threads: i64,
}

/// The values of all joints at some times (s), and the joints of which values are given.
type JointValues = (Vec<(f64, Vec<f64>)>, Vec<usize>);

/// The same, converted.
struct Sources {
    readings: Option<TouchReadings>,
    pose: Option<PathBuf>,
    /// What `pose` describes, if that is a robot.
    robot: Option<Robot>,
    joints: Option<JointsArg>,
    fit_joints: bool,
    link: Option<String>,
    radius: Option<f64>,
}

impl TouchesArgs<'_> {
    fn skin(&self) -> PyResult<Option<Arc<Skin>>> {
        let Some(skin) = &self.skin else { return Ok(None) };
        match (skin.cast::<PySkin>(), skin.cast::<PyMap>()) {
            (Ok(skin), _) => Ok(Some(Arc::clone(&skin.get().skin))),
            (_, Ok(map)) => Ok(Some(Arc::new(map.get().map.skin()))),
            _ => Err(bad("skin", skin.get_type().name()?, "a Skin, a Map or a path")),
        }
    }

    fn readings(&self) -> PyResult<Option<TouchReadings>> {
        let Some((times, ids, values, ..)) = &self.readings else { return Ok(None) };
        let values = floats("readings", values)?;
        let (frames, width) = match *values.shape() {
            [frames, width] => (frames, width),
            _ => return Err(bad("readings", "another shape", "shape (T, N)")),
        };
        let times = one_each("timestamps", times, frames)?;
        let ids = ids.as_ref().map(|ids| one_number_each("ids", ids, width)).transpose()?;
        let ids = ids.unwrap_or_default().into_iter().map(TaxelId).collect();
        let mut readings = TouchReadings { ids, ..TouchReadings::default() };
        for (time, values) in times.into_iter().zip(values.as_slice()?.chunks(width.max(1))) {
            readings.push(time, values).map_err(error)?;
        }
        Ok(Some(readings))
    }
}

impl Sources {
    /// The log, with poses and readings of other files.
    fn log(&self, rows: &TouchRows, remarks: &mut Vec<String>) -> Result<LogOfRows, Error> {
        let (rows, unused) = rows;
        note_columns("the log", unused, remarks);
        // A table may have poses of the whole robot.
        let table = self.pose.as_deref().filter(|_| self.robot.is_none());
        let links = links_of_rows(rows, table.map(read_link_names).transpose()?.unwrap_or_default());
        let values = self.robot.as_ref().map(|robot| self.joint_values(robot, remarks)).transpose()?;
        let columns =
            self.robot.as_ref().zip(values.as_ref()).map(|(robot, (rows, _))| JointColumns::new(robot, rows));
        let unlikely = columns.as_ref().map(JointColumns::unlikely).unwrap_or_default();
        if !unlikely.is_empty() {
            let names: Vec<String> = unlikely.into_iter().map(|joint| joint.name).collect();
            let names = names.join(", ");
            remarks.push(format!("beyond 360 degrees or 10 m, as other units would be, of the joints {names}: the values are taken in rad and m"));
        }
        let motion = match (&self.pose, &self.robot, &values) {
            (_, Some(robot), Some((rows, _))) => Some(robot.motion(rows, &links)?),
            (Some(path), ..) => {
                let read = read_motion(path, None, &links)?;
                note_columns(&path.display().to_string(), &read.unused, remarks);
                Some(read.motion)
            }
            (None, ..) => None,
        };
        let times = columns.as_ref().map(JointColumns::all_times);
        let joints = columns.as_ref().zip(values.as_ref()).filter(|_| self.fit_joints);
        let joints = joints.map(|(columns, (_, given))| columns.source(given));
        let sources = RowSources {
            motion: motion.as_ref().map(|motion| (motion, &links)),
            pose_times: times.as_deref(),
            readings: self.readings.as_ref(),
            radius: self.radius,
            link: self.link.as_deref(),
            joints: joints.as_ref(),
        };
        Ok(log_of_rows(rows, &sources)?)
    }

    /// The values of all joints of the robot at some times, and the joints of which values are given.
    fn joint_values(&self, robot: &Robot, remarks: &mut Vec<String>) -> Result<JointValues, Error> {
        Ok(match &self.joints {
            None => (vec![(0.0, robot.joint_values(&[]))], Vec::new()),
            Some(JointsArg::Table(path)) => {
                let table = read_joint_values(path, robot)?;
                note_columns(&path.display().to_string(), &table.unused, remarks);
                (table.rows, table.given)
            }
            Some(JointsArg::Named(values)) => {
                let joints = robot.joints.iter().enumerate();
                let given = joints.filter_map(|(k, joint)| Some((k, *values.get(&joint.name)?)));
                let given: Vec<(usize, f64)> = given.collect();
                let joints = given.iter().map(|&(joint, _)| joint).collect();
                (vec![(0.0, robot.joint_values(&given))], joints)
            }
        })
    }
}

fn note_columns(table: &str, columns: &[String], remarks: &mut Vec<String>) {
    if !columns.is_empty() {
        let s = if columns.len() == 1 { " " } else { "s " };
        let are = if columns.len() == 1 { "is" } else { "are" };
        remarks.push(format!("{table}: column{s}{} {are} not used", columns.join(", ")));
    }
}

/// The drawing of a link of a skin, with the taxels of its file that are in no triangle; a map has none.
fn drawing_of(skin: &Skin, file: Option<&Path>, link: &str) -> Result<Drawing, Error> {
    let mut drawing = Drawing::of_link(skin, link)?;
    if let Some(path) = file {
        let is_map = ["glb", "gltf"].contains(&&*file_kind(path)) && read_map(path).is_ok();
        if !is_map {
            drawing.add_bare(&read_draft(path)?, link)?;
        }
    }
    Ok(drawing)
}

/// Refuses values of joints without a robot, and those of joints that have none.
fn check_joints(robot: Option<&Robot>, joints: Option<&JointsArg>) -> PyResult<()> {
    match (robot, joints) {
        (None, Some(_)) => return Err(bad("joints", "no robot as pose", "a .urdf or .xml")),
        (Some(robot), Some(JointsArg::Named(values))) => {
            let known: Vec<&str> =
                robot.joints.iter().filter(|joint| is_free(joint)).map(|joint| &*joint.name).collect();
            for (name, value) in values {
                if !known.contains(&name.as_str()) {
                    let is_joint = robot.joints.iter().any(|joint| joint.name == *name);
                    let found =
                        format!("{name:?}{}", if is_joint { ", which has no value of its own" } else { "" });
                    return Err(bad("joints", found, format!("some of {known:?}")));
                }
                if !value.is_finite() {
                    return Err(bad(&format!("joints[{name:?}]"), value, "a finite number, in rad or m"));
                }
            }
        }
        _ => {}
    }
    Ok(())
}

/// Turn a log into observations and a dict of how they were found.
#[pyfunction]
pub(crate) fn contacts_of_log<'py>(
    py: Python<'py>,
    log: LogArg,
    arguments: TouchesArgs<'py>,
) -> PyResult<(PyObservations, Bound<'py, PyDict>)> {
    let taxel = positive("taxel_radius", arguments.taxel_radius)?;
    let stiffness = arguments.stiffness.map(|stiffness| positive("stiffness", stiffness)).transpose()?;
    let skin = arguments.skin()?;
    let readings = arguments.readings()?;
    let channel =
        arguments.readings.as_ref().map(|(.., name, unit, _)| Channel::new(name, unit).map_err(error));
    let channel = channel.transpose()?;
    let stated = arguments.readings.as_ref().and_then(|readings| readings.5);
    let mut remarks = Vec::new();
    let radius = arguments.radius.map(|radius| positive("radius", radius)).transpose()?;
    let TouchesArgs {
        drawing,
        threshold,
        pose,
        joints,
        fit_joints,
        link,
        arm_noise,
        delay,
        skip,
        threads,
        ..
    } = arguments;
    let of_robot = pose.clone().filter(|path| is_robot(path));
    let robot = of_robot.map(|path| run(py, 0, move |_| read_robot(&path))?.map_err(error)).transpose()?;
    check_joints(robot.as_ref(), joints.as_ref())?;
    let mut sources = Sources { readings, pose, robot, joints, fit_joints, link, radius };
    let work = move |stop: &Stop| {
        let rows = match log {
            LogArg::Table(LogText { text }) => touches_from_bytes("log".as_ref(), text.into_bytes())?,
            LogArg::File(path) => read_touches(&path)?,
        };
        let link =
            sources.link.clone().or_else(|| rows.0.first().map(|row| row.link.clone())).unwrap_or_default();
        if let Some(readings) = &mut sources.readings {
            skin.as_deref().map_or(Ok(()), |skin| readings.assign(skin, &link))?;
            if let Some(channel) = &channel {
                readings.set_threshold(channel, threshold, stated)?;
            }
            let above = readings.threshold;
            remarks.push(format!("taxels are active above {above:.3e}, in the unit of the readings"));
            if let Some(channel) = channel.filter(|_| stiffness.is_some()) {
                readings.become_forces(&channel, taxel)?;
            }
        }
        let made = sources.log(&rows, &mut remarks)?;
        let options = TouchesOptions {
            taxel_radius: Some(taxel),
            gain: stiffness.map(|stiffness| stiffness * std::f64::consts::PI * taxel * taxel),
            arm_noise,
            delay,
            drawing: skin.as_deref().map(|skin| drawing_of(skin, drawing.as_deref(), &link)).transpose()?,
            left_out: skip.into_iter().map(TaxelId).collect(),
        };
        let found = contacts_of_touches_with(&made.log, &options, stop.run())?;
        remarks.extend(made.remarks().into_iter().chain(found.remarks()));
        Ok::<_, Error>((found, made, remarks))
    };
    let (found, made, remarks) = run(py, count("threads", threads)?, work)?.map_err(error)?;
    let summary = summary_of(py, &found, &made, delay)?;
    Ok((PyObservations::new(found.observations(), remarks), summary))
}

/// The dict of how contacts were found; `delay` is the given one.
fn summary_of<'py>(
    py: Python<'py>,
    found: &TouchContacts,
    made: &LogOfRows,
    delay: Option<f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let (summary, said) = (PyDict::new(py), &found.summary);
    for (name, number) in [
        ("frames", said.frames),
        ("touches", said.touches),
        ("taxels", said.taxels),
        ("contacts", found.contacts.len()),
        ("fitted", said.fitted),
    ] {
        summary.set_item(name, number)?;
    }
    let left_out = PyDict::new(py);
    for (name, number) in [
        ("rows_of_other_links", made.others),
        ("rows_without_taxel", made.silent),
        ("rows_without_pose", made.unposed),
        ("touches", said.empty_touches),
        ("taxels", said.lost_taxels),
        ("frames", said.untimed),
        ("readings", said.lone),
    ] {
        left_out.set_item(name, number)?;
    }
    let spikes: Vec<_> = said.spikes.iter().map(|s| (s.row, s.taxel.0, s.reading)).collect();
    left_out.set_item("spikes", spikes)?;
    summary.set_item("left_out", left_out)?;
    summary.set_item("delay", said.delay.map(|delay| delay.seconds))?;
    summary.set_item("delay_sigma", said.delay.map(|delay| delay.sigma))?;
    let removed = said.delay.map_or(delay.unwrap_or(0.0), |delay| delay.removed);
    summary.set_item("delay_removed", removed)?;
    summary.set_item("arm_noise", said.arm_noise)?;
    summary.set_item("reading_noise", said.reading_noise)?;
    summary.set_item("spacing", said.spacing)?;
    summary.set_item("joints", found.joints.iter().map(|joint| joint.name.clone()).collect::<Vec<_>>())?;
    Ok(summary)
}
