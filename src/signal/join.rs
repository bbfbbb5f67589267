//! Joins the columns of readings to the taxels of a map, by id or by order.

use std::collections::HashMap;

use crate::{
    id::IdVec,
    map::SkinMap,
    signal::{Frame, SignalError},
    skin::{PatchId, Presence, TaxelId},
};

/// What to do with an id that several columns have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Duplicates {
    /// Refuse the readings.
    #[default]
    Refuse,
    /// Use the first column.
    First,
    /// Use the mean of the columns that have a reading.
    Mean,
}

/// How columns and taxels fit each other.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct JoinReport {
    /// Taxels that get readings.
    pub matched: usize,
    /// Taxels that get none: they have no column, are absent or thermal pads.
    pub masked: usize,
    /// Columns whose id no taxel has.
    pub unknown: usize,
    /// The ids of the first ten of them.
    pub first_unknown: Vec<TaxelId>,
    /// Ids that several taxels of the map have: all of them get the readings of that id.
    pub shared: usize,
    /// Columns whose id an earlier one has.
    pub duplicates: usize,
}

/// Which columns of readings belong to which taxels of a map.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Duplicates, Frame, Join},
///     skin::TaxelId,
/// };
///
/// // Four taxels with ids from 1 on.
/// let map = SkinMap::flat(shapes::lattice(2, 2, 0.004), 1e-3);
/// let join = Join::new(&map, Some(&[TaxelId(3), TaxelId(9)]), 2, Duplicates::Refuse)?;
/// assert_eq!((join.report().matched, join.report().masked, join.report().unknown), (1, 3, 1));
/// let mut frame = Frame::new(&map, 1);
/// join.fill(&[0.5, 7.0], &mut frame);
/// # Ok::<(), dermatome::signal::SignalError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Join {
    /// Where each taxel's columns begin; one more entry than taxels.
    starts: IdVec<PatchId, Vec<u32>>,
    /// The columns of the taxels, patch after patch, taxel after taxel.
    columns: Vec<u32>,
    width: usize,
    report: JoinReport,
}

impl Join {
    /// Joins readings of `width` columns to the taxels with the same ids; without `ids` to all taxels
    /// in the order of the map, patch after patch.
    ///
    /// # Errors
    /// If there is not one id per column, no id is in the map, two columns have the same one and
    /// `duplicates` refuses that, or without ids there is not one column per taxel.
    pub fn new(
        map: &SkinMap,
        ids: Option<&[TaxelId]>,
        width: usize,
        duplicates: Duplicates,
    ) -> Result<Self, SignalError> {
        let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let mut report = JoinReport::default();
        let columns_of = match ids {
            Some(ids) if ids.len() != width => return Err(SignalError::IdCount { ids: ids.len(), width }),
            Some(ids) => Some(columns_by_id(ids, duplicates, &mut report)?),
            None if width != taxels => return Err(SignalError::Width { found: width, needed: taxels }),
            None => None,
        };
        let (mut columns, mut known, mut place) = (Vec::new(), HashMap::new(), 0_u32);
        let starts = map.patches.map(|patch| {
            let mut starts = vec![offset(&columns)];
            for (id, presence) in patch.taxels.ids.iter().zip(&patch.taxels.presence) {
                *known.entry(*id).or_insert(0_usize) += 1;
                let own = [place];
                let found = match &columns_of {
                    Some(columns_of) => columns_of.get(id).map_or(&[][..], Vec::as_slice),
                    None => &own[..],
                };
                place += 1;
                let is_live = *presence == Presence::Present && !found.is_empty();
                columns.extend_from_slice(if is_live { found } else { &[] });
                *(if is_live { &mut report.matched } else { &mut report.masked }) += 1;
                starts.push(offset(&columns));
            }
            starts
        });
        if let Some(ids) = ids {
            let unknown = || ids.iter().filter(|id| !known.contains_key(id));
            report.unknown = unknown().count();
            report.first_unknown = unknown().take(10).copied().collect();
            let joined = columns_of.iter().flatten().map(|(id, _)| id);
            report.shared = joined.filter(|id| known.get(id).is_some_and(|&n| n > 1)).count();
            let first = map.patches.iter().find_map(|patch| patch.taxels.ids.iter().next());
            if let (true, Some(&first), Some(&known)) = (report.unknown == width, ids.first(), first) {
                return Err(SignalError::NoneMatched { columns: width, first, known });
            }
        }
        Ok(Self { starts, columns, width, report })
    }

    /// How columns and taxels fit each other.
    #[must_use]
    pub fn report(&self) -> &JoinReport {
        &self.report
    }

    /// Puts the readings `values[channel * width + column]` into a frame; taxels without a finite one
    /// become NaN. Returns how many readings of matched taxels are missing, NaN or infinite. The
    /// frame's time stays.
    ///
    /// # Panics
    /// If `values` has not `width` numbers for each channel of the frame, or the frame is not one of
    /// the map that the join was made for.
    pub fn fill(&self, values: &[f64], frame: &mut Frame) -> usize {
        assert_eq!(frame.values.len(), self.starts.len(), "one entry per patch");
        let mut missing = 0;
        for (starts, channels) in self.starts.iter().zip(frame.values.iter_mut()) {
            assert_eq!(values.len(), self.width * channels.len(), "one number per column and channel");
            for (read, taxels) in values.chunks_exact(self.width).zip(channels) {
                assert_eq!(taxels.len() + 1, starts.len(), "one number per taxel");
                for (x, range) in taxels.iter_mut().zip(starts.windows(2)) {
                    *x = match self.columns[range[0] as usize..range[1] as usize] {
                        [] => f64::NAN,
                        [column] => read[column as usize],
                        ref several => mean(several.iter().map(|&column| read[column as usize])),
                    };
                    if !x.is_finite() {
                        *x = f64::NAN;
                        missing += usize::from(range[0] != range[1]);
                    }
                }
            }
        }
        missing
    }
}

/// The columns of each id, in their order.
fn columns_by_id(
    ids: &[TaxelId],
    duplicates: Duplicates,
    report: &mut JoinReport,
) -> Result<HashMap<TaxelId, Vec<u32>>, SignalError> {
    let mut columns_of: HashMap<TaxelId, Vec<u32>> = HashMap::with_capacity(ids.len());
    for (column, &taxel) in (0_u32..).zip(ids) {
        let columns = columns_of.entry(taxel).or_default();
        match (columns.first(), duplicates) {
            (None, _) => {}
            (Some(&first), Duplicates::Refuse) => {
                return Err(SignalError::DuplicateId { taxel, columns: [first as usize, column as usize] });
            }
            (Some(_), Duplicates::First) => {
                report.duplicates += 1;
                continue;
            }
            (Some(_), Duplicates::Mean) => report.duplicates += 1,
        }
        columns.push(column);
    }
    Ok(columns_of)
}

fn offset(columns: &[u32]) -> u32 {
    u32::try_from(columns.len()).expect("fewer than 2^32 pairs of taxels and columns")
}

/// The mean of those that are finite, or NaN.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let finite = values.filter(|x| x.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    sum / count
}
