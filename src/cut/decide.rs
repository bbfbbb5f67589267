//! Where to cut: what must be cut, and what trial maps show to be worth a seam. *Heuristic*; the
//! rule and its numbers are measured on sleeves, junctions of tubes, nearly closed balls and public
//! shapes: an optional cut must lower the excess energy fourfold, and fourfold per seam length of the
//! square root of the area.

use crate::{
    cut::{
        Cut, CutError,
        pairs::{MOST_LOOPS, Pairs},
        recipe::{Recipe, join_loops, must_cut, slit},
        seam_graph::SeamGraph,
        slits::{LONG, SHORT, slit_ends, spread_curvature},
        trial::{FALL, Trial, TrialMap},
    },
    id::{IdVec, VertexId},
    mesh::{TriMesh, loop_length},
    numeric::argsort,
    parallel::par_map,
};

/// A map whose symmetric Dirichlet energy exceeds that of an isometry by at most this is good enough.
const GOOD: f64 = 0.1;
/// A loop is strained if the map stretches or shrinks it by more than `e^0.2`.
const STRAINED: f64 = 0.2;
/// Least rate (see [`Trial::rate`]) to begin cutting a surface that need not be cut.
const BEGIN: f64 = 1.0;
/// Least rate of further slits. A second slit often pays only after the first: with 1, several shapes
/// lose half of the gain.
const GO_ON: f64 = 0.5;
/// From this excess energy on down a slit must pay as much as a first cut: a torus, at 0.147, would
/// get half a seam more for a map that is hardly better.
const NEARLY_GOOD: f64 = 0.15;
/// Slits at most: a surface that needs more has no good map.
const MOST_SLITS: usize = 24;
/// Stop after this many slits without a lower area ratio: of several equal peaks all must be slit first.
/// A ball needs 3. A glove would need 11 (a minute) for little.
const PATIENCE: usize = 6;
/// An area ratio is lower than before if it is by this factor.
const LESS: f64 = 0.98;

/// A limit of the area ratio of a map.
pub(crate) struct AreaLimit<'a> {
    pub(crate) ratio: f64,
    /// Makes the map that the limit is about.
    pub(crate) map: &'a TrialMap<'a>,
}

/// What makes trial maps.
pub(crate) struct TrialMaps<'a> {
    /// Maps that may overlap themselves.
    pub(crate) free: &'a TrialMap<'a>,
    /// Maps that may not, if the final one may not.
    pub(crate) apart: Option<&'a TrialMap<'a>>,
}

/// Decides how to cut a mesh, whose taxels have these densities (1/m^2), by trial maps; slits go on
/// until `limit` holds, or no slit helps.
///
/// # Errors
/// If the mesh is not an oriented manifold in one piece.
pub(crate) fn decide(
    mesh: &TriMesh,
    densities: Option<&IdVec<VertexId, f64>>,
    how: &Cut,
    maps: &TrialMaps<'_>,
    limit: Option<&AreaLimit<'_>>,
) -> Result<Recipe, CutError> {
    let graph = SeamGraph::new(mesh, densities)?;
    let is_disk = graph.genus() == 0 && graph.loops.len() == 1;
    if *how == Cut::None || (is_disk && limit.is_none()) {
        return Ok(Recipe::default());
    }
    let base = must_cut(&graph);
    graph.checked(&base)?;
    let must = graph.mesh_edges(&base);
    let spokes = graph.spokes(&base);
    let all: Vec<usize> = (0..graph.loops.len()).collect();
    if *how == Cut::All {
        let loops = named(&graph, &all);
        return Ok(Recipe { is_cut: true, base: must, spokes, loops, ..Recipe::default() });
    }
    let decision = Decision { graph: &graph, map: maps.free };
    // A disk is judged by its limit alone.
    let none = |_: &TriMesh, _: &_, _: Option<&_>, _: f64| None;
    let mut state = Trial::new(&graph, base, if is_disk { &none } else { maps.free });
    let mut loops = Vec::new();
    if graph.loops.len() > 1
        && state.excess > GOOD
        && let Some((joined, better)) = decision.join_bad_loops(&state)
    {
        (loops, state) = (joined, better);
    }
    let mut slits = if is_disk { Vec::new() } else { decision.slit_while_it_pays(&mut state) };
    let mut through = Vec::new();
    if let Some(limit) = limit {
        decision.slit_below(limit, &mut state, &mut slits);
    } else if let Some(better) = maps.apart.and_then(|map| decision.pair_up(&loops, &state, map)) {
        through = graph.mesh_edges(&better.seam);
        state = better;
    }
    let is_cut = !state.seam.is_empty();
    let area_ratio = if limit.is_some() { state.area_ratio } else { 0.0 };
    Ok(Recipe { is_cut, base: must, spokes, loops: named(&graph, &loops), through, slits, area_ratio })
}

