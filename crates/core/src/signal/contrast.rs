//! The detail of each level beyond the next coarser one: a Laplacian pyramid on the receptive fields, `d_k =
//! f_k - P f_(k+1)`, from which the frame can be reconstructed.
//!
//! An extensive channel is compared as an amount per area: the coarser level predicts `a_k P (f_(k+1) /
//! a_(k+1))` for a field, with `a` the areas that have a reading. So a constant pressure has no contrast, in
//! either kind of channel and whichever taxels are dead. The coarsest level keeps its values.

use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::numeric::storable;
use crate::pyramid::{LevelId, Prolongation};
use crate::signal::{Channel, LevelFrame, Quantity};
use crate::skin::PatchId;

/// The contrast of frames: the detail of each level beyond the next coarser one.
///
/// It owns its buffers; after construction it allocates nothing.
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
pub struct Contrast {
    quantities: Vec<Quantity>,
    /// For each patch from level 1 to level 0, from level 2 to level 1 and so on.
    steps: IdVec<PatchId, Vec<Prolongation>>,
    out: LevelFrame,
}

impl Contrast {
    /// Prepares for frames of these channels.
    pub fn new(map: &SkinMap, channels: &[Channel]) -> Self {
        let quantities = channels.iter().map(|channel| channel.quantity).collect();
        Self { quantities, steps: map.patches.map(steps), out: LevelFrame::new(map, channels.len()) }
    }

    /// The contrast of a frame on every level, in the unit of the channel; the coarsest level unchanged. NaN
    /// where the frame has no value.
    ///
    /// # Panics
    /// If the frame does not have the patches, channels and levels that this was made for.
    pub fn of(&mut self, frame: &LevelFrame) -> &LevelFrame {
        frame.check(self.steps.len(), self.quantities.len());
        self.out.time = frame.time;
        if self.out.unmeasured != frame.unmeasured {
            self.out.unmeasured.clone_from(&frame.unmeasured);
        }
        for (id, steps) in self.steps.enumerate() {
            for (channel, &quantity) in self.quantities.iter().enumerate() {
                let copy = |from: &Levels, to: &mut Levels| {
                    from.iter()
                        .zip(to.iter_mut())
                        .for_each(|(from, to)| to.as_mut_slice().copy_from_slice(from.as_slice()));
                };
                let (values, areas) = (&mut self.out.values[id][channel], &mut self.out.areas[id][channel]);
                copy(&frame.values[id][channel], values);
                copy(&frame.areas[id][channel], areas);
                for (k, step) in steps.iter().enumerate() {
                    combine(step, quantity, areas, values, k, -1.0);
                }
            }
        }
        &self.out
    }
}

/// The frame with this contrast: the inverse of [`Contrast::of`], up to rounding.
///
/// # Panics
/// If the contrast does not have the patches, channels and levels of `map` and `channels`.
pub fn reconstruct(map: &SkinMap, channels: &[Channel], contrast: &LevelFrame) -> LevelFrame {
    let mut out = contrast.clone();
    out.check(map.patches.len(), channels.len());
    for (id, patch) in map.patches.enumerate() {
        let steps = steps(patch);
        let of_channels = out.values[id].iter_mut().zip(&out.areas[id]);
        for (channel, (values, areas)) in channels.iter().zip(of_channels) {
            for (k, step) in steps.iter().enumerate().rev() {
                combine(step, channel.quantity, areas, values, k, 1.0);
            }
        }
    }
    out
}

type Levels = IdVec<LevelId, IdVec<VertexId, f64>>;

fn steps(patch: &PatchMap) -> Vec<Prolongation> {
    patch.levels.iter().filter_map(|level| level.level.from_coarser.clone()).collect()
}

/// Adds `sign` times the prediction of level `k + 1` to the values of level `k`.
///
/// Fields without a value are ignored: the weights of the others are scaled to the sum 1.
fn combine(
    step: &Prolongation,
    quantity: Quantity,
    areas: &Levels,
    values: &mut Levels,
    k: usize,
    sign: f64,
) {
    let (fine, coarse) = (LevelId::new(k), LevelId::new(k + 1));
    let (finer, coarser) = values.as_mut_slice().split_at_mut(k + 1);
    let (finer, coarser) = (&mut finer[k], &coarser[0]);
    for (vertex, value) in finer.iter_mut().enumerate().filter(|(_, x)| !x.is_nan()) {
        let vertex = VertexId::new(vertex);
        let (mut predicted, mut weight, mut is_whole) = (0.0, 0.0, true);
        for (field, w) in step.row(vertex) {
            let x = coarser[field] / quantity.extent(areas[coarse][field]);
            if x.is_nan() {
                is_whole = false;
            } else {
                (predicted, weight) = (predicted + w * x, weight + w);
            }
        }
        if !is_whole && weight > 0.0 {
            predicted /= weight;
        }
        predicted *= quantity.extent(areas[fine][vertex]);
        *value = storable(*value + sign * predicted);
    }
}
