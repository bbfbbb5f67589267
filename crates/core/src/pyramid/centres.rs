//! Chooses the centres of receptive fields: a maximal independent set at a distance that follows
//! the local spacing, which is measured or follows from stated densities and acuities.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use crate::id::{IdVec, VertexId};
use crate::mesh::{Rings, angle};
use crate::numeric::{hash, place_hash};
use crate::pyramid::removal::SeamRole;
use crate::skin::Taxels;

/// A boundary vertex is a corner if its interior angle differs from a straight one by more than this, 75
/// degrees: the rim of a triangular lattice turns by 60 degrees at each vertex although it is straight
/// overall.
const CORNER_TURN: f64 = 75.0 / 180.0 * PI;

/// At least this many vertices stay on each boundary loop: fewer do not form a loop.
const LEAST_PER_LOOP: usize = 3;

/// Separation of centres, in local spacings, that leaves about a quarter of the vertices.
pub(super) const ALPHA: f64 = 1.35;

/// Tolerance of a requested count, as a share of it.
const COUNT_TOLERANCE: f64 = 0.01;

/// Most trials for a requested count: three or four suffice where counts do not jump.
const MAX_TRIALS: usize = 12;

/// Rounds in which each spacing is replaced by the mean of itself and its neighbours': one short edge must
/// not make a region look dense.
const SMOOTHING_ROUNDS: usize = 2;

/// Smoothed distance of every vertex to its neighbours, in m.
pub(super) fn measured_spacing(rings: &Rings, positions: &IdVec<VertexId, DVec3>) -> IdVec<VertexId, f64> {
    let mut spacing = rings.map(|v, ring| {
        let sum: f64 = ring.iter().map(|&w| positions[v].distance(positions[w])).sum();
        sum / ring.len().max(1) as f64
    });
    for _ in 0..SMOOTHING_ROUNDS {
        spacing = rings.map(|v, ring| {
            let sum: f64 = ring.iter().map(|&w| spacing[w]).sum();
            (spacing[v] + sum) / (1 + ring.len()) as f64
        });
    }
    spacing
}

/// The spacing that follows from densities and acuities on level 0, in m: that of a triangular lattice of the
/// densities `rho` (1/m^2), `sqrt(2 / (sqrt3 rho))`, or else the measured one, divided by the acuity. `None`
/// without densities and acuities.
pub(super) fn wanted_spacing(
    taxels: &Taxels,
    measured: impl FnOnce() -> IdVec<VertexId, f64>,
) -> Option<IdVec<VertexId, f64>> {
    let lattice = |rho: &f64| (2.0 / (3.0_f64.sqrt() * rho)).sqrt();
    match (&taxels.densities, taxels.relative_acuities()) {
        (None, None) => None,
        (Some(densities), None) => Some(densities.map(lattice)),
        (densities, Some(acuities)) => {
            let spacing = densities.as_ref().map_or_else(measured, |densities| densities.map(lattice));
            Some(spacing.iter().zip(acuities).map(|(h, acuity)| h / acuity).collect())
        }
    }
}

/// The spacing `wanted`, times the factor that makes its geometric mean that of the `measured` one,
/// in m.
///
/// On level 0 of a skin whose densities are correct the factor is about 1. It grows with the levels. Acuities
/// are only relative; with the factor they do not change how fast levels coarsen.
pub(super) fn scaled_spacing(
    wanted: &IdVec<VertexId, f64>,
    measured: &IdVec<VertexId, f64>,
) -> IdVec<VertexId, f64> {
    // The spacing of coincident vertices may be zero: these do not count.
    let (mut sum, mut count) = (0.0, 0.0);
    for (m, w) in measured.iter().zip(wanted).filter(|(m, w)| **m > 0.0 && **w > 0.0) {
        sum += (m / w).ln();
        count += 1.0;
    }
    let factor = if count > 0.0 { f64::exp(sum / count) } else { 1.0 };
    wanted.map(|w| w * factor)
}

