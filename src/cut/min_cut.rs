//! The lightest set of edges that parts two places of a graph, by augmenting flows along shortest
//! ways (`(dinic1970)`).

use std::collections::VecDeque;

/// A graph of two-way edges with capacities.
#[derive(Debug)]
pub(super) struct FlowGraph {
    /// The edges of each node.
    at: Vec<Vec<usize>>,
    /// Where each edge leads, and what it can still carry; edge `k ^ 1` is the way back.
    edges: Vec<(usize, u64)>,
}

impl FlowGraph {
    pub(super) fn new(nodes: usize) -> Self {
        Self { at: vec![Vec::new(); nodes], edges: Vec::new() }
    }

    /// An edge that carries as much either way.
    pub(super) fn join(&mut self, a: usize, b: usize, capacity: u64) {
        for (from, to) in [(a, b), (b, a)] {
            self.at[from].push(self.edges.len());
            self.edges.push((to, capacity));
        }
    }

    /// Whether each node is on the source's side of the lightest cut, of equal ones the nearest to
    /// the source.
    pub(super) fn cut(mut self, source: usize, sink: usize) -> Vec<bool> {
        loop {
            let depths = self.depths(source);
            if depths[sink] == usize::MAX {
                return depths.into_iter().map(|depth| depth != usize::MAX).collect();
            }
            self.block(&depths, source, sink);
        }
    }

    /// Steps from the source to each node along edges that can carry more; `usize::MAX` if none leads
    /// there.
    fn depths(&self, source: usize) -> Vec<usize> {
        let mut depths = vec![usize::MAX; self.at.len()];
        depths[source] = 0;
        let mut queue = VecDeque::from([source]);
        while let Some(node) = queue.pop_front() {
            for &edge in &self.at[node] {
                let (to, left) = self.edges[edge];
                if left > 0 && depths[to] == usize::MAX {
                    depths[to] = depths[node] + 1;
                    queue.push_back(to);
                }
            }
        }
        depths
    }

    /// Fills all shortest ways.
    fn block(&mut self, depths: &[usize], source: usize, sink: usize) {
        let mut next = vec![0; self.at.len()];
        let (mut way, mut node) = (Vec::new(), source);
        loop {
            if node == sink {
                let most = way.iter().map(|&edge: &usize| self.edges[edge].1).min().unwrap_or(0);
                for &edge in &way {
                    self.edges[edge].1 -= most;
                    self.edges[edge ^ 1].1 += most;
                }
                way.clear();
                node = source;
                continue;
            }
            let usable = |&edge: &usize| {
                let (to, left) = self.edges[edge];
                left > 0 && depths[to] == depths[node] + 1
            };
            let found = self.at[node][next[node]..].iter().position(usable);
            match (found, way.last()) {
                (Some(skipped), _) => {
                    next[node] += skipped;
                    let edge = self.at[node][next[node]];
                    way.push(edge);
                    node = self.edges[edge].0;
                }
                // A dead end: back, and never here again.
                (None, Some(&edge)) => {
                    way.pop();
                    next[node] = self.at[node].len();
                    node = self.edges[edge ^ 1].0;
                    next[node] += 1;
                }
                (None, None) => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two bridges between two squares: the cut goes through them, although they are not next to
    /// source or sink.
    #[test]
    fn the_cut_goes_through_the_narrowest_place() {
        let mut graph = FlowGraph::new(8);
        for first in [0, 4] {
            for k in 0..4 {
                graph.join(first + k, first + (k + 1) % 4, 5);
            }
        }
        graph.join(2, 4, 1);
        graph.join(3, 5, 2);
        assert_eq!(graph.cut(0, 7), [true, true, true, true, false, false, false, false]);
    }

    #[test]
    fn what_is_not_joined_is_parted_already() {
        let mut graph = FlowGraph::new(3);
        graph.join(0, 1, 3);
        assert_eq!(graph.cut(0, 2), [true, true, false]);
    }
}
