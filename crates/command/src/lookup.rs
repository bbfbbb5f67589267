//! `dermatome lookup MAP.glb CONTACTS.csv`: where contacts are on the map, on every level, and back.

mod answers;
mod back;
mod fields;
mod contacts;
mod player;
mod readings;
mod refusals;
mod robot;

use std::path::Path;
use std::process::ExitCode;

use dermatome::Error;
use dermatome::contact::{ContactIndex, IndexOptions};
use dermatome::io::{IoError, replace_file};
use dermatome::signal::Spreader;
use glob::Pattern;

use crate::console::errors::advise;
use crate::console::notes::note;
use crate::console::print::{STANDARD_OUTPUT, StandardOutput};
use crate::files::outputs::{self, is_stream};
use crate::lookup::answers::{Answers, Question};
use crate::lookup::back::Back;
use crate::lookup::contacts::{Contacts, FrameArg, LARGEST, Meaning};
use crate::lookup::player::Player;
use crate::lookup::readings::Readings;
use crate::lookup::robot::Robot;
use crate::options::{
    Common, InPath, JointsArg, LevelArg, OutFile, RegionsArgs, RobotArgs, Unit, joints, length, length_mm,
    level, pattern, whole,
};

/// Find the map cells under contacts, on every level.
///
/// A row of contacts that names a `link` is in the frame of that link, with skin or without; others
/// are in the world, or with --frame link in that of the only link with skin. One that names an
/// `only_link` is on the skin of that link. Links without a name are called link0, link1 and so on. Answers are in the frame of the contact, which the column `frame` names:
/// `x,y,z` the point of the skin, `nx,ny,nz` its normal. The output can be the input of another run: its
/// rows are read in the frame that `frame` names, and `link` is ignored. Lengths are in metres. A contact far from
/// the skin has the patch `off skin`. Rows that cannot be answered are listed as an error in the end
/// (exit code 2), the others are answered all the same.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// The contacts: a table with columns x,y,z in m, link if they are in the frame of a link, and
    /// only_link if they are on one; `-`: standard input
    #[arg(value_name = "CONTACTS.csv")]
    contacts: InPath,
    /// File for the answers; `-`: standard output
    #[arg(short, long, default_value = "-", value_name = "OUT.csv")]
    output: OutFile,
    /// Give the rows of this level only, or of one without a mesh: body.L0, body.L1, ... of the whole body,
    /// arm.thermal.L0 of a modality; may be given more than once
    /// [default: all levels of the patches]
    #[arg(long = "level", value_name = "K|NAME.LK", value_parser = level)]
    levels: Vec<LevelArg>,
    /// Unit of the lengths in CONTACTS.csv: places and radii; answers are in m [default: m]
    #[arg(long, value_enum, value_name = "UNIT")]
    unit: Option<Unit>,
    /// Take the patches of this name only, in which * and ? stand for any characters; may be given
    /// more than once [default: all patches]
    #[arg(long = "patch", value_name = "NAME", value_parser = pattern)]
    patches: Vec<Pattern>,
    /// Frame of the contacts that name no link [default: world]
    #[arg(long, value_enum)]
    frame: Option<FrameArg>,
    /// Contacts farther than this are off the skin, in m; `inf`: none [default: ten spacings of the
    /// patch's taxels]. With --nearest it is the distance of the centres, with --ray the length of the
    /// ray [default: inf]
    #[arg(long, value_name = "D", value_parser = distance, conflicts_with = "within")]
    max_distance: Option<f64>,
    #[command(flatten)]
    regions: RegionsArgs,
    #[command(flatten)]
    question: QuestionArgs,
    /// Poses of links: a table with columns link,x,y,z,qx,qy,qz,qw (in the world and in m; other links
    /// keep their pose relative to their parent) and, if they move, time in s; a .glb with an animation; or
    /// a robot (.urdf, .xml), with --joints. Contacts are matched by their `time`
    #[arg(long, value_name = "P.csv")]
    pose: Option<InPath>,
    /// Values of the joints of the robot of --pose, in rad and m [default: 0]: NAME=VALUE,..., or a table with
    /// a column for each joint and, if they move, time in s
    #[arg(long, value_name = "FILE|NAME=VALUE", value_parser = joints, requires = "pose")]
    joints: Option<JointsArg>,
    /// Pose the links by this animation of the map, or of the .glb of --pose
    #[arg(long, value_name = "NAME")]
    animation: Option<String>,
    /// Write the forces of the contacts, spread over the taxels, as a recording that `render` reads:
    /// a .csv or .npz. A contact with a radius is a sphere around x,y,z; those of one time in a row are
    /// one frame, points farther from the skin than --max-distance (default: ten spacings) press nothing
    #[arg(long, value_name = "OUT.csv", conflicts_with = "ray")]
    readings: Option<OutFile>,
    /// Radius of the discs on which taxels feel, in mm, for --readings
    #[arg(long = "taxel-radius-mm", value_name = "R", default_value = "2", value_parser = radius, requires = "readings")]
    taxel_radius: f64,
}

