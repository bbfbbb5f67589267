//! `check`: the problems of a skin, and with recordings of its taxels.

mod log;
mod order;
mod recordings;

use std::process::ExitCode;

use dermatome::id::VertexId;
use dermatome::io::is_touch_log;
use dermatome::skin::{Draft, Elements, Finding, FindingKind, Severity, Sheet, assemble, check};

use serde_json::{Value, json};

use crate::check::order::OrderArgs;
use crate::check::recordings::{RecordingArgs, finding_as_json, sentences, summary_as_json};
use crate::console::errors::{INCOMPLETE, advise};
use crate::console::notes::note;
use crate::console::print::{line, print, print_gaps, print_json};
use crate::files::input::{gaps_as_json, gaps_of, read_draft_of, read_map_if_any, read_skin};
use crate::files::outputs;
use crate::options::{Common, InPath, PatchArgs, ReadArgs};

/// List everything that is wrong with a skin; exit code 1 if `build` would refuse it.
///
/// Errors are what `build` refuses; warnings are what it accepts, though it is probably a mistake; notes
/// are nothing wrong. That taxels are bare is a note on standard error. With recordings, errors are taxels that cannot be
/// trusted too: dead, stuck, noisy, jumping, chattering, saturated, silent or swapped ones, crosstalk, and steps and turns of modules; those
/// that nothing touched are untested. With --order recordings show which of their columns is of which taxel. Of a log of
/// touches, a table with px,py,pz and taxels: whether a skin follows from it, and what it cannot tell.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Skin or mesh: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt; or a log of touches: .csv or .txt
    file: InPath,
    /// The link whose touches are judged, if a log has several
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Print all elements of every finding as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    recordings: RecordingArgs,
    #[command(flatten)]
    order: OrderArgs,
}

/// A line holds no more elements; `--json` gives them all.
const SHOWN: usize = 8;

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    if matches!(&*outputs::kind(&args.file), "csv" | "txt")
        && args.recordings.is_empty()
        && is_touch_log(&args.file)
    {
        return log::run(&args.file, args.link.as_deref(), args.json, common);
    }
    if args.link.is_some() {
        let what = format!("--link: {} is no log of touches by itself", args.file.display());
        return Err(advise(what, "leave out --link"));
    }
    args.recordings.check(if args.order.order { "twice" } else { "three times" })?;
    let draft = read_draft_of(&args.file, &args.read, false)?;
    // A map that lookups refuse is no skin without findings.
    let map = read_map_if_any(&args.file)?;
    let options = args.read.options(&[&args.file]);
    let findings = check(&draft, &options);
    let (notes, findings): (Vec<_>, Vec<_>) = findings.into_iter().partition(|f| f.kind == FindingKind::Bare);
    notes.iter().for_each(|found| note!(common, "{found}"));
    let gaps = match &map {
        Some(map) => gaps_of(Some(map), &map.skin(), args.read.unit),
        None => assemble(&draft, &options)
            .map_or_else(|_| Vec::new(), |made| gaps_of(None, &made.skin, args.read.unit)),
    };
    let is_refused = findings.iter().any(|f| f.severity() == Severity::Error);
    let (mut health, mut order) = (None, None);
    if is_refused && !args.recordings.is_empty() {
        note!(common, "the recordings are not judged: first the skin must have no errors");
    } else if !args.recordings.is_empty() {
        let skin = match map {
            Some(map) => map.skin(),
            None => read_skin(&args.file, &args.read, &PatchArgs::default(), &options, common)?,
        };
        if args.order.order {
            order = Some((args.order.find(&args.recordings, &skin, common)?, skin));
        } else {
            health = Some((args.recordings.examine(&skin, common)?, skin));
        }
    }
    if args.json {
        let mut object = as_json(&findings, &draft);
        if !gaps.is_empty() {
            object["gaps"] = gaps_as_json(&gaps);
        }
        if let (Some((report, skin)), Some(all)) = (&health, object["findings"].as_array_mut()) {
            all.extend(report.findings.iter().map(|finding| finding_as_json(finding, skin)));
            object["health"] = summary_as_json(report);
        }
        if let Some((order, skin)) = &order {
            object["order"] = order::as_json(order, skin);
        }
        print_json("dermatome.check/1", &object)?;
    } else if findings.is_empty() && health.is_none() && order.is_none() {
        print("no findings\n")?;
        print_gaps(&gaps)?;
    } else {
        let of_skin: String = findings.iter().map(|f| sentence(f, &draft)).collect();
        let of_recordings = health.as_ref().map(|(report, _)| sentences(report));
        let of_recordings = of_recordings.or(order.as_ref().map(|(order, _)| order::sentence(order)));
        print(&(of_skin + &of_recordings.unwrap_or_default()))?;
        print_gaps(&gaps)?;
    }
    let is_faulty = health.is_some_and(|(report, _)| !report.findings.is_empty());
    Ok(if is_refused || is_faulty { ExitCode::from(INCOMPLETE) } else { ExitCode::SUCCESS })
}

