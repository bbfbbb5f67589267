//! Which faces of a sheet can be seen: by face, and by parts of faces where only a part is seen.
//!
//! What lies in one cell of space, in one smooth region and on one side is judged at one point, of the largest face there; large
//! faces lie in several cells. Where faces that are connected smoothly differ, or cells of one face, each of them is judged by
//! itself, and those that are partly seen are divided, until the border between what is seen and what is not is known to 1/128
//! of the link.

use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use crate::id::FaceId;
use crate::mesh::triangle_cross;
use crate::numeric::DisjointSets;
use crate::remesh::SHARP;
use crate::remesh::divide::{Places, can_divide, divide};
use crate::remesh::faces::height;
use crate::remesh::sight::{Blockers, Sight, View, corners};
use crate::skin::Sheet;

/// Size of a cell, over that of the link: nothing that is smaller is looked for within a region. *Heuristic*: with 1/12 a third
/// fewer rays are traced, but the end of a post of 10 mm that is 5 mm deep in a block is kept.
const CELL: f64 = 1.0 / 16.0;

/// Parts of a region that are smaller than this share of the link across are taken as what is around them.
const ISLAND: f64 = 1.0 / 32.0;

/// Faces that are larger than this share of the link are divided where they are partly seen: 8 mm of a body of 1 m.
const FINEST: f64 = 1.0 / 128.0;

/// Rounds that halve a face as large as the link down to [`FINEST`], and some that follow its border.
const MAX_ROUNDS: usize = 24;

/// Parts of a face that is no larger than a cell are small enough if their area is at most this share of the square of the distance
/// of points. *Heuristic*: a narrow face of that size is viewed at one point, then. With a quarter, a hand of 27,000 faces of CAD
/// takes twice the rays, and a body of 125,000 a quarter more, of which 0.19 for 0.44 % of what can be seen is lost.
const SMALL: f64 = 1.0;

/// Most faces that a sheet is divided into.
const MAX_FACES: usize = 2_000_000;

/// A face lower than this share of its longest side is not judged: its normal is rounding noise.
const FLATTEST: f64 = 1e-5;

/// What is not seen, but from this share of the directions, is reported.
const MIN_GLIMPSE: f64 = 0.1;

/// A sheet with its faces judged.
pub(super) struct Judged {
    /// The sheet, divided where faces are partly seen.
    pub(super) sheet: Sheet,
    pub(super) is_kept: Vec<bool>,
    /// The face of the given sheet that each face is a part of.
    pub(super) origins: Vec<usize>,
    /// The area of what is left out although some directions see it, in m^2.
    pub(super) glimpsed: f64,
}

pub(super) fn judge(sight: &Sight, sheet: &Sheet) -> Judged {
    let mut faces = Faces::new(sight, sheet);
    let is_mixed = faces.judge_cells();
    faces.judge_borders(&is_mixed);
    faces.join_islands();
    faces.drop_flat();
    let of = |k: usize| (faces.views[k].free >= MIN_GLIMPSE).then(|| 0.5 * faces.crosses[k].length());
    let glimpsed = (0..faces.views.len()).filter(|&k| !faces.views[k].is_seen).filter_map(of).sum();
    let is_kept = faces.views.iter().map(|view| view.is_seen).collect();
    Judged { is_kept, origins: faces.origins, sheet: faces.sheet, glimpsed }
}

struct Faces<'a> {
    sight: &'a Sight,
    sheet: Sheet,
    places: Places,
    /// The face of the given sheet that each face is a part of.
    origins: Vec<usize>,
    crosses: Vec<DVec3>,
    /// The smooth region of each face.
    regions: Vec<usize>,
    views: Vec<View>,
    /// Whether each face was judged by itself.
    is_own: Vec<bool>,
    pairs: Vec<Pair>,
}

/// Two faces at an edge.
struct Pair {
    faces: [usize; 2],
    is_smooth: bool,
}

/// A point of a face, in a cell of space: the smooth region, the place and the side of its faces.
struct Sample {
    cell: (usize, [i64; 3], usize),
    /// Four times the square of that of the face.
    area: f64,
    face: usize,
    point: DVec3,
}

