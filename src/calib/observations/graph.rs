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
    let mut of_taxel = IdVec::<VertexId, usize>::default();
    let mut components: Vec<Component> = Vec::new();
    for v in taxels.ids() {
        // The root is the first taxel of its component.
        let root = sets.root(v);
        if root == v {
            components.push(Component { taxels: Vec::new(), fixed: false, gauge: v });
        }
        let number = if root == v { components.len() - 1 } else { of_taxel[root] };
        of_taxel.push(number);
        let component = &mut components[number];
        component.taxels.push(v);
        component.fixed |= taxels[v].fixed;
        if taxels[component.gauge].initial.is_none() && taxels[v].initial.is_some() {
            component.gauge = v;
        }
    }
    (components, of_taxel)
}
