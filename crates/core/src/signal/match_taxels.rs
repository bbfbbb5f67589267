//! Assigns the columns of readings to the taxels of a map, by id or by order.

use std::collections::HashMap;

use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::signal::{Channel, Frame, SignalError};
use crate::skin::{PatchId, Presence, TaxelId};

/// What to do with an id that several columns have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Duplicates {
    /// Refuse the readings.
    #[default]
    Refuse,
    /// Use the first column.
    First,
}

/// How columns and taxels match.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct JoinReport {
    /// Taxels that get readings.
    pub matched: usize,
    /// Taxels that get no readings: they have no column, are absent, or sense nothing that
    /// the readings are of.
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

impl JoinReport {
    /// What does not fit, a sentence each.
    pub fn remarks(&self) -> Vec<String> {
        let Self { unknown, first_unknown, shared, duplicates, masked, matched } = self;
        let ids = first_unknown.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        let more = if *unknown > first_unknown.len() { ", ..." } else { "" };
        let all = [
            (*unknown, format!("{unknown} columns are of no taxel of the map: {ids}{more}")),
            (*masked, format!("{matched} taxels have readings, {masked} have none and are masked")),
            (*shared, format!("{shared} ids belong to several taxels, which share the readings")),
            (*duplicates, format!("{duplicates} columns have the id of an earlier one")),
        ];
        all.into_iter().filter(|(count, _)| *count > 0).map(|(_, remark)| remark).collect()
    }
}

/// The assignment of columns of readings to the taxels of a map.
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
    report: JoinReport,
    sources: IdVec<PatchId, Vec<Option<u32>>>,
    /// The columns of all taxels, whatever they sense.
    columns: IdVec<PatchId, Vec<Option<u32>>>,
    /// For each channel of another modality than touch, the columns of its sensors.
    others: Vec<Option<IdVec<PatchId, Vec<Option<u32>>>>>,
    width: usize,
}

impl Join {
    /// Assigns `width` columns to the taxels with the same ids; without `ids` to all taxels in the order of
    /// the map, patch after patch.
    ///
    /// # Errors
    /// If there is not one id per column, no id is in the map, two columns have the same id and `duplicates`
    /// refuses that, or without ids there is not one column per taxel.
    pub fn new(
        map: &SkinMap,
        ids: Option<&[TaxelId]>,
        width: usize,
        duplicates: Duplicates,
    ) -> Result<Self, SignalError> {
        let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let mut report = JoinReport::default();
        let source_of = match ids {
            Some(ids) if ids.len() != width => return Err(SignalError::IdCount { ids: ids.len(), width }),
            _ if width == 0 => return Err(SignalError::Width { found: 0, needed: taxels }),
            Some(ids) => Some(columns_by_id(ids, duplicates, &mut report)?),
            None if width != taxels => return Err(SignalError::Width { found: width, needed: taxels }),
            None => None,
        };
        let (mut known, mut column) = (HashMap::new(), 0..);
        let columns: IdVec<PatchId, Vec<Option<u32>>> = map.patches.map(|patch| {
            let column_of = |(id, column): (&TaxelId, u32)| {
                *known.entry(*id).or_insert(0_usize) += 1;
                source_of.as_ref().map_or(Some(column), |source_of| source_of.get(id).copied())
            };
            patch.taxels.ids.iter().zip(&mut column).map(column_of).collect()
        });
        let sources = map.patches.iter().zip(&columns).map(|(patch, columns)| {
            let source = |(presence, source): (&Presence, &Option<u32>)| {
                let source = source.filter(|_| *presence == Presence::Present);
                *(if source.is_none() { &mut report.masked } else { &mut report.matched }) += 1;
                source
            };
            patch.taxels.presence.iter().zip(columns).map(source).collect()
        });
        let sources = sources.collect();
        if let (Some(ids), Some(source_of)) = (ids, source_of) {
            let unknown = || ids.iter().filter(|id| !known.contains_key(id));
            report.unknown = unknown().count();
            report.first_unknown = unknown().take(10).copied().collect();
            report.shared = source_of.keys().filter(|id| known.get(id).is_some_and(|&n| n > 1)).count();
            let first = map.patches.iter().find_map(|patch| patch.taxels.ids.iter().next());
            if let (true, Some(&first), Some(&known)) = (report.unknown == width, ids.first(), first) {
                return Err(SignalError::NoneMatched { columns: width, first, known });
            }
        }
        Ok(Self { sources, columns, others: Vec::new(), width, report })
    }