/// What a face has that cannot be judged.
const KEPT: View = View { is_seen: true, free: 1.0 };

impl<'a> Faces<'a> {
    fn new(sight: &'a Sight, sheet: &Sheet) -> Self {
        let (sheet, places) = (sheet.clone(), Places::new(sheet));
        let count = sheet.triangles.len();
        let mut faces = Self {
            sight,
            sheet,
            places,
            origins: (0..count).collect(),
            crosses: Vec::new(),
            regions: Vec::new(),
            views: vec![KEPT; count],
            is_own: vec![false; count],
            pairs: Vec::new(),
        };
        faces.connect();
        let mut sets = DisjointSets::<FaceId>::new(count);
        for pair in faces.pairs.iter().filter(|pair| pair.is_smooth) {
            let [a, b] = pair.faces.map(FaceId::new);
            sets.join(a, b);
        }
        faces.regions = sets.labels().of.into_iter().collect();
        faces
    }

    fn corners(&self, face: usize) -> Option<[DVec3; 3]> {
        corners(&self.sheet, &self.sheet.triangles[face])
    }

    /// Finds normals and neighbours.
    fn connect(&mut self) {
        self.crosses = (0..self.sheet.triangles.len()).map(|face| self.cross(face)).collect();
        self.pairs = self.pairs_of(0..self.crosses.len());
    }

    /// Finds the normals and the neighbours of faces that were divided; `parents` are those that each face is a part of.
    fn reconnect(&mut self, parents: &[usize]) {
        let (mut first, mut parts) = (vec![0; self.crosses.len()], vec![0_usize; self.crosses.len()]);
        for (face, &parent) in parents.iter().enumerate().rev() {
            (first[parent], parts[parent]) = (face, parts[parent] + 1);
        }
        let is_divided: Vec<bool> = parents.iter().map(|&parent| parts[parent] > 1).collect();
        let cross = |(face, &parent)| if is_divided[face] { self.cross(face) } else { self.crosses[parent] };
        self.crosses = parents.iter().enumerate().map(cross).collect();
        let mut is_beside = vec![false; parents.len()];
        let mut pairs = std::mem::take(&mut self.pairs);
        pairs.retain_mut(|pair| {
            let is_same = pair.faces.map(|face| parts[face] == 1);
            pair.faces = pair.faces.map(|face| first[face]);
            pair.faces.iter().for_each(|&face| is_beside[face] = is_beside[face] || is_same != [true; 2]);
            is_same == [true; 2]
        });
        let changed = (0..parents.len()).filter(|&face| is_divided[face] || is_beside[face]);
        let is_new = |pair: &Pair| pair.faces.iter().any(|&face| is_divided[face]);
        pairs.extend(self.pairs_of(changed).into_iter().filter(is_new));
        self.pairs = pairs;
    }

    /// The normal of a face, zero if it cannot be judged.
    fn cross(&self, face: usize) -> DVec3 {
        match self.corners(face) {
            Some(at) if height(at) > FLATTEST * longest(at) => triangle_cross(at),
            _ => DVec3::ZERO,
        }
    }

    /// Pairs of some faces at their common edges.
    fn pairs_of(&self, faces: impl Iterator<Item = usize>) -> Vec<Pair> {
        let mut sides = Vec::new();
        for face in faces {
            let [a, b, c] = self.sheet.triangles[face];
            sides.extend([(a, b), (b, c), (c, a)].map(|(p, q)| {
                let (p, q) = self.places.edge(p, q);
                ((u64::from(p) << 32) | u64::from(q), face)
            }));
        }
        sides.sort_unstable();
        let pairs = sides.windows(2).filter(|pair| pair[0].0 == pair[1].0 && pair[0].1 != pair[1].1);
        let of = |pair: &[(u64, usize)]| {
            let faces = [pair[0].1, pair[1].1];
            let [n, m] = faces.map(|face| self.crosses[face].normalize_or_zero());
            let is_smooth = n == DVec3::ZERO || m == DVec3::ZERO || n.dot(m).abs() >= SHARP;
            Pair { faces, is_smooth }
        };
        pairs.map(of).collect()
    }