/// A vertex of each of these loops.
fn named(graph: &SeamGraph<'_>, loops: &[usize]) -> Vec<VertexId> {
    loops.iter().map(|&k| graph.loops[k][0]).collect()
}

struct Decision<'a, 'm> {
    graph: &'a SeamGraph<'m>,
    map: &'a TrialMap<'a>,
}

impl Decision<'_, '_> {
    /// Joins the strained loops to the longest one if that pays: all of them, or the longest of
    /// them or the fewest of the most shrunk ones if these do nearly as well. Returns the joined loops too.
    fn join_bad_loops(&self, before: &Trial) -> Option<(Vec<usize>, Trial)> {
        let (longest, bad) = self.bad_loops(before);
        if bad.is_empty() {
            return None;
        }
        let joined = |chosen: &[usize], most: f64| {
            let mut loops: Vec<usize> = std::iter::once(longest).chain(chosen.iter().copied()).collect();
            loops.sort_unstable();
            let seam = join_loops(self.graph, &before.seam, &loops);
            (loops, Trial::after(self.graph, None, seam, self.map, most))
        };
        let all = joined(&bad, f64::INFINITY);
        if before.excess < FALL * all.1.excess || all.1.rate(before) < BEGIN {
            return None;
        }
        let enough = (2.0 * all.1.excess).max(GOOD);
        let length = |k: &usize| loop_length(self.graph.mesh, &self.graph.loops[*k]);
        let other_end = bad.iter().copied().max_by(|a, b| length(a).total_cmp(&length(b)).then(b.cmp(a)));
        let powers = std::iter::successors(Some(1), |count| Some(2 * count));
        let fewer = powers.take_while(|count| *count < bad.len()).map(|count| bad[..count].to_vec());
        let first = other_end.filter(|_| bad.len() > 1).map(|k| vec![k]);
        let is_enough = |few: &(_, Trial)| few.1.excess <= enough;
        let first = first.map(|chosen| joined(&chosen, enough)).filter(is_enough);
        let others = || {
            let fewer = fewer.collect::<Vec<_>>();
            par_map(&fewer, |chosen| joined(chosen, enough)).into_iter().find(is_enough)
        };
        Some(first.or_else(others).unwrap_or(all))
    }

