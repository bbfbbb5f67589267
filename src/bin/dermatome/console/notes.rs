//! Notes on standard error: what was changed, what a file loses, which maps overlap themselves.

use std::{collections::HashMap, fmt, mem, path::Path};

use dermatome::Error;
use dermatome::cut::Cut;
use dermatome::flatten::{FlattenOptions, Method, Overlap};
use dermatome::io::{IoError, TaxelTable, lost_in, rounding_in_gltf};
use dermatome::pipeline::Built;
use dermatome::report::{LevelReport, PatchReport};
use dermatome::skin::{Remark, Skin, TaxelId};

use crate::console::print::{line, plain, say};
use crate::options::Common;

/// Prints a note on standard error, unless the run is quiet.
macro_rules! note {
    ($common:expr, $($text:tt)*) => {
        $crate::console::notes::print_note($common, format_args!($($text)*))
    };
}
pub(crate) use note;

pub(crate) fn print_note(common: &Common, text: fmt::Arguments<'_>) {
    if !common.quiet {
        say(format_args!("note: {}", line(&text.to_string())));
    }
}

/// Notes how some `things` are, a word with an `s` at its end; nothing if there are none.
pub(crate) fn note_count(common: &Common, count: u64, things: &str, how: &str) {
    match count {
        0 => {}
        1 => note!(common, "1 {} is {how}", things.trim_end_matches('s')),
        _ => note!(common, "{count} {things} are {how}"),
    }
}

/// More remarks of one kind than this become one note.
const MOST_ALIKE: usize = 3;

/// Names that a note quotes.
const NAMED: usize = 5;

/// The first few names, and how many there are besides.
pub(crate) fn first_names(names: &[String]) -> String {
    let named: Vec<_> = names.iter().take(NAMED).map(|name| format!("`{}`", plain(name))).collect();
    let others = names.len().saturating_sub(NAMED);
    let more = if others > 0 { format!(" and {others} more") } else { String::new() };
    named.join(", ") + &more
}

/// Says which patches have a map by another energy than the one asked for.
pub(crate) fn note_other_energy(built: &Built, common: &Common) {
    let patches = built.map.patches.iter().zip(&built.by_dirichlet);
    for (patch, _) in patches.filter(|(_, by_dirichlet)| **by_dirichlet) {
        let why = "no usable map by the default energy, so --energy symmetric-dirichlet was used";
        note!(common, "{}: {why}", plain(&patch.name));
    }
}

/// Says which columns of a table change nothing.
pub(crate) fn note_columns(path: &Path, columns: &[String], common: &Common) {
    let (path, named) = (path.display(), first_names(columns));
    match columns.len() {
        0 => {}
        1 => note!(common, "{path}: column {named} is not used"),
        _ => note!(common, "{path}: columns {named} are not used"),
    }
}

/// The rows of a table of taxels; names the columns that are not used.
pub(crate) fn rows_of<T>(
    path: &Path,
    table: Result<TaxelTable<T>, IoError>,
    common: &Common,
) -> Result<Vec<T>, Error> {
    let TaxelTable { rows, unused } = table?;
    note_columns(path, &unused, common);
    Ok(rows)
}

/// Prints remarks in their order; many of one kind as one note, unless all are asked for.
pub(crate) fn note_remarks(remarks: &[Remark], common: &Common) {
    let kind = |remark: &Remark| mem::discriminant(&remark.kind);
    let mut counts = HashMap::new();
    remarks.iter().for_each(|remark| *counts.entry(kind(remark)).or_insert(0) += 1);
    for remark in remarks {
        match counts.get_mut(&kind(remark)) {
            Some(count) if *count > MOST_ALIKE && !common.verbose => {
                note!(common, "{remark}; {} more such notes, -v lists them", *count - 1);
                // The others of this kind are said.
                *count = 0;
            }
            Some(0) => {}
            _ => note!(common, "{remark}"),
        }
    }
}

/// Prints how many taxels have an id that says nothing.
pub(crate) fn note_placeholders(skin: &Skin, common: &Common) {
    let ids = || skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
    let without = ids().filter(|id| TaxelId::PLACEHOLDERS.contains(id)).count();
    if without > 1 {
        let all = ids().count();
        note!(
            common,
            "{without} of {all} taxels have a placeholder id, 0 or {}: those of one id share its readings",
            u32::MAX
        );
    }
}

/// Prints what a skin loses in the kind of file that a path names.
pub(crate) fn remark_lost(path: &Path, skin: &Skin, common: &Common) {
    for lost in lost_in(path, skin) {
        note!(common, "{}: {lost}; .glb keeps everything", path.display());
    }
    if matches!(dermatome::io::file_kind(path).as_str(), "glb" | "gltf") {
        note_rounding(skin, common);
    }
}

/// Prints which patches lie so far from the origin of their link that a .glb changes their shape.
pub(crate) fn note_rounding(skin: &Skin, common: &Common) {
    for patch in &skin.patches {
        if let Some(moved) = rounding_in_gltf(&patch.mesh) {
            let (name, moved) = (plain(&patch.name), moved * 1e3);
            note!(
                common,
                "{name}: so far from the origin of its link, positions are rounded by up to {moved:.3} mm in a .glb, \
                 which keeps seven digits: move the origin near"
            );
        }
    }
}

/// Prints which maps have flipped triangles or a boundary that crosses itself, one line a patch.
pub(crate) fn note_overlaps(patches: &[PatchReport], options: &FlattenOptions, common: &Common) {
    for patch in patches {
        let faulty = patch.levels.iter().filter(|l| l.distortion.flips + l.distortion.crossings > 0);
        let levels: Vec<String> = faulty
            .map(|l| {
                format!("L{}: flips {}, crossings {}", l.level, l.distortion.flips, l.distortion.crossings)
            })
            .collect();
        if !levels.is_empty() {
            let (name, cure) = (plain(&patch.name), cure(options));
            note!(common, "{name}: the map overlaps itself ({}); {cure}", levels.join("; "));
        }
    }
}

