//! `simulate`: observations of a simulated skin on a sphere, with known taxel poses.

mod arm;

use std::io::{BufWriter, Write};
use std::process::ExitCode;

use dermatome::Error;
use dermatome::calib::{Model, SimulateOptions, Simulation, simulate};
use dermatome::id::{IdVec, VertexId};
use dermatome::io::{observations_to_stream, write_observations, write_triangles, write_truth};
use dermatome::skin::TaxelId;
use dermatome::touches::ArmOptions;

use crate::console::notes::note;
use crate::console::print::{STANDARD_OUTPUT, StandardOutput};
use crate::files::outputs::{self, is_stream};
use crate::options::{Choice, Common, OutFile, length_mm, one_of};
use crate::simulate::arm::{ArmArgs, Shared};

/// Arguments of `simulate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// File for the observations: .g2o, or displacements of the positions model as a table .csv;
    /// `-`: g2o on standard output. With --arm the log: .csv
    #[arg(short, long, value_name = "OUT.g2o")]
    output: OutFile,
    #[command(flatten)]
    arm: ArmArgs,
    /// File for the true positions of the taxels: .csv
    #[arg(long, value_name = "OUT.csv")]
    truth: Option<OutFile>,
    /// File for the triangles between the taxels: .csv
    #[arg(long, value_name = "OUT.csv")]
    triangles: Option<OutFile>,
    /// File for the absolute contacts: .csv; required for contacts with normals
    #[arg(long, value_name = "OUT.csv")]
    contacts: Option<OutFile>,
    /// What is estimated of every taxel
    #[arg(long, value_parser = one_of(&MODELS), default_value = "positions")]
    model: Model,
    /// Number of taxels
    #[arg(long, value_name = "N", default_value_t = 500)]
    taxels: usize,
    /// Distance of lattice neighbours
    #[arg(long = "spacing-mm", value_name = "MM", default_value = "5", value_parser = length_mm)]
    spacing: f64,
    /// Radius of the sphere that carries the taxels
    #[arg(long = "radius-mm", value_name = "MM", default_value = "100", value_parser = length_mm)]
    radius: f64,
    /// Noise of displacements, per axis
    #[arg(long = "noise-mm", value_name = "MM", default_value = "1", value_parser = length_mm)]
    noise: f64,
    /// Noise of relative rotations, per axis; poses only
    #[arg(long, value_name = "DEG", default_value_t = 1.0)]
    rotation_noise_deg: f64,
    /// Number of taxels with an absolute contact observation
    #[arg(long, value_name = "K", default_value_t = 0)]
    anchors: usize,
    /// Noise of absolute contacts, per axis
    #[arg(long = "anchor-noise-mm", value_name = "MM", default_value = "1", value_parser = length_mm)]
    anchor_noise: f64,
    /// Absolute contacts have normals too, with this noise per tangent axis
    #[arg(long, value_name = "DEG", requires = "contacts")]
    normal_noise_deg: Option<f64>,
    /// How deep the elastic skin is pressed in at absolute contacts
    #[arg(long = "indentation-mm", value_name = "MM", default_value = "0", value_parser = length_mm, help_heading = "Arm")]
    indentation: f64,
    /// Noise of the end effector's position, per axis
    #[arg(long = "arm-noise-mm", value_name = "MM", default_value = "0", value_parser = length_mm, help_heading = "Arm")]
    arm_noise: f64,
    /// Noise of the end effector's orientation, per axis
    #[arg(long, value_name = "DEG", default_value_t = 0.0, help_heading = "Arm")]
    arm_noise_deg: f64,
    /// Share of displacements that are attributed to a wrong taxel within 30 mm
    #[arg(long, value_name = "F", default_value_t = 0.0)]
    outliers: f64,
    /// Seed of the random numbers
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
}

const MODELS: [Choice<Model>; 2] = [
    ("positions", Model::Positions, "Its position"),
    ("poses", Model::Poses, "Its position and orientation"),
];

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let tables = || [&args.truth, &args.triangles, &args.contacts].into_iter().flatten();
    tables().try_for_each(|path| outputs::check_table(path))?;
    if args.arm.arm {
        args.arm.run(&args.shared(), common)?;
        return Ok(ExitCode::SUCCESS);
    }
    let simulation = simulate(&args.options()).map_err(Error::from)?;
    let ids = simulation.observations.taxels.map(|t| t.id);
    args.write(&simulation, &ids, common)?;
    let Simulation { observations, mesh, outliers, .. } = &simulation;
    let (edges, contacts) = (observations.edges.len(), observations.contacts.len());
    let (wrong, triangles) = (outliers.len(), mesh.triangles.len());
    let made = format!("{} taxels, {edges} displacements ({wrong} wrong)", ids.len());
    note!(common, "{made}, {contacts} contacts, {triangles} triangles");
    Ok(ExitCode::SUCCESS)
}

impl Args {
    fn write(
        &self,
        simulation: &Simulation,
        ids: &IdVec<VertexId, TaxelId>,
        common: &Common,
    ) -> Result<(), Error> {
        let file = |path: &OutFile| common.outputs.file(path);
        let mut observations = simulation.observations.clone();
        if let Some(path) = &self.contacts {
            let edges = std::mem::take(&mut observations.edges);
            write_observations(file(path), &observations)?;
            (observations.edges, observations.contacts) = (edges, IdVec::default());
        }
        if let Some(path) = &self.triangles {
            write_triangles(file(path), ids, simulation.mesh.triangles.as_slice())?;
        }
        if let Some(path) = &self.truth {
            write_truth(file(path), ids, &simulation.truth)?;
            outputs::drop_triangles(path, common)?;
        }
        if is_stream(&self.output) {
            let mut out = BufWriter::new(StandardOutput::new(&common.outputs));
            observations_to_stream(&mut out, STANDARD_OUTPUT.as_ref(), &observations)?;
            out.flush().map_err(|e| outputs::cannot_write(STANDARD_OUTPUT.as_ref(), e))?;
        } else {
            write_observations(file(&self.output), &observations)?;
        }
        outputs::publish(common)
    }

    /// What the simulation of an arm takes, too.
    fn shared(&self) -> Shared<'_> {
        let options = ArmOptions {
            taxels: self.taxels,
            spacing: self.spacing,
            radius: self.radius,
            arm_noise: self.arm_noise,
            arm_rotation_noise: self.arm_noise_deg.to_radians(),
            seed: self.seed,
            ..ArmOptions::default()
        };
        let (output, indentation) = (&self.output, self.indentation);
        let (truth, triangles) = (self.truth.as_ref(), self.triangles.as_ref());
        Shared { output, truth, triangles, options, indentation }
    }

    fn options(&self) -> SimulateOptions {
        SimulateOptions {
            model: self.model,
            taxels: self.taxels,
            spacing: self.spacing,
            radius: self.radius,
            noise: self.noise,
            rotation_noise: self.rotation_noise_deg.to_radians(),
            anchors: self.anchors,
            anchor_noise: self.anchor_noise,
            normal_noise: self.normal_noise_deg.map(f64::to_radians),
            indentation: self.indentation,
            arm_noise: self.arm_noise,
            arm_rotation_noise: self.arm_noise_deg.to_radians(),
            outliers: self.outliers,
            seed: self.seed,
        }
    }
}
