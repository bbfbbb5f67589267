//! Which faces of a sheet can be seen: by face, and by parts of faces where only a part is seen.
//!
//! Small faces that lie in one cell of space, in one smooth region and on one side are judged by the largest of them, large ones at
//! points as far apart. Where faces that are connected smoothly differ, each of them is judged by itself, and those that are
//! partly seen are divided, until the border between what is seen and what is not is known to 1/128 of the link.

use std::collections::{BTreeMap, HashMap};

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

/// Size of a cell, over that of the link: nothing that is smaller is looked for within a region.
const CELL: f64 = 1.0 / 16.0;

/// Faces that are larger than this share of the link are divided where they are partly seen: 8 mm of a body of 1 m.
const FINEST: f64 = 1.0 / 128.0;

/// Rounds that halve a face as large as the link down to [`FINEST`], and some that follow its border.
const MAX_ROUNDS: usize = 24;

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
    /// The area of what is left out although some directions see it, in m^2.
    pub(super) glimpsed: f64,
}

pub(super) fn judge(sight: &Sight, sheet: &Sheet) -> Judged {
    let mut faces = Faces::new(sight, sheet);
    faces.judge_cells();
    faces.judge_borders();
    faces.join_islands();
    faces.drop_flat();
    let of = |k: usize| (faces.views[k].free >= MIN_GLIMPSE).then(|| 0.5 * faces.crosses[k].length());
    let glimpsed = (0..faces.views.len()).filter(|&k| !faces.views[k].is_seen).filter_map(of).sum();
    Judged { is_kept: faces.views.iter().map(|view| view.is_seen).collect(), sheet: faces.sheet, glimpsed }
}

