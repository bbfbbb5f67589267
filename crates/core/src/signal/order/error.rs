//! Why the order of columns cannot be found.

use crate::run::Cancelled;
use crate::signal::SignalError;
use crate::skin::TaxelId;

/// Why the order of the columns of recordings cannot be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum OrderError {
    #[error("{found} {what}; the order of at most {most} is found")]
    TooLarge { what: &'static str, found: usize, most: usize },
    #[error(
        "recording {number} has {found} columns, and the first {first}; recordings of the same columns are needed"
    )]
    Columns { number: usize, found: usize, first: usize },
    #[error(
        "{found} of {columns} columns are touched in {frames} frames ({crowded} of them, in which most columns are \
         touched at once, are left out); at least {needed} are needed; touches are above {threshold:.4}"
    )]
    NoTouch { found: usize, columns: usize, frames: usize, crowded: usize, needed: usize, threshold: f64 },
    #[error(
        "{found} columns are touched, and the skin has {taxels} taxels; a recording of this skin is needed"
    )]
    MoreColumns { found: usize, taxels: usize },
    #[error(
        "the signals of only {found} of {columns} columns are connected, for {taxels} taxels, after {touches} touches; \
         {needed} are needed: more separate touches that roll, all over the skin"
    )]
    Unconnected { found: usize, columns: usize, taxels: usize, touches: usize, needed: usize },
    #[error(
        "the best order explains {objective:.3} of the likeness of signals, {needed} is needed; there were {touches} touches: \
         more separate ones that roll are needed, all over the skin, some 200 of a hand and 800 of a fingertip for 600 taxels"
    )]
    Poor { objective: f64, needed: f64, touches: usize },
    #[error(
        "the skin is symmetric to signals: two orders explain them alike ({:.3} and {:.3}); the columns of three taxels must \
         be known that are not on a line, best {}, {} and {}: touch each of them, see which column reads it, and give \
         these with the table of known columns",
        objectives[0], objectives[1], taxels[0], taxels[1], taxels[2]
    )]
    Symmetric { objectives: [f64; 2], taxels: [TaxelId; 3] },
    #[error(
        "column {column} is known to be of taxel {taxel}, and so is column {other}; each taxel has one column"
    )]
    KnownTwice { column: usize, other: usize, taxel: TaxelId },
    #[error(
        "column {column} is known twice, as taxel {first} and as taxel {second}; each column has one taxel"
    )]
    KnownColumnTwice { column: usize, first: TaxelId, second: TaxelId },
    #[error("column {column} is known, but the recording has {columns} columns, counted from 0")]
    KnownColumn { column: usize, columns: usize },
    #[error(
        "column {column} is known to be of taxel {taxel}, which is the id of {count} taxels of the skin that are present; one is needed"
    )]
    KnownTaxel { column: usize, taxel: TaxelId, count: usize },
    #[error(
        "no order that explains the signals agrees with the known columns; in the nearest one column {column}, known to be of \
         taxel {known}, is {spacings:.1} spacings away from it, at taxel {found}; correct the known columns"
    )]
    Contradiction { column: usize, known: TaxelId, found: TaxelId, spacings: f64 },
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error(transparent)]
    Signal(#[from] SignalError),
}
