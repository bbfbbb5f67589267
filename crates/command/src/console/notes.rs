//! Notes on standard error: what was changed, what a file loses, which maps overlap themselves.

use std::{collections::HashMap, fmt, mem, path::Path};

use dermatome::Error;
use dermatome::cut::Cut;
use dermatome::flatten::{Distortion, FlattenOptions, Method, Overlap};
use dermatome::io::{IoError, TaxelTable, Unused, lost_in};
use dermatome::pipeline::{BuildOptions, BuildRemark, Enlarged};
use dermatome::skin::{Remark, Skin};

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

/// Says which columns of a table change nothing.
pub(crate) fn note_columns(path: &Path, columns: &[String], common: &Common) {
    let (path, named) = (path.display(), first_names(columns));
    match columns.len() {
        0 => {}
        1 => note!(common, "{path}: column {named} is not used"),
        _ => note!(common, "{path}: columns {named} are not used"),
    }
}

/// Says which columns and rows of a table about the taxels of a skin change nothing.
pub(crate) fn note_unused(path: &Path, unused: &Unused, common: &Common) {
    note_columns(path, &unused.columns, common);
    if unused.rows > 0 {
        let (rows, are) = if unused.rows == 1 { ("row", "is") } else { ("rows", "are") };
        note!(
            common,
            "{}: {} {rows} of taxels or patches that the file has and the skin has not {are} not used",
            path.display(),
            unused.rows
        );
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
    let remarks = BuildRemark::of_skin(skin);
    let rounded = remarks.iter().filter(|remark| matches!(remark, BuildRemark::Rounded { .. }));
    rounded.for_each(|remark| note!(common, "{remark}"));
}

/// Prints what a build or a map of one mesh says, with the options that help; seams of many patches in one line, unless all
/// are asked for.
pub(crate) fn note_build(remarks: &[BuildRemark], options: &BuildOptions, common: &Common) {
    let seam = |remark: &BuildRemark| match remark {
        BuildRemark::Seam { patch, length } => Some((patch.clone(), *length)),
        _ => None,
    };
    let (names, lengths): (Vec<_>, Vec<_>) = remarks.iter().filter_map(seam).unzip();
    let is_one_line = names.len() > MOST_ALIKE && !common.verbose;
    if is_one_line {
        let (count, seams, names) = (names.len(), 1e3 * lengths.iter().sum::<f64>(), first_names(&names));
        note!(
            common,
            "{count} maps are cut open along seams of {seams:.0} mm in all: {names}; -v lists them"
        );
    }
    for remark in remarks.iter().filter(|remark| !is_one_line || seam(remark).is_none()) {
        note!(common, "{remark}{}", advice(remark, options));
    }
}

/// What helps, as the end of the sentence.
fn advice(remark: &BuildRemark, options: &BuildOptions) -> String {
    match remark {
        BuildRemark::OtherEnergy { .. } => ", as with --energy symmetric-dirichlet".into(),
        BuildRemark::LargePixels(Enlarged { pixel_mm, .. }) => format!("; --pixel-mm {pixel_mm} is the same"),
        BuildRemark::Overlap { .. } => format!("; {}", cure(&options.flatten)),
        BuildRemark::AreaRatio { .. } => ": raise --max-area-ratio, or split the patch".into(),
        BuildRemark::Poor { worst, .. } => less_distorted(worst, options).into(),
        _ => String::new(),
    }
}

/// Names triangles that are removed with the older table of taxels that they belonged to.
pub(crate) fn note_dropped(triangles: &Path, common: &Common) {
    note!(common, "{} belonged to the table that is replaced, and is removed", triangles.display());
}

/// The option that improves poor maps.
fn less_distorted(worst: &Distortion, options: &BuildOptions) -> &'static str {
    match (options.flatten.method, &options.cut) {
        (Method::Linear { .. } | Method::Conformal, _) => ": --method intrinsic distorts less",
        (_, Cut::None) => ": --cut auto cuts where that helps",
        (_, Cut::Auto) if worst.is_absurd() => {
            ": CAD with needles is often better remeshed, as with --spacing 5mm"
        }
        (_, Cut::Auto) => ": --max-area-ratio 2 cuts further",
        (_, Cut::AreaRatio(wanted)) if worst.area_max <= *wanted => ": a lower --max-area-ratio cuts further",
        (_, Cut::AreaRatio(_)) => "",
        _ => ": --cut auto looks for a seam of its own",
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
