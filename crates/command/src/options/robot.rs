//! Which parts of a robot description are its skin, and where its files are.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use dermatome::Error;
use dermatome::id::IdVec;
use dermatome::io::{Packages, RobotSurface, is_robot, read_joint_values, read_robot, robot_draft};
use dermatome::remesh::drop_crumbs;
use dermatome::robot::{JointKind, Robot, Role};
use dermatome::skin::{Draft, Link, LinkId, Motion, Skin};
use dermatome::touches::JointColumns;
use glob::Pattern;

use crate::console::errors::advise;
use crate::console::notes::{first_names, note, note_columns};
use crate::options::{Choice, Common, one_of, pattern};

/// Which parts of a robot are its skin.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Robots (.urdf, .xml)")]
pub(crate) struct RobotArgs {
    /// What of a robot is its skin [default: sensors, or visual if it has none, or
    /// collision]
    #[arg(long = "mesh", value_parser = one_of(&SURFACES), value_name = "WHICH")]
    surface: Option<RobotSurface>,
    /// Take the skin of the links of this name only, in which * and ? stand for any characters; may be
    /// given more than once [default: all links]
    #[arg(long, value_name = "NAME", value_parser = pattern)]
    links: Vec<Pattern>,
    /// Leave out the skin of the links of this name, in which * and ? stand for any characters; may be given more
    /// than once
    #[arg(long, value_name = "NAME", value_parser = pattern, hide_short_help = true)]
    without: Vec<Pattern>,
    /// Leave out the smallest pieces of a link, or of CAD without links, that have less than this share of its area together, and
    /// those with less than twelve taxels of --spacing, as screws and logos; the largest stays, and 0 keeps all [default: 0.5% of a robot]
    #[arg(long, value_name = "SHARE", value_parser = share, allow_hyphen_values = true, hide_short_help = true)]
    least_area: Option<f64>,
    /// Take the links of this name that hang by fixed joints as taxels of the links above them: at their origins,
    /// normals along z; * and ? stand for any characters, may be given more than once. They are the skin then
    #[arg(long, value_name = "NAME", value_parser = pattern, conflicts_with = "surface", hide_short_help = true)]
    taxels: Vec<Pattern>,
    /// The folder of a package that the file names as package://NAME/...; may be given more than once
    /// [default: a folder NAME above the file, in ROS_PACKAGE_PATH or in a share of AMENT_PREFIX_PATH]
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = package, hide_short_help = true)]
    packages: Vec<(String, PathBuf)>,
}

const SURFACES: [Choice<RobotSurface>; 3] = [
    ("visual", RobotSurface::Visual, "What is seen: the shape as it was designed"),
    ("collision", RobotSurface::Collision, "What collides: simpler shapes, as simulators use them"),
    ("sensors", RobotSurface::Sensors, "The taxels of <sensor> elements with <tactile>"),
];

impl RobotArgs {
    /// Whether a file is a robot description.
    pub(crate) fn describes(path: &Path) -> bool {
        is_robot(path)
    }

    /// Refuses options that a file of another kind has no use for.
    pub(super) fn refuse_unused(&self, path: &Path) -> anyhow::Result<()> {
        let patterns = [&self.links, &self.without, &self.taxels];
        let is_given = self.surface.is_some() || !self.packages.is_empty();
        if !is_given && patterns.iter().all(|p| p.is_empty()) {
            return Ok(());
        }
        let what = format!("{} is no robot description", path.display());
        Err(advise(
            what,
            "leave out --mesh, --links, --without, --taxels and --package, or give a .urdf or an .xml of MuJoCo",
        ))
    }

    /// Reads a robot, with the shapes and sensors of the links that are chosen.
    ///
    /// # Errors
    /// As [`read_robot`]; also if a pattern fits no link, or one of taxels none that hangs by a fixed joint.
    pub(crate) fn read(&self, path: &Path) -> anyhow::Result<Robot> {
        let mut robot = read_robot(path).map_err(Error::from)?;
        let fixed = || robot.joints.iter().filter(|joint| joint.kind == JointKind::Fixed);
        let fits = |pattern: &Pattern| fixed().any(|joint| pattern.matches(&robot.links[joint.link].name));
        if let Some(none) = self.taxels.iter().find(|pattern| !fits(pattern)) {
            let what =
                format!("{} has no link of the name {none} in --taxels by a fixed joint", path.display());
            return Err(advise(what, "`dermatome info` lists its links and how they move"));
        }
        robot.add_taxels(|name| self.taxels.iter().any(|pattern| pattern.matches(name)));
        let names = || robot.links.iter().map(|link| &*link.name);
        let all = [("--links", &self.links), ("--without", &self.without)];
        let all =
            all.into_iter().flat_map(|(option, patterns)| patterns.iter().map(move |own| (option, own)));
        let unmatched = |(_, pattern): &(_, &glob::Pattern)| !names().any(|name| pattern.matches(name));
        if let Some((option, none)) = all.into_iter().find(unmatched) {
            let what = format!("{} has no link of the name {none} in {option}", path.display());
            return Err(advise(what, "`dermatome info` lists its links; * stands for any characters"));
        }
        {
            let links = &robot.links;
            let fits =
                |patterns: &[Pattern], name: &str| patterns.iter().any(|pattern| pattern.matches(name));
            let is_chosen =
                |name: &str| (self.links.is_empty() || fits(&self.links, name)) && !fits(&self.without, name);
            robot.shapes.retain(|shape| is_chosen(&links[shape.link].name));
            robot.sensors.retain(|sheet| sheet.link.is_some_and(|link| is_chosen(&links[link].name)));
        }
        Ok(robot)
    }

