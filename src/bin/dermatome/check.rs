//! `check`: the problems of a skin.

use std::{fmt::Write, path::PathBuf, process::ExitCode};

use dermatome::{
    Error,
    io::read_draft,
    skin::{Finding, FindingKind, check},
};

use serde_json::{Value, json};

use crate::{
    common::Common,
    notes::note,
    options::ReadArgs,
    print::{line, print, print_json},
};

/// List everything that is wrong with a skin; exit code 1 if there is anything.
///
/// That taxels are bare is a note on standard error, and is nothing wrong.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Skin or mesh: .glb, .gltf, .json, .obj, .off, .ply, .stl, .csv or .txt
    file: PathBuf,
    /// Print all elements of every finding as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

/// A line holds no more elements; `--json` gives them all.
const SHOWN: usize = 8;

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let mut draft = read_draft(&args.file).map_err(Error::from)?;
    draft.scale(args.read.unit.metres());
    let findings = check(&draft, &args.read.options());
    let (notes, findings): (Vec<_>, Vec<_>) = findings.into_iter().partition(|f| f.kind == FindingKind::Bare);
    notes.iter().for_each(|found| note(common, found));
    if args.json {
        print_json(&as_json(&findings))?;
    } else if findings.is_empty() {
        print("no findings\n")?;
    } else {
        print(&findings.iter().map(|f| line(&f.to_string()) + &elements(f) + "\n").collect::<String>())?;
    }
    Ok(if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn as_json(findings: &[Finding]) -> Value {
    let findings: Vec<_> = findings
        .iter()
        .map(|Finding { kind, patch, elements, message }| {
            json!({ "kind": kind.to_string(), "patch": patch, "elements": elements, "message": message })
        })
        .collect();
    json!({ "findings": findings })
}

/// ` [faces 3, 5, 8 and 4 more]`, or nothing for a finding about a whole sheet.
fn elements(finding: &Finding) -> String {
    let noun = finding.kind.elements();
    if noun.is_empty() {
        return String::new();
    }
    let size = if noun == "edges" { 2 } else { 1 };
    let count = finding.elements.len() / size;
    let shown: Vec<String> = finding
        .elements
        .chunks(size)
        .take(SHOWN)
        .map(|element| element.iter().map(u64::to_string).collect::<Vec<_>>().join("-"))
        .collect();
    let mut text = format!(" [{noun} {}", shown.join(", "));
    if count > SHOWN {
        let _ = write!(text, " and {} more", count - SHOWN);
    }
    text + "]"
}
