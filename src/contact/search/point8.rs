//! Eight points side by side, and their squared distances to another in `f32`.

use glam::DVec3;

use super::lanes::{LANES, Lanes};

/// Up to eight points, side by side; empty lanes repeat the last one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Point8 {
    /// One row for each coordinate.
    rows: [[f32; LANES]; 3],
}

impl Point8 {
    #[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
    pub(super) fn new(points: &[DVec3; LANES]) -> Self {
        Self { rows: [0, 1, 2].map(|k: usize| points.map(|p| p[k] as f32)) }
    }

    /// Squared distances of `q` to the points, wrong by less than the search's slack.
    #[inline(always)]
    pub(super) fn distance_squared<L: Lanes>(&self, l: L, q: [f32; 3]) -> L::F {
        let x = l.sub(l.splat(q[0]), l.load(&self.rows[0]));
        let y = l.sub(l.splat(q[1]), l.load(&self.rows[1]));
        let z = l.sub(l.splat(q[2]), l.load(&self.rows[2]));
        l.mul_add(x, x, l.mul_add(y, y, l.mul(z, z)))
    }
}