    /// Whether a face has corners and a normal.
    fn is_judged(&self, face: usize) -> bool {
        self.crosses[face] != DVec3::ZERO
    }

    /// Judges what lies in one cell of space, in one smooth region and on one side by a point of the largest face there. Returns
    /// whether some cells of a face are seen and others not.
    fn judge_cells(&mut self) -> Vec<bool> {
        let cell = CELL * self.sight.size;
        let mut samples: Vec<Sample> = Vec::new();
        for face in (0..self.crosses.len()).filter(|&face| self.is_judged(face)) {
            let Some(at) = self.corners(face) else { continue };
            let (area, normal) = (self.crosses[face].length_squared(), self.crosses[face].normalize());
            let axis = normal.abs().max_position();
            let side = 2 * axis + usize::from(normal[axis] < 0.0);
            let mut points = Vec::new();
            add_points(at, Spread { apart: cell, small: 0.0 }, &mut points);
            // A link has some thousands of cells.
            #[expect(clippy::cast_possible_truncation, reason = "only points of one cell are compared")]
            let place = |point: DVec3| (point / cell).to_array().map(|x| x.floor() as i64);
            let region = self.regions[face];
            samples.extend(points.into_iter().map(|point| Sample {
                cell: (region, place(point), side),
                area,
                face,
                point,
            }));
        }
        // Stable: of the points of a face in one cell the first is judged.
        samples.sort_by(|a, b| a.cell.cmp(&b.cell).then(b.area.total_cmp(&a.area)).then(a.face.cmp(&b.face)));
        let cells: Vec<&[Sample]> = samples.chunk_by(|a, b| a.cell == b.cell).collect();
        let view = |blockers: &mut Blockers, samples: &&[Sample]| {
            self.sight.view(samples[0].point, self.crosses[samples[0].face].normalize(), blockers)
        };
        let views: Vec<View> = cells.par_iter().map_init(Blockers::default, view).collect();
        let mut counts = vec![[0_usize; 2]; self.views.len()];
        let mut free = vec![0.0; self.views.len()];
        for (view, sample) in
            views.iter().zip(&cells).flat_map(|(view, cell)| cell.iter().map(move |s| (view, s)))
        {
            counts[sample.face][usize::from(view.is_seen)] += 1;
            free[sample.face] += view.free;
        }
        for (face, &[hidden, seen]) in
            counts.iter().enumerate().filter(|(_, counts)| counts.iter().any(|&n| n > 0))
        {
            self.views[face] = View { is_seen: seen >= hidden, free: free[face] / (hidden + seen) as f64 };
        }
        counts.iter().map(|counts| !counts.contains(&0)).collect()
    }

    /// How a face is seen at points of this spread, and whether some of them are seen and others not; where
    /// it is divided then, no more points are viewed.
    fn own_view(
        &self,
        face: usize,
        spread: Spread,
        is_divided: bool,
        blockers: &mut Blockers,
    ) -> (View, bool) {
        let Some(at) = self.corners(face) else { return (KEPT, false) };
        let normal = self.crosses[face].normalize();
        let mut points = Vec::new();
        add_points(at, spread, &mut points);
        let (mut seen, mut tried, mut free) = (0, 0, 0.0);
        for &point in &points {
            let view = self.sight.view(point, normal, blockers);
            (seen, tried, free) = (seen + usize::from(view.is_seen), tried + 1, free + view.free);
            if is_divided && seen > 0 && seen < tried {
                break;
            }
        }
        (View { is_seen: 2 * seen >= tried, free: free / tried as f64 }, seen > 0 && seen < tried)
    }

