//! Which modules share an edge, the pieces they form, and their wiring: chains of a limited length, or trees.
//!
//! Covering a graph by few paths is NP-hard. *Heuristic*: a greedy choice of the module with the fewest free neighbours,
//! many times with ties broken at random, the best kept; then a few chains that touch are drawn anew, again and again
//! (ruin and recreate, `(schrimpf2000)`). How few there can be is bounded by their length and by a flow ([`least_chains`]).
//! Chains of twelve found / bound, drawn once and anew: a tube of 319 modules 28 and 27 / 27, a half shell of 60 5 / 5; of
//! sixteen on a link with 104 modules 15 and 15 / 13.

use glam::DVec3;

use crate::design::Module;
use crate::design::grow::{GAP, Layout};
use crate::id::VertexId;
use crate::numeric::{DisjointSets, Random};

/// Ends of edges may be this much farther apart than the gap on both sides, in m, and at most a quarter of the edge: what
/// the places tried in growth allow.
const REACH: f64 = 2.0 * GAP + 1.2e-3;

/// How often all chains are drawn at random, and how often up to [`REDRAWN`] that touch. With two or three at a time the tube
/// stayed at 28 chains, with four and six it reached 27 within 500.
const DRAWS: usize = 50;
const REDRAWS: usize = 3000;
const REDRAWN: usize = 4;

/// Two modules that share an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Joint {
    pub(super) modules: [usize; 2],
    /// The edge of each, by the number of its first corner.
    pub(super) edges: [usize; 2],
}

/// How modules are wired.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wiring {
    /// Most modules that are wired together.
    pub most: usize,
    /// Whether wires may branch: trees instead of chains.
    pub has_branches: bool,
}

/// A wire from module to module across the edge they share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// The module nearer to the cable, and the next one.
    pub modules: [usize; 2],
    /// The edge of each, counted from 0 by its first corner.
    pub edges: [usize; 2],
}

/// Modules that are wired together: a module, and steps to the others, each from one that was reached before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    /// The modules, in the order of the steps.
    pub modules: Vec<usize>,
    /// A step to each of them but the first.
    pub steps: Vec<Step>,
}

/// The pairs that share an edge with ports: both ends of one are near those of the other.
pub(super) fn joints(module: &Module, layout: &Layout<'_>) -> Vec<Joint> {
    let count = module.outline.len();
    let ports: Vec<usize> = (0..count).filter(|&k| module.has_port(k)).collect();
    let ends = |m: usize, k: usize| -> [DVec3; 2] {
        let corners = &layout.all[m].corners;
        [corners[k], corners[(k + 1) % count]]
    };
    let shortest =
        (0..count).map(|k| module.edge(k)[0].distance(module.edge(k)[1])).fold(f64::INFINITY, f64::min);
    let reach = REACH.min(0.25 * shortest);
    let mut found = Vec::new();
    for m in 0..layout.all.len() {
        let mut others: Vec<usize> = layout.near(layout.all[m].centre).filter(|&other| other > m).collect();
        others.sort_unstable();
        for other in others {
            let far = |&(k, l): &(usize, usize)| {
                let ([a, b], [c, d]) = (ends(m, k), ends(other, l));
                a.distance(d).max(b.distance(c))
            };
            let pairs = ports.iter().flat_map(|&k| ports.iter().map(move |&l| (k, l)));
            let nearest = pairs.min_by(|p, q| far(p).total_cmp(&far(q)));
            if let Some((k, l)) = nearest.filter(|pair| far(pair) < reach) {
                found.push(Joint { modules: [m, other], edges: [k, l] });
            }
        }
    }
    found
}

/// The pieces of modules that share edges, the largest first, then by their first modules.
pub(super) fn pieces(count: usize, joints: &[Joint]) -> Vec<Vec<usize>> {
    let mut sets = DisjointSets::<VertexId>::new(count);
    joints
        .iter()
        .for_each(|joint| sets.join(VertexId::new(joint.modules[0]), VertexId::new(joint.modules[1])));
    let labels = sets.labels();
    let mut pieces = vec![Vec::new(); labels.count];
    labels.of.enumerate().for_each(|(k, &piece)| pieces[piece].push(k.index()));
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    pieces
}

/// The neighbours of each module: the other one, and the edges of both.
type Neighbours = Vec<Vec<(usize, [usize; 2])>>;

