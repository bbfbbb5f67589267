//! Shortest paths in graphs whose edges have lengths.

use std::cmp::{Ordering, Reverse};
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

/// For each vertex up to `count` of the `sources`, by their numbers there, nearest first, and the distances; fewer where
/// fewer can be reached. Each vertex passes on the sources that are its nearest.
pub(crate) fn nearest_sources(
    graph: &Csr<(u32, f64)>,
    sources: impl Iterator<Item = u32>,
    count: usize,
) -> Vec<Vec<(usize, f64)>> {
    let mut near = vec![Vec::new(); graph.len()];
    let mut heap: BinaryHeap<_> =
        (0_usize..).zip(sources).map(|(k, v)| (Reached(0.0, v), Reverse(k))).collect();
    while let Some((Reached(distance, v), Reverse(source))) = heap.pop() {
        let found: &mut Vec<(usize, f64)> = &mut near[v as usize];
        if found.len() == count || found.iter().any(|(known, _)| *known == source) {
            continue;
        }
        found.push((source, distance));
        let ways = graph[v as usize].iter().filter(|(w, _)| near[*w as usize].len() < count);
        heap.extend(ways.map(|&(w, length)| (Reached(distance + length, w), Reverse(source))));
    }
    near
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

    /// On a ring with chords, every vertex finds the sources that paths from each of them find.
    #[test]
    fn the_nearest_sources_are_those_of_all_paths() {
        let count = 40_u32;
        let length = |k: u32| 1.0 + f64::from(k * 7 % 11);
        let ways = (0..count).flat_map(|k| [(k, (k + 1) % count), (k, (k * 3 + 1) % count)]);
        let both =
            ways.flat_map(|(a, b)| [(a as usize, (b, length(a + b))), (b as usize, (a, length(a + b)))]);
        let graph = Csr::from_pairs(count as usize, both);
        let sources = [3, 9, 14, 15, 22, 31, 38];
        let near = nearest_sources(&graph, sources.into_iter(), 3);
        let mut all = [0.0; 40].map(|_| Vec::new());
        for &source in &sources {
            let mut distances = [0.0; 40];
            distances_from(&graph, source as usize, &mut distances);
            all.iter_mut().zip(distances).for_each(|(of, distance)| of.push(distance));
        }
        for (near, mut all) in near.into_iter().zip(all) {
            for (source, distance) in &near {
                assert_eq!(*distance, all[*source]);
            }
            all.sort_by(f64::total_cmp);
            assert_eq!(near.iter().map(|(_, distance)| *distance).collect::<Vec<_>>(), all[..3]);
        }
    }
}