/// Prints which patches are cut open for their map; many in one line, unless all are asked for.
pub(crate) fn note_seams(patches: &[PatchReport], common: &Common) {
    let finest = |patch: &PatchReport| patch.levels.first().map_or(0.0, |finest| finest.seam * 1e3);
    let cut: Vec<&PatchReport> = patches.iter().filter(|patch| finest(patch) > 0.0).collect();
    if cut.len() <= MOST_ALIKE || common.verbose {
        for patch in cut {
            let (name, seam) = (plain(&patch.name), finest(patch));
            note!(common, "{name}: the map is cut open along a seam of {seam:.0} mm");
        }
        return;
    }
    let names: Vec<String> = cut.iter().map(|patch| patch.name.clone()).collect();
    let seams: f64 = cut.iter().map(|patch| finest(patch)).sum();
    let (count, names) = (cut.len(), first_names(&names));
    note!(common, "{count} maps are cut open along seams of {seams:.0} mm in all: {names}; -v lists them");
}

/// Prints which maps do not keep the area ratio that was asked for.
pub(crate) fn note_area_ratio(patches: &[PatchReport], cut: &Cut, common: &Common) {
    let Cut::AreaRatio(wanted) = *cut else { return };
    for patch in patches {
        let ratio = patch.levels.first().map_or(1.0, |finest| finest.distortion.area_max);
        if ratio > wanted {
            let name = plain(&patch.name);
            note!(
                common,
                "{name}: the largest area ratio of the map is {ratio:.4}; no cut into a map of one piece was found that \
                     keeps {wanted}: raise --max-area-ratio, or split the patch"
            );
        }
    }
}

/// Names triangles that are removed with the older table of taxels that they belonged to.
pub(crate) fn note_dropped(triangles: &Path, common: &Common) {
    note!(common, "{} belonged to the table that is replaced, and is removed", triangles.display());
}

/// A face of a coarse level with a larger s1/s2 is named: no face of a level has one without needles of the skin.
const EXTREME: f64 = 1000.0;

/// Prints which finest maps are poor, the worst first, in one line with the option that improves them, which coarse maps
/// have needles, and which are not at a minimum.
pub(crate) fn note_distortion(patches: &[PatchReport], options: &FlattenOptions, cut: &Cut, common: &Common) {
    let finest = |patch: &PatchReport| Some((patch.name.clone(), patch.levels.first()?.distortion));
    let mut poor: Vec<_> = patches.iter().filter_map(finest).filter(|(_, map)| map.is_poor()).collect();
    poor.sort_by(|(_, a), (_, b)| b.symmetric_dirichlet.total_cmp(&a.symmetric_dirichlet));
    if let Some((_, worst)) = poor.first() {
        let advice = match (options.method, cut) {
            (Method::Linear { .. } | Method::Conformal, _) => ": --method intrinsic distorts less",
            (_, Cut::None) => ": --cut auto cuts where that helps",
            (_, Cut::Auto) if worst.is_absurd() => {
                ": CAD with needles is often better remeshed, as with --spacing 5mm"
            }
            (_, Cut::Auto) => ": --max-area-ratio 2 cuts further",
            (_, Cut::AreaRatio(wanted)) if worst.area_max <= *wanted => {
                ": a lower --max-area-ratio cuts further"
            }
            (_, Cut::AreaRatio(_)) => "",
            _ => ": --cut auto looks for a seam of its own",
        };
        let names: Vec<String> = poor.iter().map(|(name, _)| name.clone()).collect();
        let (maps, are, the) =
            if poor.len() == 1 { ("map", "is", "") } else { ("maps", "are", "the first: ") };
        note!(
            common,
            "{} {maps} {are} poor, {} ({the}symmetric Dirichlet {:.1}, largest s1/s2 {:.1}){advice}",
            poor.len(),
            first_names(&names),
            worst.symmetric_dirichlet,
            worst.qc_max,
        );
    }
    let is_extreme = |level: &&LevelReport| level.distortion.qc_max > EXTREME;
    for patch in patches {
        let name = plain(&patch.name);
        let coarse = patch.levels.iter().skip(1).filter(is_extreme);
        if let Some(worst) = coarse.max_by(|a, b| a.distortion.qc_max.total_cmp(&b.distortion.qc_max)) {
            note!(
                common,
                "{name}: the map of level {} has a face with s1/s2 of {:.1e}: its corners are almost on a line on the skin",
                worst.level,
                worst.distortion.qc_max
            );
        }
        let short =
            patch.levels.iter().filter_map(|l| Some((l.level, l.convergence.filter(|c| !c.converged)?)));
        for (level, convergence) in short {
            note!(
                common,
                "{name}: the map of level {level} is not at a minimum: its steps ended at a relative gradient of \
                     {:.1e}",
                convergence.gradient
            );
        }
    }
}

fn cure(options: &FlattenOptions) -> &'static str {
    match (options.method, options.overlap) {
        (Method::Intrinsic { .. }, Overlap::Allow) => "without --overlap allow it does not",
        (Method::Intrinsic { .. }, Overlap::Prevent) => "the mesh may be too thin there for 64-bit numbers",
        (Method::Linear { area, .. }, _) if area > 0.0 => {
            "try --area 0, or --method intrinsic, which prevents that"
        }
        (Method::Linear { .. } | Method::Conformal, _) => "--method intrinsic prevents that",
    }
}
