use crate::{
    calib::{DisplacementId, Observations},
    id::{IdVec, VertexId},
    numeric::DisjointSets,
};

/// Taxels that edges join.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Component {
    /// Its taxels, ascending.
    pub(crate) taxels: Vec<VertexId>,
    /// Whether one of them is fixed.
    pub(crate) fixed: bool,
    /// The taxel that keeps its place where nothing else says where the component is: the first with an initial
    /// value, else the first.
    pub(crate) gauge: VertexId,
}

/// The connected components of the graph of edges that say anything and that `counts` picks, in the order of their first
/// taxels.
pub(crate) fn components(
    observations: &Observations,
    counts: impl Fn(DisplacementId) -> bool,
) -> Vec<Component> {
    let taxels = &observations.taxels;
    let mut sets = DisjointSets::<VertexId>::new(taxels.len());
    for (_, edge) in observations.edges.enumerate().filter(|(id, e)| counts(*id) && e.is_observed()) {
        sets.join(edge.from, edge.to);
    }
    let mut numbers: IdVec<VertexId, usize> = IdVec::filled(usize::MAX, taxels.len());
    let mut components: Vec<Component> = Vec::new();
    for v in taxels.ids() {
        let root = sets.root(v);
        if numbers[root] == usize::MAX {
            numbers[root] = components.len();
            components.push(Component { taxels: Vec::new(), fixed: false, gauge: v });
        }
        let component = &mut components[numbers[root]];
        component.taxels.push(v);
        component.fixed |= taxels[v].fixed;
        if taxels[component.gauge].initial.is_none() && taxels[v].initial.is_some() {
            component.gauge = v;
        }
    }
    components
}

/// The place in `components` of every taxel's own.
pub(crate) fn component_of_taxels(components: &[Component], taxels: usize) -> IdVec<VertexId, usize> {
    let mut of_taxel = IdVec::filled(0, taxels);
    for (k, component) in components.iter().enumerate() {
        component.taxels.iter().for_each(|&v| of_taxel[v] = k);
    }
    of_taxel
}
