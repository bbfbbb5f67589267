//! `response`: how readings become pressures, estimated from recordings.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{read_series, write_response};
use dermatome::map::SkinMap;
use dermatome::recording::{FrameRange, Recording, Reference, ResponseReport, respond};
use dermatome::response::Spike;
use dermatome::run::Run;
use dermatome::signal::{Response, TaxelResponse, TaxelState, Zero};

use crate::console::errors::advise;
use crate::console::notes::{note, note_columns, note_count};
use crate::files::input::{read_map_if_any, read_skin};
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, InPath, OutFile, PatchArgs, ReadArgs};
use crate::readings::{ReadingsArgs, remark_channel, remark_join};

/// Estimate how readings become pressures.
///
/// From ordinary touches alone: relative gains of the taxels, with their error. From steps of a pressure that is the
/// same everywhere (--pressure): gains in Pa and exponents. From touches of known force (--force): the scale of relative
/// gains, and from 100 touches on their exponent.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin, or its map: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt
    skin: InPath,
    /// Recordings of touches
    #[arg(required = true)]
    readings: Vec<InPath>,
    /// File for the response: .csv
    #[arg(short, long, value_name = "OUT.csv")]
    output: OutFile,
    /// Steps of a pressure that is the same everywhere: a table with columns time,pressure (Pa, or as in
    /// pressure[kPa]), a row where each step begins
    #[arg(long, value_name = "STEPS.csv", conflicts_with = "force")]
    pressure: Option<InPath>,
    /// Forces on the whole skin: a table with columns time,force (N, or as in force[mN])
    #[arg(long, value_name = "FORCE.csv")]
    force: Option<InPath>,
    #[command(flatten)]
    reading: ReadingsArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    outputs::check_table(&args.output)?;
    if args.reading.response.is_some() && args.force.is_none() {
        return Err(advise("--response gives relative gains their scale", "add --force, or leave it out"));
    }
    let map = Arc::new(match read_map_if_any(&args.skin)? {
        Some(map) => map,
        None => {
            let options = args.read.options(&[&args.skin]);
            let skin = read_skin(&args.skin, &args.read, &PatchArgs::default(), &options, common)?;
            SkinMap::of_taxels(&skin)
        }
    });
    let response = match (&args.pressure, &args.force) {
        (Some(path), _) => {
            let rows = rows(path, "pressure", "Pa", common)?;
            estimate(args, common, &map, Reference::Pressure(&rows))?
        }
        (None, None) => estimate(args, common, &map, Reference::Touches)?,
        (None, Some(path)) => {
            let relative = match args.reading.response(common)? {
                Some(response) => response,
                None if args.readings.iter().any(|path| is_stream(path)) => {
                    return Err(advise(
                        "recordings are read twice",
                        "name a file, not -, or give --response",
                    ));
                }
                None => estimate(args, common, &map, Reference::Touches)?,
            };
            let rows = rows(path, "force", "N", common)?;
            estimate(args, common, &map, Reference::Force(&rows, &relative))?
        }
    };
    write_response(common.outputs.file(&args.output), &response).map_err(Error::from)?;
    outputs::publish(common)?;
    Ok(ExitCode::SUCCESS)
}

fn rows(path: &Path, column: &str, unit: &str, common: &Common) -> anyhow::Result<Vec<[f64; 2]>> {
    let (rows, unused) = read_series(path, column, unit).map_err(Error::from)?;
    note_columns(path, &unused, common);
    Ok(rows)
}

/// Estimates a response, and says how well it is known.
fn estimate(
    args: &Args,
    common: &Common,
    map: &Arc<SkinMap>,
    reference: Reference<'_>,
) -> anyhow::Result<Response> {
    let mut reading = args.reading.clone();
    reading.zero = Some(reading.zero.unwrap_or(Zero::Follow));
    let open = |number: usize, response: Option<&Response>| -> anyhow::Result<Recording> {
        let path: &Path = &args.readings[number];
        let recording = reading.open_with(response.cloned(), FrameRange::default(), path, map, common)?;
        remark_join(&recording, path, common);
        remark_channel(recording.channels(), path, common);
        Ok(recording)
    };
    let ended = |recording: &Recording| reading.remark(recording, common);
    let count = args.readings.len();
    let (response, report) = respond(map, reference, count, open, ended, Run::default())?;
    match report {
        ResponseReport::Touches(report) => {
            note!(common, "{} presses, {} steps; {}", report.presses, report.steps, summary(&response));
            let left_out = [(report.several, "of several bodies at once"), (report.small, "on few taxels")];
            for (count, what) in left_out.into_iter().filter(|(count, _)| *count > 0) {
                note!(common, "{count} touches {what} are left out");
            }
            if let Some(Spike { taxel, recording, frame }) = report.first_spike {
                let mut ids = map.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
                let taxel = ids.nth(taxel).map_or(0, |id| id.0);
                let path = args.readings[recording].display();
                note_count(common, report.spikes as u64, "readings", "left out as spikes");
                note!(common, "the first spike is that of taxel {taxel} in frame {frame} of {path}");
            }
            if report.patches > 1 {
                note!(
                    common,
                    "no press joins two of the {} patches: how their gains compare follows from presses alike deep on all",
                    report.patches
                );
            }
            if !report.has_converged {
                note!(common, "the steps did not become small: gains may be worse than their sigma");
            }
        }
        ResponseReport::Pressure(report) => {
            let [low, high] = report.pressures.map(|pressure| pressure * 1e-3);
            let (steps, placements) = (report.steps, report.placements);
            let summary = summary(&response);
            note!(common, "{steps} steps from {low} to {high} kPa, {placements} placements; {summary}");
            if report.exponent.is_nan() {
                note!(
                    common,
                    "steps of one pressure determine no exponent: it needs steps of two pressures or more"
                );
            } else {
                note!(common, "median exponent {:.3}", report.exponent);
            }
        }
        ResponseReport::Force(report) => {
            let exponent = Some(report.exponent).filter(|exponent| !exponent.is_nan());
            note!(
                common,
                "{} touches of known force: a scale to {:.1} %{}",
                report.touches,
                100.0 * report.sigma,
                exponent.map_or(String::new(), |exponent| format!(", exponent {exponent:.3}"))
            );
        }
    }
    Ok(response)
}

/// How many taxels are known, and how well.
fn summary(response: &Response) -> String {
    let is_ok = |taxel: &&TaxelResponse| taxel.state == TaxelState::Ok;
    let mut sigmas: Vec<f64> = response.taxels.iter().filter(is_ok).filter_map(|taxel| taxel.sigma).collect();
    sigmas.sort_by(f64::total_cmp);
    let median = sigmas.get(sigmas.len() / 2).map(|sigma| format!(" to {:.1} %", 100.0 * sigma));
    let untested = response.taxels.iter().filter(|taxel| taxel.state == TaxelState::Untested).count();
    format!("gains of {} taxels{}, {untested} untested", sigmas.len(), median.unwrap_or_default())
}