/// The vertices of one level in the order in which they may become centres: corners, then the boundary, then
/// the inside; of each, taxels that read pressure before absent ones and thermal pads; of these, in the order
/// of a hash of the taxel's id, so that the result depends neither on the order in a file nor on a vendor's
/// numbering; ids without gaps count from 1, so that it does not depend on other patches either. Vertices of
/// equal ids are ordered by number. Where the file has no ids, a hash of the place takes their place.
///
/// `origins` gives the taxel of each vertex. A seam counts as a boundary, its ends and
/// branchings as corners.
pub(super) fn priorities(
    rings: &Rings,
    positions: &IdVec<VertexId, DVec3>,
    origins: &IdVec<VertexId, VertexId>,
    taxels: &Taxels,
    seam: Option<&IdVec<VertexId, SeamRole>>,
) -> Vec<VertexId> {
    let ids = || taxels.ids.iter().map(|id| id.0);
    let (least, most) = (ids().min().unwrap_or_default(), ids().max().unwrap_or_default());
    let is_counted = (most - least) as usize + 1 == taxels.ids.len();
    let before = if is_counted { least.saturating_sub(1) } else { 0 };
    let cell = taxels.are_counted.then(|| cells(positions));
    let mut keyed: Vec<(u64, u64, VertexId)> = origins
        .as_slice()
        .par_iter()
        .enumerate()
        .map(|(i, &taxel)| {
            let (v, id) = (VertexId::new(i), taxels.ids[taxel]);
            let is_silent = u64::from(!taxels.presence[taxel].reads_pressure());
            let role = seam.map_or(SeamRole::Off, |roles| roles[v]);
            let class = match rings.on_boundary[v] {
                _ if role == SeamRole::Fixed => 0_u64,
                _ if role == SeamRole::Along => 1,
                true if is_corner(rings, positions, v) => 0,
                true => 1,
                false => 2,
            };
            let [first, second] = match &cell {
                Some(cell) => [cell(positions[v]), positions[v]].map(place_hash),
                None => [id.0 - before, v.raw()].map(|number| hash(u64::from(number))),
            };
            (class << 62 | is_silent << 61 | first >> 3, second, v)
        })
        .collect();
    keyed.par_sort_unstable();
    keyed.into_iter().map(|(_, _, v)| v).collect()
}

/// Cells along the longest side of a box: so wide that the rounding of a file to `f32` changes the cell of one position in
/// five thousand, and so narrow that hardly two of a million taxels share one.
const CELLS: f64 = 1024.0;

/// The cell of a position in the box of all, which is the same of a body that is shifted or scaled.
pub(crate) fn cells(positions: &IdVec<VertexId, DVec3>) -> impl Fn(DVec3) -> DVec3 + Sync + use<> {
    let ends = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = positions.iter().fold(ends, |(low, high), &p| (low.min(p), high.max(p)));
    let scale = CELLS / (high - low).max_element();
    move |p| ((p - low) * scale).round()
}

fn is_corner(rings: &Rings, positions: &IdVec<VertexId, DVec3>, v: VertexId) -> bool {
    let pairs = rings.of(v).windows(2);
    let sum: f64 = pairs.map(|pair| angle(positions[v], positions[pair[0]], positions[pair[1]])).sum();
    (sum - PI).abs() > CORNER_TURN
}

/// The data of a level from which centres are chosen.
pub(super) struct Candidates<'a> {
    pub(super) rings: &'a Rings,
    /// The boundary loops, see [`Rings::boundary_loops`].
    pub(super) loops: &'a [Vec<VertexId>],
    pub(super) positions: &'a IdVec<VertexId, DVec3>,
    /// Local spacing `h`, in m.
    pub(super) spacing: &'a IdVec<VertexId, f64>,
    /// All vertices, highest priority first.
    pub(super) priorities: &'a [VertexId],
    /// Whether each vertex must be a centre.
    pub(super) fixed: &'a dyn Fn(VertexId) -> bool,
    /// Whether each vertex is a taxel that reads pressure.
    pub(super) is_live: &'a dyn Fn(VertexId) -> bool,
}

