//! `check`: the problems of a skin.

use std::{path::PathBuf, process::ExitCode};

use dermatome::skin::{Draft, Finding, FindingKind, Sheet, check};

use serde_json::{Value, json};

use crate::{
    console::{
        notes::note,
        print::{line, print, print_json},
    },
    options::{Common, ReadArgs},
};

/// List everything that is wrong with a skin; exit code 1 if there is anything.
///
/// That taxels are bare is a note on standard error, and is nothing wrong.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Skin or mesh: .glb, .gltf, .json, .obj, .off, .ply, .stl, .npz, .csv or .txt
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
    let draft = args.read.read(&args.file, false)?;
    let findings = check(&draft, &args.read.options());
    let (notes, findings): (Vec<_>, Vec<_>) = findings.into_iter().partition(|f| f.kind == FindingKind::Bare);
    notes.iter().for_each(|found| note(common, found));
    if args.json {
        print_json("dermatome.check/1", &as_json(&findings, &draft))?;
    } else if findings.is_empty() {
        print("no findings\n")?;
    } else {
        print(&findings.iter().map(|f| sentence(f, &draft)).collect::<String>())?;
    }
    Ok(if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn as_json(findings: &[Finding], draft: &Draft) -> Value {
    let object = |finding: &Finding| {
        let Finding { kind, patch, elements, message } = finding;
        let mut object = json!({
            "kind": kind.to_string(), "patch": patch, "elements": elements, "message": message,
            "mended_by": cure(*kind),
        });
        if let Some(sheet) = sheet_of(finding, draft) {
            object["file_vertices"] = json!(sheet.numbers.as_ref().map(|all| named(finding, all)));
            object["taxels"] = json!(
                sheet
                    .ids
                    .as_ref()
                    .map(|ids| named(finding, ids))
                    .map(|ids| { ids.into_iter().map(|id| id.0).collect::<Vec<_>>() })
            );
        }
        object
    };
    json!({ "findings": findings.iter().map(object).collect::<Vec<_>>() })
}

/// What mends a finding; `None`: the file has to be corrected.
const fn cure(kind: FindingKind) -> Option<&'static str> {
    match kind {
        FindingKind::DuplicateFace | FindingKind::NonManifoldEdge | FindingKind::NotOrientable => {
            Some("--repair")
        }
        FindingKind::NonManifoldVertex
        | FindingKind::RepeatedCorner
        | FindingKind::ZeroAreaFace
        | FindingKind::InconsistentWinding
        | FindingKind::WindingAgainstNormals
        | FindingKind::SeveralComponents
        | FindingKind::IsolatedTaxel
        | FindingKind::NormalNotUnit
        | FindingKind::UnusableTangent
        | FindingKind::ConstantNormals
        | FindingKind::UnrelatedNormals
        | FindingKind::InwardNormal
        | FindingKind::AreaNotPositive => Some("reading"),
        FindingKind::DoubtfulUnit => Some("--unit"),
        FindingKind::PinHole => Some("--fill-holes"),
        FindingKind::ClosedPatch | FindingKind::Handle => Some("--cut"),
        _ => None,
    }
}

/// A finding in a line: what, how many, where, and what mends it.
fn sentence(finding: &Finding, draft: &Draft) -> String {
    let mended = match cure(finding.kind) {
        None => String::new(),
        Some("reading") => "; reading it mends it".into(),
        Some(option) => format!("; {option} mends it"),
    };
    line(&finding.to_string()) + &elements(finding, draft) + &mended + "\n"
}

/// The sheet whose vertices a finding counts; `None` if it counts something else, or its name is not
/// unique.
fn sheet_of<'a>(finding: &Finding, draft: &'a Draft) -> Option<&'a Sheet> {
    let mut sheets = draft.sheets.iter().filter(|sheet| sheet.title() == finding.patch);
    let sheet = sheets.next().filter(|_| sheets.next().is_none());
    sheet.filter(|_| matches!(finding.kind.elements(), "vertices" | "edges"))
}

/// What `values` holds for the vertices of a finding.
fn named<T: Copy>(finding: &Finding, values: &[T]) -> Vec<T> {
    let value = |&v: &u64| values.get(usize::try_from(v).ok()?).copied();
    finding.elements.iter().filter_map(value).collect()
}

/// ` [faces 3, 5, 8 and 4 more]`, or nothing for a finding about a whole sheet; vertices as the file
/// numbers them, and the ids of their taxels where it has some.
fn elements(finding: &Finding, draft: &Draft) -> String {
    let noun = finding.kind.elements();
    if noun.is_empty() {
        return String::new();
    }
    let size = if noun == "edges" { 2 } else { 1 };
    let count = finding.elements.len() / size;
    let few = |numbers: &[u64]| -> String {
        let of_element = |element: &[u64]| element.iter().map(u64::to_string).collect::<Vec<_>>().join("-");
        numbers.chunks(size).take(SHOWN).map(of_element).collect::<Vec<_>>().join(", ")
    };
    let rest = if count > SHOWN { format!(" and {} more", count - SHOWN) } else { String::new() };
    let sheet = sheet_of(finding, draft);
    let numbers = sheet.and_then(|sheet| sheet.numbers.as_ref());
    let numbers = numbers.map(|all| named(finding, all).into_iter().map(u64::from).collect());
    let mut text = format!(" [{noun} {}{rest}", few(&numbers.unwrap_or_else(|| finding.elements.clone())));
    if let Some(ids) = sheet.and_then(|sheet| sheet.ids.as_ref()) {
        let ids: Vec<u64> = named(finding, ids).into_iter().map(|id| id.0.into()).collect();
        text += &format!("; taxels {}", few(&ids));
    }
    text + "]"
}