/// What is asked of each contact, if not the nearest point of the skin.
#[derive(Debug, clap::Args)]
#[group(multiple = false)]
struct QuestionArgs {
    /// Answer in constant time: `least` and `most` bound the distance from the skin, `distance` is their mean. The point and its
    /// cells are those of a face near the nearest; a patch without a level answers with its coarsest: see `level`
    #[arg(long)]
    reactive: bool,
    /// Give the N nearest taxels, and on other levels fields: `distance` is that of the centre
    #[arg(long, value_name = "N", value_parser = count)]
    nearest: Option<usize>,
    /// Give all taxels, and on other levels fields, with their centre within R m of the contact, or
    /// of the sphere of its `radius`
    #[arg(long, value_name = "R", value_parser = finite_distance)]
    within: Option<f64>,
    /// Follow the ray from the contact along `nx,ny,nz` to the skin: `distance` is its length, or where
    /// it meets no skin the distance of the contact from the skin
    #[arg(long)]
    ray: bool,
    /// The way back: CONTACTS.csv has places on maps, columns `u,v` in m or else `px,py`, and `patch`,
    /// `level` and `time`. One row for each sheet of the map that lies there; `x,y,z` is in the world, or
    /// with --frame link in that of the link. `off_chart` is the distance from the map, of which the
    /// nearest place is answered, in m
    #[arg(long, conflicts_with_all = ["levels", "max_distance", "readings"])]
    from_map: bool,
}

impl Args {
    fn unit(&self) -> Unit {
        self.unit.unwrap_or(Unit::M)
    }

    fn frame(&self) -> FrameArg {
        self.frame.unwrap_or(FrameArg::World)
    }

    /// Asks for what is not given, if contacts are far from the skin; empty: all is.
    fn doubts(&self) -> String {
        let unit = self.unit.is_none().then_some(("in metres", "--unit"));
        let frame = self.frame.is_none().then_some(("in the frame of the world", "--frame"));
        let (asked, mut options): (Vec<_>, Vec<_>) = unit.into_iter().chain(frame).unzip();
        let mut doubts = Vec::new();
        if !asked.is_empty() {
            let has_limit =
                self.question.within.is_some() || self.question.ray || self.max_distance.is_some();
            options.extend((!has_limit).then_some("--max-distance"));
            doubts.push(format!("are they {}? ({})", asked.join(", and "), options.join(", ")));
        }
        let poses = self.pose.as_ref().map(|path| format!("are the poses of {} in metres?", path.display()));
        doubts.extend(poses);
        if doubts.is_empty() { String::new() } else { format!(": {}", doubts.join("; ")) }
    }
}

impl QuestionArgs {
    fn question(&self) -> Question {
        match (self.nearest, self.within) {
            (Some(count), _) => Question::Fields(count),
            (_, Some(distance)) => Question::Within(distance),
            _ if self.reactive => Question::Reactive,
            _ if self.ray => Question::Ray,
            _ => Question::Nearest,
        }
    }
}

fn distance(text: &str) -> Result<f64, String> {
    length(text).ok().filter(|d| *d >= 0.0).ok_or_else(|| "needed: a length, not negative".into())
}

fn finite_distance(text: &str) -> Result<f64, String> {
    distance(text).ok().filter(|d| *d <= LARGEST).ok_or_else(|| "needed: a length, 0 to 1e12 m".into())
}

