//! Errors as a user reads them, in three lines: what, why, what to do. Advice on errors of the library
//! is here alone: the library does not know the options of the command.

use std::fmt;
use std::io::{self, IsTerminal};
use std::path::Path;
use std::process::ExitCode;

use dermatome::Error;
use dermatome::atlas::AtlasError;
use dermatome::calib::CalibError;
use dermatome::cut::CutError;
use dermatome::design::DesignError;
use dermatome::diff::DiffError;
use dermatome::flatten::FlattenError;
use dermatome::image::ImageError;
use dermatome::io::{Feature, IoError, file_kind};
use dermatome::map::MapError;
use dermatome::pattern::PatternError;
use dermatome::plot::PlotError;
use dermatome::registration::RegistrationError;
use dermatome::response::ResponseError;
use dermatome::signal::{OrderError, SignalError};
use dermatome::skin::SkinError;
use dermatome::touches::TouchesError;

use crate::console::print::{line, print, say};
use crate::options::ColorChoice;

/// Exit code of a skin with problems, and of a map without some of its patches.
pub(crate) const INCOMPLETE: u8 = 1;

/// Exit code of bad usage and bad input, and of a calibration that did not converge.
pub(crate) const BAD_INPUT: u8 = 2;

/// What a user can do about an error of the command's own, as a sentence.
#[derive(Debug)]
pub(crate) struct Advice(pub String);

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Advice {}

/// An error with advice of the command's own.
pub(crate) fn advise(what: impl fmt::Display, help: impl Into<String>) -> anyhow::Error {
    anyhow::Error::new(Advice(help.into())).context(what.to_string())
}

/// Prints what clap says: help on standard output, an error on standard error.
pub(crate) fn usage(error: &clap::Error) -> ExitCode {
    if error.use_stderr() {
        // Without a standard error the exit code is all that is left.
        let _ = error.print();
        return ExitCode::from(BAD_INPUT);
    }
    match print(&error.render().to_string()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(full) => report(&full, ColorChoice::Auto),
    }
}

/// A label in colour where the terminal shows it.
fn paint(text: &str, code: &str, color: ColorChoice) -> String {
    let is_painted = match color {
        ColorChoice::Always => true,
        ColorChoice::Never => false,
        ColorChoice::Auto => std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none(),
    };
    if is_painted { format!("\u{1b}[1;{code}m{text}\u{1b}[0m") } else { text.to_owned() }
}

/// Prints an error.
pub(crate) fn report(error: &anyhow::Error, color: ColorChoice) -> ExitCode {
    let label = |text: &str, code| paint(text, code, color);
    let mut reasons: Vec<String> = Vec::new();
    for cause in error.chain().filter(|cause| !cause.is::<Advice>()).map(ToString::to_string) {
        // Most errors quote their source in their own sentence.
        if !reasons.last().is_some_and(|last| last.contains(&cause)) {
            reasons.push(cause);
        }
    }
    let what = reasons.first().cloned().unwrap_or_default();
    say(format_args!("{} {}", label("error:", "31"), line(&what)));
    if reasons.len() > 1 {
        say(format_args!("{} {}", label("  why:", "33"), line(&reasons[1..].join(": "))));
    }
    if let Some(help) = help(error) {
        say(format_args!("{} {}", label(" help:", "32"), line(&help)));
    }
    ExitCode::from(BAD_INPUT)
}

/// Whether the reader of an output closed it.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    let kind = |cause: &(dyn std::error::Error + 'static)| Some(cause.downcast_ref::<io::Error>()?.kind());
    error.chain().any(|cause| kind(cause) == Some(io::ErrorKind::BrokenPipe))
}

/// What a user can do about an error, as a sentence.
pub(crate) fn help(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(|cause| {
        if let Some(advice) = cause.downcast_ref::<Advice>() {
            return Some(advice.0.clone());
        }
        if let Some(e) = cause.downcast_ref::<IoError>() {
            return Some(io_help(e));
        }
        cause.downcast_ref::<Error>().map(library_help)
    })
}

/// The answer to an error in a skin that no option or command repairs.
const CORRECT: &str =
    "correct the file, or export it again; `dermatome check` lists what is wrong with a skin";

