//! `calibrate --cad`: touches move the bodies of a drawn skin.

use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context;
use dermatome::Error;
use dermatome::calib::{BodyCalibration, Comparison, Pose, fit_bodies};
use dermatome::io::{write_bodies, write_skin};
use dermatome::skin::TaxelId;

use crate::calibrate::args::Args;
use crate::calibrate::body_summary::{BodySummary, print_bodies};
use crate::calibrate::drawing::Drawing;
use crate::calibrate::inputs::{Truth, is_assumed, read_seen};
use crate::calibrate::results::{OutputKind, check};
use crate::console::errors::{BAD_INPUT, advise};
use crate::console::notes::{note, remark_lost};
use crate::console::print::{print, print_json, say};
use crate::console::progress;
use crate::files::outputs;
use crate::options::Common;

/// The remark on touches whose table has no uncertainty.
pub(super) const NOISE_IS_ESTIMATED: &str =
    "the table gives no uncertainty; it is estimated from the touches";

/// Fits the bodies of the drawing `cad`.
pub(super) fn run(args: &Args, cad: &Path, common: &Common) -> anyhow::Result<ExitCode> {
    let outputs = check_outputs(args)?;
    let drawing = Drawing::read(cad, &args.cad, common)?;
    let truth = Truth::read(args)?;
    let (mut observations, remarks) = read_seen(&args.observations, &[])?;
    remarks.iter().filter(|remark| !is_assumed(remark)).for_each(|remark| note!(common, "{remark}"));
    if remarks.iter().any(is_assumed) {
        note!(common, "{NOISE_IS_ESTIMATED}");
    }
    observations.scale(args.unit.metres());
    let bar = progress::bar(common);
    bar.set_message("calibrating");
    let clock = Instant::now();
    let found = fit_bodies(&observations, &drawing.cad, &args.cad.options())
        .map_err(Error::from)
        .with_context(|| format!("cannot calibrate {}", args.observations.display()))?;
    let seconds = clock.elapsed().as_secs_f64();
    bar.finish_and_clear();
    if !common.quiet {
        found.remarks(&drawing.cad).iter().for_each(|remark| note!(common, "{remark}"));
    }
    let placed: Vec<(TaxelId, Pose)> =
        found.taxels.iter().map(|t| (t.id, Pose { position: t.position, ..Pose::default() })).collect();
    let truth = truth.map(|truth| truth.compare(&placed, common)).transpose()?;
    let faults = found.faults();
    if !faults.is_empty() && !args.keep {
        let what = format!("{}: {}; nothing was written", args.observations.display(), faults.join("; "));
        return Err(advise(
            what,
            "check that ids, poses and drawing belong together, or write what there is with --keep",
        ));
    }
    if !found.converged && !args.keep {
        let what = format!("{}: not converged; nothing was written", args.observations.display());
        return Err(advise(what, "give smaller tolerances, or write what there is with --keep"));
    }
    write(&outputs, &drawing, &found, common)?;
    if args.json {
        print_json("dermatome.bodies/1", &BodySummary::new(&found, &drawing.cad, seconds, truth))?;
    } else if !common.quiet {
        print_bodies(&found)?;
        if let Some(Comparison { absolute, rigid, .. }) = truth {
            let [absolute, rigid] = [absolute, rigid].map(|metres| 1e3 * metres);
            print(&format!("RMSE {absolute:.4} mm, after rigid alignment {rigid:.4} mm\n"))?;
        }
    }
    if !faults.is_empty() {
        // Also in a quiet run: an exit code that is not 0 needs its reason.
        say(format_args!("warning: {} (exit code 2)", faults.join("; ")));
    }
    let is_good = found.converged && faults.is_empty();
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::from(BAD_INPUT) })
}

/// The outputs, none of which is a graph.
pub(super) fn check_outputs(args: &Args) -> anyhow::Result<Vec<(&Path, OutputKind)>> {
    let outputs = check(args)?;
    match outputs.iter().find(|(_, kind)| matches!(kind, OutputKind::Graph)) {
        Some((path, _)) => Err(advise(
            format!("{}: a graph has no place for bodies", path.display()),
            "write a table .csv or a skin, as .glb",
        )),
        None => Ok(outputs),
    }
}

/// Writes every output, or none if one of them cannot be made.
pub(super) fn write(
    outputs: &[(&Path, OutputKind)],
    drawing: &Drawing,
    found: &BodyCalibration,
    common: &Common,
) -> anyhow::Result<()> {
    let file = |path: &Path| common.outputs.file(path);
    for &(path, kind) in outputs {
        if matches!(kind, OutputKind::Table) {
            write_bodies(file(path), &drawing.cad, &found.taxels).map_err(Error::from)?;
            outputs::drop_triangles(path, common)?;
        } else {
            let skin = drawing.calibrated(found, common)?;
            write_skin(file(path), &skin).map_err(Error::from)?;
            remark_lost(path, &skin, common);
        }
    }
    Ok(outputs::publish(common)?)
}
