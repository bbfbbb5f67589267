//! `dermatome diff A B`: what changed between two files of one skin.

use std::path::Path;
use std::process::ExitCode;

use dermatome::Error;
use dermatome::diff::{Change, ChangeKind, Diff, DiffOptions, diff};
use dermatome::io::{IoError, modules_of_skin, read_modules, write_diff};
use dermatome::plot::{Picture, PlotOptions, plot_diff};
use dermatome::skin::{Draft, TaxelId};
use serde_json::{Value, json};

use crate::console::errors::INCOMPLETE;
use crate::console::notes::{note, rows_of};
use crate::console::print::{line, print, print_json};
use crate::files::input::{read_draft_of, read_map_if_any};
use crate::files::outputs;
use crate::files::pictures::{picture_kind, write_picture};
use crate::options::{Common, InPath, ModulesArg, OutFile, ReadArgs, length_mm, modules_arg};

/// List what changed between two files of one skin: exit code 1 if anything did, or taxels cannot be matched.
///
/// Taxels are matched by id, those that share one by link and patch, too, and links by name; each link is aligned by the motion that most of its taxels follow. Modules and
/// taxels are compared with their neighbours: moved, turned, swapped, mirrored, renumbered, missing and new ones are
/// listed, and other links, normals, areas, modules, modalities and regions.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin before: any file that `build` or `calibrate` reads or writes
    before: InPath,
    /// The skin after
    after: InPath,
    /// Table of the changes
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<OutFile>,
    /// Picture of the changes on the map of the first file: .svg or .png; `-`: SVG on standard output, in place of the
    /// list
    #[arg(long, value_name = "OUT", conflicts_with = "json")]
    plot: Option<OutFile>,
    /// The module of each taxel: a table with columns taxel_id,module, or N: the same id / N [default: as the files say]
    #[arg(long, value_name = "M.csv|N", value_parser = modules_arg)]
    modules: Option<ModulesArg>,
    /// Standard deviation of the difference of one taxel along each axis [default: estimated from the files]
    #[arg(long = "sigma-mm", value_name = "MM", value_parser = length_mm)]
    sigma: Option<f64>,
    /// Print the changes as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

/// A line holds no more ids; `--json` and the table have them all.
const SHOWN: usize = 8;

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    args.output.as_deref().map_or(Ok(()), outputs::check_table)?;
    let plot = args.plot.as_deref();
    plot.map_or(Ok(()), |path| picture_kind(path).map(|_| ()))?;
    args.read.allow_as_written("diff compares files as they are written")?;
    let [before, after] = [&args.before, &args.after].map(|path| read_draft_of(path, &args.read, false));
    let (before, after) = (before?, after?);
    let modules = match &args.modules {
        None => [&args.before, &args.after].map(|path| modules_of_skin(path).map(Option::unwrap_or_default)),
        Some(ModulesArg::Of(size)) => [&before, &after].map(|draft| Ok(modules_of(draft, *size))),
        Some(ModulesArg::Table(path)) => {
            let rows = rows_of(path, read_modules(path), common)?;
            [Ok(rows.clone()), Ok(rows)]
        }
    };
    let [of_before, of_after] = modules.map(|modules: Result<_, IoError>| modules.map_err(Error::from));
    let modules = [of_before?, of_after?];
    let options = DiffOptions { modules, sigma: args.sigma, ..DiffOptions::default() };
    let found = diff(&before, &after, &options).map_err(Error::from)?;
    if let Some(path) = &args.output {
        write_diff(common.outputs.file(path), &found).map_err(Error::from)?;
    }
    let picture = plot.map(|path| draw(args, &found, path, common)).transpose()?;
    outputs::publish(common)?;
    for (path, count) in [&args.before, &args.after].into_iter().zip(found.ambiguous) {
        if count > 0 {
            note!(common, "{}: {count} taxels not compared, since their ids are not unique", path.display());
        }
    }
    for link in found.links.iter().filter(|link| 2 * link.unchanged < link.taxels) {
        let name = &link.name;
        note!(
            common,
            "link {name:?}: only {} of {} taxels are where the others say; what is listed may be the rest",
            link.unchanged,
            link.taxels
        );
    }
    if let (Some(picture), true) = (picture, plot.is_some_and(outputs::is_stream)) {
        print(&picture.to_svg())?;
    } else if args.json {
        print_json("dermatome.diff/1", &as_json(&found))?;
    } else {
        print(&sentences(&found))?;
    }
    let is_whole = found.ambiguous == [0, 0];
    Ok(if found.changes.is_empty() && is_whole { ExitCode::SUCCESS } else { ExitCode::from(INCOMPLETE) })
}

/// Draws the changes on the map of the first file, and writes the picture unless it is printed.
fn draw(args: &Args, found: &Diff, path: &Path, common: &Common) -> anyhow::Result<Picture> {
    let no_map = || IoError::NoMap { path: args.before.to_path_buf() };
    let map = read_map_if_any(&args.before)?.ok_or_else(|| Error::from(no_map()))?;
    let picture = plot_diff(&map, found, &PlotOptions::default()).map_err(Error::from)?;
    if !outputs::is_stream(path) {
        write_picture(path, &picture, common)?;
    }
    Ok(picture)
}

