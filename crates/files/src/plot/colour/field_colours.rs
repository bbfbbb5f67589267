//! Colours of receptive fields; neighbours have different ones.

use std::collections::BTreeSet;

use crate::id::{IdVec, VertexId};
use crate::map::MapLevel;
use crate::mesh::TriMesh;
use crate::plot::colour::Colour;

/// Fills of neighbouring fields: Paul Tol's "light" scheme, made for areas under black lines and
/// letters and distinguishable with every kind of colour vision, without its grey.
const FIELDS: [u32; 8] = [0x77aadd, 0xee8866, 0xeedd88, 0x44bb99, 0xffaabb, 0x99ddff, 0xbbcc33, 0xaaaa00];

/// The field to which each taxel belongs most, the first of several; on level 0 every taxel is its own field.
pub(crate) fn dominant_fields(level: &MapLevel) -> IdVec<VertexId, u32> {
    let Some(to_finest) = &level.level.to_finest else {
        return level.level.mesh.positions.ids().map(VertexId::raw).collect();
    };
    let row = |(v, t): (VertexId, &[VertexId; 3])| t[largest(to_finest.weights[v])].raw();
    to_finest.indices.enumerate().map(row).collect()
}

/// A colour for each of `count` fields that differs from those of its neighbours.
pub(crate) fn field_colours(groups: &IdVec<VertexId, u32>, mesh: &TriMesh, count: usize) -> Vec<Colour> {
    let mut neighbours = BTreeSet::new();
    for &[a, b, c] in &mesh.triangles {
        for [a, b] in [[a, b], [b, c], [c, a]].map(|edge| edge.map(|v| groups[v] as usize)) {
            if a != b {
                neighbours.insert((a.min(b), a.max(b)));
            }
        }
    }
    colour_fields(count, &neighbours).into_iter().map(|c| Colour::rgb(FIELDS[c])).collect()
}

/// One of [`FIELDS`] for each of `count` fields so that neighbours differ.
///
/// The field with the fewest remaining neighbours is removed repeatedly, and fields are coloured in reverse
/// order `(matula1983)`: six colours then suffice for a planar map. Of the colours that no neighbour has, the
/// one that is rarest two steps away is used, then the rarest so far. If all colours are used, neighbours may
/// have the same.
fn colour_fields(count: usize, neighbours: &BTreeSet<(usize, usize)>) -> Vec<usize> {
    let mut ring = vec![Vec::new(); count];
    for &(a, b) in neighbours {
        ring[a].push(b);
        ring[b].push(a);
    }
    let mut colours: Vec<Option<usize>> = vec![None; count];
    let mut used = [0_usize; FIELDS.len()];
    for &field in smallest_last(&ring).iter().rev() {
        let mut near = [0_usize; FIELDS.len()];
        let mut beyond = [0_usize; FIELDS.len()];
        for &a in &ring[field] {
            colours[a].into_iter().for_each(|c| near[c] += 1);
            // Bounded, since each of the thousands of neighbours of a hub would visit all others.
            ring[a].iter().take(64).filter_map(|&b| colours[b]).for_each(|c| beyond[c] += 1);
        }
        let best = (0..FIELDS.len()).min_by_key(|&c| (near[c], beyond[c], used[c], c)).unwrap_or(0);
        colours[field] = Some(best);
        used[best] += 1;
    }
    colours.into_iter().map(|c| c.unwrap_or(0)).collect()
}

/// The fields in the order of removal: always the one with the fewest remaining neighbours, the first of
/// several.
fn smallest_last(ring: &[Vec<usize>]) -> Vec<usize> {
    let mut left: Vec<usize> = ring.iter().map(Vec::len).collect();
    let mut queue: BTreeSet<(usize, usize)> = left.iter().copied().enumerate().map(|(i, n)| (n, i)).collect();
    let mut order = Vec::with_capacity(ring.len());
    while let Some((_, field)) = queue.pop_first() {
        order.push(field);
        for &other in &ring[field] {
            if queue.remove(&(left[other], other)) {
                left[other] -= 1;
                queue.insert((left[other], other));
            }
        }
    }
    order
}

/// The corner with the largest weight; the first of equal ones.
pub(super) fn largest(weights: [f64; 3]) -> usize {
    (1..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(columns: usize, rows: usize) -> BTreeSet<(usize, usize)> {
        let at = |i: usize, j: usize| j * columns + i;
        let mut pairs = BTreeSet::new();
        for j in 0..rows {
            for i in 0..columns {
                if i + 1 < columns {
                    pairs.insert((at(i, j), at(i + 1, j)));
                }
                if j + 1 < rows {
                    pairs.insert((at(i, j), at(i, j + 1)));
                    if i + 1 < columns {
                        pairs.insert((at(i, j), at(i + 1, j + 1)));
                    }
                }
            }
        }
        pairs
    }

    #[test]
    fn neighbours_differ() {
        let pairs = grid(20, 15);
        let colours = colour_fields(300, &pairs);
        assert!(pairs.iter().all(|&(a, b)| colours[a] != colours[b]));
        let used: BTreeSet<_> = colours.iter().collect();
        assert!(used.len() > 4, "a varied picture: {used:?}");
    }

    /// A wheel with a thousand spokes: greedy colouring in another order may run out of colours.
    #[test]
    fn a_hub_with_many_neighbours_differs_from_all() {
        let rim = 1000;
        let spokes = (1..=rim).map(|k| (0, k));
        let pairs: BTreeSet<_> =
            spokes.chain((1..=rim).map(|k| (k.min(k % rim + 1), k.max(k % rim + 1)))).collect();
        let colours = colour_fields(rim + 1, &pairs);
        assert!(pairs.iter().all(|&(a, b)| colours[a] != colours[b]));
    }
}
