//! Where to cut: what must be cut, and what trial maps show to be worth a seam. *Heuristic*; the
//! numbers are measured on bodies with legs and horns, gloves, junctions of tubes, nearly closed balls,
//! tori and sleeves.

use std::collections::BTreeSet;

use crate::cut::cones::ConformalFactor;
use crate::cut::recipe::{Recipe, Seam, must_cut};
use crate::cut::seam_graph::SeamGraph;
use crate::cut::shorten::shorten;
use crate::cut::trial::{Trial, TrialMap};
use crate::cut::{Cut, CutError};
use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, boundary_edges, loop_length};
use crate::numeric::argsort;
use crate::parallel::par_map;

/// Excess of the symmetric Dirichlet energy over that of an isometry at which a map is good: less is not
/// worth any seam.
const GOOD: f64 = 0.05;
/// Excess at which a surface that need not be cut stays whole.
const WHOLE: f64 = 0.1;
/// Excess at which no more cones are tried.
const ENOUGH: f64 = 0.14;
/// A seam longer by the square root of the area must divide the excess by at least this.
const FALL: f64 = 3.0;
/// As [`FALL`], where a surface has a map without any cut; it must fall by as much in any case.
const FIRST_FALL: f64 = 4.0;
/// A map with more excess is poor: more seam is tried on any surface, a plain disk too. The excess must fall by
/// [`POOR_FALL`] for each length of the square root of the area, and at least by that.
const POOR: f64 = 0.6;
const POOR_FALL: f64 = 2.0;
/// A loop is strained if the map stretches or shrinks it by more than `e^0.2`.
const STRAINED: f64 = 0.2;
/// Conformal factors that a seam may leave, one after the other: cones are added until no larger one is
/// left, then the map is tried. Above the first of them every map is poor.
const LEFT: [f64; 4] = [1.0, 0.8, 0.65, 0.5];
/// Further ones, to keep an area ratio.
const LEFT_FOR_RATIO: [f64; 5] = [0.35, 0.25, 0.18, 0.12, 0.08];
/// Cones at most: a surface that needs more has no good map.
const MOST_CONES: usize = 200;

/// Takes one seam after the other, and answers whether it wants another.
pub(crate) type Consider<'a> = dyn FnMut(&Recipe) -> Result<bool, CutError> + 'a;

/// Whether the map of a plain disk may be poor: one solution shows that most disks need no trial. Without a cone
/// of the first factor of [`LEFT`] no map is.
#[doc(hidden)]
pub fn may_be_poor(mesh: &TriMesh) -> bool {
    let mut fixed = IdVec::filled(false, mesh.positions.len());
    boundary_edges(mesh).iter().flatten().for_each(|&v| fixed[v] = true);
    let cone = ConformalFactor::new(mesh).and_then(|factor| factor.next_cone(&fixed));
    cone.is_some_and(|(_, most)| most > LEFT[0])
}

/// Decides how to cut a mesh, on which seams have these costs, by trial maps.
/// Fails if the mesh is not an oriented manifold in one piece.
#[doc(hidden)]
pub fn decide(
    mesh: &TriMesh,
    costs: Option<&IdVec<VertexId, f64>>,
    how: &Cut,
    map: &TrialMap<'_>,
) -> Result<Recipe, CutError> {
    let graph = SeamGraph::new(mesh, costs)?;
    let is_disk = graph.genus() == 0 && graph.loops.len() == 1;
    if *how == Cut::None || (is_disk && *how == Cut::All) {
        return Ok(Recipe::default());
    }
    let base = must_cut(&graph);
    graph.checked(&base.edges)?;
    if *how == Cut::All {
        let all = (0..graph.loops.len()).map(|k| graph.apex(k));
        return Ok(Recipe::new(&graph, &base.joined(&graph, all)));
    }
    let search = SeamSearch { graph: &graph, map, factor: ConformalFactor::new(mesh) };
    Ok(Recipe::new(&graph, &search.best(base).seam))
}

/// Shows the seam that [`decide`] takes, then longer ones that reach more cones, each with a lower area ratio of its trial
/// map, until no more are wanted. Which they are does not depend on when that is.
/// Fails as [`decide`].
#[doc(hidden)]
pub fn with_falling_ratios(
    mesh: &TriMesh,
    costs: Option<&IdVec<VertexId, f64>>,
    map: &TrialMap<'_>,
    consider: &mut Consider<'_>,
) -> Result<(), CutError> {
    let graph = SeamGraph::new(mesh, costs)?;
    let base = must_cut(&graph);
    graph.checked(&base.edges)?;
    let search = SeamSearch { graph: &graph, map, factor: ConformalFactor::new(mesh) };
    search.with_falling_ratios(search.best(base), consider)
}