/// Ids of one module give the same number divided by its size.
fn modules_of(draft: &Draft, size: u32) -> Vec<(TaxelId, String)> {
    let ids = draft.sheets.iter().filter_map(|sheet| sheet.ids.as_ref()).flatten();
    ids.map(|id| (*id, (id.0 / size).to_string())).collect()
}

fn sentences(found: &Diff) -> String {
    let changes: String = found.changes.iter().map(|change| line(&sentence(change)) + "\n").collect();
    let many = if found.changes.len() == 1 { "change" } else { "changes" };
    changes + &format!("{} taxels compared by {}, {} {many}\n", found.matched, found.by, found.changes.len())
}

/// `module 7 of palm moved by 3.1 mm, turned by 2.0 deg (12 sigma) [taxels 1, 2 and 8 more]`.
fn sentence(change: &Change) -> String {
    let Change { kind, subject, name, other, link, patch, distance, angle, sigmas, .. } = change;
    let subject_name = match name.as_str() {
        "" => format!("a {subject} without a name"),
        _ => format!("{subject} {name}"),
    };
    let of = if patch.is_empty() || patch == name { String::new() } else { format!(" of {patch}") };
    let (millimetres, degrees) = (1e3 * distance, angle.to_degrees());
    let at = other.as_ref().map_or(String::new(), |other| format!(", to the place of {subject} {other}"));
    let how = match kind {
        ChangeKind::Frame => format!("moved as a whole by {millimetres:.2} mm and {degrees:.2} deg"),
        ChangeKind::Mirrored => "has its ids the other way round: mirrored".into(),
        ChangeKind::Moved => format!("moved by {millimetres:.2} mm and turned by {degrees:.1} deg{at}"),
        ChangeKind::Turned => format!("turned by {degrees:.1} deg at its place"),
        ChangeKind::Swapped => {
            format!("exchanged its place with {subject} {}", other.as_deref().unwrap_or_default())
        }
        ChangeKind::Renumbered => format!("has other ids: {}", few(&change.others)),
        // Of a patch or a module some taxels may be there.
        ChangeKind::Missing | ChangeKind::New => {
            let (count, is) = (change.taxels.len(), if change.taxels.len() == 1 { "is" } else { "are" });
            let taxels = if count == 1 { "1 taxel".to_owned() } else { format!("{count} taxels") };
            let what = if *kind == ChangeKind::New { "new" } else { "missing" };
            let named = few(&change.taxels);
            return format!("{taxels} of {subject_name}{of} {is} {what} in the second file [taxels {named}]");
        }
        ChangeKind::Relinked => {
            format!("is on the link {:?} in place of {link:?}", other.as_deref().unwrap_or_default())
        }
        ChangeKind::Tilted => format!("has other normals, turned by up to {degrees:.1} deg"),
        ChangeKind::Resized => "has other areas".into(),
        ChangeKind::Modality => format!("senses {}", other.as_deref().unwrap_or_default()),
        ChangeKind::Region => match other.as_deref() {
            Some(region) if !region.is_empty() => format!("is in the region {region}"),
            _ => "is in no region".into(),
        },
        ChangeKind::Regrouped => format!("belongs to the module {}", other.as_deref().unwrap_or_default()),
    };
    let sure = if sigmas.is_nan() { String::new() } else { format!(" ({sigmas:.1} sigma)") };
    format!("{subject_name}{of} {how}{sure} [taxels {}]", few(&change.taxels))
}

fn few(ids: &[TaxelId]) -> String {
    let shown = ids.iter().take(SHOWN).map(ToString::to_string).collect::<Vec<_>>().join(", ");
    if ids.len() > SHOWN { format!("{shown} and {} more", ids.len() - SHOWN) } else { shown }
}

fn as_json(found: &Diff) -> Value {
    let known = |x: f64| Some(x).filter(|x| x.is_finite());
    let ids = |ids: &[TaxelId]| ids.iter().map(|id| id.0).collect::<Vec<_>>();
    let change = |change: &Change| {
        let is_measured = !change.sigmas.is_nan();
        json!({
            "kind": change.kind.to_string(), "subject": change.subject.to_string(), "name": change.name,
            "other": change.other, "link": change.link, "patch": change.patch,
            "taxels": ids(&change.taxels), "others": ids(&change.others),
            "distance_mm": is_measured.then_some(1e3 * change.distance),
            "angle_deg": is_measured.then_some(change.angle.to_degrees()),
            "sigmas": known(change.sigmas), "p": known(change.p),
        })
    };
    let links = found.links.iter().map(|link| {
        let (moved, rotation) = (link.motion.position, link.motion.rotation);
        json!({
            "name": link.name, "taxels": link.taxels, "unchanged": link.unchanged,
            "translation": moved.to_array(), "rotation": rotation.to_array(),
        })
    });
    json!({
        "matched": found.matched, "by": found.by.to_string(), "ambiguous": found.ambiguous,
        "links": links.collect::<Vec<_>>(), "changes": found.changes.iter().map(change).collect::<Vec<_>>(),
    })
}
