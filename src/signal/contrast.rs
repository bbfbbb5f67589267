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
};

/// The contrast of a frame on every level: what it has beyond the next coarser one, in the unit of
/// the channel; the coarsest level as it is. NaN where the frame has no value.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, Frame, Restrictor, contrast, reconstruct},
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let channels = [Channel::default()];
/// let levels = Restrictor::new(&map, &channels).restrict(&Frame::new(&map, 1)).clone();
/// let detail = contrast(&map, &channels, &levels);
/// assert_eq!(reconstruct(&map, &channels, &detail).values.len(), levels.values.len());
/// ```
///
/// # Panics
/// If the frame has not the patches, channels and levels of `map` and `channels`.
#[must_use]
pub fn contrast(map: &SkinMap, channels: &[Channel], frame: &LevelFrame) -> LevelFrame {
    let mut out = frame.clone();
    each_channel(map, channels, &mut out, |levels, quantity, values| {
        let areas = live_areas(levels, &values[LevelId::new(0)]);
        for k in 1..levels.len() {
            combine(levels, quantity, &areas, values, k, -1.0);
        }
    });
    out
}

/// The frame that has this contrast: [`contrast`] undone, but for rounding.
///
/// # Panics
/// As [`contrast`].
#[must_use]
pub fn reconstruct(map: &SkinMap, channels: &[Channel], contrast: &LevelFrame) -> LevelFrame {
    let mut out = contrast.clone();
    each_channel(map, channels, &mut out, |levels, quantity, values| {
        let areas = live_areas(levels, &values[LevelId::new(0)]);
        for k in (1..levels.len()).rev() {
            combine(levels, quantity, &areas, values, k, 1.0);
        }
    });
    out
}

type Levels<T> = IdVec<LevelId, T>;
type Values = Levels<IdVec<VertexId, f64>>;

fn each_channel(
    map: &SkinMap,
    channels: &[Channel],
    frame: &mut LevelFrame,
    mut work: impl FnMut(&Levels<MapLevel>, Quantity, &mut Values),
) {
    assert_eq!(frame.values.len(), map.patches.len(), "one entry per patch");
    for (patch, values) in map.patches.iter().zip(frame.values.iter_mut()) {
        assert_eq!(values.len(), channels.len(), "one array per channel of {}", patch.name);
        for (channel, values) in channels.iter().zip(values) {
            work(&patch.levels, channel.quantity, values);
        }
    }
}

/// The area of each field that has a reading, in m^2.
pub(super) fn live_areas(levels: &Levels<MapLevel>, taxels: &IdVec<VertexId, f64>) -> Values {
    let finest = &levels[LevelId::new(0)].level.areas;
    let live = taxels.iter().zip(finest).map(|(x, &a)| if x.is_nan() { 0.0 } else { a });
    let mut areas: Values = vec![live.collect()].into();
    for (k, level) in levels.enumerate() {
        if let Some(up) = &level.level.from_coarser {
            let coarser = up.restrict(&areas[k]);
            areas.push(coarser);
        }
    }
    areas
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
    let (finer, coarser) = values.as_mut_slice().split_at_mut(k);
    let (finer, coarser) = (&mut finer[k - 1], &coarser[0]);
    for (vertex, value) in finer.iter_mut().enumerate().filter(|(_, x)| !x.is_nan()) {
        let vertex = VertexId::new(vertex);
        let predicted: f64 = match quantity {
            Quantity::Intensive => up.row(vertex).map(|(c, w)| w * coarser[c]).sum(),
            Quantity::Extensive => {
                let density: f64 = up.row(vertex).map(|(c, w)| w * coarser[c] / areas[coarse][c]).sum();
                areas[fine][vertex] * density
            }
        };
        *value += sign * predicted;
    }
}