impl Candidates<'_> {
    /// The lexicographically first maximal set of vertices without a conflict, at separation
    /// `alpha`: `i` and `j` conflict if `|x_i - x_j| <= alpha (h_i + h_j) / 2` and a path of such
    /// vertices leads from `i` to `j`. (Equality counts: where vertices coincide, `h` may be zero.)
    pub(super) fn choose(&self, alpha: f64) -> IdVec<VertexId, bool> {
        let mut chosen = self.positions.ids().map(self.fixed).collect();
        self.add(alpha, &mut chosen, usize::MAX);
        for walk in self.loops {
            keep_loop(walk, self.is_live, &mut chosen);
        }
        chosen
    }

    /// Adds vertices without a conflict at separation `alpha` in order of priority, `most` at most.
    ///
    /// Paths distinguish the two sides of a thin fold. One sweep in order of priority is faster than rounds
    /// of parallel selection, because only the chosen quarter searches its neighbourhood.
    fn add(&self, alpha: f64, chosen: &mut IdVec<VertexId, bool>, mut most: usize) {
        let mut ruled_out = IdVec::<VertexId, bool>::filled(false, self.positions.len());
        let mut seen = IdVec::filled(VertexId::from(u32::MAX), self.positions.len());
        let mut stack = Vec::new();
        let mut rule_out_around = |v: VertexId, ruled_out: &mut IdVec<VertexId, bool>| {
            seen[v] = v;
            stack.push(v);
            while let Some(u) = stack.pop() {
                for &w in self.rings.of(u) {
                    let reach = 0.5 * alpha * (self.spacing[v] + self.spacing[w]);
                    if seen[w] != v && self.positions[v].distance_squared(self.positions[w]) <= reach * reach
                    {
                        seen[w] = v;
                        ruled_out[w] = true;
                        stack.push(w);
                    }
                }
            }
        };
        for v in chosen.ids().filter(|&v| chosen[v]) {
            rule_out_around(v, &mut ruled_out);
        }
        for &v in self.priorities {
            if most > 0 && !ruled_out[v] && !chosen[v] {
                chosen[v] = true;
                most -= 1;
                rule_out_around(v, &mut ruled_out);
            }
        }
    }

    /// About `count` centres, at the separation `alpha` that gives them.
    ///
    /// Counts fall like `alpha^-2`, which proposes the next trial within a bracket. On a regular lattice
    /// counts jump: there centres at the narrower separation are added to those at the wider one, up to
    /// `count`.
    pub(super) fn choose_about(&self, count: f64) -> IdVec<VertexId, bool> {
        let (mut low, mut high) = (0.0, f64::INFINITY);
        let mut alpha = ALPHA;
        let mut sparse: Option<(usize, IdVec<VertexId, bool>)> = None;
        for _ in 0..MAX_TRIALS {
            let chosen = self.choose(alpha);
            let found = chosen.iter().filter(|c| **c).count();
            let excess = found as f64 / count;
            if excess.ln().abs() < COUNT_TOLERANCE {
                return chosen;
            }
            if excess > 1.0 {
                low = alpha;
            } else {
                high = alpha;
                sparse = Some((found, chosen));
            }
            let proposal = alpha * excess.sqrt();
            let middle = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * low };
            alpha = if proposal > low && proposal < high { proposal } else { middle };
        }
        // Boundary loops alone may have more than `count` centres: then no choice is sparse enough, and this
        // one has few.
        let Some((found, mut chosen)) = sparse else { return self.choose(alpha) };
        #[expect(clippy::cast_possible_truncation, reason = "a count of vertices")]
        let missing = (count.round() as usize).saturating_sub(found);
        self.add(low, &mut chosen, missing);
        chosen
    }
}

/// Adds centres to a boundary loop that has too few: the vertices at thirds of the loop, from a centre if it
/// has one, or the live vertices nearest to them.
fn keep_loop(walk: &[VertexId], is_live: &dyn Fn(VertexId) -> bool, chosen: &mut IdVec<VertexId, bool>) {
    if walk.iter().filter(|v| chosen[**v]).count() >= LEAST_PER_LOOP {
        return;
    }
    let count = walk.len();
    let start = walk.iter().position(|v| chosen[*v]).unwrap_or(0);
    // So that searches from different thirds do not meet.
    let reach = (count / LEAST_PER_LOOP).saturating_sub(1) / 2;
    for third in 0..LEAST_PER_LOOP.min(count) {
        let at = start + third * count / LEAST_PER_LOOP;
        let near = (0..=reach).flat_map(|k| [at + k, at + count - k]).map(|k| walk[k % count]);
        let kept = near.clone().find(|&v| chosen[v] || is_live(v));
        chosen[kept.unwrap_or(walk[at % count])] = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_loop_keeps_three_centres() {
        let walk: Vec<_> = (0..7).map(VertexId::new).collect();
        let mut chosen = IdVec::filled(false, 7);
        chosen[walk[4]] = true;
        keep_loop(&walk, &|_| true, &mut chosen);
        let kept: Vec<_> = chosen.ids().filter(|&v| chosen[v]).map(VertexId::index).collect();
        assert_eq!(kept, [1, 4, 6], "thirds of the loop from the centre it has");
    }

    #[test]
    fn a_loop_keeps_live_taxels_where_it_can() {
        let walk: Vec<_> = (0..12).map(VertexId::new).collect();
        let kept = |dead: &[usize]| {
            let mut chosen = IdVec::filled(false, 12);
            keep_loop(&walk, &|v| !dead.contains(&v.index()), &mut chosen);
            chosen.ids().filter(|&v| chosen[v]).map(VertexId::index).collect::<Vec<_>>()
        };
        assert_eq!(kept(&[]), [0, 4, 8]);
        assert_eq!(kept(&[4]), [0, 5, 8]);
        assert_eq!(kept(&[0, 1]), [4, 8, 11]);
        assert_eq!(kept(&[3, 4, 5]), [0, 4, 8], "no live one is near");
    }
}
