//! `calibrate`: observations in, skin out.

mod args;
mod bodies;
mod body_summary;
mod cad_args;
mod drawing;
mod follow;
mod inputs;
mod results;

use std::process::ExitCode;

use anyhow::Context;
use dermatome::Error;
use dermatome::calib::{
    Calibration, Comparison, FreeComponent, GoodnessOfFit, Iteration, Loss, Model, ObservationDiagnostics,
    Observations, Pose, calibrate,
};
use dermatome::id::VertexId;
use dermatome::skin::TaxelId;
use serde::Serialize;

pub(crate) use args::Args;

use crate::calibrate::args::ROBUST;
use crate::calibrate::inputs::Inputs;
use crate::console::errors::{BAD_INPUT, advise};
use crate::console::notes::note;
use crate::console::print::{print, print_json, print_table, say};
use crate::console::progress;
use crate::options::{Common, word_of};

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    if args.follow {
        return follow::run(args, common);
    }
    if let Some(cad) = &args.cad.cad {
        return bodies::run(args, cad, common);
    }
    let outputs = results::check(args)?;
    let inputs = Inputs::read(args, common)?;
    let observations = &inputs.observations;
    let bar = progress::bar(common);
    bar.set_message("calibrating");
    let found = calibrate(observations, &args.options())
        .map_err(Error::from)
        .with_context(|| format!("cannot calibrate {}", args.observations.display()))?;
    bar.finish_and_clear();
    if !common.quiet {
        if common.verbose {
            list_iterations(&found.iterations, common);
        }
        if args.robust.is_none()
            && found.loss == Loss::Truncated
            && found.rejected() != (Vec::new(), Vec::new())
        {
            note!(common, "some observations were rejected as outliers (gnc); --robust none uses all");
        }
        remark_free(&found, common);
        remark_rejected(&found, observations, common);
    }
    let placed: Vec<(TaxelId, Pose)> = found.ids.iter().copied().zip(found.poses.iter().copied()).collect();
    let truth = inputs.truth.as_ref().map(|truth| truth.compare(&placed, common)).transpose()?;
    if !found.termination.is_converged() && !args.keep {
        return Err(advise(
            format!("{}: {}; nothing was written", args.observations.display(), found.termination),
            "try --robust gnc if some observations may be wrong, --initial tree, more --iterations, or write what there is with --keep",
        ));
    }
    results::write(&outputs, &found, &inputs, args, common)?;
    if !found.termination.is_converged() {
        // Also in a quiet run: an exit code that is not 0 needs its reason.
        say(format_args!("warning: {}: what was written is not a minimum (exit code 2)", found.termination));
    }
    let summary = Summary::new(&found, truth);
    if args.json {
        print_json("dermatome.calibrate/1", &summary)?;
    } else if !common.quiet {
        print_summary(&summary)?;
    }
    Ok(if found.termination.is_converged() { ExitCode::SUCCESS } else { ExitCode::from(BAD_INPUT) })
}

fn list_iterations(iterations: &[Iteration], common: &Common) {
    for (number, Iteration { cost, step, damping, graduation }) in (1..).zip(iterations) {
        let control = match graduation {
            Some(mu) => format!(", graduation {mu:.1e}"),
            None if *damping > 0.0 => format!(", damping {damping:.1e}"),
            None => String::new(),
        };
        note!(common, "iteration {number}: cost {cost:.10e}, step {step:.2e}{control}");
    }
}

/// A skin in more components than this is probably not intended: the rest is counted.
const MOST_COMPONENTS: usize = 8;

