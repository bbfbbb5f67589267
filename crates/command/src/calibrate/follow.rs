//! `calibrate --follow`: a line of JSON for each touch while the table of observations is written.

use std::fs;
use std::io::{BufReader, Write, stdout};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use dermatome::Error;
use dermatome::calib::{
    BodyFollower, CalibError, Calibration, FollowedSolve, FollowedTouch, Follower, Observations,
};
use dermatome::io::{ObservationRemark, touches_from_stream, write_bodies, write_calibration};
use dermatome::run::Run;
use serde::Serialize;

use crate::calibrate::args::Args;
use crate::calibrate::bodies::{self, NOISE_IS_ESTIMATED};
use crate::calibrate::drawing::Drawing;
use crate::calibrate::inputs::{Inputs, is_assumed};
use crate::calibrate::results::{self, OutputKind};
use crate::console::errors::{BAD_INPUT, advise};
use crate::console::notes::note;
use crate::console::print::{print, say};
use crate::files::input::open_input;
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, Unit};

/// A line for each touch.
#[derive(Debug, Serialize)]
struct TouchLine<'t> {
    schema: &'static str,
    time: Option<f64>,
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

/// What is solved after touches.
enum Solver {
    Taxels(Box<Follower>),
    Bodies { drawing: Box<Drawing>, follower: Box<BodyFollower> },
}

impl Solver {
    fn new(args: &Args, common: &Common) -> anyhow::Result<Self> {
        let Some(cad) = &args.cad.cad else {
            return Ok(Self::Taxels(Box::new(Calibration::follow(&args.options(), args.every))));
        };
        let drawing = Box::new(Drawing::read(cad, &args.cad, common)?);
        let options = args.cad.options();
        let follower = BodyFollower::new(drawing.cad.clone(), &options, args.every).map_err(Error::from)?;
        Ok(Self::Bodies { drawing, follower: Box::new(follower) })
    }

    fn push(&mut self, touch: &Observations) -> Result<FollowedTouch, CalibError> {
        match self {
            Self::Taxels(follower) => follower.push(touch, Run::default()),
            Self::Bodies { follower, .. } => follower.push(touch, Run::default()),
        }
    }

    /// Whether the last solution may be written: bodies are judged as at the end, without contacts that are held back.
    fn may_write(&self, args: &Args) -> bool {
        match self {
            Self::Taxels(_) => true,
            Self::Bodies { follower, .. } => {
                args.keep
                    || follower.solution().is_some_and(|found| found.converged && found.faults().is_empty())
            }
        }
    }

    /// Writes the tables of the last solution, each whole or not at all.
    fn write_tables(&self, outputs: &[(&Path, OutputKind)]) -> Result<(), Error> {
        for (path, _) in outputs.iter().filter(|(_, kind)| matches!(kind, OutputKind::Table)) {
            match self {
                Self::Taxels(follower) => {
                    follower.solution().map(|found| write_calibration(*path, found)).transpose()?;
                }
                Self::Bodies { drawing, follower } => {
                    follower
                        .solution()
                        .map(|found| write_bodies(*path, &drawing.cad, &found.taxels))
                        .transpose()?;
                }
            }
        }
        Ok(())
    }

    /// Writes every output of the batch result; returns why it is not a minimum.
    fn finish(
        self,
        outputs: &[(&Path, OutputKind)],
        args: &Args,
        common: &Common,
    ) -> anyhow::Result<Option<String>> {
        match self {
            Self::Taxels(follower) => {
                let (observations, found) = follower.finish(Run::default()).map_err(Error::from)?;
                if !found.termination.is_converged() && !args.keep {
                    return Err(advise(
                        format!("{}; nothing was written at the end", found.termination),
                        "give more --iterations, or write what there is with --keep",
                    ));
                }
                let inputs = Inputs { observations, triangles: None, truth: None };
                results::write(outputs, &found, &inputs, args, common)?;
                Ok((!found.termination.is_converged()).then(|| found.termination.to_string()))
            }
            Self::Bodies { drawing, follower } => {
                let found = follower.finish(Run::default()).map_err(Error::from)?;
                if !common.quiet {
                    found.remarks(&drawing.cad).iter().for_each(|remark| note!(common, "{remark}"));
                }
                let faults = found.faults();
                if !faults.is_empty() && !args.keep {
                    let what = format!(
                        "{}; nothing was written at the end, and earlier tables are taken back",
                        faults.join("; ")
                    );
                    return Err(advise(
                        what,
                        "check that ids, poses and drawing belong together, or write what there is with --keep",
                    ));
                }
                if !found.converged && !args.keep {
                    return Err(advise(
                        "not converged; nothing was written at the end, and earlier tables are taken back",
                        "give smaller tolerances, or write what there is with --keep",
                    ));
                }
                bodies::write(outputs, &drawing, &found, common)?;
                let why = if found.converged { faults } else { vec!["not converged".to_owned()] };
                Ok((!why.is_empty()).then(|| why.join("; ")))
            }
        }
    }
}

