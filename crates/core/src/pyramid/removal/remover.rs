//! Removes the vertices of a level that are not kept, in rounds of independent stars. A vertex along a seam
//! has two, one on each side, which are filled separately and removed together.

use glam::DVec3;
use rayon::prelude::*;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, HalfedgeMesh, diagonals, triangle_cross};
use crate::pyramid::removal::queue::Queue;
use crate::pyramid::removal::retriangulation::Filler;
use crate::pyramid::removal::seam::{SeamRole, SeamedLevel};
use crate::pyramid::removal::star::{Limits, Star, folds_over, small};
use crate::pyramid::removal::taxel_locations::{Move, TaxelLocations};
use crate::pyramid::{Removal, RemovalLog};
use crate::run::{Cancelled, Run};

/// Most stars planned by one task: enough to reuse buffers. The result does not depend on it.
const MAX_STARS_PER_TASK: usize = 256;

/// Number of tasks in a round with few stars: on a coarse level each star has many taxels.
const TASKS: usize = 32;

/// First a filling may turn by 60 degrees from the star it replaces, and a boundary may lose a
/// vertex where it turns by less than about 70 degrees (the corner of a hexagonal hole lies 0.29
/// edges from the edge that cuts it off). No new face has an angle below 3 degrees.
const STRICT: Limits = Limits { min_cos_turn: 0.5, max_sagitta: 0.35, min_squared_sine: 2.7e-3 };

/// The remaining vertices (at sharp folds, in the last rows between kept vertices) may turn it by 78 degrees:
/// a level that kept them as fields would be uneven, and folds begin at 90. Angles may be 0.6 degrees small.
const LENIENT: Limits = Limits { min_cos_turn: 0.2, max_sagitta: 0.35, min_squared_sine: 1e-4 };

/// Turns one level into the next coarser one.
pub(crate) struct Remover<'a> {
    pub(crate) mesh: &'a mut HalfedgeMesh,
    pub(crate) locations: &'a mut TaxelLocations,
    pub(crate) positions: &'a IdVec<VertexId, DVec3>,
    /// The taxel of each vertex.
    pub(crate) origins: &'a IdVec<VertexId, VertexId>,
    /// The seam along which the level is cut for its map.
    pub(crate) seam: Option<&'a mut SeamedLevel>,
}

