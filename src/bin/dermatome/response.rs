//! `response`: how readings become pressures, estimated from recordings.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{read_series, write_response};
use dermatome::map::SkinMap;
use dermatome::recording::{FrameRange, Recording};
use dermatome::response::{GainEstimator, ScaleEstimator, StepEstimator};
use dermatome::run::Run;
use dermatome::signal::{Frame, Response, Scale, TaxelResponse, TaxelState, Zero};
use dermatome::skin::Skin;

use crate::console::errors::advise;
use crate::console::notes::{note, note_columns};
use crate::files::input::{read_map_if_any, read_skin};
use crate::files::outputs;
use crate::options::{Common, InPath, OutFile, PatchArgs, ReadArgs};
use crate::readings::{ReadingsArgs, remark_join};

/// Estimate how readings become pressures.
///
/// From ordinary touches alone: relative gains of the taxels, with their error. From steps of a pressure that is the
/// same everywhere (--pressure): gains in Pa and exponents. From touches of known force (--force): the scale of relative
/// gains, and from 100 touches on their exponent.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin, or its map: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .urdf, .xml, .npz, .csv or
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
    let job = Job { args, common, skin: map.skin(), map };
    let response = match (&args.pressure, &args.force) {
        (Some(steps), _) => job.by_steps(steps)?,
        (None, None) => job.by_touches()?,
        (None, Some(forces)) => {
            let relative = match args.reading.response(common)? {
                Some(response) => response,
                None => job.by_touches()?,
            };
            job.scaled(relative, forces)?
        }
    };
    write_response(common.outputs.file(&args.output), &response).map_err(Error::from)?;
    outputs::publish(common)?;
    Ok(ExitCode::SUCCESS)
}

struct Job<'a> {
    args: &'a Args,
    common: &'a Common,
    map: Arc<SkinMap>,
    skin: Skin,
}