/// Follows the observations of the arguments.
pub(super) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let outputs = if args.cad.cad.is_some() { bodies::check_outputs(args)? } else { results::check(args)? };
    if outputs.iter().any(|(path, _)| is_stream(path)) {
        return Err(advise("standard output has a line for each touch", "write the result to a file"));
    }
    let (name, input) = open_input(&args.observations)?;
    let mut stream = touches_from_stream(BufReader::new(input), name).map_err(Error::from)?;
    let mut solver = Solver::new(args, common)?;
    let (mut unfit, mut failed) = (0_usize, None);
    let mut remarked = Vec::new();
    let earlier = Earlier::of(&outputs);
    while let Some(touch) = stream.next() {
        let (mut observations, mut remarks) = match touch {
            Ok(read) => read,
            Err(error) => {
                failed = Some(Error::from(error));
                break;
            }
        };
        if let Solver::Bodies { .. } = &solver
            && remarks.extract_if(.., |remark| is_assumed(remark)).next().is_some()
        {
            remark_once(&mut remarked, NOISE_IS_ESTIMATED, common);
        }
        remark(&mut remarked, &remarks, args.unit, common)?;
        observations.scale(args.unit.metres());
        let followed = match solver.push(&observations) {
            Ok(followed) => followed,
            Err(error) => {
                failed = Some(Error::from(error));
                break;
            }
        };
        unfit += usize::from(followed.innovation.is_some_and(|i| !i.fits()));
        if matches!(followed.solved, Some(FollowedSolve::Solved { .. })) && solver.may_write(args) {
            solver.write_tables(&outputs)?;
        }
        print(&line(&followed, stream.time())?)?;
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
        let is_of_bodies = matches!(solver, Solver::Bodies { .. });
        if let Err(other) = solver.finish(&outputs, args, common) {
            note!(common, "nothing was written at the end: {other:#}");
            if is_of_bodies {
                earlier.restore()?;
            }
        }
        return Err(error.into());
    }
    let is_of_bodies = matches!(solver, Solver::Bodies { .. });
    let unfinished = match solver.finish(&outputs, args, common) {
        Ok(unfinished) => unfinished,
        Err(refused) => {
            // A skin that is refused must not stay from a fit to fewer touches.
            if is_of_bodies {
                earlier.restore()?;
            }
            return Err(refused);
        }
    };
    if let Some(why) = &unfinished {
        // Also in a quiet run: an exit code that is not 0 needs its reason.
        say(format_args!("warning: {why}: what was written is not a minimum (exit code 2)"));
    }
    Ok(if unfinished.is_none() { ExitCode::SUCCESS } else { ExitCode::from(BAD_INPUT) })
}

/// What was in the outputs before.
struct Earlier(Vec<(PathBuf, Option<Vec<u8>>)>);

impl Earlier {
    fn of(outputs: &[(&Path, OutputKind)]) -> Self {
        let tables = outputs.iter().filter(|(_, kind)| matches!(kind, OutputKind::Table));
        Self(tables.map(|(path, _)| (path.to_path_buf(), fs::read(path).ok())).collect())
    }

    /// Writes it again, or removes what was not there.
    fn restore(&self) -> anyhow::Result<()> {
        for (path, bytes) in &self.0 {
            let restored = match bytes {
                Some(bytes) if fs::read(path).ok().as_ref() == Some(bytes) => Ok(()),
                Some(bytes) => fs::write(path, bytes),
                None if path.exists() => fs::remove_file(path),
                None => Ok(()),
            };
            restored.map_err(|error| outputs::cannot_write(path, error))?;
        }
        Ok(())
    }
}

/// Prints each remark once.
fn remark(
    seen: &mut Vec<String>,
    remarks: &[ObservationRemark],
    unit: Unit,
    common: &Common,
) -> anyhow::Result<()> {
    for remark in remarks {
        if unit != Unit::M && is_assumed(remark) {
            let what = "a table gives no uncertainty, and none is assumed with --unit";
            return Err(advise(what, "add a column sigma, in the unit of the file"));
        }
        remark_once(seen, &remark.to_string(), common);
    }
    Ok(())
}

fn remark_once(seen: &mut Vec<String>, text: &str, common: &Common) {
    if !seen.iter().any(|other| other == text) {
        note!(common, "{text}");
        seen.push(text.to_owned());
    }
}

fn line(followed: &FollowedTouch, time: Option<f64>) -> anyhow::Result<String> {
    let taxels: Vec<u32> = followed.taxels.iter().map(|id| id.0).collect();
    let (moved, worst, undetermined) = match &followed.solved {
        None => (None, None, None),
        Some(FollowedSolve::Solved { moved, worst }) => (Some(1e3 * moved), *worst, None),
        Some(FollowedSolve::Undetermined(id)) => (None, None, Some(id.0)),
    };
    let line = TouchLine {
        schema: "dermatome.touch/1",
        time,
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