/// Wires a piece: every module once, every step across a shared edge, in few chains. With them the number that no wiring
/// goes below.
pub(super) fn wire(
    piece: &[usize],
    joints: &[Joint],
    count: usize,
    wiring: Wiring,
    seed: u64,
) -> (Vec<Chain>, usize) {
    let mut neighbours: Neighbours = vec![Vec::new(); count];
    for &Joint { modules: [m, n], edges: [k, l] } in joints {
        neighbours[m].push((n, [k, l]));
        neighbours[n].push((m, [l, k]));
    }
    let bound = least_chains(piece, &neighbours, wiring);
    let mut random = Random::new(seed, 4);
    let mut best: Option<Vec<Vec<usize>>> = None;
    for _ in 0..DRAWS {
        let drawn = draw(piece, &neighbours, wiring, &mut random);
        if best.as_ref().is_none_or(|best| drawn.len() < best.len()) {
            best = Some(drawn);
        }
        if best.as_ref().is_some_and(|best| best.len() <= bound) {
            break;
        }
    }
    let mut drawn = best.unwrap_or_default();
    redraw(&mut drawn, &neighbours, wiring, bound, &mut random);
    let mut chains: Vec<Chain> =
        drawn.into_iter().map(|members| chain(members, &neighbours, wiring)).collect();
    chains.sort_by_key(|chain| chain.modules.iter().min().copied());
    (chains, bound)
}

/// No wiring of a piece has fewer chains: they must hold all modules, and chains without branches have a step less than
/// modules, where each module is in at most two steps.
///
/// The steps are bounded by half of a maximal flow: two units leave each module and two arrive, one at most in each direction
/// between neighbours (the fractional 2-matching; `(schrijver2003)`, chapter 30).
fn least_chains(piece: &[usize], neighbours: &Neighbours, wiring: Wiring) -> usize {
    let by_length = piece.len().div_ceil(wiring.most);
    if wiring.has_branches {
        by_length
    } else {
        by_length.max(piece.len() - largest_flow(piece, neighbours) / 2)
    }
}

/// That flow, by paths along which it can grow.
fn largest_flow(piece: &[usize], neighbours: &Neighbours) -> usize {
    // Where the units come from that arrive at each module.
    let mut arrived = vec![Vec::<usize>::new(); neighbours.len()];
    // The search that reached a module, and from where: as one at which a unit arrives, and as one that sends another.
    let mut reached = vec![[0, 0]; neighbours.len()];
    let mut sends = reached.clone();
    let (mut search, mut flow) = (1, 0);
    for &start in piece.iter().chain(piece) {
        let mut open = vec![start];
        let end = 'search: loop {
            let Some(from) = open.pop() else { break None };
            for &(to, _) in &neighbours[from] {
                if reached[to][0] == search || arrived[to].contains(&from) {
                    continue;
                }
                reached[to] = [search, from];
                if arrived[to].len() < 2 {
                    break 'search Some(to);
                }
                for &other in &arrived[to] {
                    if sends[other][0] != search {
                        sends[other] = [search, to];
                        open.push(other);
                    }
                }
            }
        };
        // What a search without an end has reached stays without an end: only a path begins a new search.
        let Some(mut at) = end else { continue };
        loop {
            let from = reached[at][1];
            arrived[at].push(from);
            if from == start {
                break;
            }
            at = sends[from][1];
            arrived[at].retain(|&other| other != from);
        }
        (flow, search) = (flow + 1, search + 1);
    }
    flow
}

/// The steps that reach the modules in their order: from the one before, or, with branches, the first that is a neighbour.
fn chain(modules: Vec<usize>, neighbours: &Neighbours, wiring: Wiring) -> Chain {
    let step = |k: usize| {
        let from = if wiring.has_branches { 0 } else { k - 1 };
        modules[from..k].iter().find_map(|&m| {
            let (_, edges) = neighbours[m].iter().find(|(other, _)| *other == modules[k])?;
            Some(Step { modules: [m, modules[k]], edges: *edges })
        })
    };
    let steps = (1..modules.len()).filter_map(step).collect();
    Chain { modules, steps }
}

/// Draws a few chains that touch anew, the first a short one, until there are no more than `bound`. Of as many chains, more
/// different lengths are better: the short ones vanish.
fn redraw(
    chains: &mut Vec<Vec<usize>>,
    neighbours: &Neighbours,
    wiring: Wiring,
    bound: usize,
    random: &mut Random,
) {
    let worth = |of: &[Vec<usize>]| {
        (std::cmp::Reverse(of.len()), of.iter().map(|chain| chain.len().pow(2)).sum::<usize>())
    };
    let mut chain_of = vec![0; neighbours.len()];
    for _ in 0..REDRAWS {
        if chains.len() <= bound {
            break;
        }
        for (k, chain) in chains.iter().enumerate() {
            chain.iter().for_each(|&m| chain_of[m] = k);
        }
        let three = [(); 3].map(|()| random.below(chains.len()));
        let mut chosen: Vec<usize> = three.into_iter().min_by_key(|&k| chains[k].len()).into_iter().collect();
        while chosen.len() < REDRAWN {
            let members = chosen.iter().flat_map(|&k| &chains[k]);
            let around = members.flat_map(|&m| neighbours[m].iter().map(|(n, _)| chain_of[*n]));
            let mut around: Vec<usize> = around.filter(|k| !chosen.contains(k)).collect();
            around.sort_unstable();
            around.dedup();
            let Some(&next) = around.get(random.below(around.len())) else { break };
            chosen.push(next);
        }
        let before: Vec<Vec<usize>> = chosen.iter().map(|&k| chains[k].clone()).collect();
        let after = draw(&before.concat(), neighbours, wiring, random);
        if worth(&after) >= worth(&before) {
            chosen.sort_unstable();
            chosen.iter().rev().for_each(|&k| {
                chains.swap_remove(k);
            });
            chains.extend(after);
        }
    }
}