impl Remover<'_> {
    /// Removes every vertex that is not `kept`, if the rules allow it; `order` decides between neighbours.
    ///
    /// Works in rounds: vertices of which no two are neighbours, so that their stars share no
    /// triangle, are planned in parallel and applied in order.
    pub(crate) fn remove(
        mut self,
        kept: &IdVec<VertexId, bool>,
        order: &[VertexId],
        run: Run<'_>,
    ) -> Result<RemovalLog, Cancelled> {
        let mut log = RemovalLog::with_capacity(kept.iter().filter(|kept| !**kept).count());
        let mut queue = Queue::new(kept, order);
        // The round in which each face became part of a filling.
        let mut filled = IdVec::filled(0, self.mesh.face_count());
        for limits in [STRICT, LENIENT] {
            queue.wake_all();
            loop {
                run.step()?;
                let chosen = queue.independent(self.mesh);
                if chosen.is_empty() {
                    break;
                }
                let stars_per_task = chosen.len().div_ceil(TASKS).min(MAX_STARS_PER_TASK);
                let plans: Vec<Plans> =
                    chosen.par_chunks(stars_per_task).map(|part| self.plan(part, &limits)).collect();
                for plans in &plans {
                    plans.refused.iter().for_each(|&v| queue.park(v));
                    for plan in plans.iter() {
                        if !self.still_fits(&plan, &queue, &filled) {
                            continue;
                        }
                        plan.star.iter().for_each(|h| filled[h.face()] = queue.round);
                        self.apply(&plan);
                        queue.removed(plan.removal.vertex, plan.removal.ring);
                        log.push(&plan.removal);
                    }
                }
            }
        }
        Ok(log)
    }

    /// Plans the removal of each of `vertices`; the mesh does not change meanwhile.
    fn plan(&self, vertices: &[VertexId], limits: &Limits) -> Plans {
        let (mut star, mut filler, mut plans) = (Star::default(), Filler::default(), Plans::default());
        let mut pair = Pair::default();
        for &v in vertices {
            if let Some(seam) = self.seam.as_deref().filter(|seam| seam.roles[v] == SeamRole::Along) {
                if !self.plan_pair(v, seam, limits, &mut pair, &mut filler, &mut plans) {
                    plans.refused.push(v);
                }
                continue;
            }
            let fits =
                star.gather(self.mesh, self.positions, v, limits) && filler.fill(&star, self.mesh, limits);
            if !fits {
                plans.refused.push(v);
                continue;
            }
            let triangles = &filler.triangles;
            plans.log.push(&Removal { vertex: v, ring: &star.ring, boundary: !star.closed, triangles });
            plans.stars.extend_from_slice(&star.halfedges);
            self.locations.plan(&star, self.origins[v], triangles, &mut plans.moves);
            plans.ends.push((plans.stars.len(), plans.moves.len()));
        }
        plans
    }

    /// Plans the removal of a vertex along the seam: its star is filled on both sides of the new edge of the
    /// seam. `false` if that is not possible.
    fn plan_pair(
        &self,
        v: VertexId,
        seam: &SeamedLevel,
        limits: &Limits,
        Pair { whole, half, filling, moves }: &mut Pair,
        filler: &mut Filler,
        plans: &mut Plans,
    ) -> bool {
        if !whole.gather_ring(self.mesh, v) {
            return false;
        }
        let Some([first, second]) = seam.crossings(&whole.halfedges) else { return false };
        whole.ring.rotate_left(first);
        whole.halfedges.rotate_left(first);
        let (count, middle) = (whole.ring.len(), second - first);
        let sides = &whole.halfedges;
        // An edge between two ends of the seam would not be open: it would be one edge of the cut mesh too.
        if seam.ends_at(sides[0], sides[count - 1]) && seam.ends_at(sides[middle], sides[middle - 1]) {
            return false;
        }
        filling.clear();
        moves.clear();
        for (part, centre) in [(0..middle, Some(self.origins[v])), (middle..count, None)] {
            let start = part.start;
            if !half.gather_part(whole, part, self.mesh, self.positions, (v, limits)) {
                return false;
            }
            if centre.is_none() {
                // The other side's triangle at the new edge, which runs from its last corner to its
                // first.
                let closing = filling.iter().find(|t| t[0] == 0 && usize::from(t[2]) == middle);
                half.look_across(closing, whole, self.positions);
            }
            if !filler.fill(half, self.mesh, limits) {
                return false;
            }
            let before = moves.len();
            match centre {
                Some(centre) => self.locations.plan(half, centre, &filler.triangles, moves),
                None => self.locations.plan_inside(half, &filler.triangles, moves),
            }
            let offset = filling.len();
            for &t in &filler.triangles {
                let [i, k, j] = t.map(|p| (start + usize::from(p)) % count);
                // Ascending again where the last corner is the ring's first.
                filling.push(if j == 0 { [j, i, k] } else { [i, k, j] }.map(small));
            }
            for step in &mut moves[before..] {
                step.triangle += small(offset);
                if filling[usize::from(step.triangle)][0] == 0 && start > 0 {
                    step.weights.rotate_right(1);
                }
            }
        }
        plans.log.push(&Removal { vertex: v, ring: &whole.ring, boundary: false, triangles: filling });
        plans.stars.extend_from_slice(&whole.halfedges);
        plans.moves.append(moves);
        plans.ends.push((plans.stars.len(), plans.moves.len()));
        true
    }

    /// Whether no plan applied in this round forbids this one, by using one of its edges or by folding over
    /// it. If one does, the vertex waits for the next round.
    fn still_fits(&self, plan: &Plan<'_>, queue: &Queue, filled: &IdVec<FaceId, u32>) -> bool {
        let Removal { ring, boundary, triangles, .. } = plan.removal;
        let last = ring.len() - 1;
        let exists = |[i, j]: [usize; 2]| {
            let [a, b] = [ring[i], ring[j]];
            queue.has_changed(a) && queue.has_changed(b) && self.mesh.has_edge(a, b)
        };
        let is_taken = diagonals(triangles, ring.len()).any(exists) || boundary && exists([0, last]);
        !is_taken && !self.folds(plan, |face| filled[face] == queue.round)
    }

    /// Whether the filling folds over a face beyond the ring that `is_new` since the filling was
    /// planned.
    fn folds(&self, plan: &Plan<'_>, is_new: impl Fn(FaceId) -> bool) -> bool {
        let Removal { ring, triangles, .. } = plan.removal;
        let last = ring.len() - 1;
        plan.star.iter().enumerate().any(|(i, h)| {
            let twin = self.mesh.twin(h.next());
            if twin == Halfedge::NONE || !is_new(twin.face()) {
                return false;
            }
            let beyond = self.mesh.face_cross(twin.face(), self.positions);
            let has_side = |t: &&[u8; 3]| {
                let [a, b, c] = t.map(usize::from);
                (a, b) == (i, i + 1) || (b, c) == (i, i + 1) || (c, a) == (i, 0) && i == last
            };
            triangles.iter().find(has_side).is_some_and(|t| {
                folds_over(triangle_cross(t.map(|i| self.positions[ring[usize::from(i)]])), beyond)
            })
        })
    }

    fn apply(&mut self, plan: &Plan<'_>) {
        let Removal { vertex, ring, triangles, .. } = plan.removal;
        if let Some(seam) = &mut self.seam {
            seam.apply(&plan.removal, plan.star);
        }
        self.mesh.replace_star(vertex, ring, plan.star, triangles);
        self.locations.carry(plan.star, plan.moves);
    }
}

/// Buffers for the star of a vertex along the seam.
#[derive(Debug, Default)]
struct Pair {
    whole: Star,
    /// One side of it.
    half: Star,
    filling: Vec<[u8; 3]>,
    moves: Vec<Move>,
}

struct Plan<'a> {
    removal: Removal<'a>,
    star: &'a [Halfedge],
    moves: &'a [Move],
}

/// The plans of one task, one after the other in shared arrays.
#[derive(Debug, Default)]
struct Plans {
    refused: Vec<VertexId>,
    log: RemovalLog,
    stars: Vec<Halfedge>,
    moves: Vec<Move>,
    /// The end of each plan in `stars` and in `moves`.
    ends: Vec<(usize, usize)>,
}

impl Plans {
    fn iter(&self) -> impl Iterator<Item = Plan<'_>> {
        let starts = std::iter::once((0, 0)).chain(self.ends.iter().copied());
        self.log.iter().zip(starts.zip(&self.ends)).map(|(removal, (from, to))| Plan {
            removal,
            star: &self.stars[from.0..to.0],
            moves: &self.moves[from.1..to.1],
        })
    }
}