fn radius(text: &str) -> Result<f64, String> {
    let radius = length_mm(text).ok().filter(|r| (0.0..=LARGEST).contains(r));
    radius.ok_or_else(|| "needed: a length, as in 2, 2mm or 0.002m".into())
}

fn count(text: &str) -> Result<usize, String> {
    whole(text, "a whole number above 0")
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    if !is_stream(&args.output) {
        outputs::check_table(&args.output)?;
    }
    let robot = Robot::read(&args.map, &args.patches, &args.levels, &args.regions, common)?;
    let motion = match args.pose.as_deref().filter(|path| RobotArgs::describes(path)) {
        Some(path) if args.animation.is_some() => {
            return Err(advise(
                format!("{} has no animations", path.display()),
                "leave out --animation; --joints move a robot",
            ));
        }
        Some(path) => Some(robot.joint_motion(path, args.joints.as_ref(), common)?),
        None if args.joints.is_some() => {
            return Err(advise("--joints are those of a robot", "give --pose its .urdf or .xml"));
        }
        None => robot.motion(&args.map, args.pose.as_deref(), args.animation.as_deref(), common)?,
    };
    if let Some(fields) = robot.fields.iter().find(|fields| fields.is_of_body).filter(|_| motion.is_some()) {
        note!(common, "fields of {} are those of the links at rest; poses move the skin alone", fields.name);
    }
    let player = Player::new(args.pose.as_deref().unwrap_or(&args.map), motion);
    let question = args.question.question();
    if !robot.fields.is_empty() && matches!(question, Question::Fields(_) | Question::Within(_)) {
        return Err(advise(
            "--nearest and --within are of levels with a mesh, not of the whole body or of modalities",
            "leave out --level NAME.LK; without --nearest it gives the fields of each contact",
        ));
    }
    let options = IndexOptions {
        reactive: question == Question::Reactive,
        fields: matches!(question, Question::Fields(_) | Question::Within(_)) || args.readings.is_some(),
    };
    let index = ContactIndex::with_options(&robot.map, &options).map_err(Error::from)?;
    if args.question.from_map {
        let frame = (args.frame(), player);
        let mut back = Back::open(&args.contacts, args.unit(), &robot, index, frame, common)?;
        let written = write(&args.output, common, &mut |path, output| back.answer(path, output));
        back.refusals.explain(written)?;
        outputs::publish(common)?;
        back.note(common);
        back.refusals.finish()?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut used = Vec::new();
    used.extend((question == Question::Ray).then_some("nx,ny,nz"));
    used.extend(matches!(question, Question::Within(_)).then_some("radius"));
    let readings = args.readings.as_ref().map(|path| {
        used.extend(["force", "radius"]);
        let spreader = Spreader { disc: args.taxel_radius, max_distance: args.max_distance };
        Readings::create(common.outputs.file(path), &robot.map, spreader)
    });
    let (unit, frame) = (args.unit(), args.frame());
    let meaning = Meaning { unit, frame };
    let mut contacts = Contacts::open(&args.contacts, meaning, &used, common)?;
    let readings = readings.transpose().map_err(Error::from)?;
    let mut answers =
        Answers::new(&robot, index, question, args.max_distance, player).with_readings(readings);
    let written =
        write(&args.output, common, &mut |path, output| answers.answer(&mut contacts, path, output));
    contacts.refusals.explain(written)?;
    outputs::publish(common)?;
    contacts.note_unused(common);
    answers.note(&contacts, &args.doubts(), common);
    contacts.refusals.finish()?;
    Ok(ExitCode::SUCCESS)
}

/// Lets `answer` write the table of answers.
fn write(
    path: &Path,
    common: &Common,
    answer: &mut dyn FnMut(&Path, &mut (dyn std::io::Write + Send)) -> Result<(), IoError>,
) -> anyhow::Result<()> {
    let written = if is_stream(path) {
        answer(STANDARD_OUTPUT.as_ref(), &mut StandardOutput::new(&common.outputs))
    } else {
        replace_file(common.outputs.file(path), |output| answer(path, output))
    };
    Ok(written.map_err(Error::from)?)
}
