//! Transfers frames from the taxels to the receptive fields of every level.
//!
//! Intensive channels become `Q'(a m p) / Q'(a m)`, extensive ones `Q'(m f)`, with `Q` the map from a level
//! to level 0 ([`Level::to_finest`](crate::pyramid::Level::to_finest)), `a` the areas of the taxels and `m` 1
//! where there is a reading, else 0 (`(cannata)`, the virtual taxels of its equation 9, here with overlapping
//! fields). The rows of `Q` have the sum 1, so the total force of a level is that of the taxels up to
//! rounding. A lookup of a contact gives the same fields with the same weights.
//!
//! All fields are summed in every frame, in the same order: this takes a tenth of the time of drawing them,
//! and of 716 taxels of real skin two thirds change from frame to frame.

use crate::body::Modality;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::numeric::Csr;
use crate::pyramid::{LevelId, Prolongation};
use crate::signal::body_fields::BodyFields;
use crate::signal::{Channel, Frame, LevelFrame, Quantity};
use crate::skin::PatchId;

/// Transfers frames to all levels.
///
/// It owns its buffers: after the first frame it allocates nothing.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     pipeline::{BuildOptions, build},
///     signal::{Channel, Frame, Restrictor},
///     skin::Skin,
/// };
///
/// let map = build(&Skin::from_mesh("palm", shapes::cap(400, 0.1, 0.5)), &BuildOptions::default())?;
/// let mut restrictor = Restrictor::new(&map, &[Channel::default()]);
/// let mut frame = Frame::new(&map, 1);
/// for value in frame.values.iter_mut().flatten().flat_map(|channel| channel.iter_mut()) {
///     *value = 2.5;
/// }
/// let levels = restrictor.restrict(&frame);
/// let (palm, pressure) = (map.patches.ids().next().unwrap(), 0);
/// for field in levels.values[palm][pressure].iter().flatten() {
///     assert!((field - 2.5).abs() < 1e-12, "a constant pressure is the same on every level");
/// }
/// # Ok::<(), dermatome::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Restrictor {
    quantities: Vec<Quantity>,
    patches: IdVec<PatchId, PatchFields>,
    /// For each channel `a m p` or `m f` of the taxels.
    amounts: IdVec<PatchId, Vec<IdVec<VertexId, f64>>>,
    levels: LevelFrame,
    /// Of the whole body, if all levels are wanted.
    body: Option<BodyFields>,
    /// Of each modality, if all levels are wanted, and whether each channel is of it.
    modalities: Vec<(BodyFields, Vec<bool>)>,
}

#[derive(Debug, Clone)]
struct PatchFields {
    /// The areas of the taxels, in m^2.
    areas: IdVec<VertexId, f64>,
    /// The fields of the wanted levels above level 0.
    coarse: Vec<(LevelId, Fields)>,
}

#[derive(Debug, Clone)]
struct Fields {
    /// `Q'` by rows: the taxels of each field and their weights.
    members: Csr<(u32, f64)>,
}

impl Fields {
    fn new(to_finest: &Prolongation) -> Self {
        let taxels = to_finest.indices.ids();
        let rows = taxels.flat_map(|v| to_finest.row(v).map(move |(field, w)| (field.index(), (v.raw(), w))));
        Self { members: Csr::from_pairs(to_finest.coarse_len, rows) }
    }

    /// The sum of an amount `x` of the taxels in one field.
    #[inline]
    fn sum(&self, field: usize, x: &[f64]) -> f64 {
        // Two chains of additions, which run in parallel and hide the latency of each.
        let pairs = self.members[field].chunks_exact(2);
        let (mut even, mut odd) = (0.0, 0.0);
        if let [(v, w)] = pairs.remainder() {
            even = w * x[*v as usize];
        }
        for pair in pairs {
            let [(v, w), (u, z)] = [pair[0], pair[1]];
            even += w * x[v as usize];
            odd += z * x[u as usize];
        }
        even + odd
    }

    /// [`Self::sum`] of `N` frames at once.
    fn sum_at_once<const N: usize>(&self, field: usize, x: &[[f64; N]]) -> [f64; N] {
        let pairs = self.members[field].chunks_exact(2);
        let (mut even, mut odd) = ([0.0; N], [0.0; N]);
        if let [(v, w)] = pairs.remainder() {
            even = x[*v as usize].map(|x| w * x);
        }
        for pair in pairs {
            let [(v, w), (u, z)] = [pair[0], pair[1]];
            for k in 0..N {
                even[k] += w * x[v as usize][k];
                odd[k] += z * x[u as usize][k];
            }
        }
        for k in 0..N {
            even[k] += odd[k];
        }
        even
    }
}

