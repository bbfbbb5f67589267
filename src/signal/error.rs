//! Why readings cannot be used with a map, or not be simulated.

use crate::{
    contact::ContactError,
    skin::{SkinError, TaxelId},
};

/// Why readings cannot be used with a map, or not be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum SignalError {
    /// Two columns of the readings have the same id.
    #[error(
        "columns {} and {} of the readings both have the taxel id {taxel}; an id of its own is needed for \
         each column, or the choice of the first",
        columns[0], columns[1]
    )]
    DuplicateId { taxel: TaxelId, columns: [usize; 2] },
    /// Readings without ids that are not as many as the map has taxels.
    #[error(
        "the readings have {found} columns without ids, but the map has {needed} taxels; needed are \
         {needed} columns in the order of the map, patch after patch, or an array `ids` with the taxel id \
         of each of the {found} columns"
    )]
    Width { found: usize, needed: usize },
    /// Not one id per column.
    #[error("{ids} taxel ids for readings of {width} columns; one for each column is needed")]
    IdCount { ids: usize, width: usize },
    /// No column belongs to a taxel of the map.
    #[error(
        "none of the {columns} taxel ids of the readings is in the map; the first is {first}, that of the \
         map {known}; readings of the skin that the map was made of are needed"
    )]
    NoneMatched { columns: usize, first: TaxelId, known: TaxelId },
    /// An option that is out of range.
    #[error("{option} is {found}; {needed} is needed")]
    Option { option: String, found: f64, needed: String },
    /// A skin without a working taxel, on which touches were to be simulated.
    #[error("the skin has no working taxel that could feel a touch")]
    NoTaxels,
    /// A frame whose first channel does not have a value for each taxel.
    #[error("a frame with {found:?} values in its patches; one of the map, with {needed:?}, is needed")]
    ForeignFrame { found: Vec<usize>, needed: Vec<usize> },
    /// A recording of more readings than a page holds.
    #[error("{frames} frames of {taxels} taxels do not fit into a page; at most {most} do")]
    TooLong { frames: usize, taxels: usize, most: usize },
    /// A contact that cannot be answered.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// Data that is not a valid skin.
    #[error(transparent)]
    Skin(#[from] SkinError),
}

impl SignalError {
    pub(super) fn option(option: impl Into<String>, found: f64, needed: impl Into<String>) -> Self {
        Self::Option { option: option.into(), found, needed: needed.into() }
    }
}
