//! The connected components of the graph of taxels and displacements.

use crate::{
    calib::{DisplacementId, Observations, Pose},
    id::{IdVec, VertexId},
    numeric::DisjointSets,
};

/// A pose for every taxel.
pub(crate) type Poses = IdVec<VertexId, Pose>;

/// Taxels that edges join.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Component {
    /// Its taxels, ascending.
    pub(crate) taxels: Vec<VertexId>,
    pub(crate) fixed: bool,
    /// The taxel that keeps its pose if no contact determines that of the component: the first with
    /// an initial value, else the first.
    pub(crate) gauge: VertexId,
}

/// The connected components of the graph of edges that have information and that `counts` picks, in
/// the order of their first taxels; and the index of the component of every taxel.
pub(crate) fn components(
    observations: &Observations,
    counts: impl Fn(DisplacementId) -> bool,
) -> (Vec<Component>, IdVec<VertexId, usize>) {
    let taxels = &observations.taxels;
    let mut sets = DisjointSets::<VertexId>::new(taxels.len());
    for (_, edge) in observations.edges.enumerate().filter(|(id, e)| counts(*id) && e.is_observed()) {
        sets.join(edge.from, edge.to);
    }
    let of_taxel = sets.labels();
    let empty = |gauge| Component { taxels: Vec::new(), fixed: false, gauge };
    let mut components: Vec<Component> = of_taxel.firsts().into_iter().map(empty).collect();
    for (v, &number) in of_taxel.of.enumerate() {
        let component = &mut components[number];
        component.taxels.push(v);
        component.fixed |= taxels[v].fixed;
        if taxels[component.gauge].initial.is_none() && taxels[v].initial.is_some() {
            component.gauge = v;
        }
    }
    (components, of_taxel.of)
}