    /// Reads the skin of a robot as it was written.
    ///
    /// # Errors
    /// As [`Self::read`] and [`robot_draft`].
    pub(super) fn read_draft(&self, path: &Path) -> anyhow::Result<Draft> {
        let robot = self.read(path)?;
        let packages = Packages { folders: self.packages.clone(), ..Packages::from_env() };
        let surface = self.surface.unwrap_or_default();
        Ok(robot_draft(path, &robot, surface, &packages).map_err(Error::from)?)
    }
}

/// The share of a link's area that its small pieces have together at most, unless another is given.
const LEAST_AREA: f64 = 0.005;

impl RobotArgs {
    /// Leaves out the small pieces of the links of a `robot`, or of other CAD where that is asked for; prints which, and
    /// whether the collision shapes of the robot are fewer.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub(crate) fn drop_crumbs(
        &self,
        robot: Option<&Path>,
        skin: &mut Skin,
        spacings: Option<&[f64]>,
        common: &Common,
    ) -> anyhow::Result<()> {
        let least = self.least_area.or(robot.map(|_| LEAST_AREA));
        let Some(least) = least else { return Ok(()) };
        let robot = robot.map(|path| self.read(path)).transpose()?;
        let surface = self.surface.unwrap_or_default();
        // Taxels of sensors are the skin itself.
        let has_sensors = robot.as_ref().is_some_and(|robot| !robot.sensors.is_empty());
        if surface == RobotSurface::Auto && has_sensors || surface == RobotSurface::Sensors {
            return Ok(());
        }
        let pieces = skin.patches.len();
        let names = drop_crumbs(skin, least, spacings);
        if names.is_empty() {
            return Ok(());
        }
        let shapes = robot.iter().flat_map(|robot| &robot.shapes);
        let shapes = shapes.filter(|shape| shape.role == Role::Collision).count();
        let fewer = if surface != RobotSurface::Collision && (1..pieces).contains(&shapes) {
            format!("; --mesh collision has {shapes} shapes")
        } else {
            String::new()
        };
        let of_links = if robot.is_some() { "pieces of links" } else { "pieces" };
        note!(
            common,
            "small {of_links} are left out, {} of {pieces}: {}; --least-area 0 keeps them{fewer}",
            names.len(),
            first_names(&names)
        );
        Ok(())
    }
}

/// A parser of a share: a number from 0 to 1, or from 0% to 100%.
fn share(text: &str) -> Result<f64, String> {
    let (digits, whole) = text.strip_suffix('%').map_or((text, 1.0), |digits| (digits, 100.0));
    let share = digits.trim().parse::<f64>().ok().map(|x| x / whole).filter(|x| (0.0..=1.0).contains(x));
    share.ok_or_else(|| "needed: a share from 0 to 1, or from 0% to 100%".into())
}

/// The values of the joints of a robot, as an argument gives them.
#[derive(Debug, Clone)]
pub(crate) enum JointsArg {
    /// A table.
    File(PathBuf),
    /// Some of them, by name.
    Values(Vec<(String, f64)>),
}

/// A parser of [`JointsArg`].
pub(crate) fn joints(text: &str) -> Result<JointsArg, String> {
    if !text.contains('=') {
        return Ok(JointsArg::File(text.into()));
    }
    let pair = |pair: &str| {
        let (name, value) = pair.split_once('=')?;
        Some((name.trim().to_owned(), value.trim().parse().ok().filter(|x: &f64| x.is_finite())?))
    };
    let pairs: Option<Vec<_>> = text.split(',').map(pair).collect();
    let pairs = pairs.ok_or("needed: FILE.csv, or NAME=VALUE,... in rad and m")?;
    let mut names = HashSet::new();
    match pairs.iter().find(|(name, _)| !names.insert(name)) {
        Some((name, _)) => Err(format!("needed: each joint once; {name} has several values")),
        None => Ok(JointsArg::Values(pairs)),
    }
}

