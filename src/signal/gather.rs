//! The transpose of a prolongation, stored by its rows: what each receptive field collects.
//!
//! One field is one sum in a fixed order, so that a single field computed anew has the same bits as
//! in a pass over all of them.

use crate::{
    id::{IdVec, VertexId},
    pyramid::Prolongation,
};

/// `P'` by rows: the members and weights of every receptive field of a level, on the next finer one.
#[derive(Debug, Clone)]
pub(super) struct Gather {
    /// Where each field's members begin; one more entry than fields.
    starts: Vec<u32>,
    members: Vec<u32>,
    weights: Vec<f64>,
}

impl Gather {
    pub(super) fn new(prolongation: &Prolongation) -> Self {
        let rows =
            || prolongation.indices.ids().flat_map(|v| prolongation.row(v).map(move |(c, w)| (v, c, w)));
        let mut starts = vec![0_u32; prolongation.coarse_len + 1];
        rows().for_each(|(_, coarse, _)| starts[coarse.index() + 1] += 1);
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        let count = starts.last().map_or(0, |&end| end as usize);
        let (mut next, mut members, mut weights) = (starts.clone(), vec![0; count], vec![0.0; count]);
        for (fine, coarse, weight) in rows() {
            let at = next[coarse.index()] as usize;
            (members[at], weights[at]) = (fine.raw(), weight);
            next[coarse.index()] += 1;
        }
        Self { starts, members, weights }
    }

    /// What one field collects of an amount `x` on the finer level.
    #[inline]
    pub(super) fn sum(&self, field: usize, x: &[f64]) -> f64 {
        let range = self.starts[field] as usize..self.starts[field + 1] as usize;
        let (members, weights) = (&self.members[range.clone()], &self.weights[range]);
        // Two chains of additions: each is as long as it takes to add, and they run side by side.
        let (mut even, mut odd) = (0.0, 0.0);
        let (members, weights) = (members.chunks_exact(2), weights.chunks_exact(2));
        if let ([v], [w]) = (members.remainder(), weights.remainder()) {
            even = w * x[*v as usize];
        }
        for (v, w) in members.zip(weights) {
            even += w[0] * x[v[0] as usize];
            odd += w[1] * x[v[1] as usize];
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