fn draw(piece: &[usize], neighbours: &Neighbours, wiring: Wiring, random: &mut Random) -> Vec<Vec<usize>> {
    let mut is_free = vec![false; neighbours.len()];
    piece.iter().for_each(|&m| is_free[m] = true);
    let mut left = piece.to_vec();
    let mut drawn = Vec::new();
    while !left.is_empty() {
        let degree = |m: usize, is_free: &[bool]| neighbours[m].iter().filter(|(n, _)| is_free[*n]).count();
        let mut pick = |among: &[usize], is_free: &[bool]| {
            let least = among.iter().map(|&m| degree(m, is_free)).min()?;
            let ties: Vec<usize> = among.iter().copied().filter(|&m| degree(m, is_free) == least).collect();
            Some(ties[random.below(ties.len())])
        };
        let Some(first) = pick(&left, &is_free) else { break };
        is_free[first] = false;
        let mut members = vec![first];
        // A chain grows at its end, then at its beginning; a tree anywhere.
        for at_end in [true, false] {
            while members.len() < wiring.most {
                let tip = if at_end { members.len() - 1 } else { 0 };
                let from = if wiring.has_branches { &members[..] } else { &members[tip..=tip] };
                let free = from.iter().flat_map(|&m| neighbours[m].iter().map(|(n, _)| *n));
                let mut free: Vec<usize> = free.filter(|&n| is_free[n]).collect();
                free.sort_unstable();
                free.dedup();
                let Some(next) = pick(&free, &is_free) else { break };
                is_free[next] = false;
                members.insert(if at_end { members.len() } else { 0 }, next);
            }
            if wiring.has_branches {
                break;
            }
        }
        left.retain(|&m| is_free[m]);
        drawn.push(members);
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ladder of 2 x 6: neighbours along and across.
    fn ladder() -> Vec<Joint> {
        let joint = |m, n| Joint { modules: [m, n], edges: [0, 0] };
        let along = (0..2).flat_map(|row| (0..5).map(move |k| joint(6 * row + k, 6 * row + k + 1)));
        along.chain((0..6).map(|k| joint(k, k + 6))).collect()
    }

    #[test]
    fn every_module_is_wired_once_across_shared_edges() {
        let joints = ladder();
        let piece: Vec<usize> = (0..12).collect();
        assert_eq!(pieces(12, &joints), vec![piece.clone()]);
        for (most, has_branches) in [(12, false), (4, false), (1, false), (5, true)] {
            let (chains, bound) = wire(&piece, &joints, 12, Wiring { most, has_branches }, 0);
            assert_eq!(bound, 12_usize.div_ceil(most));
            let mut all: Vec<usize> = chains.iter().flat_map(|chain| chain.modules.clone()).collect();
            all.sort_unstable();
            assert_eq!(all, piece);
            assert!(chains.len() <= bound + usize::from(most == 5), "{most}: {chains:?}");
            for chain in &chains {
                assert!(chain.modules.len() <= most && chain.steps.len() + 1 == chain.modules.len());
                for (k, step) in chain.steps.iter().enumerate() {
                    let [m, n] = step.modules;
                    assert_eq!(n, chain.modules[k + 1]);
                    assert!(chain.modules[..=k].contains(&m));
                    assert!(joints.iter().any(|j| j.modules == [m.min(n), m.max(n)]));
                }
            }
        }
    }

    /// A comb: every tooth ends a chain, so there are half as many chains as teeth, however long a chain may be.
    #[test]
    fn ends_of_a_graph_bound_its_chains() {
        let joint = |m, n| Joint { modules: [m, n], edges: [0, 0] };
        let joints: Vec<Joint> =
            (0..7).map(|k| joint(k, k + 1)).chain((0..8).map(|k| joint(k, k + 8))).collect();
        let piece: Vec<usize> = (0..16).collect();
        let wired = |has_branches: bool| wire(&piece, &joints, 16, Wiring { most: 100, has_branches }, 0);
        let (chains, bound) = wired(false);
        assert_eq!((chains.len(), bound), (4, 4));
        let (trees, bound) = wired(true);
        assert_eq!((trees.len(), bound), (1, 1));
    }
}
