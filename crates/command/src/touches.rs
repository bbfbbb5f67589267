//! `touches`: from the log of a robot that touches its skin to contacts for `calibrate`.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use dermatome::Error;
use dermatome::id::IdVec;
use dermatome::io::{
    ReadingsLayout, ReadingsReader, read_link_names, read_motion, read_response, read_robot, read_touches,
    write_touch_contacts,
};
use dermatome::robot::Robot;
use dermatome::signal::TaxelState;
use dermatome::skin::{Link, LinkId, Motion, Skin, TaxelId};
use dermatome::touches::{
    Drawing, JointColumns, LeftOutReading, LogOfRows, RowSources, TouchReadings, TouchRow, TouchesError,
    TouchesOptions, contacts_of_touches, links_of_rows, log_of_rows,
};
use serde::Serialize;

use crate::console::errors::advise;
use crate::console::notes::{note, note_columns};
use crate::console::print::print_json;
use crate::files::input::{read_any_skin, read_draft_of, read_map_if_any};
use crate::files::outputs;
use crate::options::{
    Common, InPath, JointValues, JointsArg, OutFile, ReadArgs, RobotArgs, SkipArg, joints, length_mm,
    skip_arg,
};
use crate::readings::positive;

/// Turn the log of a robot that touches its skin into contacts for `calibrate`.
///
/// A row of the log is a frame: the pose of the link that carries the skin, the centre and radius of the sphere that
/// touches it, and the active taxels with their readings (docs/files.md). Each touch gives each of its taxels a
/// contact: a position in the frame of the link, with its information.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The log: a table with columns px,py,pz and, unless --pose or --readings has them, x,y,z,qx,qy,qz,qw and taxels
    #[arg(value_name = "LOG.csv")]
    log: InPath,
    /// File for the contacts: .csv
    #[arg(short, long, value_name = "OUT.csv")]
    output: OutFile,
    /// A drawing of the skin, in the frame of the link: its taxels have their normals and neighbours from it
    #[arg(long, value_name = "SKIN")]
    skin: Option<InPath>,
    /// Readings of the taxels, at the times of the log, if it has no column `taxels`; without ids those of all taxels of
    /// --skin in its order
    #[arg(long, value_name = "R")]
    readings: Option<InPath>,
    /// A taxel is active above this, in the unit of the readings [default: as they state, or five times the noise]
    #[arg(long, value_name = "X", value_parser = positive, requires = "readings")]
    threshold: Option<f64>,
    /// Poses of links: a table with columns link,x,y,z,qx,qy,qz,qw and, if they move, time in s; or a robot (.urdf,
    /// .xml), with --joints
    #[arg(long, value_name = "P.csv")]
    pose: Option<InPath>,
    /// Values of the joints of the robot of --pose, in rad and m [default: 0]: NAME=VALUE,..., or a table with
    /// a column for each joint and, if they move, time in s
    #[arg(long, value_name = "FILE|NAME=VALUE", value_parser = joints, requires = "pose")]
    joints: Option<JointsArg>,
    /// Write how each touch moves with the joints between the skin and what touches it, for `calibrate --fit-joints`
    #[arg(long, requires = "joints")]
    fit_joints: bool,
    /// The link whose skin is touched, if the log has several
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Radius of the sphere that touches, if the log has no column `radius`
    #[arg(long = "radius-mm", value_name = "MM", value_parser = length_mm)]
    radius: Option<f64>,
    /// Radius of the disc on which a taxel feels
    #[arg(long = "taxel-mm", value_name = "MM", default_value = "2", value_parser = length_mm)]
    taxel: f64,
    /// Stiffness of the skin, pressure for each millimetre of depth, if readings are forces in N [default: estimated]
    #[arg(long, value_name = "KPA", value_parser = positive)]
    stiffness_kpa: Option<f64>,
    /// Noise of the arm's position, per axis [default: estimated, or else 1]
    #[arg(long = "arm-noise-mm", value_name = "MM", value_parser = length_mm)]
    arm_noise: Option<f64>,
    /// How late the readings are next to the poses; `auto`: estimated, and taken off beyond five standard deviations
    #[arg(long = "delay-ms", value_name = "auto|MS", default_value = "auto", value_parser = delay_ms, allow_hyphen_values = true)]
    delay: DelayArg,
    /// Leave out taxels: their ids, or the table of faults that `check --recording -o` writes
    #[arg(long, value_name = "ID,...|F.csv", value_parser = skip_arg)]
    skip: Option<SkipArg>,
    /// Print how the contacts were found as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

/// The delay of --delay-ms in s; `None`: estimated.
#[derive(Debug, Clone, Copy)]
struct DelayArg(Option<f64>);