/// Prints which components have no place of their own.
fn remark_free(found: &Calibration, common: &Common) {
    let shown = if common.verbose { found.free.len() } else { found.free.len().min(MOST_COMPONENTS) };
    for free in &found.free[..shown] {
        let FreeComponent { gauge, taxels, free_motions, rejected_contacts } = free;
        let these = format!("the component of {taxels} taxels around taxel {gauge}");
        let all = match found.model {
            Model::Positions => 3,
            Model::Poses => 6,
        };
        if *free_motions < all {
            note!(common, "the contacts leave {free_motions} rigid motions of {these} undetermined");
        } else if *rejected_contacts > 0 {
            note!(common, "all contacts of {these} were rejected: its absolute position is arbitrary");
        } else {
            note!(
                common,
                "no contact determines where {these} is: taxel {gauge} keeps its start, and covariances are about the centroid"
            );
        }
    }
    if shown < found.free.len() {
        let rest = &found.free[shown..];
        let taxels = rest.iter().map(|f| f.taxels).sum::<usize>();
        note!(
            common,
            "no contact determines where {taxels} taxels in {} more components are; --verbose names each",
            rest.len()
        );
    }
}

/// Prints how many observations were rejected, and if it is asked for, which.
fn remark_rejected(found: &Calibration, observations: &Observations, common: &Common) {
    let fits = &found.diagnostics;
    let (edges, contacts) = found.rejected();
    if !edges.is_empty() || !contacts.is_empty() {
        note!(
            common,
            "{} of {} edges and {} of {} contacts were rejected as outliers; --inliers lists them",
            edges.len(),
            fits.edges.len(),
            contacts.len(),
            fits.contacts.len()
        );
    }
    if common.verbose {
        let id = |v: VertexId| observations.taxels[v].id;
        let describe =
            |fit: &ObservationDiagnostics| format!("{:.1} sigma, weight {:.3}", fit.chi2.sqrt(), fit.weight);
        for e in edges {
            let (edge, fit) = (&observations.edges[e], describe(&fits.edges[e]));
            note!(common, "edge {} to {}: {fit}", id(edge.from), id(edge.to));
        }
        for c in contacts {
            let taxel = id(observations.contacts[c].taxel);
            note!(common, "contact of taxel {taxel}: {}", describe(&fits.contacts[c]));
        }
    }
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    model: String,
    residual: String,
    cost: f64,
    chi2: f64,
    dof: usize,
    p: Option<f64>,
    verdict: String,
    robust: &'static str,
    iterations: usize,
    converged: bool,
    ending: String,
    rejected: usize,
    seconds: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_aligned_mm: Option<f64>,
}

impl Summary {
    fn new(found: &Calibration, truth: Option<Comparison>) -> Self {
        let GoodnessOfFit { chi2, degrees_of_freedom, p, .. } = found.fit;
        let (edges, contacts) = found.rejected();
        Self {
            model: found.model.to_string(),
            residual: found.residual.to_string(),
            cost: found.cost,
            chi2,
            dof: degrees_of_freedom,
            p,
            verdict: found.fit.to_string(),
            robust: word_of(&ROBUST, &Some(found.loss)),
            iterations: found.iterations.len(),
            converged: found.termination.is_converged(),
            ending: found.termination.to_string(),
            rejected: edges.len() + contacts.len(),
            seconds: found.seconds,
            // Without contacts the absolute position is arbitrary.
            rmse_mm: truth.filter(|_| found.free.is_empty()).map(|t| t.absolute * 1e3),
            rmse_aligned_mm: truth.map(|t| t.rigid * 1e3),
        }
    }
}

fn print_summary(summary: &Summary) -> anyhow::Result<()> {
    let row = [
        ("model", summary.model.clone()),
        ("residual", summary.residual.clone()),
        ("ending", summary.ending.clone()),
        ("iterations", summary.iterations.to_string()),
        ("cost", format!("{:.10}", summary.cost)),
        ("chi2", format!("{:.6}", summary.chi2)),
        ("dof", summary.dof.to_string()),
        ("p", summary.p.map_or("-".into(), |p| format!("{p:.4}"))),
        ("seconds", format!("{:.4}", summary.seconds)),
    ];
    print_table(3, &[row])?;
    print(&format!("fit: {}\n", summary.verdict))?;
    if let Some(rigid) = summary.rmse_aligned_mm {
        let absolute = summary.rmse_mm.map_or_else(String::new, |mm| format!("{mm:.4} mm, "));
        print(&format!("RMSE {absolute}after rigid alignment {rigid:.4} mm\n"))?;
    }
    Ok(())
}
