//! Fills missing readings from neighbouring ones on the skin.
//!
//! Taxels without a reading that are connected by edges are one gap. Each of them gets the mean of its neighbours,
//! weighted by one over the length of the edge: a discrete harmonic function, found by symmetric Gauss-Seidel sweeps
//! from the mean of the readings around the gap. Every step is an average, so no filled value leaves the range of
//! those readings, and none depends on an earlier frame. A gap without a reading around it stays missing, and so do slots
//! without a taxel that the channel is of, which are not crossed either.

use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::mesh::edges;
use crate::numeric::Csr;
use crate::pyramid::LevelId;
use crate::signal::{Channel, Frame, Stage};
use crate::skin::PatchId;

/// Sweeps stop when no value moves by more than this share of the range of the readings around the gap.
const TOLERANCE: f64 = 1e-9;

/// Most sweeps: enough for a gap of a few hundred taxels to converge.
const MAX_SWEEPS: usize = 500;

/// Fills missing readings; owns its buffers, and allocates nothing in the steady state.
///
/// ```
/// use dermatome::{
///     id::VertexId,
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, Filler, Frame, Stage},
///     skin::PatchId,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(3, 3, 0.004), 1e-3);
/// let (mut filler, mut frame) = (Filler::new(&map, &[Channel::default()]), Frame::new(&map, 1));
/// frame.values[PatchId::new(0)][0].iter_mut().for_each(|x| *x = 2.0);
/// frame.values[PatchId::new(0)][0][VertexId::new(4)] = f64::NAN;
/// let filled = filler.apply(&frame);
/// assert_eq!(filled.values[PatchId::new(0)][0][VertexId::new(4)], 2.0);
/// assert_eq!(filled.filled[PatchId::new(0)][0], [VertexId::new(4)]);
/// ```
#[derive(Debug, Clone)]
pub struct Filler {
    graphs: Vec<Graph>,
    /// That of each channel.
    of_channels: Vec<usize>,
    out: Frame,
    is_seen: Vec<bool>,
    gap: Vec<VertexId>,
}

/// The taxels that channels are of.
#[derive(Debug, Clone)]
struct Graph {
    is_read: IdVec<PatchId, IdVec<VertexId, bool>>,
    /// Neighbours of each of them that are such taxels, and one over their distance in 1/m.
    neighbours: IdVec<PatchId, Csr<(VertexId, f64)>>,
}

impl Graph {
    fn new(map: &SkinMap, is_read: IdVec<PatchId, IdVec<VertexId, bool>>) -> Self {
        /// Least distance of taxels for their weights, in m.
        const CLOSEST: f64 = 1e-9;
        let of_patch = |(id, patch): (PatchId, &PatchMap)| {
            let mesh = &patch.levels[LevelId::new(0)].level.mesh;
            let edges = edges(mesh);
            let are_read = |ends: &&[VertexId; 2]| ends.iter().all(|&end| is_read[id][end]);
            let pairs = edges.iter().filter(are_read).flat_map(|&[a, b]| {
                let weight = mesh.positions[a].distance(mesh.positions[b]).max(CLOSEST).recip();
                [(a.index(), (b, weight)), (b.index(), (a, weight))]
            });
            Csr::from_pairs(mesh.positions.len(), pairs)
        };
        let neighbours = map.patches.enumerate().map(of_patch).collect();
        Self { is_read, neighbours }
    }
}

impl Filler {
    /// A filler for frames with these channels, each of which is filled on the taxels that it [is of](Channel::taxels).
    pub fn new(map: &SkinMap, channels: &[Channel]) -> Self {
        let mut graphs: Vec<Graph> = Vec::new();
        let mut of_channels = Vec::new();
        for is_read in channels.iter().map(|channel| channel.taxels(map)) {
            let known = graphs.iter().position(|graph| graph.is_read == is_read);
            of_channels.push(known.unwrap_or(graphs.len()));
            if known.is_none() {
                graphs.push(Graph::new(map, is_read));
            }
        }
        let most = map.patches.iter().map(|patch| patch.taxels.ids.len()).max().unwrap_or(0);
        let mut out = Frame::new(map, channels.len());
        out.filled.iter_mut().flatten().for_each(|filled| filled.reserve(most));
        Self { graphs, of_channels, out, is_seen: vec![false; most], gap: Vec::with_capacity(most) }
    }
}

impl Filler {
    /// The frame that was passed on last.
    #[doc(hidden)]
    pub fn latest(&self) -> &Frame {
        &self.out
    }
}