fn as_json(findings: &[Finding], draft: &Draft) -> Value {
    let object = |finding: &Finding| {
        let mut object = json!({
            "kind": finding.kind.to_string(), "severity": finding.severity().to_string(), "patch": finding.patch,
            "elements": finding.elements.numbers(), "message": finding.message(), "repaired_by": cure(&finding.kind),
        });
        if let Some((sheet, vertices)) = vertices_of(finding, draft) {
            object["file_vertices"] = json!(sheet.numbers.as_ref().map(|all| named(&vertices, all)));
            let ids = sheet.ids.as_ref().map(|ids| named(&vertices, ids));
            object["taxels"] = json!(ids.map(|ids| ids.iter().map(|id| id.0).collect::<Vec<_>>()));
        }
        object
    };
    json!({ "findings": findings.iter().map(object).collect::<Vec<_>>() })
}

/// What repairs a finding; `None`: nothing need be done, or the file has to be corrected.
const fn cure(kind: &FindingKind) -> Option<&'static str> {
    match kind {
        FindingKind::DuplicateFace | FindingKind::NonManifoldEdge { .. } | FindingKind::NotOrientable => {
            Some("--repair")
        }
        FindingKind::NonManifoldVertex
        | FindingKind::RepeatedCorner
        | FindingKind::ZeroAreaFace
        | FindingKind::InconsistentWinding { .. }
        | FindingKind::WindingAgainstNormals { .. }
        | FindingKind::SeveralComponents { .. }
        | FindingKind::IsolatedTaxel { .. }
        | FindingKind::NormalNotUnit
        | FindingKind::UnusableTangent
        | FindingKind::ConstantNormals
        | FindingKind::UnrelatedNormals
        | FindingKind::InwardNormal
        | FindingKind::AreaNotPositive => Some("reading"),
        FindingKind::DoubtfulUnit { .. } => Some("--unit"),
        FindingKind::PinHole { .. } => Some("--fill-holes"),
        _ => None,
    }
}

/// A finding in a line: how bad it is, what, how many, where, and what repairs it.
fn sentence(finding: &Finding, draft: &Draft) -> String {
    let repair = match cure(&finding.kind) {
        None => String::new(),
        Some("reading") => "; repaired when read".into(),
        Some(option) => format!("; {option} repairs it"),
    };
    line(&format!("{}: {finding}", finding.severity())) + &elements(finding, draft) + &repair + "\n"
}

/// The vertices, or ends of edges, of a finding and the sheet that they are of; `None` if it is about
/// something else, or the name of the sheet is not unique.
fn vertices_of<'a>(finding: &Finding, draft: &'a Draft) -> Option<(&'a Sheet, Vec<VertexId>)> {
    let mut sheets = draft.sheets.iter().filter(|sheet| sheet.title() == finding.patch);
    let sheet = sheets.next().filter(|_| sheets.next().is_none())?;
    match &finding.elements {
        Elements::Vertices(vertices) => Some((sheet, vertices.clone())),
        Elements::Edges(edges) => Some((sheet, edges.concat())),
        _ => None,
    }
}

/// What `values` holds for some vertices.
fn named<T: Copy>(vertices: &[VertexId], values: &[T]) -> Vec<T> {
    vertices.iter().filter_map(|v| values.get(v.index()).copied()).collect()
}

/// ` [faces 3, 5, 8 and 4 more]`, or nothing for a finding about a whole sheet; vertices as the file
/// numbers them, and the ids of their taxels where it has some.
fn elements(finding: &Finding, draft: &Draft) -> String {
    let (noun, size) = match &finding.elements {
        Elements::Whole => return String::new(),
        Elements::Vertices(_) => ("vertices", 1),
        Elements::Faces(_) => ("faces", 1),
        Elements::Edges(_) => ("edges", 2),
        Elements::Links(_) => ("links", 1),
    };
    let few = |numbers: &[u32]| -> String {
        let of_element = |element: &[u32]| element.iter().map(u32::to_string).collect::<Vec<_>>().join("-");
        numbers.chunks(size).take(SHOWN).map(of_element).collect::<Vec<_>>().join(", ")
    };
    let count = finding.elements.len();
    let rest = if count > SHOWN { format!(" and {} more", count - SHOWN) } else { String::new() };
    let vertices = vertices_of(finding, draft);
    let in_file =
        |(sheet, vertices): &(&Sheet, Vec<VertexId>)| Some(named(vertices, sheet.numbers.as_ref()?));
    let numbers = vertices.as_ref().and_then(in_file).unwrap_or_else(|| finding.elements.numbers());
    let mut text = format!(" [{noun} {}{rest}", few(&numbers));
    let of_taxels = |(sheet, vertices): &(&Sheet, Vec<VertexId>)| Some(named(vertices, sheet.ids.as_ref()?));
    if let Some(ids) = vertices.as_ref().and_then(of_taxels) {
        text += &format!("; taxels {}", few(&ids.iter().map(|id| id.0).collect::<Vec<_>>()));
    }
    text + "]"
}
