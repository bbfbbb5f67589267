//! The transpose of a prolongation, stored by its rows: what each receptive field collects.
//!
//! One field is one sum in a fixed order, so that a single field computed anew has the same bits as
//! in a pass over all of them.

use crate::{
    id::{IdVec, VertexId},
    numeric::Csr,
    pyramid::Prolongation,
};

/// `P'` by rows: the members and weights of every receptive field of a level, on the next finer one.
#[derive(Debug, Clone)]
pub(super) struct Gather {
    members: Csr<(u32, f64)>,
}

impl Gather {
    pub(super) fn new(prolongation: &Prolongation) -> Self {
        let fine = prolongation.indices.ids();
        let rows = fine.flat_map(|v| prolongation.row(v).map(move |(c, w)| (c.index(), (v.raw(), w))));
        Self { members: Csr::from_pairs(prolongation.coarse_len, rows) }
    }

    /// What one field collects of an amount `x` on the finer level.
    #[inline]
    pub(super) fn sum(&self, field: usize, x: &[f64]) -> f64 {
        // Two chains of additions: each is as long as it takes to add, and they run side by side.
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

    /// What all fields collect.
    pub(super) fn apply(&self, x: &IdVec<VertexId, f64>, sums: &mut IdVec<VertexId, f64>) {
        for (field, sum) in sums.iter_mut().enumerate() {
            *sum = self.sum(field, x);
        }
    }
}