impl Stage for Filler {
    /// The frame with its gaps filled, and the list of filled taxels.
    fn apply<'f>(&'f mut self, frame: &'f Frame) -> &'f Frame {
        let Self { graphs, of_channels, out, is_seen, gap } = self;
        assert_eq!(frame.values.len(), out.values.len(), "one entry per patch");
        out.time = frame.time;
        for (patch, read) in frame.values.enumerate() {
            assert_eq!(read.len(), of_channels.len(), "one array per channel");
            let out = out.values[patch].iter_mut().zip(&mut out.filled[patch]);
            for (((values, filled), read), &graph) in out.zip(read).zip(&*of_channels) {
                let Graph { is_read, neighbours } = &graphs[graph];
                let neighbours = &neighbours[patch];
                values.as_mut_slice().copy_from_slice(read.as_slice());
                filled.clear();
                is_seen.fill(false);
                for seed in read.ids() {
                    let needs_one = is_read[patch][seed] && !values[seed].is_finite();
                    if !needs_one || std::mem::replace(&mut is_seen[seed.index()], true) {
                        continue;
                    }
                    gap.clear();
                    gap.push(seed);
                    let mut next = 0;
                    while let Some(&taxel) = gap.get(next) {
                        next += 1;
                        for &(other, _) in &neighbours[taxel.index()] {
                            if !values[other].is_finite()
                                && !std::mem::replace(&mut is_seen[other.index()], true)
                            {
                                gap.push(other);
                            }
                        }
                    }
                    if fill_gap(neighbours, gap, values) {
                        filled.extend_from_slice(gap);
                    }
                }
                filled.sort_unstable();
            }
        }
        out
    }
}

/// Fills one gap; `false` if no reading is next to it.
fn fill_gap(neighbours: &Csr<(VertexId, f64)>, gap: &[VertexId], values: &mut IdVec<VertexId, f64>) -> bool {
    let (mut low, mut high, mut sum, mut weight) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0);
    for &(other, w) in gap.iter().flat_map(|taxel| &neighbours[taxel.index()]) {
        let x = values[other];
        if x.is_finite() {
            (low, high) = (low.min(x), high.max(x));
            (sum, weight) = (sum + w * x, weight + w);
        }
    }
    if weight == 0.0 {
        return false;
    }
    gap.iter().for_each(|&taxel| values[taxel] = (sum / weight).clamp(low, high));
    for sweep in 0..MAX_SWEEPS {
        let mut moved = 0.0_f64;
        for k in 0..gap.len() {
            let taxel = gap[if sweep % 2 == 0 { k } else { gap.len() - 1 - k }];
            let (mut sum, mut weight) = (0.0, 0.0);
            for &(other, w) in &neighbours[taxel.index()] {
                (sum, weight) = (sum + w * values[other], weight + w);
            }
            let x = (sum / weight).clamp(low, high);
            moved = moved.max((x - values[taxel]).abs());
            values[taxel] = x;
        }
        if moved <= TOLERANCE * (high - low) {
            break;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Filled values are averages of their neighbours and in their range, independent of the order of frames.
    #[test]
    fn gaps_are_filled_within_the_range_of_their_neighbours() {
        let map = SkinMap::flat(shapes::lattice(20, 16, 0.006), 1e-3);
        let patch = PatchId::new(0);
        let mut filler = Filler::new(&map, &[Channel::default()]);
        let frame = |kept: &dyn Fn(usize) -> bool| {
            let mut frame = Frame::new(&map, 1);
            for (v, x) in frame.values[patch][0].iter_mut().enumerate().filter(|(v, _)| kept(*v)) {
                *x = ((v * 37) % 101) as f64 / 100.0;
            }
            frame
        };
        let sparse = frame(&|v| v % 7 == 3 || v < 20);
        let first = filler.apply(&sparse).clone();
        assert!(first.values[patch][0].iter().all(|x| (0.0..=1.0).contains(x)));
        assert_eq!(
            first.filled[patch][0].len(),
            sparse.values[patch][0].iter().filter(|x| x.is_nan()).count()
        );
        filler.apply(&frame(&|v| v % 2 == 0));
        assert_eq!(filler.apply(&sparse), &first, "no memory of earlier frames");
        let none = filler.apply(&frame(&|_| false)).clone();
        assert!(none.filled[patch][0].is_empty() && none.values[patch][0].iter().all(|x| x.is_nan()));
    }
}
