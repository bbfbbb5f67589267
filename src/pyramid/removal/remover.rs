use glam::DVec3;
use rayon::prelude::*;

use crate::{
    id::{FaceId, IdVec, VertexId},
    pyramid::{
        Removal, RemovalLog,
        removal::{
            queue::Queue,
            retriangulation::{Filler, diagonals},
            star::{Limits, Star},
            taxel_locations::{Move, TaxelLocations},
        },
        surface::{NEXT, Side, Surface},
    },
};

/// Most stars planned by one task: enough to reuse buffers. The result does not depend on it.
const MAX_STARS_PER_TASK: usize = 256;

/// Tasks of a round that has fewer stars: few stars of a coarse level carry many taxels each.
const TASKS: usize = 32;

/// First a filling may turn by 60 degrees from the star it replaces, and a boundary may lose a vertex where it turns
/// by less than about 70 degrees (the corner of a hexagonal hole lies 0.29 edges from the edge that cuts it off).
const STRICT: Limits = Limits { min_cos_turn: 0.5, max_sagitta: 0.35 };

/// What is left then (sharp folds, the last rows between kept vertices) may turn by 78 degrees: a level that kept
/// them as fields would be uneven, and folds begin at 90.
const LENIENT: Limits = Limits { min_cos_turn: 0.2, max_sagitta: 0.35 };

/// Turns one level into the next coarser one.
pub(in crate::pyramid) struct Remover<'a> {
    pub(in crate::pyramid) surface: &'a mut Surface,
    pub(in crate::pyramid) places: &'a mut TaxelLocations,
    pub(in crate::pyramid) positions: &'a IdVec<VertexId, DVec3>,
    /// The taxel that each vertex is.
    pub(in crate::pyramid) origins: &'a IdVec<VertexId, VertexId>,
}

impl Remover<'_> {
    /// Removes every vertex that is not `kept`, where the rules allow it; `order` decides between neighbours.
    ///
    /// Works in rounds: vertices of which no two are neighbours, so that their stars share no triangle, are planned in
    /// parallel and applied in order.
    pub(in crate::pyramid) fn remove(
        &mut self,
        kept: &IdVec<VertexId, bool>,
        order: &[VertexId],
    ) -> RemovalLog {
        let mut log = RemovalLog::default();
        let mut queue = Queue::new(kept, order);
        // The round in which each face became part of a filling.
        let mut filled = IdVec::filled(0, self.surface.faces.len());
        for limits in [STRICT, LENIENT] {
            queue.wake_all();
            loop {
                let chosen = queue.independent(self.surface);
                if chosen.is_empty() {
                    break;
                }
                let stars_per_task = chosen.len().div_ceil(TASKS).min(MAX_STARS_PER_TASK);
                let plans: Vec<Plans> =
                    chosen.par_chunks(stars_per_task).map(|part| self.plan(part, &limits)).collect();
                for plan in &plans {
                    for &v in &plan.refused {
                        queue.park(v);
                    }
                    self.apply(plan, &mut queue, &mut filled, &mut log);
                }
            }
        }
        log
    }

    /// Plans the removal of each of `vertices`, on a surface that rests.
    fn plan(&self, vertices: &[VertexId], limits: &Limits) -> Plans {
        let (mut star, mut filler, mut plans) = (Star::default(), Filler::default(), Plans::default());
        for &v in vertices {
            let fits = star.gather(self.surface, self.positions, v, limits)
                && filler.fill(&star, self.surface, limits);
            if !fits {
                plans.refused.push(v);
                continue;
            }
            let triangles = &filler.triangles;
            plans.log.push(&Removal { vertex: v, ring: &star.ring, boundary: !star.closed, triangles });
            plans.sides.extend_from_slice(&star.sides);
            self.places.plan(&star, self.origins[v], triangles, &mut plans.moves);
            plans.move_ends.push(plans.moves.len());
        }
        plans
    }

    /// Carries out what was planned, first come first served: where another star of the same round has taken a
    /// diagonal or folds over this one now, the vertex waits for the next round.
    fn apply(
        &mut self,
        plans: &Plans,
        queue: &mut Queue<'_>,
        filled: &mut IdVec<FaceId, u32>,
        log: &mut RemovalLog,
    ) {
        let (mut sides, mut moves_start) = (plans.sides.as_slice(), 0);
        for (removal, &moves_end) in plans.log.iter().zip(&plans.move_ends) {
            let (star, rest) = sides.split_at(removal.ring.len() - usize::from(removal.boundary));
            sides = rest;
            let moves = &plans.moves[moves_start..moves_end];
            moves_start = moves_end;
            let last = removal.ring.len() - 1;
            let exists = |[i, j]: [usize; 2]| self.surface.has_edge(removal.ring[i], removal.ring[j]);
            let taken = diagonals(removal.triangles, removal.ring.len()).any(exists)
                || removal.boundary && exists([0, last]);
            let is_new = |face: FaceId| filled[face] == queue.round();
            if taken || self.folds(&removal, star, is_new) {
                continue;
            }
            self.surface.refill(&removal, star);
            for side in star {
                filled[side.face()] = queue.round();
            }
            self.places.carry(star, moves);
            queue.removed(removal.vertex, removal.ring);
            log.push(&removal);
        }
    }

    /// Whether the filling folds over a face beyond the ring that `is_new` since the filling was planned.
    fn folds(&self, removal: &Removal<'_>, star: &[Side], is_new: impl Fn(FaceId) -> bool) -> bool {
        let last = removal.ring.len() - 1;
        star.iter().enumerate().any(|(i, side)| {
            let twin = self.surface.faces[side.face()].twins[NEXT[side.k()]];
            if twin == Side::NONE || !is_new(twin.face()) {
                return false;
            }
            let beyond = self.surface.face_cross(twin.face(), self.positions);
            let has_side = |t: &&[u8; 3]| {
                let [a, b, c] = t.map(usize::from);
                (a, b) == (i, i + 1) || (b, c) == (i, i + 1) || (c, a) == (i, 0) && i == last
            };
            removal.triangles.iter().find(has_side).is_some_and(|t| {
                let [a, b, c] = t.map(|i| self.positions[removal.ring[usize::from(i)]]);
                (b - a).cross(c - a).dot(beyond) < 0.0
            })
        })
    }
}

/// The plans of one task.
#[derive(Debug, Default)]
struct Plans {
    refused: Vec<VertexId>,
    log: RemovalLog,
    /// The star's sides that leave each removed vertex, one removal after the other.
    sides: Vec<Side>,
    moves: Vec<Move>,
    move_ends: Vec<usize>,
}