struct Faces<'a> {
    sight: &'a Sight,
    sheet: Sheet,
    places: Places,
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
        let cross = |t: &[u32; 3]| match corners(&self.sheet, t) {
            Some(at) if height(at) > FLATTEST * longest(at) => triangle_cross(at),
            _ => DVec3::ZERO,
        };
        self.crosses = self.sheet.triangles.iter().map(cross).collect();
        let mut sides = Vec::with_capacity(3 * self.crosses.len());
        for (face, &[a, b, c]) in self.sheet.triangles.iter().enumerate() {
            sides.extend([(a, b), (b, c), (c, a)].map(|(p, q)| (self.places.edge(p, q), face)));
        }
        sides.sort_unstable();
        let pairs = sides.windows(2).filter(|pair| pair[0].0 == pair[1].0 && pair[0].1 != pair[1].1);
        let of = |pair: &[((u32, u32), usize)]| {
            let faces = [pair[0].1, pair[1].1];
            let [n, m] = faces.map(|face| self.crosses[face].normalize_or_zero());
            let is_smooth = n == DVec3::ZERO || m == DVec3::ZERO || n.dot(m).abs() >= SHARP;
            Pair { faces, is_smooth }
        };
        self.pairs = pairs.map(of).collect();
    }

    /// Whether a face has corners and a normal.
    fn is_judged(&self, face: usize) -> bool {
        self.crosses[face] != DVec3::ZERO
    }

    /// Judges small faces by the largest in their cell, and large ones by themselves.
    fn judge_cells(&mut self) {
        let cell = CELL * self.sight.size;
        let mut cells: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        for face in (0..self.crosses.len()).filter(|&face| self.is_judged(face)) {
            let Some(at) = self.corners(face) else { continue };
            let (middle, normal) = ((at[0] + at[1] + at[2]) / (3.0 * cell), self.crosses[face].normalize());
            let side = normal.abs().max_position();
            let key = if longest(at) < cell {
                // A link has some thousands of cells.
                #[expect(clippy::cast_possible_truncation, reason = "only faces of one cell are compared")]
                let place = middle.to_array().map(|x| x.floor() as i64);
                (self.regions[face], place, 2 * side + usize::from(normal[side] < 0.0), 0)
            } else {
                (self.regions[face], [0; 3], 0, face + 1)
            };
            cells.entry(key).or_default().push(face);
        }
        let cells: Vec<Vec<usize>> = cells.into_values().collect();
        let largest = |cell: &Vec<usize>, blockers: &mut Blockers| {
            let by_area = |&&f: &&usize, &&g: &&usize| {
                self.crosses[f].length_squared().total_cmp(&self.crosses[g].length_squared()).then(g.cmp(&f))
            };
            cell.iter().max_by(by_area).map(|&face| self.own_view(face, f64::INFINITY, blockers).0)
        };
        let is_large = |cell: &Vec<usize>| {
            cell.len() == 1 && self.corners(cell[0]).is_some_and(|at| longest(at) >= CELL * self.sight.size)
        };
        let view = |blockers: &mut Blockers, cell: &Vec<usize>| {
            if is_large(cell) { None } else { largest(cell, blockers) }
        };
        let views: Vec<Option<View>> = cells.par_iter().map_init(Blockers::default, view).collect();
        for (cell, view) in cells.iter().zip(views) {
            if let Some(view) = view {
                cell.iter().for_each(|&face| self.views[face] = view);
            }
        }
    }

    /// How a face is seen at points at most `apart` from each other, and whether some of them are seen and others not.
    fn own_view(&self, face: usize, apart: f64, blockers: &mut Blockers) -> (View, bool) {
        let Some(at) = self.corners(face) else { return (KEPT, false) };
        let normal = self.crosses[face].normalize();
        let mut points = Vec::new();
        add_points(at, apart, &mut points);
        let views: Vec<View> = points.iter().map(|&point| self.sight.view(point, normal, blockers)).collect();
        let seen = views.iter().filter(|view| view.is_seen).count();
        let free = views.iter().map(|view| view.free).sum::<f64>() / views.len() as f64;
        (View { is_seen: 2 * seen >= views.len(), free }, seen > 0 && seen < views.len())
    }

    /// Judges large faces, and those at borders, by themselves, and divides what is partly seen.
    fn judge_borders(&mut self) {
        let (cell, finest) = (CELL * self.sight.size, FINEST * self.sight.size);
        let is_whole = !can_divide(&self.sheet);
        let size = |faces: &Self, face: usize| faces.corners(face).map_or(0.0, longest);
        // Each with whether it may be divided: small faces of the file are judged in their middle, and stay.
        let mut fresh: Vec<(usize, bool)> = (0..self.views.len())
            .filter(|&face| self.is_judged(face) && size(self, face) >= cell)
            .map(|face| (face, true))
            .collect();
        for round in 0..MAX_ROUNDS {
            let judged: Vec<(View, bool)> = fresh
                .par_iter()
                .map_init(Blockers::default, |blockers, &(face, may_be_divided)| {
                    let size = size(self, face);
                    let apart = if size > cell { cell } else { 0.5 * size };
                    let apart = if may_be_divided && size > finest { apart } else { f64::INFINITY };
                    self.own_view(face, apart, blockers)
                })
                .collect();
            let mut is_mixed = vec![false; self.views.len()];
            for (&(face, _), (view, mixed)) in fresh.iter().zip(judged) {
                (self.views[face], self.is_own[face]) = (view, true);
                is_mixed[face] = mixed;
            }
            let can_divide = !is_whole && round + 1 < MAX_ROUNDS && self.views.len() < MAX_FACES;
            let mut parts = Vec::new();
            if can_divide && is_mixed.contains(&true) {
                let parents = divide(&mut self.sheet, &mut self.places, &is_mixed);
                self.regions = parents.iter().map(|&face| self.regions[face]).collect();
                self.views = parents.iter().map(|&face| self.views[face]).collect();
                self.is_own = parents.iter().map(|&face| self.is_own[face] && !is_mixed[face]).collect();
                self.connect();
                parts = (0..parents.len()).filter(|&k| is_mixed[parents[k]] && self.is_judged(k)).collect();
            }
            let differ = |pair: &&Pair| {
                let [a, b] = pair.faces;
                pair.is_smooth && self.views[a].is_seen != self.views[b].is_seen
            };
            let at_border = self.pairs.iter().filter(differ).flat_map(|pair| pair.faces);
            let is_open = |face: &usize| !self.is_own[*face] && self.is_judged(*face);
            let by_size = |face: usize| (face, size(self, face) > 0.5 * cell);
            fresh = at_border
                .filter(is_open)
                .map(by_size)
                .chain(parts.into_iter().map(|face| (face, true)))
                .collect();
            // Of a face that is there twice, the one that may be divided stays.
            fresh.sort_unstable_by(|a, b| b.cmp(a));
            fresh.dedup_by_key(|(face, _)| *face);
            if fresh.is_empty() {
                break;
            }
        }
    }

    /// Takes small islands of a region as what is around them: parts that are not seen, and seen ones that touch nothing seen.
    fn join_islands(&mut self) {
        let least = (0.5 * CELL * self.sight.size).powi(2);
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

/// The middles of the parts of a triangle that is halved until no side is longer than `apart`, or each is as small as half such a
/// square.
fn add_points(at: [DVec3; 3], apart: f64, points: &mut Vec<DVec3>) {
    let length = |k: usize| at[k].distance(at[(k + 1) % 3]);
    let side = (1..3).fold(0, |best, k| if length(k) > length(best) { k } else { best });
    if length(side) <= apart || triangle_cross(at).length() <= 0.5 * apart * apart {
        points.push((at[0] + at[1] + at[2]) / 3.0);
        return;
    }
    let [a, b, c] = [0, 1, 2].map(|k| at[(side + k) % 3]);
    let middle = a.midpoint(b);
    add_points([a, middle, c], apart, points);
    add_points([middle, b, c], apart, points);
}