impl Job<'_> {
    /// Passes the frames of all recordings on; returns the unit of the readings, and the zeros at the end.
    fn each_frame(
        &self,
        response: Option<&Response>,
        mut see: impl FnMut(&Frame),
        mut end: impl FnMut(),
    ) -> anyhow::Result<(String, Vec<f64>)> {
        let mut reading = self.args.reading.clone();
        reading.zero = Some(reading.zero.unwrap_or(Zero::Follow));
        let (mut unit, mut zeros) = (None, Vec::new());
        for path in &self.args.readings {
            let path: &Path = path;
            let mut recording: Recording =
                reading.open_with(response.cloned(), FrameRange::default(), path, &self.map, self.common)?;
            remark_join(&recording, path, self.common);
            let found = recording.channels()[0].unit.clone();
            let first = unit.get_or_insert_with(|| found.clone());
            if *first != found {
                let what = format!(
                    "{} is in {found:?}, and the recordings before it are in {first:?}",
                    path.display()
                );
                return Err(advise(what, "name recordings of one sensor"));
            }
            while let Some(step) = recording.next_step()? {
                see(step.frame);
            }
            end();
            zeros = recording.zeros();
            reading.remark(&recording, self.common);
        }
        Ok((unit.unwrap_or_default(), zeros))
    }

    /// Relative gains from touches.
    fn by_touches(&self) -> anyhow::Result<Response> {
        let estimator = std::cell::RefCell::new(GainEstimator::new(&self.skin).map_err(Error::from)?);
        let (unit, zeros) = self.each_frame(
            None,
            |frame| estimator.borrow_mut().see(frame),
            || estimator.borrow_mut().end_recording(),
        )?;
        let (gains, report) = estimator.into_inner().solve(Run::default()).map_err(Error::from)?;
        let taxel = |(k, gain): (usize, &dermatome::response::TaxelGain)| {
            let is_known = !gain.gain.is_nan();
            Known {
                gain: gain.gain,
                exponent: f64::NAN,
                sigma: if gain.presses > 0 { gain.sigma } else { f64::NAN },
                zero: zeros.get(k).copied().unwrap_or(f64::NAN),
                state: if is_known { TaxelState::Ok } else { TaxelState::Untested },
            }
        };
        let all = gains.iter().flatten().enumerate().map(taxel);
        let response = self.response(unit, Scale::Relative, format!("{} touches", report.presses), all);
        note!(self.common, "{} presses, {} steps; {}", report.presses, report.steps, summary(&response));
        for (count, what) in [(report.several, "of several bodies at once"), (report.small, "on few taxels")]
        {
            if count > 0 {
                note!(self.common, "{count} touches {what} are left out");
            }
        }
        if !report.has_converged {
            note!(self.common, "the steps did not become small: gains may be worse than their sigma");
        }
        Ok(response)
    }

    /// Gains and exponents from steps of pressure.
    fn by_steps(&self, path: &Path) -> anyhow::Result<Response> {
        let (rows, unused) = read_series(path, "pressure", "Pa").map_err(Error::from)?;
        note_columns(path, &unused, self.common);
        if self.args.readings.len() > 1 {
            return Err(advise(
                "steps of pressure are of one recording",
                "name one, or join them with their steps",
            ));
        }
        let mut estimator = StepEstimator::new(&self.skin, &rows).map_err(Error::from)?;
        let (unit, zeros) = self.each_frame(None, |frame| estimator.see(frame), || ())?;
        let (curves, report) = estimator.solve().map_err(Error::from)?;
        let taxel = |(k, curve): (usize, &dermatome::response::TaxelCurve)| Known {
            gain: curve.gain,
            exponent: curve.exponent,
            sigma: curve.sigma,
            zero: zeros.get(k).copied().unwrap_or(f64::NAN),
            state: if curve.gain.is_nan() { TaxelState::Untested } else { TaxelState::Ok },
        };
        let all = curves.iter().flatten().enumerate().map(taxel);
        let response =
            self.response(unit, Scale::Pascals, format!("{} steps of pressure", report.steps), all);
        let [low, high] = report.pressures.map(|pressure| pressure * 1e-3);
        note!(
            self.common,
            "{} steps from {low} to {high} kPa, {} placements; {}",
            report.steps,
            report.placements,
            summary(&response)
        );
        if report.exponent.is_nan() {
            note!(self.common, "one pressure tells no exponent; steps of at least two are needed");
        } else {
            note!(self.common, "median exponent {:.3}", report.exponent);
        }
        Ok(response)
    }

    /// Relative gains with their scale.
    fn scaled(&self, relative: Response, path: &Path) -> anyhow::Result<Response> {
        if relative.scale != Some(Scale::Relative) {
            return Err(advise(
                "the response has no relative gains",
                "leave out --force, or name one that has",
            ));
        }
        let (rows, unused) = read_series(path, "force", "N").map_err(Error::from)?;
        note_columns(path, &unused, self.common);
        let has_exponents = relative.taxels.iter().any(|taxel| taxel.exponent.is_some());
        let estimator = ScaleEstimator::new(&self.skin, !has_exponents, rows);
        let mut estimator = estimator.map_err(Error::from)?;
        self.each_frame(Some(&relative), |frame| estimator.see(frame), || ())?;
        let report = estimator.solve().map_err(Error::from)?;
        note!(
            self.common,
            "{} touches of known force: a scale to {:.1} %{}",
            report.touches,
            100.0 * report.sigma,
            if report.exponent.is_nan() {
                String::new()
            } else {
                format!(", exponent {:.3}", report.exponent)
            }
        );
        let scaled = |taxel: &TaxelResponse| {
            let exponent = if report.exponent.is_nan() { None } else { Some(report.exponent) };
            let power = exponent.unwrap_or(1.0);
            let gain = taxel.gain.map(|gain| report.scale * gain.abs().powf(power) * gain.signum());
            let sigma = taxel.sigma.map(|sigma| sigma.hypot(report.sigma));
            TaxelResponse { gain, sigma, exponent: exponent.or(taxel.exponent), ..*taxel }
        };
        Ok(Response {
            scale: Some(Scale::Pascals),
            method: format!("{}; {} known forces", relative.method, report.touches),
            taxels: relative.taxels.iter().map(scaled).collect(),
            unit: relative.unit,
        })
    }

    fn response(
        &self,
        unit: String,
        scale: Scale,
        method: String,
        known: impl Iterator<Item = Known>,
    ) -> Response {
        let ids = self.skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
        let some = |x: f64| Some(x).filter(|x| x.is_finite());
        let mut seen = std::collections::HashSet::new();
        let taxels = ids.zip(known).filter(|(id, _)| seen.insert(**id)).map(|(&id, known)| TaxelResponse {
            zero: some(known.zero),
            gain: some(known.gain),
            exponent: some(known.exponent),
            sigma: some(known.sigma),
            state: known.state,
            ..TaxelResponse::unknown(id)
        });
        Response { unit, scale: Some(scale), method, taxels: taxels.collect() }
    }
}

/// What is known of a taxel; NaN what is not.
struct Known {
    gain: f64,
    exponent: f64,
    sigma: f64,
    zero: f64,
    state: TaxelState,
}

/// How many taxels are known, and how well.
fn summary(response: &Response) -> String {
    let is_ok = |taxel: &&TaxelResponse| taxel.state == TaxelState::Ok;
    let mut sigmas: Vec<f64> = response.taxels.iter().filter(is_ok).filter_map(|taxel| taxel.sigma).collect();
    sigmas.sort_by(f64::total_cmp);
    let median = sigmas.get(sigmas.len() / 2).map(|sigma| format!(" to {:.1} %", 100.0 * sigma));
    let untested = response.taxels.len() - sigmas.len();
    format!("gains of {} taxels{}, {untested} untested", sigmas.len(), median.unwrap_or_default())
}
