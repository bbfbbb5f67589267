//! `touch`: a recording of spheres, fingers or palms that press and roll on a skin.

use std::{collections::HashSet, process::ExitCode};

use dermatome::Error;
use dermatome::io::{ReadingsColumns, ReadingsWriter, write_response, write_steps, write_touches};
use dermatome::signal::{
    FaultCounts, Quantity, ReadoutOptions, TaxelState, Touch, TouchOptions, TouchShape, TouchSimulation,
};

use crate::console::notes::note;
use crate::files::input::read_any_skin;
use crate::files::outputs;
use crate::options::{Choice, Common, InPath, OutFile, ReadArgs, length_mm, one_of};

/// Arguments of `touch`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin, or its map: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt
    skin: InPath,
    /// File for the readings: .csv with a column for each taxel, or .npz
    #[arg(short, long, value_name = "OUT.csv")]
    output: OutFile,
    /// File for the true touches: .csv
    #[arg(long, value_name = "OUT.csv")]
    truth: Option<OutFile>,
    /// Number of presses, one after the other, each at a random place
    #[arg(long, value_name = "N", default_value_t = 5)]
    presses: usize,
    /// Number of spheres that press at once, at least a diameter apart
    #[arg(long, value_name = "N", default_value_t = 1)]
    touches: usize,
    /// Radius of the sphere; of several radii each press has one, at random
    #[arg(long = "sphere-mm", value_name = "MM,...", default_value = "15", value_delimiter = ',', value_parser = length_mm)]
    spheres: Vec<f64>,
    /// What presses
    #[arg(long, value_parser = one_of(&SHAPES), default_value = "sphere")]
    shape: TouchShape,
    /// Length of a finger without its round ends, or diameter of a palm
    #[arg(long = "length-mm", value_name = "MM", default_value = "40", value_parser = length_mm)]
    length: f64,
    /// Distance along the skin between bodies that press at once, which then roll side by side [default: at random]
    #[arg(long = "apart-mm", value_name = "MM", value_parser = length_mm, hide_short_help = true)]
    apart: Option<f64>,
    /// How deep the sphere is pressed in; of two depths each press has one between them
    #[arg(long = "depth-mm", value_name = "MM[,MM]", default_value = "2", value_parser = one_or_two_mm)]
    depths: [f64; 2],
    /// Ellipsoids instead of spheres: the largest ratio of their two radii of curvature
    #[arg(long, value_name = "F", default_value_t = 1.0, hide_short_help = true)]
    aspect: f64,
    /// Stiffness of the skin: pressure for each millimetre of depth
    #[arg(long, value_name = "KPA", default_value_t = 20.0)]
    stiffness_kpa: f64,
    /// How far the sphere rolls during a press
    #[arg(long = "roll-mm", value_name = "MM", default_value = "20", value_parser = length_mm)]
    roll: f64,
    /// How long a press takes
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    press_s: f64,
    /// How long nothing is touched before each press and after the last
    #[arg(long, value_name = "S", default_value_t = 0.25)]
    pause_s: f64,
    /// Frames per second
    #[arg(long, value_name = "HZ", default_value_t = 100.0)]
    rate_hz: f64,
    /// Radius of the disc on which a taxel feels
    #[arg(long = "taxel-mm", value_name = "MM", default_value = "2", value_parser = length_mm)]
    taxel: f64,
    /// A cover spreads pressures: the standard deviation along each axis
    #[arg(long = "blur-mm", value_name = "MM", default_value = "0", value_parser = length_mm)]
    blur: f64,
    /// Response curve: pressure is the reading to this power, both relative to the pressure of a press
    #[arg(long, value_name = "F", default_value_t = 1.0, hide_short_help = true)]
    exponent: f64,
    /// A bag instead of spheres: it presses on all taxels with these pressures, up and down again in each press; the
    /// truth is a table time,pressure
    #[arg(long = "bag-kpa", value_name = "KPA,...", value_delimiter = ',', hide_short_help = true)]
    bag: Vec<f64>,
    /// How uneven the pressure of the bag is, standard deviation between taxels, relative
    #[arg(long, value_name = "F", default_value_t = 0.0, requires = "bag", hide_short_help = true)]
    uneven: f64,
    /// What a taxel reads
    #[arg(long, value_parser = one_of(&READS), default_value = "force")]
    reads: Quantity,
    /// Noise of the mean pressure on a taxel, standard deviation
    #[arg(long, value_name = "KPA", default_value_t = 0.0)]
    noise_kpa: f64,
    /// Drift: the pressure of every taxel grows at a rate of its own, with this standard deviation
    /// per second
    #[arg(long, value_name = "KPA", default_value_t = 0.0, hide_short_help = true)]
    drift_kpa: f64,
    /// Share of the taxels that are dead and read NaN
    #[arg(long, value_name = "F", default_value_t = 0.0)]
    dead: f64,
    /// Spread of the gains of the taxels: standard deviation of their logarithm
    #[arg(long, value_name = "F", default_value_t = 0.0, hide_short_help = true)]
    gain_spread: f64,
    /// Drift of all zeros with temperature, per second; each taxel has its own coefficient, 1 give or take 0.3
    #[arg(long, value_name = "KPA", default_value_t = 0.0)]
    warming_kpa: f64,
    /// Faulty taxels, as in dead=3,swapped=2: dead, silent, stuck, noisy, jumping, chattering or saturated ones,
    /// swapped or crosstalk pairs, module-step groups of 12, turned ones of a taxel and all around it
    #[arg(long, value_name = "KIND=N", value_delimiter = ',', value_parser = fault)]
    faults: Vec<(TaxelState, usize)>,
    /// File for what each taxel is: gain, exponent, drift and fault, a .csv as `response` writes
    #[arg(long, value_name = "OUT.csv", hide_short_help = true)]
    true_response: Option<OutFile>,
    #[command(flatten)]
    read: ReadArgs,
    /// Seed of the random numbers
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
}

