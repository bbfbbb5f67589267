use crate::skin::{Sheet, names::sheet_name};

/// Parts of robots are smaller, in m. The same part in millimetres reads as a thousand times larger, so that down to a
/// fingertip of 10 mm its unit shows.
const LARGEST_PART: f64 = 10.0;

/// Says of the largest sheet that its size makes no sense in metres; its name, and the sentence.
pub(super) fn doubtful_unit(sheets: &[Sheet]) -> Option<(&str, String)> {
    let largest = sheets.iter().map(|sheet| (sheet, extent(sheet))).max_by(|a, b| a.1.total_cmp(&b.1));
    let (sheet, extent) = largest.filter(|&(_, extent)| extent > LARGEST_PART && extent.is_finite())?;
    // What CAD and scanners write.
    let size = if extent < 1e5 { format!("{extent:.0}") } else { format!("{extent:.0e}") };
    let message = format!(
        "it is {size} m across: is the file in millimetres? Lengths are read as metres, so divide them by 1000"
    );
    Some((sheet_name(sheet), message))
}

/// Longest side, in m, of the box around a sheet without its outermost hundredth on either side: numbers that stand for none are
/// often -999.
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