    /// Judges large faces that are partly seen, and those at borders, by themselves, and divides what is partly seen.
    fn judge_borders(&mut self, is_mixed: &[bool]) {
        let (cell, finest) = (CELL * self.sight.size, FINEST * self.sight.size);
        let is_whole = !can_divide(&self.sheet);
        let mixed = (0..is_mixed.len()).filter(|&face| is_mixed[face]).collect();
        let mut fresh = self.fresh(mixed);
        for round in 0..MAX_ROUNDS {
            if fresh.is_empty() {
                break;
            }
            let can_divide = !is_whole && round + 1 < MAX_ROUNDS && self.views.len() < MAX_FACES;
            let judged: Vec<(View, bool)> = fresh
                .par_iter()
                .map_init(Blockers::default, |blockers, &(face, may_be_divided)| {
                    let size = self.size(face);
                    let spread = if !may_be_divided || size <= finest {
                        Spread { apart: f64::INFINITY, small: 0.0 }
                    } else if size > cell {
                        Spread { apart: cell, small: 0.0 }
                    } else {
                        Spread { apart: 0.5 * size, small: SMALL * (0.5 * size).powi(2) }
                    };
                    self.own_view(face, spread, can_divide, blockers)
                })
                .collect();
            let mut is_mixed = vec![false; self.views.len()];
            for (&(face, _), (view, mixed)) in fresh.iter().zip(judged) {
                (self.views[face], self.is_own[face]) = (view, true);
                is_mixed[face] = mixed;
            }
            let mut parts = Vec::new();
            if can_divide && is_mixed.contains(&true) {
                let parents = divide(&mut self.sheet, &mut self.places, &is_mixed);
                self.origins = parents.iter().map(|&face| self.origins[face]).collect();
                self.regions = parents.iter().map(|&face| self.regions[face]).collect();
                self.views = parents.iter().map(|&face| self.views[face]).collect();
                self.is_own = parents.iter().map(|&face| self.is_own[face] && !is_mixed[face]).collect();
                self.reconnect(&parents);
                parts = (0..parents.len()).filter(|&k| is_mixed[parents[k]] && self.is_judged(k)).collect();
            }
            fresh = self.fresh(parts);
        }
    }

    /// The longest side of a face.
    fn size(&self, face: usize) -> f64 {
        self.corners(face).map_or(0.0, longest)
    }

    /// The faces to judge next, each with whether it may be divided: `parts`, and faces at borders, of which the small ones
    /// of the file are judged in their middle, and stay.
    fn fresh(&self, parts: Vec<usize>) -> Vec<(usize, bool)> {
        let cell = CELL * self.sight.size;
        // How these are seen is not known yet.
        let mut is_waiting = vec![false; self.views.len()];
        parts.iter().for_each(|&face| is_waiting[face] = true);
        let differ = |pair: &&Pair| {
            let [a, b] = pair.faces;
            let are_known = !is_waiting[a] && !is_waiting[b];
            pair.is_smooth && are_known && self.views[a].is_seen != self.views[b].is_seen
        };
        let at_border = self.pairs.iter().filter(differ).flat_map(|pair| pair.faces);
        let is_open = |face: &usize| !self.is_own[*face] && self.is_judged(*face);
        let by_size = |face: usize| (face, self.size(face) > 0.5 * cell);
        let parts = parts.into_iter().map(|face| (face, true));
        let mut fresh: Vec<_> = at_border.filter(is_open).map(by_size).chain(parts).collect();
        // Of a face that is there twice, the one that may be divided stays.
        fresh.sort_unstable_by(|a, b| b.cmp(a));
        fresh.dedup_by_key(|(face, _)| *face);
        fresh
    }

    /// Takes small islands of a region as what is around them: parts that are not seen, and seen ones that touch nothing seen.
    fn join_islands(&mut self) {
        let least = (ISLAND * self.sight.size).powi(2);
        let mut sets = DisjointSets::<FaceId>::new(self.views.len());
        for pair in self.pairs.iter().filter(|pair| pair.is_smooth) {
            let [a, b] = pair.faces;
            if self.views[a].is_seen == self.views[b].is_seen {
                sets.join(FaceId::new(a), FaceId::new(b));
            }
        }
        let labels = sets.labels();
        let island = |face: usize| labels.of[FaceId::new(face)];
        let (mut areas, mut of_region) = (vec![0.0; labels.count], HashMap::new());
        let mut touches = vec![false; labels.count];
        for (face, cross) in self.crosses.iter().enumerate() {
            areas[island(face)] += 0.5 * cross.length();
            *of_region.entry(self.regions[face]).or_insert(0.0) += 0.5 * cross.length();
        }
        for pair in &self.pairs {
            let [a, b] = pair.faces.map(island);
            if a != b && pair.faces.iter().all(|&face| self.views[face].is_seen) {
                (touches[a], touches[b]) = (true, true);
            }
        }
        for face in 0..self.views.len() {
            let (island, whole) = (island(face), of_region[&self.regions[face]]);
            let is_part = areas[island] < least.min(0.5 * whole);
            if is_part && self.is_judged(face) && !(self.views[face].is_seen && touches[island]) {
                self.views[face].is_seen = !self.views[face].is_seen;
            }
        }
    }