impl PatchFields {
    /// Lists the vertices of each level whose readings are all filled.
    fn find_unmeasured(
        &self,
        filled: &[VertexId],
        areas: &IdVec<LevelId, IdVec<VertexId, f64>>,
        unmeasured: &mut IdVec<LevelId, Vec<VertexId>>,
    ) {
        let finest = LevelId::new(0);
        unmeasured[finest].clear();
        unmeasured[finest].extend_from_slice(filled);
        let is_measured = |&(v, w): &(u32, f64)| {
            let taxel = VertexId::from(v);
            w != 0.0 && areas[finest][taxel] > 0.0 && filled.binary_search(&taxel).is_err()
        };
        for (level, fields) in &self.coarse {
            unmeasured[*level].clear();
            let of_level = areas[*level].enumerate().filter(|(_, area)| **area > 0.0);
            let lost = of_level.filter(|(field, _)| !fields.members[field.index()].iter().any(is_measured));
            unmeasured[*level].extend(lost.map(|(field, _)| field));
        }
    }
}

impl Restrictor {
    /// A restrictor for frames of these channels.
    pub fn new(map: &SkinMap, channels: &[Channel]) -> Self {
        Self::of(map, channels, None)
    }

    /// A restrictor to one level, or the coarsest of a patch without it: as [`Self::new`], but without values
    /// of the other levels above level 0.
    pub fn to_level(map: &SkinMap, channels: &[Channel], level: LevelId) -> Self {
        Self::of(map, channels, Some(level))
    }

    fn of(map: &SkinMap, channels: &[Channel], only: Option<LevelId>) -> Self {
        let patches = map.patches.map(|patch: &PatchMap| {
            let is_wanted = |level| only.is_none_or(|only| patch.nearest_level(only) == level);
            let levels = patch.levels.enumerate().filter(|(level, _)| is_wanted(*level));
            let fields = |(level, map): (LevelId, &MapLevel)| {
                Some((level, Fields::new(map.level.to_finest.as_ref()?)))
            };
            PatchFields { areas: patch.taxels.areas.clone(), coarse: levels.filter_map(fields).collect() }
        });
        let amounts = patches.map(|patch| vec![IdVec::filled(0.0, patch.areas.len()); channels.len()]);
        let mut levels = LevelFrame::new(map, channels.len());
        // There are no readings yet.
        let areas = levels.areas.iter_mut().flatten().flat_map(|levels| levels.iter_mut());
        areas.for_each(|areas| areas.as_mut_slice().fill(0.0));
        let body = (only.is_none() && !map.body.levels.is_empty()).then(|| BodyFields::new(map));
        let fields = |modality: &Modality| {
            let is_of_it = channels.iter().map(|channel| channel.modality(map) == Some(&*modality.name));
            (BodyFields::of_modality(map, modality), is_of_it.collect())
        };
        let modalities = map.body.modalities.iter().filter(|_| only.is_none()).map(fields).collect();
        let quantities = channels.iter().map(|c| c.quantity).collect();
        Self { quantities, patches, amounts, levels, body, modalities }
    }

    /// The frame on all levels. Readings that are not finite, or beyond what 32-bit floats
    /// hold, count as missing.
    ///
    /// # Panics
    /// If the frame does not have the patches, channels and taxels that the restrictor was made for.
    pub fn restrict(&mut self, frame: &Frame) -> &LevelFrame {
        assert_eq!(frame.values.len(), self.patches.len(), "one entry per patch");
        self.levels.time = frame.time;
        for (id, patch) in self.patches.enumerate() {
            assert_eq!(frame.values[id].len(), self.quantities.len(), "one array per channel");
            let LevelFrame { values, areas, unmeasured, .. } = &mut self.levels;
            let out = values[id].iter_mut().zip(&mut areas[id]).zip(&mut self.amounts[id]);
            let out = out.zip(unmeasured[id].iter_mut()).enumerate();
            for ((&quantity, read), (number, (((values, areas), amounts), unmeasured))) in
                self.quantities.iter().zip(&frame.values[id]).zip(out)
            {
                let mut channel = ChannelOut { quantity, values, areas, amounts };
                let masks_changed = channel.take(read.as_slice(), &patch.areas);
                channel.collect(&patch.coarse, masks_changed);
                // Frames that were not made by a `Filler` may have no lists.
                let filled =
                    frame.filled.get(id).and_then(|of| of.get(number)).map_or(&[][..], Vec::as_slice);
                if unmeasured[LevelId::new(0)] != filled || masks_changed && !filled.is_empty() {
                    patch.find_unmeasured(filled, channel.areas, unmeasured);
                }
            }
        }
        if let Some(fields) = &mut self.body {
            let LevelFrame { body, is_body_measured, .. } = &mut self.levels;
            let channels = self.quantities.iter().zip(body).zip(is_body_measured).enumerate();
            for (channel, ((&quantity, values), is_measured)) in channels {
                fields.carry((frame, channel), quantity, values, is_measured);
            }
        }
        for ((fields, is_of_it), out) in self.modalities.iter_mut().zip(&mut self.levels.modalities) {
            let channels = self.quantities.iter().zip(&mut out.values).zip(&mut out.is_measured).enumerate();
            for (channel, ((&quantity, values), is_measured)) in channels.filter(|(k, _)| is_of_it[*k]) {
                fields.carry((frame, channel), quantity, values, is_measured);
            }
        }
        &self.levels
    }