#[derive(Debug, Clone)]
struct Found {
    seam: Seam,
    trial: Trial,
}

impl Found {
    /// Its excess energy, times [`FALL`] for each seam length of the square root of the area.
    fn cost(&self) -> f64 {
        self.trial.excess.max(GOOD) * FALL.powf(self.trial.length)
    }
}

struct SeamSearch<'a, 'm> {
    graph: &'a SeamGraph<'m>,
    map: &'a TrialMap<'a>,
    factor: Option<ConformalFactor>,
}

impl SeamSearch<'_, '_> {
    /// The map of the surface cut along a seam. One that is likely to have more excess energy than `most`
    /// may be given up.
    fn tried(&self, seam: Seam, most: f64) -> Found {
        let trial = Trial::new(self.graph, &seam.edges, self.map, most);
        Found { seam, trial }
    }

    /// A seam that must be, with the number of cones that pays best.
    fn with_cones(&self, seam: Seam) -> Found {
        self.more_cones(seam.clone(), None).unwrap_or_else(|| self.tried(seam, f64::INFINITY))
    }

    /// A seam with the number of cones that pays best; `None` if it is `known` and no cone is added to it.
    fn more_cones(&self, mut seam: Seam, known: Option<&Trial>) -> Option<Found> {
        let mut best: Option<Found> = None;
        for left in LEFT {
            if !self.add_cones(&mut seam, left) && (best.is_some() || known.is_some()) {
                continue;
            }
            let found = self.tried(seam.clone(), f64::INFINITY);
            best = Some(
                best.into_iter().fold(found, |new, old| if new.cost() < old.cost() { new } else { old }),
            );
            if best.as_ref().is_some_and(|best| best.trial.excess <= ENOUGH) {
                break;
            }
        }
        best
    }

    /// A poor map with more cones, or that of the seam that must be with all loops joined to it before any cone, if that is
    /// much better. A cone may be joined to a loop that the seam leaves out; then a tube between the two stays a ring
    /// on the map, however many cones follow, and joining the loops afterwards keeps the detours of the cones.
    fn relieved(&self, poor: Found, base: &Seam) -> Found {
        let graph = self.graph;
        let coned = self.more_cones(poor.seam.clone(), Some(&poor.trial));
        let apexes = (0..graph.loops.len()).map(|k| graph.apex(k));
        let has_others = graph.loops.len() > 1 && !apexes.clone().all(|apex| poor.seam.ends.contains(&apex));
        let joined = has_others.then(|| self.with_cones(base.joined(graph, apexes)));
        // The excess that a map of the first seam would need to be as good.
        let worth =
            |new: &Found| new.trial.excess * POOR_FALL.powf((new.trial.length - poor.trial.length).max(1.0));
        let best = coned.into_iter().chain(joined).reduce(|a, b| if worth(&b) < worth(&a) { b } else { a });
        best.filter(|new| worth(new) < poor.trial.excess).unwrap_or(poor)
    }

    /// The seam that pays best, from that without which the surface has no map.
    fn best(&self, base: Seam) -> Found {
        let is_disk = self.graph.genus() == 0 && self.graph.loops.len() == 1;
        let found = if base.edges.is_empty() {
            let whole = self.tried(base.clone(), f64::INFINITY);
            if is_disk || whole.trial.excess <= WHOLE { whole } else { self.with_loops(whole) }
        } else {
            self.with_cones(base.clone())
        };
        if found.trial.excess > POOR { self.relieved(found, &base) } else { found }
    }

    /// Shows a found seam, then adds cones to it, down to one conformal factor after the other, and shows those that lower
    /// the area ratio.
    fn with_falling_ratios(&self, found: Found, consider: &mut Consider<'_>) -> Result<(), CutError> {
        let mut seam = found.seam.clone();
        let mut least = found.trial.area_ratio;
        let mut goes_on = consider(&Recipe::new(self.graph, &found.seam))?;
        for left in LEFT.into_iter().chain(LEFT_FOR_RATIO) {
            if !goes_on {
                break;
            }
            if !self.add_cones(&mut seam, left) {
                continue;
            }
            let found = self.tried(seam.clone(), f64::INFINITY);
            if found.trial.area_ratio < least {
                least = found.trial.area_ratio;
                goes_on = consider(&Recipe::new(self.graph, &found.seam))?;
            }
        }
        Ok(())
    }