    /// From now on the sensors of a modality besides touch get the readings of the channels that are [of it](Channel::modality),
    /// and on their patches no other taxel does; `channels` are those of the frames.
    pub fn follow(&mut self, map: &SkinMap, channels: &[Channel]) {
        let of_channel = |channel: &Channel| {
            channel.modality(map)?;
            let of_patch = |(columns, is_read): (&Vec<Option<u32>>, &IdVec<VertexId, bool>)| {
                columns.iter().zip(is_read).map(|(column, is_read)| column.filter(|_| *is_read)).collect()
            };
            Some(self.columns.iter().zip(&channel.taxels(map)).map(of_patch).collect())
        };
        self.others = channels.iter().map(of_channel).collect();
        let mut is_read: Vec<bool> = self.is_matched().collect();
        let before = is_read.iter().filter(|is_read| **is_read).count();
        for of_channel in self.others.iter().flatten() {
            let all = is_read.iter_mut().zip(of_channel.iter().flatten());
            all.for_each(|(is_read, source)| *is_read |= source.is_some());
        }
        let gained = is_read.iter().filter(|is_read| **is_read).count() - before;
        self.report.matched += gained;
        self.report.masked -= gained;
    }

    /// How columns and taxels match.
    pub fn report(&self) -> &JoinReport {
        &self.report
    }

    /// Whether each taxel, patch after patch, gets readings.
    pub fn is_matched(&self) -> impl Iterator<Item = bool> + '_ {
        self.sources.iter().flatten().map(Option::is_some)
    }

    /// Copies the readings `values[channel * width + column]` into a frame; taxels without a finite one
    /// become NaN. Returns how many readings of matched taxels are missing, NaN or infinite. Does not change
    /// the frame's time.
    ///
    /// # Panics
    /// If `values` does not have `width` numbers for each channel of the frame, or the frame is not one of
    /// the map that the join was made for.
    pub fn fill<T: Copy + Into<f64>>(&self, values: &[T], frame: &mut Frame) -> usize {
        assert_eq!(frame.values.len(), self.sources.len(), "one entry per patch");
        let mut missing = 0;
        for (patch, channels) in frame.values.ids().zip(frame.values.as_mut_slice()) {
            assert_eq!(values.len(), self.width * channels.len(), "one number per column and channel");
            for (channel, (read, taxels)) in values.chunks_exact(self.width).zip(channels).enumerate() {
                let other = self.others.get(channel).and_then(Option::as_ref);
                let sources = &other.unwrap_or(&self.sources)[patch];
                assert_eq!(taxels.len(), sources.len(), "one number per taxel");
                for (x, source) in taxels.iter_mut().zip(sources) {
                    *x = source.map_or(f64::NAN, |column| read[column as usize].into());
                    if !x.is_finite() {
                        *x = f64::NAN;
                        missing += usize::from(source.is_some());
                    }
                }
            }
        }
        missing
    }
}

/// The column of each id.
fn columns_by_id(
    ids: &[TaxelId],
    duplicates: Duplicates,
    report: &mut JoinReport,
) -> Result<HashMap<TaxelId, u32>, SignalError> {
    let mut columns = HashMap::with_capacity(ids.len());
    for (column, &taxel) in (0_u32..).zip(ids) {
        let first = *columns.entry(taxel).or_insert(column);
        report.duplicates += usize::from(first != column);
        if first != column && duplicates == Duplicates::Refuse {
            return Err(SignalError::DuplicateId { taxel, columns: [first as usize, column as usize] });
        }
    }
    Ok(columns)
}
