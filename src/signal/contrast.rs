//! What each level shows that the next coarser one does not: a Laplacian pyramid on the receptive
//! fields, `d_k = f_k - P f_(k+1)`, which sums back to the frame.
//!
//! An extensive channel is compared as an amount per area: the coarser level predicts of a field
//! `a_k P (f_(k+1) / a_(k+1))`, with `a` the areas that have a reading. So a constant pressure has no
//! contrast, in either kind of channel and whatever taxels are dead. The coarsest level keeps its
//! values.

use crate::{
    id::{IdVec, VertexId},
    map::{MapLevel, SkinMap},
    pyramid::{LevelId, Prolongation},
    signal::{Channel, LevelFrame, Quantity},
    skin::PatchId,
};

/// The contrast of frames: what each level has beyond the next coarser one.
///
/// It owns its buffers and allocates nothing after it was made.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, Contrast, Frame, Restrictor, reconstruct},
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let channels = [Channel::default()];
/// let mut restrictor = Restrictor::new(&map, &channels);
/// let mut contrast = Contrast::new(&map, &channels);
/// let levels = restrictor.restrict(&Frame::new(&map, 1));
/// let detail = contrast.of(levels);
/// assert_eq!(reconstruct(&map, &channels, detail).values.len(), levels.values.len());
/// ```
#[derive(Debug, Clone)]
pub struct Contrast<'a> {
    map: &'a SkinMap,
    quantities: Vec<Quantity>,
    areas: LiveAreas,
    out: LevelFrame,
}

impl<'a> Contrast<'a> {
    /// Prepares for frames of these channels.
    #[must_use]
    pub fn new(map: &'a SkinMap, channels: &[Channel]) -> Self {
        let quantities = channels.iter().map(|channel| channel.quantity).collect();
        Self { map, quantities, areas: LiveAreas::new(map), out: LevelFrame::new(map, channels.len()) }
    }

    /// The contrast of a frame on every level, in the unit of the channel; the coarsest level as it
    /// is. NaN where the frame has no value.
    ///
    /// # Panics
    /// If the frame has not the patches, channels and levels that this was made for.
    pub fn of(&mut self, frame: &LevelFrame) -> &LevelFrame {
        frame.check(self.map, self.quantities.len());
        self.out.time = frame.time;
        for (id, patch) in self.map.patches.enumerate() {
            let channels = self.quantities.iter().zip(&frame.values[id]);
            for ((&quantity, values), out) in channels.zip(&mut self.out.values[id]) {
                for (values, out) in values.iter().zip(out.iter_mut()) {
                    out.copy_from_slice(values);
                }
                let areas = self.areas.update(id, &patch.levels, quantity, &values[LevelId::new(0)]);
                for k in 1..patch.levels.len() {
                    combine(&patch.levels, quantity, areas, out, k, -1.0);
                }
            }
        }
        &self.out
    }
}

/// The frame that has this contrast: [`Contrast::of`] undone, but for rounding.
///
/// # Panics
/// If the contrast has not the patches, channels and levels of `map` and `channels`.
#[must_use]
pub fn reconstruct(map: &SkinMap, channels: &[Channel], contrast: &LevelFrame) -> LevelFrame {
    let mut out = contrast.clone();
    let mut areas = LiveAreas::new(map);
    out.check(map, channels.len());
    for (id, patch) in map.patches.enumerate() {
        for (channel, values) in channels.iter().zip(&mut out.values[id]) {
            let areas = areas.update(id, &patch.levels, channel.quantity, &values[LevelId::new(0)]);
            for k in (1..patch.levels.len()).rev() {
                combine(&patch.levels, channel.quantity, areas, values, k, 1.0);
            }
        }
    }
    out
}

type Levels<T> = IdVec<LevelId, T>;
type Values = Levels<IdVec<VertexId, f64>>;

/// The areas of fields that have a reading, in m^2; a buffer.
#[derive(Debug, Clone)]
pub(super) struct LiveAreas(IdVec<PatchId, Values>);

impl LiveAreas {
    pub(super) fn new(map: &SkinMap) -> Self {
        Self(map.patches.map(|patch| patch.levels.map(|l| IdVec::filled(0.0, l.level.mesh.positions.len()))))
    }

    /// The areas of a patch whose taxels read this. Only extensive channels need them: for others
    /// they stay as they are.
    pub(super) fn update(
        &mut self,
        patch: PatchId,
        levels: &Levels<MapLevel>,
        quantity: Quantity,
        taxels: &IdVec<VertexId, f64>,
    ) -> &Values {
        let areas = &mut self.0[patch];
        if quantity != Quantity::Extensive {
            return areas;
        }
        let live = taxels.iter().zip(&levels[LevelId::new(0)].level.areas);
        let served = areas[LevelId::new(0)].iter_mut().zip(live);
        served.for_each(|(served, (x, &area))| *served = if x.is_nan() { 0.0 } else { area });
        for (k, level) in levels.enumerate() {
            let Some(up) = &level.level.from_coarser else { continue };
            let (fine, coarse) = areas.split_at_mut(k.index() + 1);
            let (fine, coarse) = (&fine[k.index()], &mut coarse[0]);
            coarse.iter_mut().for_each(|area| *area = 0.0);
            for (v, &area) in fine.enumerate() {
                up.row(v).for_each(|(field, weight)| coarse[field] += weight * area);
            }
        }
        areas
    }
}

/// Adds `sign` times what level `k` predicts to the values of level `k - 1`.
///
/// A vertex with a value has shares only in fields with one, so no weight is ever left out.
fn combine(
    levels: &Levels<MapLevel>,
    quantity: Quantity,
    areas: &Values,
    values: &mut Values,
    k: usize,
    sign: f64,
) {
    let (fine, coarse) = (LevelId::new(k - 1), LevelId::new(k));
    let Some(up): Option<&Prolongation> = levels[fine].level.from_coarser.as_ref() else { return };
    let (finer, coarser) = values.split_at_mut(k);
    let (finer, coarser) = (&mut finer[k - 1], &coarser[0]);
    for (vertex, value) in finer.iter_mut().enumerate().filter(|(_, x)| !x.is_nan()) {
        let vertex = VertexId::new(vertex);
        let predicted: f64 = match quantity {
            Quantity::Intensive | Quantity::Direction => up.row(vertex).map(|(c, w)| w * coarser[c]).sum(),
            Quantity::Extensive => {
                let density: f64 = up.row(vertex).map(|(c, w)| w * coarser[c] / areas[coarse][c]).sum();
                areas[fine][vertex] * density
            }
        };
        *value += sign * predicted;
    }
}