/// The answer to a file that cannot be read, by `check` neither.
const CORRECT_FILE: &str = "correct the file, or export it again";

const BUILD_AGAIN: &str = "make the map again with `dermatome build`";

/// What repairs an error of the library: an option, another command, or a better file.
fn library_help(error: &Error) -> String {
    match error {
        Error::Io(e) => return io_help(e),
        Error::Patch { source, .. } | Error::Recording { source, .. } => return library_help(source),
        Error::Skin(SkinError::Several { errors, valid }) => return several_help(errors, *valid),
        Error::Several(errors) => {
            let first = errors.first().map(library_help).unwrap_or_default();
            let others = "`dermatome build --keep-going` maps the other patches";
            return if first.contains("--keep-going") { first } else { format!("{first}; {others}") };
        }
        Error::Atlas(AtlasError::TooLarge { fits_mm, .. } | AtlasError::TooManyPixels { fits_mm, .. }) => {
            return format!("use larger pixels: --pixel-mm {fits_mm} or more");
        }
        _ => {}
    }
    option_help(error).to_owned()
}

/// What repairs an error, where the answer is the same for all of its kind.
fn option_help(error: &Error) -> &'static str {
    match error {
        Error::Skin(e) | Error::Signal(SignalError::Skin(e)) => match e {
            SkinError::Gap { .. } => "change --gap",
            SkinError::NonManifoldEdges { .. } => {
                "--repair splits such edges into sheets; `dermatome check` lists them"
            }
            SkinError::DuplicateFaces { .. } => "--repair drops such faces; `dermatome check` lists them",
            SkinError::NotOrientable { .. } => {
                "--repair cuts the surface open where its faces are wound differently; `dermatome check` lists such \
                 edges"
            }
            SkinError::TooFewPlaces { .. } | SkinError::NoSurface { .. } | SkinError::NoFace { .. } => {
                "give the taxels triangles, or normals that distinguish the sides of thin parts; check --unit"
            }
            _ => CORRECT,
        },
        Error::Design(e) => match e {
            DesignError::Module { .. } => "correct the drawing of the module, or give --module triangle:L",
            DesignError::TooLarge { .. } => {
                "give a smaller --module; --unit mm reads a file in millimetres, --patch and --links take others"
            }
            DesignError::TooLoose { .. } => "give a smaller --tolerance: lengths have a unit, as 1mm",
            DesignError::TooMany { .. } => "give a larger --module; --unit says the unit of the file",
            DesignError::NothingFits { .. } => {
                "give a smaller --module or a larger --tolerance; --bend-radius lets modules bend"
            }
            _ => "change the option: `dermatome help design` lists what each takes",
        },
        Error::Diff(e) => match e {
            DiffError::NothingShared { .. } => {
                "compare two files of one skin; `dermatome info` lists their patches"
            }
            _ => "change the option: `dermatome help diff` lists what each takes",
        },
        Error::Flatten(e) => match e {
            FlattenError::NotADisk { .. } => "leave out --cut none, or give each piece a file of its own",
            FlattenError::Option { .. } => {
                "change the option: `dermatome help flatten` lists what each takes"
            }
            FlattenError::Size { .. } => "give positions in metres, or say their --unit",
            FlattenError::BoundaryPlace { .. }
            | FlattenError::BoundaryTaxel { .. }
            | FlattenError::BoundaryShape { .. } => {
                "correct --boundary: it names each taxel of the outer boundary once, counter-clockwise"
            }
            FlattenError::NoRoom { .. } => "use --boundary circle, or split the face",
            FlattenError::NotInjective { .. } => {
                "cut it open with --cut FILE, remesh it with --spacing, or take --overlap allow"
            }
            FlattenError::Mesh(_) | FlattenError::Pyramid(_) | FlattenError::PointFace { .. } => CORRECT,
            _ => {
                "remesh the thin part, try another --method, or map the other patches with `dermatome build \
                 --keep-going`"
            }
        },
        Error::Cut(CutError::Mesh(_)) => CORRECT,
        Error::Cut(CutError::AreaRatio { .. }) => "give --max-area-ratio a number above 1",
        Error::Cut(_) => {
            "correct the table of --cut: `from,to` are the ids of taxels that an edge joins; --cut auto finds a seam"
        }
        Error::Calib(e) => match e {
            CalibError::IndefiniteEdge { .. } => {
                "write the inverse of the covariance, upper triangle row by row: x y z, then rotations; or take the \
                 nearest matrices with --clip-information"
            }
            CalibError::NoJointColumns { .. } => {
                "write the contacts with `touches --fit-joints`, or leave out --fit-joints"
            }
            CalibError::NoTriangulation { .. } => {
                "give the triangles with --triangles FILE.csv, or write .csv or .g2o"
            }
            CalibError::NoInitialValue { .. } => "choose another start: --initial chordal or --initial tree",
            CalibError::BadOption { .. } => "change the option: `dermatome help` lists what each takes",
            _ => "correct the file of observations",
        },
        Error::Signal(e) => match e {
            SignalError::DuplicateId { .. } => "--duplicates first takes the first of them",
            SignalError::Width { .. } => {
                "give readings with ids: a .csv whose header names them, or a .npz with an array `ids`; the axes of an \
                 array of three are frames, taxels, channels, or with --layout tcn frames, channels, taxels"
            }
            SignalError::NoneMatched { .. } => {
                "give the map of the skin that was recorded; `dermatome info` lists what a map has"
            }
            SignalError::ChannelCount { .. } | SignalError::ChannelTwice { .. } => {
                "give each channel one name and one unit, as in --channels force.N,temperature --readings-unit N,K"
            }
            SignalError::NoChannel { .. } => "give --channel one of them, or leave it out to take the first",
            SignalError::NoTouch { .. } => {
                "state its unit with --readings-unit, or `kind` in a layout; or leave out --zero, --gain and --response"
            }
            SignalError::NoTimes => "say how many frames come in a second with --rate HZ",
            SignalError::Option { .. } => "change the option: `dermatome help` lists what each takes",
            _ => "correct the readings",
        },
        Error::Order(e) => match e {
            OrderError::Symmetric { .. } => {
                "give --known three columns: a table with columns column,taxel_id"
            }
            OrderError::NoTouch { .. } => "check --threshold and --zero, and that the recording has touches",
            OrderError::Unconnected { .. } | OrderError::Poor { .. } => {
                "record more touches, and give all recordings to --recording"
            }
            OrderError::KnownTwice { .. }
            | OrderError::KnownColumnTwice { .. }
            | OrderError::KnownColumn { .. }
            | OrderError::KnownTaxel { .. }
            | OrderError::Contradiction { .. } => "correct --known",
            OrderError::TooLarge { .. } => "find the order of one patch at a time",
            _ => "correct the readings",
        },
        Error::Response(e) => match e {
            ResponseError::TooFewPresses { .. } => "record more touches, and give all recordings",
            ResponseError::Saturated { .. } | ResponseError::ForeignPower { .. } => {
                "record lighter touches, or use steps of pressure with --pressure"
            }
            ResponseError::ForeignContacts { .. } => "use steps of pressure with --pressure",
            ResponseError::NoSteps { .. }
            | ResponseError::StepTime { .. }
            | ResponseError::StepPressure { .. }
            | ResponseError::StepsOutside { .. }
            | ResponseError::StepsDoNotFit { .. } => {
                "correct --pressure: a row where each step begins, in Pa, or as in pressure[kPa], on the clock of the recording"
            }
            ResponseError::ForceTime { .. }
            | ResponseError::Force { .. }
            | ResponseError::ForceUnit { .. }
            | ResponseError::TooFewForces { .. }
            | ResponseError::ForcesDoNotFit { .. } => {
                "correct --force: forces in N, or as in force[mN], 0 where nothing touches, on the clock of the recording"
            }
            ResponseError::NotRelative => "give --response a file that touches alone made, or leave it out",
            _ => "correct the readings",
        },
        Error::Touches(e) => match e {
            TouchesError::NoPose { .. } => "give the columns, or poses with --pose",
            TouchesError::OffClock { .. } => "give log, poses and readings the times of one clock, in s",
            TouchesError::SeveralLinks { .. } | TouchesError::NoLink { .. } => {
                "name the link of the skin with --link"
            }
            TouchesError::NoRobotLink { .. } | TouchesError::NoMovingJoint { .. } => {
                "name the links of the log as the robot of --pose does, or leave out --fit-joints"
            }
            TouchesError::NoJointValues { .. } => {
                "add a column for the joint to --joints, or leave out --fit-joints"
            }
            TouchesError::NoReadings { .. } | TouchesError::TwoReadings { .. } => {
                "give the column `taxels`, or a recording with --readings"
            }
            TouchesError::UnknownTaxel { .. } => {
                "give the drawing of this skin with --skin, or leave out --skin"
            }
            TouchesError::ReadingTime { .. } => "give the readings of one trial, whose times ascend",
            TouchesError::SharedId { .. } => {
                "add a column `link` to the log, or give the taxels of --skin ids that differ"
            }
            TouchesError::Columns { .. } => "give --skin the skin that was recorded",
            TouchesError::NoOutside { .. } => "give a drawing of the skin with --skin",
            TouchesError::NothingFelt { .. } => "check --skip and --threshold, and that the log has touches",
            TouchesError::BadOption { .. } | TouchesError::Calib(CalibError::BadOption { .. }) => {
                "change the option: `dermatome help` lists what each takes"
            }
            _ => "correct the log",
        },
        Error::Image(ImageError::Level { .. }) => "give one of them, or leave out --level to draw all",
        Error::Image(ImageError::NoPixel { .. }) => BUILD_AGAIN,
        Error::Plot(e) => match e {
            PlotError::Channel { .. } | PlotError::Range { .. } => {
                "give --range two numbers, the lower one first"
            }
            PlotError::NoCovariances { .. } => "calibrate the skin with covariances, or use --show fields",
            PlotError::UnknownLevel { .. } => "give one of them, or leave out --level to draw the finest",
            PlotError::Width { .. } | PlotError::Size { .. } => {
                "choose another --width, or draw fewer patches and levels"
            }
            PlotError::Skin(_) => CORRECT,
            _ => BUILD_AGAIN,
        },
        Error::Pattern(e) => match e {
            PatternError::Sheet { .. } => "give --sheet A4, A3, or width and height of the paper in mm",
            PatternError::TooManySheets { .. } => {
                "take larger sheets or leave out --sheet, draw fewer patches with --patch, or state the unit of the file (--unit)"
            }
            _ => BUILD_AGAIN,
        },
        Error::Map(
            MapError::RegionName { .. }
            | MapError::NoTaxelInRegion { .. }
            | MapError::NoPatchOfRegion { .. }
            | MapError::Corners { .. }
            | MapError::OutsideMap { .. }
            | MapError::Crosses { .. },
        ) => "correct --regions",
        Error::Map(MapError::SharedLink { .. }) => {
            "name the taxels of each by a table, columns taxel_id,region"
        }
        Error::Map(MapError::Rounded { .. }) => {
            "remesh it with --spacing, remove slivers (`dermatome check` lists them), move it near the origin of its \
             link, or leave such patches out with `dermatome build --keep-going`"
        }
        Error::Registration(RegistrationError::OtherHand { .. }) => {
            "if the skin is that of the other hand, give --mirror; if it is not, leave it out"
        }
        Error::Registration(RegistrationError::Flipped { .. }) => "leave out --method",
        Error::Registration(RegistrationError::System { .. }) => BUILD_AGAIN,
        Error::Registration(_) => "correct the table of --landmarks",
        Error::Atlas(AtlasError::OtherPlane { .. }) => "draw one on the other with `dermatome build --atlas`",
        Error::Atlas(AtlasError::PixelBeyondPatches { .. }) => "give a smaller --pixel-mm: its unit is mm",
        Error::Remesh(_) => {
            "change --spacing, state the unit of the file (--unit), or take other patches with --patch or --links"
        }
        Error::Mesh(_) | Error::Pyramid(_) => CORRECT,
        _ => BUILD_AGAIN,
    }
}

