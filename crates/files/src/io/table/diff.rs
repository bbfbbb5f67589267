//! Tables of what changed between two files of one skin.

use crate::diff::{Change, Diff};
use crate::io::IoError;
use crate::io::file::OutPath;
use crate::io::table::writer::write_table;

const COLUMNS: &str = "kind,what,patch,taxels,distance_mm,angle_deg,sigmas,p,link,other";

/// Writes the changes between two files, a row each: `what` is `module 7`, `taxels` are ids between semicolons, `other`
/// is that with which it was exchanged or at whose place it is, or the new ids. What was not measured is an empty cell.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_diff(path: impl Into<OutPath>, diff: &Diff) -> Result<(), IoError> {
    write_table(&path.into(), COLUMNS, |table| {
        for change in &diff.changes {
            let Change { kind, subject, name, other, link, patch, taxels, others, .. } = change;
            let list = |ids: &[_]| ids.iter().map(ToString::to_string).collect::<Vec<_>>().join(";");
            table.cell(&kind.to_string());
            table.cell(&format!("{subject} {name}"));
            table.cell(patch);
            table.cell(&list(taxels));
            let is_measured = !change.sigmas.is_nan();
            let numbers = [1e3 * change.distance, change.angle.to_degrees(), change.sigmas, change.p];
            numbers.into_iter().for_each(|x| table.number_if_any(is_measured.then_some(x)));
            table.cell(link);
            table.cell(&other.clone().unwrap_or_else(|| list(others)));
            table.end_row()?;
        }
        Ok(())
    })
}
