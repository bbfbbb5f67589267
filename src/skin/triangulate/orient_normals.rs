//! Turns the normals of a point cloud to one side of the surface (hoppe1992), judged as in
//! (konig2009).

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    id::{IdVec, VertexId},
    numeric::{DisjointSets, Relation},
    parallel::par_collect,
    skin::triangulate::{neighbours::Neighbours, normals::PointNormals},
};

/// Orientation spreads along the edges to this many nearest neighbours; more only cost time.
const SPREAD: usize = 10;

/// An edge steeper than this over a tangent plane, as a sine, comes after all others: it may join
/// the two sides of a thin part, or two taxels that noise put above each other. Along a chord of 90
/// degrees it is 0.7.
const STEEP: f64 = 0.75;

/// Turns normals that are known up to sign so that those of neighbours agree: along the spanning
/// tree of the edges on which this is clearest (hoppe1992).
///
/// How clear it is, and which sign agrees, is judged as if both taxels lay on one circle (konig2009): a
/// tight bend is clear then, and an edge across a thin part is not. Edges that contradict the file's normals come last, so that correct normals lead and a few wrong ones are
/// avoided.
pub(super) fn orient_normals(
    normals: &mut PointNormals,
    positions: &IdVec<VertexId, DVec3>,
    neighbours: &Neighbours,
) {
    let PointNormals { normal, file, .. } = normals;
    let has_side = |v: VertexId| file[v] != DVec3::ZERO;
    let mut edges: Vec<(f64, VertexId, VertexId, bool)> = par_collect(positions.len(), |range, edges| {
        for v in range.map(VertexId::new) {
            edges.extend(neighbours.of(v).iter().take(SPREAD).map(|&w| {
                let along = (positions[w] - positions[v]).normalize_or_zero();
                let carried = normal[w] - 2.0 * normal[w].dot(along) * along;
                let agreement = normal[v].dot(carried);
                let is_steep = [v, w].iter().any(|&u| normal[u].dot(along).abs() > STEEP);
                let is_denied = agreement < 0.0 && has_side(v) && has_side(w);
                let doubt = 1.0 - agreement.abs() + f64::from(u8::from(is_steep) + 2 * u8::from(is_denied));
                (doubt, v, w, agreement < 0.0)
            }));
        }
    });
    edges.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut sets = DisjointSets::<VertexId, Relation>::new(positions.len());
    for (_, v, w, is_reversed) in edges {
        // Edges that close a cycle are ignored, whether they agree or not.
        let _ = sets.join(v, w, Relation::reversed_if(is_reversed));
    }
    // The file's normals choose the side of a set.
    let mut votes = IdVec::<VertexId, i32>::filled(0, positions.len());
    for v in positions.ids().filter(|&v| has_side(v)) {
        let (root, relation) = sets.root(v);
        votes[root] += if relation.is_reversed() { -1 } else { 1 };
    }
    for v in positions.ids() {
        let (root, relation) = sets.root(v);
        if relation.is_reversed() != (votes[root] < 0) {
            normal[v] = -normal[v];
        }
    }
}