/// What repairs several patches of a skin, of which `valid` others are good.
fn several_help(errors: &[SkinError], valid: usize) -> String {
    let is_repaired = |e: &SkinError| {
        matches!(
            e,
            SkinError::NonManifoldEdges { .. }
                | SkinError::DuplicateFaces { .. }
                | SkinError::NotOrientable { .. }
        )
    };
    let repair = "--repair drops duplicate faces, and splits edges of more than two faces and surfaces with one side; ";
    let repair = if errors.iter().any(is_repaired) { repair } else { "" };
    let rest = "`dermatome build --keep-going` maps the other patches; ";
    let rest = if valid > 0 { rest } else { "" };
    match (repair, rest) {
        ("", "") => CORRECT.to_owned(),
        _ => format!("{repair}{rest}`dermatome check` lists the findings of all"),
    }
}

fn io_help(error: &IoError) -> String {
    match error {
        IoError::Read { .. } => "check that the file exists and may be read",
        IoError::Write { .. } => "check that the folder exists, may be written to and has space",
        IoError::Unsupported { feature: Feature::Extension(name), .. } if name.ends_with("compression") => {
            "undo the compression: `npx @gltf-transform/cli cp IN.glb OUT.glb`"
        }
        IoError::Unsupported { .. } => {
            "export the file again without it: triangles with positions, as text or glTF 2.0 with its buffers"
        }
        IoError::Unfit { .. } => {
            "change what the message names, or choose another format"
        }
        IoError::NoMap { .. } | IoError::Rewritten { .. } => BUILD_AGAIN,
        IoError::UnknownKind { path, .. } => {
            return match converter(path) {
                _ if file_kind(path) == "xacro" => {
                    "expand its macros first: `pip install xacrodoc`, `xacrodoc -d FOLDER_OF_PACKAGES IN.xacro -o OUT.urdf`, with NAME:=VALUE for each argument it has".into()
                }
                _ if file_kind(path) == "sdf" => {
                    "give a .urdf of the robot, or the mesh files that it names".into()
                }
                Some(recording @ (BAGS | ARRAYS)) => recording.to_owned(),
                Some(converter) => format!("{converter} to .glb, .obj, .ply or .stl first"),
                None => "give a file of one of these kinds".into(),
            };
        }
        IoError::MeshFile { package, has_collision, .. } => {
            let collision =
                if *has_collision { "--mesh collision takes the shapes that collide" } else { "--without LINK leaves out a link" };
            return match package {
                Some(package) => format!("say where that package is: --package {package}=DIR; {collision}"),
                None => format!("put the file there, or correct its name; {collision}"),
            };
        }
        IoError::Animation { .. } => {
            "give a file with an animation, and --animation the name of one of several"
        }
        IoError::Streams { .. } => "name one with --stream NAME; `dermatome convert` of one sensor makes its skin",
        IoError::ReplacesInput { .. } => "write to another file",
        _ => CORRECT_FILE,
    }
    .to_owned()
}

