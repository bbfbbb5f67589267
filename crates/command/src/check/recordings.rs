//! `check --recording`: the taxels that cannot be trusted, as recordings of ordinary touches show.

use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{read_modules, write_response};
use dermatome::map::SkinMap;
use dermatome::recording::examine;
use dermatome::signal::{HealthFinding, HealthOptions, HealthReport};
use dermatome::skin::Skin;
use serde_json::{Value, json};

use crate::console::errors::advise;
use crate::console::notes::{note, rows_of};
use crate::console::print::line;
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, InPath, OutFile};
use crate::readings::{ReadingsArgs, positive, remark_channel, remark_join};

/// What recordings say of the taxels.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Recordings")]
pub(super) struct RecordingArgs {
    /// Recordings of ordinary touches, of which zeros are followed by default: list the taxels that cannot be trusted
    #[arg(long = "recording", value_name = "R", num_args = 1..)]
    pub(super) readings: Vec<InPath>,
    /// The module of each taxel, for steps and turns of whole modules: a table with columns taxel_id,module
    #[arg(long, value_name = "M.csv", requires = "readings")]
    modules: Option<InPath>,
    /// A taxel is touched above this, in the unit of the readings [default: four times the noise]
    #[arg(long, value_name = "X", value_parser = positive, requires = "readings")]
    pub(super) threshold: Option<f64>,
    /// File for the state of each taxel: a response .csv; with --order for the taxel of each column: .csv
    #[arg(short, long, value_name = "OUT.csv", requires = "readings")]
    pub(super) output: Option<OutFile>,
    #[command(flatten)]
    pub(super) read: ReadingsArgs,
}

impl RecordingArgs {
    pub(super) fn is_empty(&self) -> bool {
        self.readings.is_empty()
    }

    /// `passes` says how often recordings are read.
    pub(super) fn check(&self, passes: &str) -> anyhow::Result<()> {
        self.output.as_deref().map_or(Ok(()), outputs::check_table)?;
        if self.readings.iter().any(|path| is_stream(path)) {
            return Err(advise(format!("recordings are read {passes}"), "name a file, not -"));
        }
        Ok(())
    }

    /// Judges the taxels of a skin, and writes their states.
    pub(super) fn examine(&self, skin: &Skin, common: &Common) -> anyhow::Result<HealthReport> {
        let map = Arc::new(SkinMap::of_taxels(skin));
        let modules =
            self.modules.as_ref().map(|path| rows_of(path, read_modules(path), common)).transpose()?;
        let modules = modules.unwrap_or_default();
        let defaults = HealthOptions::default();
        let zero = self.read.zero().unwrap_or(defaults.zero);
        let options = HealthOptions { zero, threshold: self.threshold, modules };
        let mut opened = 0;
        let report = examine(&map, &options, self.readings.len(), |number, zero| {
            let path = &self.readings[number];
            let recording = self.read.open_at(zero, path, &map, common)?;
            if opened < self.readings.len() {
                remark_join(&recording, path, common);
                remark_channel(recording.channels(), path, common);
            }
            opened += 1;
            Ok::<_, anyhow::Error>(recording)
        })?;
        if let Some(path) = &self.output {
            write_response(common.outputs.file(path), &report.response).map_err(Error::from)?;
            outputs::publish(common)?;
        }
        if report.crowded > 0 {
            note!(common, "in {} frames too many taxels are touched to compare single ones", report.crowded);
        }
        if report.is_full {
            note!(
                common,
                "more pairs of taxels are touched at once than are compared; shorter recordings need fewer"
            );
        }
        Ok(report)
    }
}

/// What was found, a line each, with its patch where several have the same id, and how much was tested.
pub(super) fn sentences(report: &HealthReport, skin: &Skin) -> String {
    let HealthReport { taxels, tested, without_readings, frames, recordings, threshold, .. } = report;
    let found = report.sentences(skin.patches.iter().map(|patch| (&*patch.name, &patch.taxels)));
    let faults: String = found.iter().map(|found| line(&format!("error: {found}")) + "\n").collect();
    let of = if *recordings == 1 { String::new() } else { format!(" of {recordings} recordings") };
    let missing =
        if *without_readings == 0 { String::new() } else { format!(", {without_readings} without readings") };
    let untested = (taxels + without_readings).saturating_sub(*tested);
    faults
        + &format!(
            "{tested} taxels tested, {untested} untested{missing}; {frames} frames{of}, touches are above {threshold:.4}\n"
        )
}

/// A finding in the schema of the others.
pub(super) fn finding_as_json(finding: &HealthFinding, skin: &Skin) -> Value {
    let evidence: serde_json::Map<_, _> =
        finding.evidence.iter().map(|(name, x)| ((*name).to_owned(), json!(x))).collect();
    json!({
        "kind": finding.kind.to_string(), "severity": "error", "patch": skin.patches[finding.patch].name,
        "elements": finding.vertices.iter().map(|v| v.raw()).collect::<Vec<_>>(),
        "message": finding.to_string(), "repaired_by": null,
        "taxels": finding.taxels.iter().map(|id| id.0).collect::<Vec<_>>(),
        "other": finding.other.map(|id| id.0), "evidence": evidence,
    })
}

/// How much was tested.
pub(super) fn summary_as_json(report: &HealthReport) -> Value {
    let untested = (report.taxels + report.without_readings).saturating_sub(report.tested);
    json!({
        "tested": report.tested, "untested": untested, "without_readings": report.without_readings,
        "frames": report.frames, "recordings": report.recordings, "threshold": report.threshold,
    })
}