    /// Whether the taxels with readings are, in each of `N` frames, those of the frame that was restricted last.
    pub(crate) fn fits<const N: usize>(&self, patch: PatchId, channel: usize, readings: &[[f64; N]]) -> bool {
        let served = &self.levels.areas[patch][channel][LevelId::new(0)];
        let fits = |(readings, &served): (&[f64; N], &f64)| {
            readings.iter().fold(true, |fits, reading| fits & (reading.is_finite() == (served > 0.0)))
        };
        readings.iter().zip(served).all(fits)
    }

    /// The values of a level above level 0, as [`Self::restrict`] computes them, for readings that
    /// [fit](Self::fits); the readings are overwritten.
    pub(crate) fn restrict_at_once<const N: usize>(
        &self,
        patch: PatchId,
        channel: usize,
        level: LevelId,
        readings: &mut [[f64; N]],
        values: &mut Vec<[f64; N]>,
    ) {
        let (areas, quantity) = (&self.levels.areas[patch][channel], self.quantities[channel]);
        for (readings, &served) in readings.iter_mut().zip(&areas[LevelId::new(0)]) {
            if served == 0.0 {
                *readings = [0.0; N];
            } else if quantity == Quantity::Intensive {
                readings.iter_mut().for_each(|reading| *reading *= served);
            }
        }
        values.clear();
        for (_, fields) in self.patches[patch].coarse.iter().filter(|(other, _)| *other == level) {
            values.extend(areas[level].iter().enumerate().map(|(field, &area)| {
                fields.sum_at_once(field, readings).map(|sum| quantity.of_sums(sum, area))
            }));
        }
    }
}

struct ChannelOut<'a> {
    quantity: Quantity,
    values: &'a mut IdVec<LevelId, IdVec<VertexId, f64>>,
    /// `a m` of the taxels, and its sums in the fields.
    areas: &'a mut IdVec<LevelId, IdVec<VertexId, f64>>,
    amounts: &'a mut IdVec<VertexId, f64>,
}

impl ChannelOut<'_> {
    /// Stores the readings; returns whether the set of taxels with readings has changed.
    fn take(&mut self, read: &[f64], areas: &IdVec<VertexId, f64>) -> bool {
        let finest = LevelId::new(0);
        let (values, served) = (&mut self.values[finest], &mut self.areas[finest]);
        assert_eq!(read.len(), values.len(), "one reading per taxel");
        let mut masks_changed = false;
        let taken = values.iter_mut().zip(served).zip(self.amounts.iter_mut()).zip(areas);
        for (&x, (((value, served), amount), &area)) in read.iter().zip(taken) {
            let is_live = x.abs() <= f64::from(f32::MAX);
            masks_changed |= is_live != (*served > 0.0);
            (*value, *served) = if is_live { (x, area) } else { (f64::NAN, 0.0) };
            *amount = if is_live { self.quantity.weight(area) * x } else { 0.0 };
        }
        masks_changed
    }

    /// Sums all fields, and their areas where masks changed.
    fn collect(&mut self, coarse: &[(LevelId, Fields)], masks_changed: bool) {
        for (level, fields) in coarse {
            if masks_changed {
                let (served, collected) = self.areas.as_mut_slice().split_at_mut(level.index());
                let collected = collected[0].iter_mut().enumerate();
                collected.for_each(|(field, area)| *area = fields.sum(field, served[0].as_slice()));
            }
            for (field, (value, &area)) in self.values[*level].iter_mut().zip(&self.areas[*level]).enumerate()
            {
                *value = self.quantity.of_sums(fields.sum(field, self.amounts.as_slice()), area);
            }
        }
    }
}