const BAGS: &str = "`dermatome.ros` of the Python package reads bags";

const ARRAYS: &str = "write its arrays as .npz or .csv, as `numpy.savez(\"readings.npz\", values=..., ids=..., timestamps=...)`";

/// What converts a file of robots, scenes or CAD that is not read here.
fn converter(path: &Path) -> Option<&'static str> {
    let kind = path.extension()?.to_string_lossy().to_ascii_lowercase();
    Some(match kind.as_str() {
        "fbx" | "3ds" | "blend" => "convert it with Blender or `assimp export`",
        "step" | "stp" | "iges" | "igs" | "fcstd" => "convert it with FreeCAD (Mesh Design, Mesh from Shape)",
        "usd" | "usda" | "usdc" | "usdz" => "convert it with Blender or `usdcat` and a glTF exporter",
        "vtk" | "vtu" => "convert it with `meshio convert`",
        "vtp" => "convert it with ParaView (Save Data, STL)",
        "msh" => {
            "convert it, a mesh of Gmsh with `meshio convert` or an old one of MuJoCo with its msh2obj.py,"
        }
        "bag" | "mcap" | "db3" => return Some(BAGS),
        "h5" | "hdf5" | "mat" | "parquet" | "xlsx" | "zarr" => return Some(ARRAYS),
        _ => return None,
    })
}