    /// Adds cones to a seam until no conformal factor above `left` is left; returns whether it changed.
    fn add_cones(&self, seam: &mut Seam, left: f64) -> bool {
        let own = self.graph.mesh.positions.len();
        let before = seam.ends.len();
        let mut reached = self.graph.vertices(&seam.edges);
        reached.extend((0..self.graph.loops.len()).map(|k| self.graph.apex(k)));
        let on_loops = self.graph.loops.iter().flatten().copied();
        let mut fixed = IdVec::<VertexId, bool>::filled(false, own);
        reached.iter().copied().filter(|v| v.index() < own).chain(on_loops).for_each(|v| fixed[v] = true);
        while seam.ends.len() < MOST_CONES {
            let next = self.factor.as_ref().and_then(|factor| factor.next_cone(&fixed));
            let Some((cone, _)) = next.filter(|(_, most)| *most > left) else { break };
            let Some(path) = self.graph.path(&[cone].into(), &reached) else { break };
            for v in path.iter().flat_map(|&edge| self.graph.ends[edge]) {
                if v.index() < own {
                    fixed[v] = true;
                    reached.insert(v);
                } else {
                    seam.ends.insert(v);
                }
            }
            seam.edges.extend(path);
            seam.ends.insert(cone);
        }
        if seam.ends.len() > before {
            seam.edges = shorten(self.graph, std::mem::take(&mut seam.edges), &seam.ends);
        }
        seam.ends.len() > before
    }

    /// The strained loops joined to the longest one, with cones, if that pays: all of them, the longest of
    /// them, or the fewest of the most shrunk ones.
    fn with_loops(&self, whole: Found) -> Found {
        let (longest, bad) = self.bad_loops(&whole.trial);
        let joined = |chosen: &[usize], cones: &BTreeSet<VertexId>| {
            let loops = std::iter::once(longest).chain(chosen.iter().copied()).map(|k| self.graph.apex(k));
            Seam::default().joined(self.graph, loops.chain(cones.iter().copied()))
        };
        let best = self.with_cones(joined(&bad, &BTreeSet::new()));
        if best.trial.excess * FIRST_FALL.powf(best.trial.length.max(1.0)) > whole.trial.excess {
            return whole;
        }
        let is_cone = |v: &VertexId| v.index() < self.graph.mesh.positions.len();
        let cones = best.seam.ends.iter().copied().filter(is_cone).collect();
        let length = |k: &usize| loop_length(self.graph.mesh, &self.graph.loops[*k]);
        let other_end = bad.iter().copied().max_by(|a, b| length(a).total_cmp(&length(b)).then(b.cmp(a)));
        let powers = std::iter::successors(Some(1), |count| Some(2 * count));
        let fewer = powers.take_while(|count| *count < bad.len()).map(|count| bad[..count].to_vec());
        let fewer: Vec<_> = fewer.chain(other_end.filter(|_| bad.len() > 1).map(|k| vec![k])).collect();
        let trials = par_map(&fewer, |chosen| {
            let seam = joined(chosen, &cones);
            let most = best.cost() / FALL.powf(self.graph.length(&seam.edges));
            self.tried(seam, most)
        });
        trials.into_iter().fold(best, |best, new| if new.cost() < best.cost() { new } else { best })
    }

    /// The longest loop, and the others that the map stretches or shrinks much, most shrunk first.
    fn bad_loops(&self, whole: &Trial) -> (usize, Vec<usize>) {
        let graph = self.graph;
        let lengths: Vec<f64> = graph.loops.iter().map(|walk| loop_length(graph.mesh, walk)).collect();
        let longest = (0..lengths.len()).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best });
        if whole.uv.is_empty() {
            return (longest, (0..lengths.len()).filter(|&k| k != longest).collect());
        }
        let stretch = |k: usize| {
            let walk = &graph.loops[k];
            let next = walk.iter().cycle().skip(1);
            let on_map: f64 = walk.iter().zip(next).map(|(&a, &b)| whole.uv[a].distance(whole.uv[b])).sum();
            (on_map / lengths[k]).ln()
        };
        let stretches: Vec<f64> = (0..lengths.len()).map(stretch).collect();
        let is_bad = |&k: &usize| k != longest && stretches[k].abs() > STRAINED;
        (longest, argsort(&stretches).into_iter().filter(is_bad).collect())
    }
}