impl JointsArg {
    /// How `links` move where the joints of the robot in `path` have some values; none: 0.
    pub(crate) fn motion(
        joints: Option<&Self>,
        path: &Path,
        links: &IdVec<LinkId, Link>,
        common: &Common,
    ) -> anyhow::Result<Motion> {
        let robot = read_robot(path).map_err(Error::from)?;
        let rest = || Ok(JointValues::at_rest(&robot));
        let values = joints.map_or_else(rest, |joints| joints.values(&robot, common))?;
        Ok(robot.motion(&values.rows, links).map_err(Error::from)?)
    }

    /// The values of all joints at one time.
    ///
    /// # Errors
    /// As [`Self::values`]; also of a table with times, or several rows.
    pub(crate) fn one_pose(&self, robot: &Robot, common: &Common) -> anyhow::Result<Vec<f64>> {
        let JointValues { mut rows, has_times, .. } = self.values(robot, common)?;
        let found = match (rows.len(), has_times) {
            (1, false) => return Ok(rows.remove(0).1),
            (1, true) => "a column of times".to_owned(),
            (rows, _) => format!("{rows} rows"),
        };
        let what = format!("the table of --joints has {found}; needed: one row without a time");
        Err(advise(
            what,
            "give the values of one pose; `dermatome lookup --pose` takes poses at several times",
        ))
    }

    /// The values of all joints, at the times there are; prints what is beyond the limits, in an unlikely unit or not used.
    ///
    /// # Errors
    /// As [`read_joint_values`]; also if no joint has a name that is given, or it has no value of its own.
    pub(crate) fn values(&self, robot: &Robot, common: &Common) -> anyhow::Result<JointValues> {
        let values = match self {
            Self::File(path) => {
                let table = read_joint_values(path, robot).map_err(Error::from)?;
                note_columns(path, &table.unused, common);
                JointValues { rows: table.rows, given: table.given, has_times: table.has_times }
            }
            Self::Values(pairs) => {
                let place = |(name, value): &(String, f64)| {
                    let place = robot.joints.iter().position(|joint| joint.name == *name);
                    let place = place
                        .filter(|&k| robot.joints[k].kind.has_value() && robot.joints[k].mimic.is_none());
                    let help = "`dermatome info` lists the joints; one that is fixed, floating, planar or a ball, or follows another, has no value";
                    let what = || format!("the robot has no joint {name:?} with a value of its own");
                    place.map(|place| (place, *value)).ok_or_else(|| advise(what(), help))
                };
                let pairs = pairs.iter().map(place).collect::<anyhow::Result<Vec<_>>>()?;
                let given = pairs.iter().map(|&(joint, _)| joint).collect();
                JointValues { rows: vec![(0.0, robot.joint_values(&pairs))], given, has_times: false }
            }
        };
        let beyond = values.rows.iter().flat_map(|(_, values)| robot.beyond_limits(values));
        let mut names: Vec<String> = beyond.map(|(joint, _)| joint.name.clone()).collect();
        names.sort();
        names.dedup();
        if !names.is_empty() {
            note!(
                common,
                "beyond the limits of the joints {}: the values are taken as they are",
                first_names(&names)
            );
        }
        let unlikely = JointColumns::new(robot, &values.rows).unlikely();
        let names: Vec<String> = unlikely.into_iter().map(|joint| joint.name).collect();
        if !names.is_empty() {
            note!(
                common,
                "beyond 360 degrees or 10 m, as other units would be, of the joints {}: the values are taken in rad and m",
                first_names(&names)
            );
        }
        Ok(values)
    }
}

/// The values of the joints of a robot.
pub(crate) struct JointValues {
    /// Those of all joints, at some times (s).
    pub(crate) rows: Vec<(f64, Vec<f64>)>,
    /// The joints of which values are given; the others are at 0, or follow another.
    pub(crate) given: Vec<usize>,
    /// Whether the times are given, of a table.
    has_times: bool,
}

impl JointValues {
    /// All joints at 0, or where those are that they follow.
    pub(crate) fn at_rest(robot: &Robot) -> Self {
        Self { rows: vec![(0.0, robot.joint_values(&[]))], given: Vec::new(), has_times: false }
    }
}

fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && Path::new(folder).is_dir() => {
            Ok((name.into(), folder.into()))
        }
        Some((_, folder)) => Err(format!("needed: NAME=DIR; {folder:?} is no folder")),
        None => Err("needed: NAME=DIR, the name of a package and its folder".into()),
    }
}
