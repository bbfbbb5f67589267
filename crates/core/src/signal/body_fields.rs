//! Transfers frames from the taxels of all patches to the fields of the whole body, or from the sensors of a modality to its
//! fields, by the law of receptive fields (`restrict`).

use crate::body::{BodyRows, Modality};
use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::numeric::Csr;
use crate::pyramid::{LevelId, Prolongation};
use crate::signal::{Frame, Quantity};
use crate::skin::PatchId;

/// Carries readings to body levels, or to those of a modality; owns its buffers.
#[derive(Debug, Clone)]
pub struct BodyFields {
    /// The taxels of each field, numbered through the patches that are read, and their weights.
    levels: IdVec<LevelId, Csr<(u32, f64)>>,
    /// The patches that are read, the first taxel of each, and areas of all, in m^2: those that sensors stand for.
    starts: Vec<(PatchId, usize)>,
    areas: Vec<f64>,
    /// `a m p` or `m f` of the taxels, `a m`, and whether each is measured.
    amounts: Vec<f64>,
    served: Vec<f64>,
    is_measured: Vec<bool>,
}

impl BodyFields {
    /// For the body levels of a map.
    pub fn new(map: &SkinMap) -> Self {
        let BodyRows(rows) = map.body_rows();
        let (mut starts, mut areas) = (Vec::new(), Vec::new());
        for (id, patch) in map.patches.enumerate() {
            starts.push((id, areas.len()));
            areas.extend_from_slice(patch.taxels.areas.as_slice());
        }
        let members = |of_patches: &IdVec<PatchId, Prolongation>| {
            let count = of_patches.iter().next().map_or(0, |rows| rows.coarse_len);
            let entries = of_patches.iter().zip(&starts).flat_map(|(rows, &(_, start))| {
                rows.indices.ids().flat_map(move |taxel| {
                    let number = u32::try_from(start + taxel.index()).unwrap_or(u32::MAX);
                    rows.row(taxel).map(move |(field, weight)| (field.index(), (number, weight)))
                })
            });
            Csr::from_pairs(count, entries)
        };
        Self::of(rows.iter().map(members).collect(), starts, areas)
    }

    /// For the levels of a modality of a map: readings of its sensors.
    ///
    /// # Panics
    /// If the modality is not one of this map.
    pub fn of_modality(map: &SkinMap, modality: &Modality) -> Self {
        let of_sensors = map.body.sensor_areas(modality, |patch| &map.patches[patch].taxels.areas);
        let (mut starts, mut areas, mut sensors) = (Vec::new(), Vec::new(), Vec::new());
        for (patch, part) in map.body.parts(modality) {
            let start = areas.len();
            starts.push((patch, start));
            areas.resize(start + map.patches[patch].taxels.ids.len(), 0.0);
            sensors.extend(part.sensors().map(|at| start + at.taxel.index()));
        }
        sensors.iter().zip(&of_sensors).for_each(|(&sensor, &area)| areas[sensor] = area);
        let sensors: Vec<u32> = sensors.into_iter().filter_map(|sensor| u32::try_from(sensor).ok()).collect();
        let members = |rows: &Prolongation| {
            let row = |(field, &sensor): (VertexId, &u32)| {
                rows.row(field).map(move |(coarse, weight)| (coarse.index(), (sensor, weight)))
            };
            Csr::from_pairs(rows.coarse_len, rows.indices.ids().zip(&sensors).flat_map(row))
        };
        let levels = modality.sensor_rows().iter().map(members).collect();
        Self::of(levels, starts, areas)
    }

    fn of(levels: IdVec<LevelId, Csr<(u32, f64)>>, starts: Vec<(PatchId, usize)>, areas: Vec<f64>) -> Self {
        let taxels = areas.len();
        Self {
            levels,
            starts,
            areas,
            amounts: vec![0.0; taxels],
            served: vec![0.0; taxels],
            is_measured: vec![false; taxels],
        }
    }

    /// The number of fields of each level.
    pub fn sizes(&self) -> IdVec<LevelId, usize> {
        self.levels.iter().map(Csr::len).collect()
    }

    /// Takes a channel of a frame. Readings that are not finite, or beyond what 32-bit floats hold, count as missing.
    ///
    /// # Panics
    /// If the frame does not have the patches, the channel and the taxels of the map.
    pub fn take(&mut self, frame: &Frame, channel: usize, quantity: Quantity) {
        for &(patch, start) in &self.starts {
            for (taxel, &x) in frame.values[patch][channel].enumerate() {
                let k = start + taxel.index();
                let is_live = x.abs() <= f64::from(f32::MAX);
                self.is_measured[k] = is_live;
                self.served[k] = if is_live { self.areas[k] } else { 0.0 };
                self.amounts[k] = if is_live { quantity.weight(self.areas[k]) * x } else { 0.0 };
            }
            let filled =
                frame.filled.get(patch).and_then(|of| of.get(channel)).map_or(&[][..], Vec::as_slice);
            filled.iter().for_each(|taxel| self.is_measured[start + taxel.index()] = false);
        }
    }

    /// Takes a channel of a frame, and gives the value of each field and whether it is measured.
    pub(super) fn carry(
        &mut self,
        (frame, channel): (&Frame, usize),
        quantity: Quantity,
        values: &mut IdVec<LevelId, IdVec<VertexId, f64>>,
        is_measured: &mut IdVec<LevelId, IdVec<VertexId, bool>>,
    ) {
        self.take(frame, channel, quantity);
        for (level, values) in values.ids().zip(values.as_mut_slice()) {
            let out = values.iter_mut().zip(is_measured[level].iter_mut()).enumerate();
            for (field, (value, is_measured)) in out {
                let field = VertexId::new(field);
                *value = self.value(level, field, quantity);
                *is_measured = self.is_measured(level, field);
            }
        }
    }

    /// The value of a field from what was taken last: the sum of an amount, the mean of an average weighted by area; NaN
    /// where no taxel has a reading.
    ///
    /// # Panics
    /// If there is no such field.
    pub fn value(&self, level: LevelId, field: VertexId, quantity: Quantity) -> f64 {
        let (mut amount, mut area) = (0.0, 0.0);
        for &(taxel, weight) in &self.levels[level][field.index()] {
            amount += weight * self.amounts[taxel as usize];
            area += weight * self.served[taxel as usize];
        }
        quantity.of_sums(amount, area)
    }

    /// Whether a reading of a field was measured, not [filled](Frame::filled).
    ///
    /// # Panics
    /// If there is no such field.
    pub fn is_measured(&self, level: LevelId, field: VertexId) -> bool {
        let is_measured = |&(taxel, weight): &(u32, f64)| weight > 0.0 && self.is_measured[taxel as usize];
        self.levels[level][field.index()].iter().any(is_measured)
    }
}
