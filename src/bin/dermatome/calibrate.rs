//! `calibrate`: observations in, skin out.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::Context;
use clap::ValueEnum;
use dermatome::{
    Error,
    calib::{
        CalibOptions, Calibration, Comparison, Ending, Fit, Iteration, Limits, Method, Observations, Outside,
        Pose, Residual, Robust, Start, Uncertainty, calibrate, calibrated_skin, compare,
    },
    id::{IdVec, TaxelId, VertexId},
    io::{
        append_observations, read_observations, read_triangles, read_truth, write_calibration, write_inliers,
        write_observations, write_skin,
    },
};
use serde::Serialize;

use crate::{
    Common,
    failure::advise,
    progress,
    tables::{print, print_json, print_table},
};

/// Arguments of `calibrate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The observations: .g2o, or .csv with the columns i,j,dx,dy,dz; - is standard input
    observations: PathBuf,
    /// Where to write: a table .csv, the graph with calibrated poses .g2o, or a skin .glb, .gltf, .json, .obj, .ply,
    /// .stl; may be given more than once
    #[arg(short, long, value_name = "SKIN", required = true)]
    output: Vec<PathBuf>,
    /// Absolute contacts in a table of their own: i,x,y,z[,nx,ny,nz]
    #[arg(long, value_name = "C.csv")]
    contacts: Vec<PathBuf>,
    /// Triangles of the skin by taxel ids, i,j,k [default: those that the edges form]
    #[arg(long, value_name = "TRI.csv")]
    triangles: Option<PathBuf>,
    /// Compare with where the taxels truly are: id,x,y,z[,qx,qy,qz,qw]
    #[arg(long, value_name = "T.csv")]
    truth: Option<PathBuf>,
    /// Write how well every observation fits, and whether noise explains it: i,j,sigmas,weight,inlier
    #[arg(long, value_name = "I.csv")]
    inliers: Option<PathBuf>,
    /// What to do about observations that do not fit; gnc against wrongly attributed contacts
    #[arg(long, value_enum, default_value_t = RobustArg::None, help_heading = "Solver")]
    robust: RobustArg,
    /// How the error of a relative pose becomes six numbers
    #[arg(long, visible_alias = "rotation-residual", value_enum, default_value_t = ResidualArg::Split, help_heading = "Solver")]
    residual: ResidualArg,
    /// Where to start
    #[arg(long, value_enum, default_value_t = StartArg::Chordal, help_heading = "Solver")]
    initial: StartArg,
    /// How to step
    #[arg(long, value_enum, default_value_t = MethodArg::Lm, help_heading = "Solver")]
    method: MethodArg,
    /// Most iterations
    #[arg(long, value_name = "N", default_value_t = Limits::default().iterations, help_heading = "Solver")]
    iterations: usize,
    /// No covariances
    #[arg(long, help_heading = "Solver")]
    no_covariance: bool,
    /// Write the result even if the solve did not converge
    #[arg(long)]
    keep: bool,
    /// Print every iteration, and every observation that noise does not explain
    #[arg(long, short)]
    verbose: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RobustArg {
    /// Least squares
    None,
    /// The pull stops growing
    Huber,
    /// The pull fades slowly
    Cauchy,
    /// Lets go of what is far off
    Tukey,
    /// Lets go quickly
    GemanMcclure,
    /// Truncated least squares by graduated non-convexity
    Gnc,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ResidualArg {
    /// Translation and rotation vector apart
    Split,
    /// Logarithm of SE(3), as GTSAM
    Log,
    /// Translation and half-angle quaternion, as g2o
    Quaternion,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum StartArg {
    /// Two linear systems
    Chordal,
    /// Chained along a spanning tree
    Tree,
    /// The values in the file
    File,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MethodArg {
    /// Gauss-Newton
    Gn,
    /// Levenberg-Marquardt, undamped while the cost falls
    Lm,
    /// Powell's dogleg
    Dogleg,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let observations = read(args, common)?;
    let bar = progress::bar(common);
    bar.set_message("calibrating");
    bar.set_length(args.iterations as u64);
    let watch = |number: usize, iteration: &Iteration| {
        bar.set_position(number as u64);
        if args.verbose && !common.quiet {
            bar.suspend(|| {
                eprintln!(
                    "note: iteration {number}: cost {:.10e}, step {:.2e}, control {:.1e}",
                    iteration.cost, iteration.step, iteration.control
                );
            });
        }
    };
    let found = calibrate(&observations, &args.options(), &watch)
        .map_err(Error::from)
        .with_context(|| format!("cannot calibrate {}", args.observations.display()))?;
    bar.finish_and_clear();
    if !common.quiet {
        remark(&found, &observations, args.verbose);
    }
    let truth = args.truth.as_ref().map(|path| against_truth(path, &found)).transpose()?;
    if !found.ending.is_converged() && !args.keep {
        return Err(advise(
            format!("{}: {}; nothing was written", args.observations.display(), found.ending.describe()),
            "try --method dogleg, --initial tree, more --iterations, or write what there is with --keep",
        ));
    }
    for path in &args.output {
        write(path, &found, &observations, args, common)?;
    }
    if let Some(path) = &args.inliers {
        write_inliers(path, &observations, &found).map_err(Error::from)?;
    }
    let summary = Summary::new(&found, truth);
    if args.json {
        print_json(&summary)?;
    } else if !common.quiet {
        print_summary(&summary, &found.fit)?;
    }
    Ok(if found.ending.is_converged() { ExitCode::SUCCESS } else { ExitCode::from(2) })
}

impl Args {
    fn options(&self) -> CalibOptions {
        CalibOptions {
            robust: match self.robust {
                RobustArg::None => Robust::None,
                RobustArg::Huber => Robust::Huber,
                RobustArg::Cauchy => Robust::Cauchy,
                RobustArg::Tukey => Robust::Tukey,
                RobustArg::GemanMcclure => Robust::GemanMcClure,
                RobustArg::Gnc => Robust::Graduated,
            },
            residual: match self.residual {
                ResidualArg::Split => Residual::Split,
                ResidualArg::Log => Residual::Log,
                ResidualArg::Quaternion => Residual::Quaternion,
            },
            start: match self.initial {
                StartArg::Chordal => Start::Chordal,
                StartArg::Tree => Start::Tree,
                StartArg::File => Start::Initial,
            },
            method: match self.method {
                MethodArg::Gn => Method::GaussNewton,
                MethodArg::Lm => Method::LevenbergMarquardt,
                MethodArg::Dogleg => Method::Dogleg,
            },
            limits: Limits { iterations: self.iterations, ..Limits::default() },
            uncertainty: if self.no_covariance { Uncertainty::Skip } else { Uncertainty::Marginals },
        }
    }
}

/// Reads the observations and the tables of contacts that go with them.
fn read(args: &Args, common: &Common) -> anyhow::Result<Observations> {
    let mut read = read_observations(&args.observations).map_err(Error::from)?;
    for path in &args.contacts {
        let more = read_observations(path).map_err(Error::from)?;
        append_observations(&mut read, more, path).map_err(Error::from)?;
    }
    if !common.quiet {
        for remark in &read.remarks {
            eprintln!("note: {remark}");
        }
    }
    Ok(read.observations)
}

/// Tells what a user should know about the result.
fn remark(found: &Calibration, observations: &Observations, verbose: bool) {
    for free in &found.free {
        eprintln!(
            "note: nothing says where the {} taxels around taxel {} are ({} of their motions as a whole are free): taxel {} keeps its start",
            free.taxels, free.gauge, free.directions, free.gauge
        );
    }
    let fits = &found.weights;
    let (edges, contacts): (Vec<_>, Vec<_>) =
        (fits.rejected_edges().collect(), fits.rejected_contacts().collect());
    if !edges.is_empty() || !contacts.is_empty() {
        eprintln!(
            "note: noise does not explain {} of {} edges and {} of {} contacts; --inliers lists them",
            edges.len(),
            fits.edges.len(),
            contacts.len(),
            fits.contacts.len()
        );
    }
    if verbose {
        let id = |v: VertexId| observations.taxels[v].id;
        for e in edges {
            let (edge, sigmas) = (&observations.edges[e], fits.edge_squares[e].sqrt());
            let weight = fits.edges[e];
            eprintln!(
                "note: edge {} to {}: {sigmas:.1} sigma, weight {weight:.3}",
                id(edge.from),
                id(edge.to)
            );
        }
        for c in contacts {
            let (taxel, sigmas) = (id(observations.contacts[c].taxel), fits.contact_squares[c].sqrt());
            eprintln!("note: contact of taxel {taxel}: {sigmas:.1} sigma, weight {:.3}", fits.contacts[c]);
        }
    }
}

/// Compares the taxels that the truth knows.
fn against_truth(path: &Path, found: &Calibration) -> anyhow::Result<Comparison> {
    let truth: HashMap<TaxelId, Pose> = read_truth(path).map_err(Error::from)?.into_iter().collect();
    let (mut here, mut there) = (IdVec::<VertexId, Pose>::new(), IdVec::new());
    for (id, pose) in found.ids.iter().zip(&found.poses) {
        if let Some(known) = truth.get(id) {
            here.push(*pose);
            there.push(*known);
        }
    }
    compare(&here, &there)
        .map_err(Error::from)
        .with_context(|| format!("{} knows none of the taxels", path.display()))
}

fn write(
    path: &Path,
    found: &Calibration,
    observations: &Observations,
    args: &Args,
    common: &Common,
) -> anyhow::Result<()> {
    let kind = path.extension().map(|e| e.to_ascii_lowercase());
    match kind.as_ref().and_then(|k| k.to_str()) {
        Some("csv") => write_calibration(path, found).map_err(Error::from)?,
        Some("g2o") => {
            let mut solved = observations.clone();
            for (taxel, pose) in solved.taxels.iter_mut().zip(&found.poses) {
                taxel.initial = Some(*pose);
            }
            write_observations(path, &solved).map_err(Error::from)?;
        }
        _ => {
            let triangles = args.triangles.as_ref().map(|p| read_triangles(p, &found.ids));
            let triangles = triangles.transpose().map_err(Error::from)?;
            let made = calibrated_skin(found, observations, triangles.as_deref()).map_err(Error::from)?;
            if made.outside == Outside::Origin && !common.quiet {
                eprintln!(
                    "note: neither frames nor normals tell the outside: it is taken to be away from the origin; --triangles decides"
                );
            }
            if !made.left_out.is_empty() && !common.quiet {
                eprintln!(
                    "note: {} taxels are in no triangle and are left out of the skin",
                    made.left_out.len()
                );
            }
            write_skin(path, &made.skin).map_err(Error::from)?;
        }
    }
    Ok(())
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    model: &'static str,
    residual: &'static str,
    cost: f64,
    chi2: f64,
    dof: usize,
    p: f64,
    iterations: usize,
    converged: bool,
    ending: &'static str,
    rejected: usize,
    seconds: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_aligned_mm: Option<f64>,
}

impl Summary {
    fn new(found: &Calibration, truth: Option<Comparison>) -> Self {
        let Fit { chi2, degrees, p } = found.fit;
        Self {
            model: found.model.name(),
            residual: found.residual.name(),
            cost: found.cost,
            chi2,
            dof: degrees,
            p,
            iterations: found.iterations.len(),
            converged: found.ending.is_converged(),
            ending: Ending::describe(found.ending),
            rejected: found.weights.rejected_edges().count() + found.weights.rejected_contacts().count(),
            seconds: found.seconds.iter().sum(),
            rmse_mm: truth.map(|t| t.absolute * 1e3),
            rmse_aligned_mm: truth.map(|t| t.rigid * 1e3),
        }
    }
}

fn print_summary(summary: &Summary, fit: &Fit) -> anyhow::Result<()> {
    let titles = ["model", "residual", "ending", "iterations", "cost", "chi2", "dof", "p", "seconds"];
    let row = [
        summary.model.to_owned(),
        summary.residual.to_owned(),
        summary.ending.to_owned(),
        summary.iterations.to_string(),
        format!("{:.10}", summary.cost),
        format!("{:.6}", summary.chi2),
        summary.dof.to_string(),
        format!("{:.4}", summary.p),
        format!("{:.4}", summary.seconds),
    ];
    print_table(titles, 3, &[row])?;
    print(&format!("fit: {}\n", fit.verdict()))?;
    if let (Some(absolute), Some(rigid)) = (summary.rmse_mm, summary.rmse_aligned_mm) {
        print(&format!("RMSE {absolute:.4} mm, after rigid alignment {rigid:.4} mm\n"))?;
    }
    Ok(())
}
