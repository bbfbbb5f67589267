//! Shortest paths in graphs whose edges have lengths.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::numeric::Csr;

/// A vertex that is reached at a distance; the nearest one is the greatest.
#[derive(PartialEq)]
struct Reached(f64, u32);

impl Eq for Reached {}

impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Reached {
    fn cmp(&self, other: &Self) -> Ordering {
        other.0.total_cmp(&self.0).then(other.1.cmp(&self.1))
    }
}

/// The length of the shortest path from a vertex to every other one `(dijkstra1959)`; infinite where there is none.
/// `graph` has the neighbours of each vertex with the lengths of edges, which are not negative.
pub(crate) fn distances_from(graph: &Csr<(u32, f64)>, from: usize, distances: &mut [f64]) {
    distances.fill(f64::INFINITY);
    each_by_distance(graph, from, distances, &mut Vec::new(), |_, _| true);
}

/// Visits the vertices by their distance from one, which comes first, until `visit` is false. `distances` and `reached` are
/// scratch: the former is infinite but for the vertices that the latter lists.
pub(crate) fn each_by_distance(
    graph: &Csr<(u32, f64)>,
    from: usize,
    distances: &mut [f64],
    reached: &mut Vec<u32>,
    mut visit: impl FnMut(u32, f64) -> bool,
) {
    reached.drain(..).for_each(|v| distances[v as usize] = f64::INFINITY);
    distances[from] = 0.0;
    let mut heap: BinaryHeap<Reached> = u32::try_from(from).into_iter().map(|v| Reached(0.0, v)).collect();
    reached.extend(u32::try_from(from));
    while let Some(Reached(distance, v)) = heap.pop() {
        if distance > distances[v as usize] {
            continue;
        }
        if !visit(v, distance) {
            return;
        }
        for &(w, length) in &graph[v as usize] {
            let further = distance + length;
            if further < distances[w as usize] {
                distances[w as usize] = further;
                heap.push(Reached(further, w));
                reached.push(w);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_detour_may_be_shorter() {
        let edges = [(0, (1, 5.0)), (0, (2, 1.0)), (2, (1, 2.0)), (1, (2, 2.0))];
        let graph = Csr::from_pairs(4, edges.into_iter());
        let mut distances = [0.0; 4];
        distances_from(&graph, 0, &mut distances);
        assert_eq!(distances, [0.0, 3.0, 1.0, f64::INFINITY]);
    }
}
