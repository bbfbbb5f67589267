//! `simulate --arm`: the log of an arm that rolls its skin over a fixed sphere.

use std::io::Write;

use dermatome::Error;
use dermatome::io::{
    IoError, replace_file, write_joint_values, write_touch_log, write_triangles, write_truth,
};
use dermatome::skin::TaxelId;
use dermatome::touches::{
    ARM_DESCRIPTION, ARM_JOINTS, ArmOptions, LogFaults, arm_joint_values, simulate_arm,
};

use crate::console::notes::note;
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, OutFile, length_mm};

/// The arm that rolls its skin over a fixed sphere.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Arm")]
pub(super) struct ArmArgs {
    /// Simulate the log of an arm that rolls its skin over a fixed sphere of 10 mm radius: poses and readings, for
    /// `touches`
    #[arg(long, conflicts_with_all = ["model", "noise", "rotation_noise_deg", "anchors", "anchor_noise", "normal_noise_deg", "contacts", "outliers"])]
    pub(super) arm: bool,
    /// With --arm: the force of the contact, which the arm keeps [default: 0.6]
    #[arg(long, value_name = "N", requires = "arm", conflicts_with = "indentation")]
    force_n: Option<f64>,
    /// With --arm: how well the arm keeps the force, standard deviation in percent
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, requires = "arm")]
    force_noise_percent: f64,
    /// With --arm: frames per second
    #[arg(long, value_name = "HZ", default_value_t = 20.0, requires = "arm")]
    rate_hz: f64,
    /// With --arm: how fast the contact travels over the skin, per second
    #[arg(long = "speed-mm", value_name = "MM", default_value = "50", value_parser = length_mm, requires = "arm")]
    speed: f64,
    /// With --arm: radius of the disc on which a taxel feels
    #[arg(long = "taxel-mm", value_name = "MM", default_value = "2", value_parser = length_mm, requires = "arm")]
    taxel: f64,
    /// With --arm: stiffness of the skin, pressure for each millimetre of depth
    #[arg(long, value_name = "KPA", default_value_t = 20.0, requires = "arm")]
    stiffness_kpa: f64,
    /// With --arm: noise of the mean pressure on a taxel, standard deviation
    #[arg(long, value_name = "KPA", default_value_t = 0.0, requires = "arm")]
    reading_noise_kpa: f64,
    /// With --arm: faults of real logs, as in late-ms=40,ids-percent=5: the clock of the readings is late; touches have
    /// ids of other taxels (ids-percent) or are at wrong places (places-percent); the stated radius of the fixed
    /// sphere is off (radius-percent); the joints of the arm have constant offsets (joints-deg) and play (play-deg)
    #[arg(long, value_name = "NAME=VALUE,...", requires = "arm", value_parser = faults)]
    fault: Option<LogFaults>,
    /// With --arm: file for the values of its joints, .csv
    #[arg(long, value_name = "OUT.csv", requires = "arm")]
    joints: Option<OutFile>,
    /// With --arm: file for its robot description, .urdf
    #[arg(long, value_name = "OUT.urdf", requires = "arm")]
    robot: Option<OutFile>,
}

/// A parser of faults, each at most once.
fn faults(text: &str) -> Result<LogFaults, String> {
    const NAMES: [&str; 6] =
        ["late-ms", "ids-percent", "places-percent", "radius-percent", "joints-deg", "play-deg"];
    let mut values = [None; NAMES.len()];
    for fault in text.split(',') {
        let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.is_finite());
        let parsed = fault
            .split_once('=')
            .and_then(|(name, value)| Some((NAMES.iter().position(|known| *known == name)?, number(value)?)));
        let Some((name, value)) = parsed else {
            let names = NAMES.join(", ");
            return Err(format!(
                "found {fault:?}; needed: a name and a number, as in late-ms=40; names are {names}"
            ));
        };
        if values[name].replace(value).is_some() {
            return Err(format!("{} comes twice; needed: each fault once", NAMES[name]));
        }
    }
    let [late, wrong_ids, wrong_places, radius_off, joints, play] = values.map(Option::unwrap_or_default);
    let [wrong_ids, wrong_places, radius_off] = [wrong_ids, wrong_places, radius_off].map(|x| x / 100.0);
    let (joint_offsets, play) = (joints.to_radians(), play.to_radians());
    Ok(LogFaults { late: late / 1e3, wrong_ids, wrong_places, radius_off, joint_offsets, play, seed: 0 })
}