fn delay_ms(text: &str) -> Result<DelayArg, String> {
    if text == "auto" {
        return Ok(DelayArg(None));
    }
    let ms = text.parse::<f64>().ok().filter(|ms| ms.abs() <= 1e3);
    ms.map(|ms| DelayArg(Some(1e-3 * ms))).ok_or_else(|| "needed: auto, or -1000 to 1000".into())
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    frames: usize,
    touches: usize,
    taxels: usize,
    contacts: usize,
    fitted: usize,
    left_out: LeftOut,
    delay_ms: Option<f64>,
    delay_sigma_ms: Option<f64>,
    delay_removed_ms: f64,
    arm_noise_mm: f64,
    reading_noise: Option<f64>,
    spacing_mm: Option<f64>,
    joints: Vec<String>,
}

/// What gives no contact.
#[derive(Debug, Serialize)]
struct LeftOut {
    rows_of_other_links: usize,
    rows_without_taxel: usize,
    rows_without_pose: usize,
    touches: usize,
    taxels: usize,
    frames: usize,
    readings: usize,
    spikes: Vec<Spike>,
}

/// A reading that its taxel does not give.
#[derive(Debug, Serialize)]
struct Spike {
    line: usize,
    taxel: u32,
    reading: f64,
}

impl Spike {
    fn new(left_out: &LeftOutReading) -> Self {
        Self { line: left_out.row, taxel: left_out.taxel.0, reading: left_out.reading }
    }
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    outputs::check_table(&args.output)?;
    let (rows, unused) = read_touches(&args.log).map_err(Error::from)?;
    note_columns(&args.log, &unused, common);
    let skin = args.skin.as_ref().map(|path| read_any_skin(path, &args.read, common)).transpose()?;
    // The link that the log has, or the one of several that is chosen.
    let link = args.link.as_deref().or_else(|| rows.first().map(|row| &*row.link)).unwrap_or_default();
    let made = args.log(&rows, skin.as_ref(), link, common)?;
    let mut drawing = skin.as_ref().map(|skin| Drawing::of_link(skin, link)).transpose();
    if let (Ok(Some(of_skin)), Some(path)) = (&mut drawing, &args.skin)
        && read_map_if_any(path)?.is_none()
        && let Err(error) = of_skin.add_bare(&read_draft_of(path, &args.read, false)?, link)
    {
        drawing = Err(error);
    }
    let options = TouchesOptions {
        taxel_radius: Some(args.taxel),
        gain: args.stiffness_kpa.map(|kpa| kpa * 1e6 * std::f64::consts::PI * args.taxel * args.taxel),
        arm_noise: args.arm_noise,
        delay: args.delay.0,
        drawing: drawing.map_err(Error::from).with_context(|| args.about())?,
        left_out: args.left_out(common)?,
    };
    let options = match &args.skip {
        // A table of faults has the taxels of the whole skin.
        Some(SkipArg::File(_)) => options.left_out_of(&made.log),
        _ => options,
    };
    let found =
        contacts_of_touches(&made.log, &options).map_err(Error::from).with_context(|| args.about())?;
    write_touch_contacts(common.outputs.file(&args.output), &found).map_err(Error::from)?;
    outputs::publish(common)?;
    for remark in made.remarks().into_iter().chain(found.remarks()) {
        note!(common, "{remark}");
    }
    if args.json {
        let summary = &found.summary;
        let printed = Summary {
            frames: summary.frames,
            touches: summary.touches,
            taxels: summary.taxels,
            contacts: found.contacts.len(),
            fitted: summary.fitted,
            left_out: LeftOut {
                rows_of_other_links: made.others,
                rows_without_taxel: made.silent,
                rows_without_pose: made.unposed,
                touches: summary.empty_touches,
                taxels: summary.lost_taxels,
                frames: summary.untimed,
                readings: summary.lone,
                spikes: summary.spikes.iter().map(Spike::new).collect(),
            },
            delay_ms: summary.delay.map(|delay| 1e3 * delay.seconds),
            delay_sigma_ms: summary.delay.map(|delay| 1e3 * delay.sigma),
            delay_removed_ms: 1e3 * summary.delay.map_or(args.delay.0.unwrap_or(0.0), |delay| delay.removed),
            arm_noise_mm: 1e3 * summary.arm_noise,
            reading_noise: summary.reading_noise,
            spacing_mm: summary.spacing.map(|spacing| 1e3 * spacing),
            joints: found.joints.iter().map(|joint| joint.name.clone()).collect(),
        };
        print_json("dermatome.touches/1", &printed)?;
    }
    Ok(ExitCode::SUCCESS)
}

impl Args {
    /// What an error is about.
    fn about(&self) -> String {
        format!("the log in {} cannot be used", self.log.display())
    }