/// One length, or the smallest and the largest, in m; bare numbers are in mm.
fn one_or_two_mm(text: &str) -> Result<[f64; 2], String> {
    let lengths = text.split(',').map(length_mm).collect::<Result<Vec<_>, _>>()?;
    match lengths[..] {
        [one] => Ok([one; 2]),
        [least, most] => Ok([least, most]),
        _ => Err("needed: one length, or the smallest and the largest, as in 1,4".into()),
    }
}

const READS: [Choice<Quantity>; 2] = [
    ("force", Quantity::Extensive, "The force on its disc, in N"),
    ("pressure", Quantity::Intensive, "The mean pressure on its disc, in Pa"),
];

const SHAPES: [Choice<TouchShape>; 3] = [
    ("sphere", TouchShape::Sphere, "A sphere, or an ellipsoid with --aspect"),
    ("finger", TouchShape::Finger, "A laid finger: a capsule along the skin, with the radius of the sphere"),
    ("palm", TouchShape::Palm, "A soft disc that follows the skin, with a rim of 8 mm"),
];

/// A parser of `kind=count`.
fn fault(text: &str) -> Result<(TaxelState, usize), String> {
    let parsed =
        text.split_once('=').and_then(|(kind, count)| Some((kind.parse().ok()?, count.parse().ok()?)));
    parsed.filter(|(kind, _)| FaultCounts::kinds().contains(kind)).ok_or_else(|| {
        let kinds = FaultCounts::kinds().iter().map(ToString::to_string).collect::<Vec<_>>();
        format!("needed: a kind and a count, as in dead=3; kinds are {}", kinds.join(", "))
    })
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    [&args.truth, &args.true_response]
        .into_iter()
        .flatten()
        .try_for_each(|path| outputs::check_table(path))?;
    let skin = read_any_skin(&args.skin, &args.read, common)?;
    let mut simulation = TouchSimulation::new(&skin, &args.options()).map_err(Error::from)?;
    let mut touches = Vec::new();
    let taxels = skin.patches.iter().map(|patch| &patch.taxels);
    let output = common.outputs.file(&args.output);
    let columns = ReadingsColumns { channels: std::slice::from_ref(simulation.channel()), has_times: true };
    let mut writer = ReadingsWriter::create(output, taxels, columns).map_err(Error::from)?;
    let mut steps: Vec<[f64; 2]> = Vec::new();
    while let Some((frame, now)) = simulation.next_frame() {
        writer.write(frame).map_err(Error::from)?;
        touches.extend_from_slice(now);
        let (time, pressure) = (frame.time, simulation.bag_pressure());
        if steps.last().is_none_or(|[_, last]| *last != pressure) {
            steps.push([time, pressure]);
        }
    }
    writer.finish().map_err(Error::from)?;
    if let Some(path) = &args.truth {
        let path = common.outputs.file(path);
        let truth = if args.bag.is_empty() {
            write_touches(path, &skin, &touches)
        } else {
            write_steps(path, &steps)
        };
        truth.map_err(Error::from)?;
    }
    if let Some(path) = &args.true_response {
        write_response(common.outputs.file(path), simulation.response()).map_err(Error::from)?;
    }
    outputs::publish(common)?;
    if !args.bag.is_empty() {
        note!(common, "{} frames, {} steps of pressure", simulation.frames(), steps.len());
        return Ok(ExitCode::SUCCESS);
    }
    let distinct = |number: fn(&Touch) -> usize| touches.iter().map(number).collect::<HashSet<_>>().len();
    let most = touches.iter().map(|touch| touch.force).fold(0.0, f64::max);
    note!(
        common,
        "{} frames, {} of them with a touch; {} presses of up to {most:.3} N",
        simulation.frames(),
        distinct(|touch| touch.frame),
        distinct(|touch| touch.press)
    );
    Ok(ExitCode::SUCCESS)
}

impl Args {
    fn options(&self) -> TouchOptions {
        TouchOptions {
            radii: self.spheres.clone(),
            shape: self.shape,
            length: self.length,
            apart: self.apart,
            depths: self.depths,
            aspect: self.aspect,
            stiffness: self.stiffness_kpa * 1e6,
            presses: self.presses,
            touches: self.touches,
            roll: self.roll,
            duration: self.press_s,
            pause: self.pause_s,
            rate: self.rate_hz,
            taxel_radius: self.taxel,
            blur: self.blur,
            exponent: self.exponent,
            steps: self.bag.iter().map(|kpa| kpa * 1e3).collect(),
            uneven: self.uneven,
            quantity: self.reads,
            noise: self.noise_kpa * 1e3,
            drift: self.drift_kpa * 1e3,
            dead: self.dead,
            readout: ReadoutOptions {
                gain_spread: self.gain_spread,
                warming: self.warming_kpa * 1e3,
                faults: self.faults.iter().fold(FaultCounts::default(), |all, &(kind, n)| all.with(kind, n)),
                ..ReadoutOptions::default()
            },
            seed: self.seed,
            ..TouchOptions::default()
        }
    }
}
