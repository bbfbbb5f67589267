//! Files of patterns: their kinds, their sheets of paper, and how they are written.

use std::path::{Path, PathBuf};

use dermatome::Error;
use dermatome::io::IoError;
use dermatome::pattern::{Drawing, Sheet, write_dxf, write_sheets, write_svg};
use glam::DVec2;

use crate::console::errors::advise;
use crate::files::outputs::{self, guard, is_stream, write_bytes};
use crate::options::{Common, numbers};

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum PatternKind {
    Svg,
    Dxf,
}

/// The kind of a pattern by its extension; standard output is SVG.
pub(crate) fn pattern_kind(path: &Path) -> Option<PatternKind> {
    match outputs::kind(path).as_str() {
        "svg" => Some(PatternKind::Svg),
        "dxf" => Some(PatternKind::Dxf),
        _ => is_stream(path).then_some(PatternKind::Svg),
    }
}

/// Refuses sheets that no file has.
pub(crate) fn check_sheet<'a>(
    sheet: Option<Sheet>,
    mut outputs: impl Iterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    let has_file = |path: &Path| !is_stream(path) && pattern_kind(path) == Some(PatternKind::Svg);
    if sheet.is_some() && !outputs.any(has_file) {
        let why = "--sheet changes nothing: sheets are files, written for an output .svg";
        return Err(advise(why, "add -o OUT.svg, or leave out --sheet"));
    }
    Ok(())
}

/// Writes a pattern to files that are no streams; they appear with the other outputs.
pub(crate) fn write_pattern(
    path: &Path,
    drawing: &Drawing,
    sheet: Option<Sheet>,
    common: &Common,
) -> Result<(), Error> {
    let write = |path: &Path, text: String| write_bytes(&common.outputs.file(path), text.as_bytes());
    match (pattern_kind(path), sheet) {
        (Some(PatternKind::Dxf), _) => write(path, write_dxf(drawing))?,
        (Some(PatternKind::Svg), None) => write(path, write_svg(drawing, &title(path)))?,
        (Some(PatternKind::Svg), Some(sheet)) => {
            let sheets = write_sheets(drawing, &title(path), sheet)?;
            let paths: Vec<PathBuf> = (1..=sheets.len()).map(|k| sheet_path(path, k, sheets.len())).collect();
            guard(&paths, &common.outputs)?;
            paths.iter().zip(sheets).try_for_each(|(path, text)| write(path, text))?;
        }
        (None, _) => return Err(IoError::UnknownKind { path: path.to_owned(), known: ".svg, .dxf" }.into()),
    }
    Ok(())
}

/// The name of a pattern: that of its file.
fn title(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// `pattern-03.svg`: the numbers have as many digits as the last.
fn sheet_path(path: &Path, number: usize, count: usize) -> PathBuf {
    let digits = count.to_string().len();
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{number:0digits$}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// A size of paper.
pub(crate) fn sheet(text: &str) -> Result<Sheet, String> {
    match text {
        "A4" | "a4" => Ok(Sheet::A4),
        "A3" | "a3" => Ok(Sheet::A3),
        _ => numbers(text)
            .map(|size| Sheet { size: DVec2::from_array(size), can_turn: false })
            .ok_or_else(|| "needed: A4, A3, or width and height in mm, as in 210,297".to_owned()),
    }
}
