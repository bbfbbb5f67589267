//! The taxels in terms of the fields of body levels: products of rows.

use crate::body::{Body, BodyLevel, BodyTaxel};
use crate::id::{IdVec, VertexId};
use crate::pyramid::{Level, LevelId, Prolongation};
use crate::skin::PatchId;

/// For each body level and patch, its taxels in terms of the fields of the level.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BodyRows(pub IdVec<LevelId, IdVec<PatchId, Prolongation>>);

impl BodyRows {
    /// Those of a body; `coarsest` has the coarsest level of each patch. A product of rows has its three largest weights,
    /// over their sum.
    ///
    /// # Panics
    /// If the levels of the body are not above these.
    pub fn new(body: &Body, coarsest: &IdVec<PatchId, &Level>) -> Self {
        let mut start = 0;
        let mut rows: IdVec<PatchId, Prolongation> = coarsest.map(|level| {
            let first = start;
            start += level.origins.len();
            match &level.to_finest {
                Some(direct) => shifted(direct, first),
                None => shifted(&own_rows(level.origins.len()), first),
            }
        });
        let of_level = |level: &BodyLevel| {
            rows = rows.map(|rows| product(rows, &level.rows));
            rows.clone()
        };
        Self(body.levels.iter().map(of_level).collect())
    }
}

/// The areas of the fields of a level, from rows of the taxels of each patch and their areas.
#[doc(hidden)]
pub fn field_areas<'a>(
    rows: &IdVec<PatchId, Prolongation>,
    areas: impl Iterator<Item = &'a IdVec<VertexId, f64>>,
) -> IdVec<VertexId, f64> {
    let mut sums = IdVec::filled(0.0, rows.iter().next().map_or(0, |rows| rows.coarse_len));
    for (rows, areas) in rows.iter().zip(areas) {
        sums.iter_mut().zip(&rows.restrict(areas)).for_each(|(sum, area)| *sum += area);
    }
    sums
}

/// Fields in terms of themselves.
pub(super) fn own_rows(count: usize) -> Prolongation {
    Prolongation {
        indices: (0..count).map(|field| [VertexId::new(field); 3]).collect(),
        weights: IdVec::filled([1.0, 0.0, 0.0], count),
        coarse_len: count,
    }
}

/// Rows whose fields are numbered from `first` on among others.
pub(super) fn shifted(rows: &Prolongation, first: usize) -> Prolongation {
    let number = |field: VertexId| VertexId::new(first + field.index());
    Prolongation {
        indices: rows.indices.map(|row| row.map(number)),
        weights: rows.weights.clone(),
        coarse_len: first + rows.coarse_len,
    }
}

/// A weight that is not larger is none: one at a corner of a triangle has 1e-17 of the other two, or 0, as its frame has it.
const NO_WEIGHT: f64 = 1e-9;

/// The rows of `fine` through those of `coarse`.
pub(super) fn product(fine: &Prolongation, coarse: &Prolongation) -> Prolongation {
    let (mut indices, mut weights) = (IdVec::default(), IdVec::default());
    let mut row: Vec<(VertexId, f64)> = Vec::with_capacity(9);
    for taxel in fine.indices.ids() {
        row.clear();
        for (middle, w) in fine.row(taxel) {
            for (field, v) in coarse.row(middle) {
                match row.iter_mut().find(|(other, _)| *other == field) {
                    Some((_, sum)) => *sum += w * v,
                    None => row.push((field, w * v)),
                }
            }
        }
        row.retain(|(_, weight)| *weight > NO_WEIGHT);
        row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        row.truncate(3);
        let sum: f64 = row.iter().map(|(_, w)| w).sum();
        let slot = |k: usize| row.get(k).or(row.first()).copied().unwrap_or_default();
        indices.push([0, 1, 2].map(|k| slot(k).0));
        weights.push([0, 1, 2].map(|k| row.get(k).map_or(0.0, |(_, w)| w / sum)));
    }
    Prolongation { indices, weights, coarse_len: coarse.coarse_len }
}

/// Checks that the rows of a level fit the level before, and that its centres are taxels for which `exists`.
pub(crate) fn is_valid(level: &BodyLevel, before: usize, exists: impl Fn(&BodyTaxel) -> bool) -> bool {
    let BodyLevel { origins, rows } = level;
    rows.indices.len() == before
        && rows.coarse_len == origins.len()
        && rows.validate().is_ok()
        && origins.iter().all(exists)
}

/// Whether each level is coarser than the one before.
pub(crate) fn shrinks(origins: &IdVec<VertexId, BodyTaxel>, before: usize) -> bool {
    !origins.is_empty() && origins.len() < before
}
