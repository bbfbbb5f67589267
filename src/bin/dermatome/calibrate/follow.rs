//! `calibrate --follow`: a line of JSON for each touch while the table of observations is written.

use std::fs::File;
use std::io::{BufRead, BufReader, Write, stdin, stdout};
use std::path::Path;
use std::process::ExitCode;

use dermatome::Error;
use dermatome::calib::{Calibration, FollowedSolve, FollowedTouch, Follower, Observations};
use dermatome::io::{IoError, ObservationRemark, touches_from_stream, write_calibration};
use dermatome::run::Run;
use serde::Serialize;

use crate::calibrate::args::Args;
use crate::calibrate::inputs::Inputs;
use crate::calibrate::results::{self, OutputKind};
use crate::console::errors::{BAD_INPUT, advise};
use crate::console::notes::note;
use crate::console::print::{print, say};
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, Unit};

/// Touches after which the table is written anew, whatever follows.
const TOUCHES_PER_TABLE: usize = 100;

/// A line for each touch.
#[derive(Debug, Serialize)]
struct TouchLine<'t> {
    schema: &'static str,
    touch: usize,
    taxels: &'t [u32],
    /// Length of the whitened innovation, and the number of its dimensions.
    sigmas: Option<f64>,
    dof: Option<usize>,
    fits: Option<bool>,
    moved_mm: Option<f64>,
    worst: Option<Worst>,
    undetermined: Option<u32>,
}

/// The least certain taxel.
#[derive(Debug, Serialize)]
struct Worst {
    taxel_id: u32,
    sigma_mm: f64,
}

/// Follows the observations of the arguments.
pub(super) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let outputs = results::check(args)?;
    if outputs.iter().any(|(path, _)| is_stream(path)) {
        return Err(advise("standard output has a line for each touch", "write the result to a file"));
    }
    let (input, name): (Box<dyn BufRead>, &Path) = if is_stream(&args.observations) {
        (Box::new(BufReader::new(stdin())), "standard input".as_ref())
    } else {
        let path: &Path = &args.observations;
        let fail = |source| Error::from(IoError::Read { path: path.to_owned(), source });
        (Box::new(BufReader::new(File::open(path).map_err(fail)?)), path)
    };
    let mut stream = touches_from_stream(input, name).map_err(Error::from)?;
    let mut follower = Calibration::follow(&args.options(), args.every);
    let (mut unfit, mut failed) = (0_usize, None);
    let mut remarked = Vec::new();
    for touch in &mut stream {
        let (mut observations, remarks) = match touch {
            Ok(read) => read,
            Err(error) => {
                failed = Some(error);
                break;
            }
        };
        remark(&mut remarked, remarks, args.unit, common)?;
        observations.scale(args.unit.metres());
        let followed = follower.push(&observations, Run::default()).map_err(Error::from)?;
        unfit += usize::from(followed.innovation.is_some_and(|i| !i.fits()));
        print(&line(&followed)?)?;
        if followed.touch.is_multiple_of(TOUCHES_PER_TABLE) {
            write_tables(&outputs, &follower)?;
        }
    }
    stdout().flush().map_err(|e| outputs::cannot_write("standard output".as_ref(), e))?;
    if let Some(line) = stream.half_row() {
        note!(common, "{}: line {line} has no end and was not read", name.display());
    }
    if unfit > 0 {
        note!(common, "{unfit} touches did not fit what was known before them");
    }
    if let Some(error) = failed {
        // What came before the error is kept.
        if let Ok((observations, found)) = follower.finish(Run::default()) {
            finish(&outputs, observations, &found, args, common)?;
        }
        return Err(Error::from(error).into());
    }
    let (observations, found) = follower.finish(Run::default()).map_err(Error::from)?;
    finish(&outputs, observations, &found, args, common)?;
    let converged = found.termination.is_converged();
    if !converged {
        // Also in a quiet run: an exit code that is not 0 needs its reason.
        say(format_args!("warning: {}: what was written is not a minimum (exit code 2)", found.termination));
    }
    Ok(if converged { ExitCode::SUCCESS } else { ExitCode::from(BAD_INPUT) })
}

/// Prints each remark once.
fn remark(
    seen: &mut Vec<String>,
    remarks: Vec<ObservationRemark>,
    unit: Unit,
    common: &Common,
) -> anyhow::Result<()> {
    for remark in remarks {
        if unit != Unit::M && matches!(remark, ObservationRemark::AssumedSigma { .. }) {
            let what = "a table gives no uncertainty, and none is assumed with --unit";
            return Err(advise(what, "add a column sigma, in the unit of the file"));
        }
        let text = remark.to_string();
        if !seen.contains(&text) {
            note!(common, "{text}");
            seen.push(text);
        }
    }
    Ok(())
}

fn line(followed: &FollowedTouch) -> anyhow::Result<String> {
    let taxels: Vec<u32> = followed.taxels.iter().map(|id| id.0).collect();
    let (moved, worst, undetermined) = match &followed.solved {
        None => (None, None, None),
        Some(FollowedSolve::Solved { moved, worst }) => (Some(1e3 * moved), *worst, None),
        Some(FollowedSolve::Undetermined(id)) => (None, None, Some(id.0)),
    };
    let line = TouchLine {
        schema: "dermatome.touch/1",
        touch: followed.touch,
        taxels: &taxels,
        sigmas: followed.innovation.map(|i| i.chi2.max(0.0).sqrt()),
        dof: followed.innovation.map(|i| i.degrees_of_freedom),
        fits: followed.innovation.map(|i| i.fits()),
        moved_mm: moved,
        worst: worst.map(|(id, sigma)| Worst { taxel_id: id.0, sigma_mm: 1e3 * sigma }),
        undetermined,
    };
    Ok(serde_json::to_string(&line)? + "\n")
}

/// Writes the tables of the last solution, each whole or not at all.
fn write_tables(outputs: &[(&Path, OutputKind)], follower: &Follower) -> Result<(), Error> {
    let Some(found) = follower.solution() else { return Ok(()) };
    for (path, _) in outputs.iter().filter(|(_, kind)| matches!(kind, OutputKind::Table)) {
        write_calibration(*path, found)?;
    }
    Ok(())
}

/// Writes every output of the batch result.
fn finish(
    outputs: &[(&Path, OutputKind)],
    observations: Observations,
    found: &Calibration,
    args: &Args,
    common: &Common,
) -> anyhow::Result<()> {
    let inputs = Inputs { observations, triangles: None, truth: None };
    results::write(outputs, found, &inputs, args, common)
}
