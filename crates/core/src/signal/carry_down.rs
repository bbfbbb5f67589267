//! Carries values of the fields of a level without a mesh down to the taxels, to be drawn on their maps.

use std::collections::BTreeSet;

use crate::body::FieldLevel;
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::pyramid::Prolongation;
use crate::signal::{LevelFrame, Quantity};
use crate::skin::PatchId;

/// Carries values of the fields of a level of the whole body, or of a modality, down to the taxels: each gets the mean of
/// its fields by its weights in them, of an amount that per area. Sums of an amount are kept.
#[derive(Debug, Clone)]
pub struct CarryDown {
    at: FieldLevel,
    rows: IdVec<PatchId, Option<Prolongation>>,
    /// Of the fields, in m^2.
    areas: IdVec<VertexId, f64>,
}

impl CarryDown {
    /// For a level of a map.
    pub fn new(map: &SkinMap, at: FieldLevel) -> Self {
        Self { at, rows: map.field_rows(at), areas: map.field_areas(at) }
    }

    /// Whether taxels of a patch have fields of this level.
    pub fn has_fields(&self, patch: PatchId) -> bool {
        self.rows.get(patch).is_some_and(Option::is_some)
    }

    /// The fields that taxels of a patch have, in ascending order.
    pub fn fields_of(&self, patch: PatchId) -> BTreeSet<VertexId> {
        let Some(rows) = self.rows.get(patch).and_then(Option::as_ref) else { return BTreeSet::new() };
        rows.indices.ids().flat_map(|taxel| rows.row(taxel)).map(|(field, _)| field).collect()
    }

    /// The values of the fields in a channel of a frame; `None` if it is of another map.
    pub fn fields<'f>(&self, frame: &'f LevelFrame, channel: usize) -> Option<&'f IdVec<VertexId, f64>> {
        let of_channels = match self.at.modality {
            None => &frame.body,
            Some(number) => &frame.modalities.get(number)?.values,
        };
        let values = of_channels.get(channel)?.get(self.at.level)?;
        (values.len() == self.areas.len()).then_some(values)
    }

    /// What a taxel gets of these fields, of an amount per m^2; NaN where it has none with a value.
    pub fn density(
        &self,
        (patch, taxel): (PatchId, VertexId),
        fields: &IdVec<VertexId, f64>,
        quantity: Quantity,
    ) -> f64 {
        let Some(rows) = &self.rows[patch] else { return f64::NAN };
        let (mut sum, mut weight) = (0.0, 0.0);
        for (field, w) in rows.row(taxel).filter(|(field, _)| !fields[*field].is_nan()) {
            let extent = quantity.extent(self.areas[field]);
            (sum, weight) = (sum + w * fields[field] / extent, weight + w);
        }
        sum / weight
    }
}
