//! `check LOG`: what is wrong with a log of touches.

use std::process::ExitCode;

use anyhow::Context;
use dermatome::Error;
use dermatome::io::read_touches;
use dermatome::touches::{LogFinding, RowSources, examine_log, log_of_rows};
use serde_json::{Value, json};

use crate::console::errors::INCOMPLETE;
use crate::console::notes::{note, note_columns};
use crate::console::print::{line, print, print_json};
use crate::options::{Common, InPath};

/// Judges a log that is complete by itself; exit code 1 if no skin follows from it.
pub(super) fn run(
    file: &InPath,
    link: Option<&str>,
    as_json: bool,
    common: &Common,
) -> anyhow::Result<ExitCode> {
    let (rows, unused) = read_touches(file).map_err(Error::from)?;
    note_columns(file, &unused, common);
    let about = || format!("the log in {} cannot be judged", file.display());
    let made = log_of_rows(&rows, &RowSources { link, ..RowSources::default() })
        .map_err(Error::from)
        .with_context(about)?;
    made.remarks().iter().for_each(|remark| note!(common, "{remark}"));
    let report = examine_log(&made.log).map_err(Error::from).with_context(about)?;
    let severity = |finding: &LogFinding| if finding.is_error { "error" } else { "warning" };
    if as_json {
        let finding = |finding: &LogFinding| json!({ "kind": finding.kind.to_string(), "severity": severity(finding), "message": finding.message });
        let [frames, touches, taxels] = report.counts;
        let findings: Vec<Value> = report.findings.iter().map(finding).collect();
        let log = json!({
            "frames": frames, "touches": touches, "taxels": taxels, "touches_per_taxel": report.touches_per_taxel,
            "rate_hz": report.rate,
        });
        print_json("dermatome.check/1", &json!({ "findings": findings, "log": log }))?;
    } else {
        let sentence =
            |finding: &LogFinding| line(&format!("{}: {}", severity(finding), finding.message)) + "\n";
        let said: String = report.findings.iter().map(sentence).collect();
        print(if said.is_empty() { "no findings\n" } else { &said })?;
    }
    let is_refused = report.findings.iter().any(|finding| finding.is_error);
    Ok(if is_refused { ExitCode::from(INCOMPLETE) } else { ExitCode::SUCCESS })
}
