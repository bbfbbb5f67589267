//! The sums of the normal equations.

use glam::DVec3;

use crate::{
    calib::solve::layout::BlockLayout,
    numeric::{Matrix6, Twist},
    sparse::{BlockMatrix, BlockSlot},
};

/// The system while it is summed up.
pub(super) struct Accumulator<'s> {
    pub(super) matrix: BlockMatrix<'s>,
    pub(super) gradient: Vec<f64>,
    pub(super) layout: BlockLayout,
    pub(super) rows: usize,
}

impl Accumulator<'_> {
    pub(super) fn add_block(&mut self, slot: BlockSlot, block: &Matrix6, weight: f64, transposed: bool) {
        if transposed {
            self.matrix.add(slot, |a, b| weight * block.entry(b, a));
        } else {
            self.matrix.add(slot, |a, b| weight * block.entry(a, b));
        }
    }

    pub(super) fn add_twist(&mut self, row: u32, gradient: Twist, weight: f64) {
        self.add_vector(row, 0, weight * gradient[0]);
        self.add_vector(row, 3, weight * gradient[1]);
    }

    pub(super) fn add_vector(&mut self, row: u32, k: usize, x: DVec3) {
        for (c, x) in x.to_array().into_iter().enumerate() {
            self.gradient[self.layout.index(self.rows, row, k + c)] += x;
        }
    }
}