    /// Drops faces without area, unless two kept faces are connected across them.
    fn drop_flat(&mut self) {
        let mut around = vec![Vec::new(); self.views.len()];
        for pair in &self.pairs {
            let [a, b] = pair.faces;
            around[a].push(b);
            around[b].push(a);
        }
        let is_loose = |views: &[View], face: usize| {
            views[face].is_seen
                && around[face].iter().filter(|&&other| views[other].is_seen).count() < 2
                && around[face].iter().any(|&other| !views[other].is_seen)
        };
        let flat = |face: &usize| !self.is_judged(*face) && self.corners(*face).is_some();
        let mut open: Vec<usize> = (0..self.views.len()).filter(flat).collect();
        let is_flat = open.clone();
        while let Some(face) = open.pop() {
            if is_loose(&self.views, face) {
                self.views[face] = View { is_seen: false, free: 0.0 };
                open.extend(around[face].iter().filter(|other| is_flat.binary_search(other).is_ok()));
            }
        }
    }
}

fn longest([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance(b).max(b.distance(c)).max(c.distance(a))
}

/// How near to each other points of a face are.
#[derive(Debug, Clone, Copy)]
struct Spread {
    /// Parts with no longer side have one point, in m.
    apart: f64,
    /// Parts of at most this area have one point, too, however long they are, in m^2.
    small: f64,
}

/// The middles of the parts of a triangle that is halved until each has one point.
fn add_points(at: [DVec3; 3], spread: Spread, points: &mut Vec<DVec3>) {
    let length = |k: usize| at[k].distance(at[(k + 1) % 3]);
    let side = (1..3).fold(0, |best, k| if length(k) > length(best) { k } else { best });
    if length(side) <= spread.apart || 0.5 * triangle_cross(at).length() <= spread.small {
        points.push((at[0] + at[1] + at[2]) / 3.0);
        return;
    }
    let [a, b, c] = [0, 1, 2].map(|k| at[(side + k) % 3]);
    let middle = a.midpoint(b);
    add_points([a, middle, c], spread, points);
    add_points([middle, b, c], spread, points);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Also where a face stands twice, so that its edges have three.
    #[test]
    fn neighbours_of_divided_faces_are_those_found_anew() {
        let ball = shapes::ball(2, 1.0);
        let mut triangles: Vec<[u32; 3]> = ball.triangles.iter().map(|t| t.map(|v| v.raw())).collect();
        triangles.push(triangles[6]);
        let sheet = Sheet { positions: ball.positions.as_slice().to_vec(), triangles, ..Sheet::default() };
        let sight = Sight::new(std::iter::once(&sheet)).unwrap();
        let mut faces = Faces::new(&sight, &sheet);
        let known = |faces: &Faces<'_>| {
            let mut pairs: Vec<_> = faces.pairs.iter().map(|pair| (pair.faces, pair.is_smooth)).collect();
            pairs.sort_unstable();
            (pairs, faces.crosses.clone())
        };
        for step in [2, 3, 5, 7] {
            let is_divided: Vec<bool> = (0..faces.crosses.len()).map(|face| face % step == 0).collect();
            let parents = divide(&mut faces.sheet, &mut faces.places, &is_divided);
            faces.reconnect(&parents);
            let found = known(&faces);
            faces.connect();
            assert!(found == known(&faces), "every {step}. face is divided");
        }
    }
}
