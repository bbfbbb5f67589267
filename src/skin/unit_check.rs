//! *Heuristic*: recognises files in millimetres by the size of the skin.
//!
//! The extent without outliers is robust against sentinel coordinates such as -999; the bounding
//! box is not.

use crate::skin::{Remark, RemarkKind, Sheet};

/// Parts of robots are smaller, in m. The same part in millimetres reads as a thousand times
/// larger, so that its unit shows down to a fingertip of 10 mm.
const LARGEST_PART: f64 = 10.0;

/// A warning about the largest sheet, if its size makes no sense in metres.
pub(super) fn doubtful_unit(sheets: &[Sheet]) -> Option<Remark> {
    let largest = sheets.iter().map(|sheet| (sheet, extent(sheet))).max_by(|a, b| a.1.total_cmp(&b.1));
    let (sheet, extent) = largest.filter(|&(_, extent)| extent > LARGEST_PART && extent.is_finite())?;
    Some(Remark { patch: sheet.title().to_owned(), kind: RemarkKind::DoubtfulUnit { extent } })
}

/// Longest side, in m, of the box around a sheet without the outermost hundredth of its vertices on
/// each side.
fn extent(sheet: &Sheet) -> f64 {
    let count = sheet.positions.len();
    let out = count.div_ceil(100).min(count.saturating_sub(1) / 2);
    let side = |axis: usize| {
        let mut along: Vec<f64> = sheet.positions.iter().map(|p| p[axis]).collect();
        let mut nth = |k: usize| *along.select_nth_unstable_by(k, f64::total_cmp).1;
        nth(count - 1 - out) - nth(out)
    };
    if count == 0 { 0.0 } else { (0..3).map(side).fold(0.0, f64::max) }
}
