//! Contacts that are attributed to a wrong taxel nearby.

use std::collections::HashMap;

use glam::{DVec3, IVec3};

use super::sensor_layout::SensorLayout;
use crate::id::VertexId;
use crate::numeric::Random;

/// A wrongly attributed displacement leads to a taxel within this distance, in m.
const MISATTRIBUTION_DISTANCE: f64 = 0.03;

/// Taxels by the cube of space that they are in, as wide as [`MISATTRIBUTION_DISTANCE`].
#[derive(Debug, Default)]
pub(super) struct Neighbourhoods(HashMap<IVec3, Vec<VertexId>>);

impl Neighbourhoods {
    pub(super) fn new(layout: &SensorLayout) -> Self {
        let mut cells: HashMap<IVec3, Vec<VertexId>> = HashMap::new();
        for (v, frame) in layout.frames.enumerate() {
            cells.entry(Self::of(frame.position)).or_default().push(v);
        }
        Self(cells)
    }

    fn of(position: DVec3) -> IVec3 {
        (position / MISATTRIBUTION_DISTANCE).floor().as_ivec3()
    }

    /// One of the taxels that the end of an edge may be mistaken for, each with the same chance.
    pub(super) fn misattributed(
        &self,
        layout: &SensorLayout,
        from: VertexId,
        to: VertexId,
        chance: &mut Random,
    ) -> Option<VertexId> {
        /// A third of the taxels around are near enough, so more than a few draws are hardly ever
        /// needed.
        const DRAWS: usize = 30;
        let here = layout.frames[from].position;
        let is_near = |v: VertexId| {
            let squared = layout.frames[v].position.distance_squared(here);
            v != from && v != to && squared < MISATTRIBUTION_DISTANCE * MISATTRIBUTION_DISTANCE
        };
        let steps = (0..27).map(|k| IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
        let around: Vec<&[VertexId]> =
            steps.filter_map(|step| self.0.get(&(Self::of(here) + step))).map(Vec::as_slice).collect();
        let total = around.iter().map(|cell| cell.len()).sum();
        for _ in 0..DRAWS {
            let mut k = chance.below(total);
            let cell = around.iter().find(|cell| {
                let inside = k < cell.len();
                k -= if inside { 0 } else { cell.len() };
                inside
            })?;
            if is_near(cell[k]) {
                return Some(cell[k]);
            }
        }
        let near: Vec<VertexId> = around.into_iter().flatten().copied().filter(|&v| is_near(v)).collect();
        (!near.is_empty()).then(|| near[chance.below(near.len())])
    }
}