    /// The log, with poses and readings of other files.
    fn log(
        &self,
        rows: &[TouchRow],
        skin: Option<&Skin>,
        link: &str,
        common: &Common,
    ) -> anyhow::Result<LogOfRows> {
        // A table may have poses of the whole robot.
        let table = self.pose.as_deref().filter(|path| !RobotArgs::describes(path));
        let names = table.map(read_link_names).transpose().map_err(Error::from)?;
        let links = links_of_rows(rows, names.unwrap_or_default());
        let robot = self.pose.as_deref().filter(|path| RobotArgs::describes(path)).map(read_robot);
        let robot = robot.transpose().map_err(Error::from)?;
        let values = robot.as_ref().map(|robot| self.values(robot, common)).transpose()?;
        let columns =
            robot.as_ref().zip(values.as_ref()).map(|(robot, values)| JointColumns::new(robot, &values.rows));
        let motion = match (&self.pose, &robot, &values) {
            (_, Some(robot), Some(values)) => Some(robot.motion(&values.rows, &links).map_err(Error::from)?),
            (Some(path), ..) => Some(self.motion(path, &links, common)?),
            (None, ..) => None,
        };
        let recording = |path: &InPath| self.recording(path, skin, link, common);
        let readings = self.readings.as_ref().map(recording).transpose()?;
        let times = columns.as_ref().map(JointColumns::all_times);
        let joints = columns.as_ref().zip(values.as_ref()).filter(|_| self.fit_joints);
        let joints = joints.map(|(columns, values)| columns.source(&values.given));
        let sources = RowSources {
            motion: motion.as_ref().map(|motion| (motion, &links)),
            pose_times: times.as_deref(),
            readings: readings.as_ref(),
            radius: self.radius,
            link: self.link.as_deref(),
            joints: joints.as_ref(),
        };
        log_of_rows(rows, &sources).map_err(Error::from).with_context(|| self.about())
    }

    /// The values of the joints of a robot.
    fn values(&self, robot: &Robot, common: &Common) -> anyhow::Result<JointValues> {
        let rest = || Ok(JointValues::at_rest(robot));
        self.joints.as_ref().map_or_else(rest, |joints| joints.values(robot, common))
    }

    /// How links move, by a table of poses.
    fn motion(&self, path: &Path, links: &IdVec<LinkId, Link>, common: &Common) -> anyhow::Result<Motion> {
        if self.joints.is_some() {
            let what = format!("--joints: {} is no robot", path.display());
            return Err(advise(what, "give --pose a .urdf or .xml, or leave out --joints"));
        }
        let read = read_motion(path, None, links).map_err(Error::from)?;
        note_columns(path, &read.unused, common);
        Ok(read.motion)
    }

    /// The readings of a recording, and above which a taxel is active.
    fn recording(
        &self,
        path: &Path,
        skin: Option<&Skin>,
        link: &str,
        common: &Common,
    ) -> anyhow::Result<TouchReadings> {
        let mut reader = ReadingsReader::open(path, ReadingsLayout::default()).map_err(Error::from)?;
        if !reader.has_times || reader.channels.len() != 1 {
            let what = format!("{} has no times, or several channels", path.display());
            return Err(advise(what, "give a recording with times and one channel"));
        }
        if reader.ids.is_none() && skin.is_none() {
            let what = format!("{} has no ids of taxels", path.display());
            return Err(advise(
                what,
                "give the skin with --skin, whose taxels the columns are in its order, or a recording with ids",
            ));
        }
        let mut readings =
            TouchReadings { ids: reader.ids.clone().unwrap_or_default(), ..TouchReadings::default() };
        let in_recording = |e: TouchesError| Error::Recording {
            recording: path.display().to_string(),
            source: Box::new(e.into()),
        };
        let (mut values, mut time) = (Vec::new(), 0.0);
        while reader.read(&mut values, &mut time).map_err(Error::from)? {
            readings.push(time, &values).map_err(in_recording)?;
        }
        if let Some(skin) = skin {
            readings.assign(skin, link).map_err(in_recording)?;
        }
        readings
            .set_threshold(&reader.channels[0], self.threshold, reader.rest.threshold)
            .map_err(in_recording)?;
        note!(common, "taxels are active above {:.3e}, in the unit of the readings", readings.threshold);
        if self.stiffness_kpa.is_some() {
            readings.become_forces(&reader.channels[0], self.taxel).map_err(in_recording)?;
        }
        Ok(readings)
    }

    /// The taxels of --skip.
    fn left_out(&self, common: &Common) -> anyhow::Result<BTreeSet<TaxelId>> {
        Ok(match &self.skip {
            None => BTreeSet::new(),
            Some(SkipArg::Ids(ids)) => ids.iter().map(|&id| TaxelId(id)).collect(),
            Some(SkipArg::File(path)) => {
                let (response, unused) = read_response(path).map_err(Error::from)?;
                note_columns(path, &unused, common);
                let is_faulty = |state| !matches!(state, TaxelState::Ok | TaxelState::Untested);
                let faulty = response.taxels.iter().filter(|known| is_faulty(known.state));
                faulty.map(|known| known.taxel).collect()
            }
        })
    }
}