/// The name of the link that carries the skin.
const LINK: &str = "end_effector";

/// Options that `simulate` has with and without an arm.
pub(super) struct Shared<'a> {
    pub(super) output: &'a OutFile,
    pub(super) truth: Option<&'a OutFile>,
    pub(super) triangles: Option<&'a OutFile>,
    /// The skin, the noise of the arm and the seed; all else is as by default.
    pub(super) options: ArmOptions,
    /// How deep the skin is pressed in, in m; 0: by the force.
    pub(super) indentation: f64,
}

impl ArmArgs {
    pub(super) fn run(&self, shared: &Shared<'_>, common: &Common) -> anyhow::Result<()> {
        if is_stream(shared.output) {
            let what = "the log of --arm is a table, which is not written to standard output";
            return Err(crate::console::errors::advise(what, "name a file, as -o log.csv"));
        }
        outputs::check_table(shared.output)?;
        let options = self.options(shared);
        let simulation = simulate_arm(&options).map_err(Error::from)?;
        let faults = LogFaults { seed: options.seed, ..self.fault.unwrap_or_default() };
        let faulty = faults.apply(&simulation.log).map_err(Error::from)?;
        let file = |path| common.outputs.file(path);
        write_touch_log(file(shared.output), LINK, &faulty.log).map_err(Error::from)?;
        if let Some(path) = &self.joints {
            let values = arm_joint_values(&faulty.log).map_err(Error::from)?;
            let times = faulty.log.frames.iter().map(|frame| frame.time.unwrap_or_default());
            let rows = times.zip(values.iter().map(|values| &values[..]));
            write_joint_values(file(path), &ARM_JOINTS, rows).map_err(Error::from)?;
        }
        if let Some(path) = &self.robot {
            let failed = |source| IoError::Write { path: path.to_path_buf(), source };
            replace_file(file(path), |out| out.write_all(ARM_DESCRIPTION.as_bytes()).map_err(failed))
                .map_err(Error::from)?;
        }
        let ids = simulation.truth.ids().map(|v| TaxelId(v.raw())).collect();
        if let Some(path) = shared.triangles {
            write_triangles(file(path), &ids, simulation.mesh.triangles.as_slice()).map_err(Error::from)?;
        }
        if let Some(path) = shared.truth {
            write_truth(file(path), &ids, &simulation.truth).map_err(Error::from)?;
            outputs::drop_triangles(path, common)?;
        }
        outputs::publish(common)?;
        let frames = faulty.log.frames.len();
        let touches = faulty.log.frames.chunk_by(|a, b| a.touch == b.touch).count();
        let depth = simulation.depth * 1e3;
        note!(common, "{} taxels, {touches} touches with {frames} frames, {depth:.3} mm deep", ids.len());
        for (what, touches) in [("wrong ids", &faulty.wrong_ids), ("wrong places", &faulty.wrong_places)] {
            if !touches.is_empty() {
                let numbers: Vec<String> = touches.iter().map(u64::to_string).collect();
                note!(common, "{what} in the touches {}", numbers.join(", "));
            }
        }
        if faults.joint_offsets > 0.0 {
            let offsets = ARM_JOINTS.iter().zip(faulty.joint_offsets);
            let offsets: Vec<String> =
                offsets.map(|(name, q)| format!("{name} {:.3}", q.to_degrees())).collect();
            note!(common, "the joints are off by {} degrees", offsets.join(", "));
        }
        Ok(())
    }

    fn options(&self, shared: &Shared<'_>) -> ArmOptions {
        let options = ArmOptions {
            taxel_radius: self.taxel,
            stiffness: self.stiffness_kpa * 1e6,
            force_noise: self.force_noise_percent / 100.0,
            speed: self.speed,
            rate: self.rate_hz,
            noise: self.reading_noise_kpa * 1e3,
            ..shared.options
        };
        let by_depth = (shared.indentation > 0.0).then(|| options.force_at(shared.indentation));
        ArmOptions { force: self.force_n.or(by_depth).unwrap_or(options.force), ..options }
    }
}