    /// The longest loop, and the others that the map stretches or shrinks much, most shrunk first.
    fn bad_loops(&self, state: &Trial) -> (usize, Vec<usize>) {
        let Self { graph, .. } = self;
        let lengths: Vec<f64> = graph.loops.iter().map(|walk| loop_length(graph.mesh, walk)).collect();
        let longest = (0..lengths.len()).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best });
        let stretch = |k: usize| {
            let walk = &graph.loops[k];
            let next = walk.iter().cycle().skip(1);
            // Of a vertex of the seam one place is taken: the error is small.
            let on_map: f64 = walk.iter().zip(next).map(|(&a, &b)| state.uv[a].distance(state.uv[b])).sum();
            (on_map / lengths[k]).ln()
        };
        if state.uv.is_empty() {
            return (longest, (0..lengths.len()).filter(|&k| k != longest).collect());
        }
        let stretches: Vec<f64> = (0..lengths.len()).map(stretch).collect();
        let is_bad = |&k: &usize| k != longest && stretches[k].abs() > STRAINED;
        (longest, argsort(&stretches).into_iter().filter(is_bad).collect())
    }

    /// Adds the best slit again and again while it lowers the excess energy fast enough; returns
    /// where they end.
    fn slit_while_it_pays(&self, state: &mut Trial) -> Vec<VertexId> {
        let mut slits = Vec::new();
        let curvature = spread_curvature(self.graph);
        while state.excess > GOOD && slits.len() < MOST_SLITS {
            let ends = slit_ends(self.graph, state, &curvature, LONG);
            let with = |&end: &VertexId| {
                let seam = slit(self.graph, &state.seam, end);
                Trial::after(self.graph, Some(state), seam, self.map, f64::INFINITY)
            };
            let trials = par_map(&ends, with);
            let rated = ends.into_iter().zip(trials).map(|(end, trial)| (trial.rate(state), end, trial));
            // Of equal rates the first.
            let Some((rate, end, trial)) = rated.reduce(|a, b| if b.0 > a.0 { b } else { a }) else { break };
            let least = if state.seam.is_empty() || state.excess <= NEARLY_GOOD { BEGIN } else { GO_ON };
            if rate < least {
                break;
            }
            slits.push(end);
            *state = trial;
        }
        slits
    }

    /// Joins these loops pair by pair instead, where the map is poor because it may not overlap itself.
    fn pair_up(&self, loops: &[usize], state: &Trial, map: &TrialMap<'_>) -> Option<Trial> {
        if loops.len() < 3 || loops.len() > MOST_LOOPS {
            return None;
        }
        let now = Trial::after(self.graph, Some(state), state.seam.clone(), map, f64::INFINITY);
        if now.excess <= GOOD {
            return None;
        }
        let curvature = spread_curvature(self.graph);
        let promising = Pairs::new(self.graph, &curvature).promising(loops);
        let trials = par_map(&promising, |seam| Trial::new(self.graph, seam.clone(), map));
        // Of equal ones the first.
        let best = trials.into_iter().reduce(|a, b| if b.cost() < a.cost() { b } else { a });
        best.filter(|trial| trial.cost() < now.cost())
    }

    /// Adds the slits that lower the area ratio most until it is below the limit, or none lowers it.
    fn slit_below(&self, limit: &AreaLimit<'_>, state: &mut Trial, slits: &mut Vec<VertexId>) {
        let curvature = spread_curvature(self.graph);
        *state = Trial::new(self.graph, std::mem::take(&mut state.seam), limit.map);
        let mut now = state.clone();
        let (mut slits_now, mut waiting) = (slits.clone(), 0);
        while now.area_ratio > limit.ratio && slits_now.len() < MOST_SLITS && waiting < PATIENCE {
            let ends = slit_ends(self.graph, &now, &curvature, SHORT);
            let trials =
                par_map(&ends, |&end| Trial::new(self.graph, slit(self.graph, &now.seam, end), limit.map));
            let best = ends.into_iter().zip(trials);
            let best = best.reduce(|a, b| if b.1.area_ratio < a.1.area_ratio { b } else { a });
            match best {
                // A worst face that stays may need a second slit: less energy is progress as well.
                Some((end, trial)) if trial.area_ratio < now.area_ratio || trial.excess < now.excess => {
                    slits_now.push(end);
                    now = trial;
                    waiting += 1;
                    if now.area_ratio < LESS * state.area_ratio {
                        waiting = 0;
                        state.clone_from(&now);
                        slits.clone_from(&slits_now);
                    }
                }
                _ => break,
            }
        }
        // The last slits are kept only if they reach the limit.
        if now.area_ratio <= limit.ratio {
            (*state, *slits) = (now, slits_now);
        }
    }
}
