//! Distances along the body: its coarsest fields, joined along their meshes, gap links, and links that only levels have.

use crate::body::BodyTaxel;
use crate::body::rest::{Rest, are_joined};
use crate::bvh::{Aabb, BoxTree};
use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, edges};
use crate::numeric::{Csr, DisjointSets};
use crate::pyramid::Level;
use crate::skin::{PatchId, Skin};

/// The fields of the coarsest levels of all patches, numbered patch after patch, or the taxels of one.
pub(super) struct Graph {
    /// Their neighbours, and the lengths of the ways to them, in m.
    pub(super) ways: Csr<(u32, f64)>,
    /// Their taxels.
    pub(super) origins: Vec<BodyTaxel>,
}

impl Graph {
    pub(super) fn new(
        skin: &Skin,
        rest: &Rest,
        links: &[[BodyTaxel; 2]],
        coarsest: &IdVec<PatchId, &Level>,
    ) -> Self {
        let (mut starts, mut origins) = (IdVec::<PatchId, usize>::default(), Vec::new());
        for (patch, level) in coarsest.enumerate() {
            starts.push(origins.len());
            origins.extend(level.origins.iter().map(|&taxel| BodyTaxel { patch, taxel }));
        }
        let place = |field: usize| rest.positions[rest.number(origins[field])];
        let mut all: Vec<(usize, usize, f64)> = Vec::new();
        for (patch, level) in coarsest.enumerate() {
            let fields = edges(&level.mesh).into_iter().map(|ends| ends.map(|v| starts[patch] + v.index()));
            all.extend(fields.map(|[a, b]| (a, b, place(a).distance(place(b)))));
        }
        // The field that a taxel has most weight in.
        let field_of = |at: BodyTaxel| {
            let rows = coarsest[at.patch].to_finest.as_ref();
            let largest =
                rows.and_then(|rows| rows.row(at.taxel).reduce(|a, b| if b.1 > a.1 { b } else { a }));
            starts[at.patch] + largest.map_or(at.taxel, |(field, _)| field).index()
        };
        let mut join = |ends: [BodyTaxel; 2]| {
            let [a, b] = ends.map(field_of);
            let [from, to] = ends.map(|end| rest.positions[rest.number(end)]);
            all.push((a, b, place(a).distance(from) + from.distance(to) + to.distance(place(b))));
        };
        links.iter().copied().for_each(&mut join);
        nearest_links(skin, rest, links).into_iter().for_each(&mut join);
        let both = |&(a, b, length): &(usize, usize, f64)| {
            let number = |k: usize| u32::try_from(k).unwrap_or(u32::MAX);
            [(a, (number(b), length)), (b, (number(a), length))]
        };
        Self { ways: Csr::from_pairs(origins.len(), all.iter().flat_map(both)), origins }
    }
}

impl Graph {
    /// The taxels of a patch, joined along its mesh.
    pub(super) fn of_patch(patch: PatchId, mesh: &TriMesh) -> Self {
        let both = |[a, b]: [VertexId; 2]| {
            let length = mesh.positions[a].distance(mesh.positions[b]);
            [(a.index(), (b.raw(), length)), (b.index(), (a.raw(), length))]
        };
        let origins = mesh.positions.ids().map(|taxel| BodyTaxel { patch, taxel }).collect();
        let ways = Csr::from_pairs(mesh.positions.len(), edges(mesh).into_iter().flat_map(both));
        Self { ways, origins }
    }
}

/// The taxels of a patch, to find the one nearest to those of another.
struct Sheet {
    patch: PatchId,
    /// The number of the first.
    start: usize,
    tree: BoxTree,
    around: Aabb,
    count: usize,
}

impl Sheet {
    fn new(skin: &Skin, rest: &Rest, patch: PatchId) -> Self {
        let (start, count) = (rest.start(patch), skin.patches[patch].mesh.positions.len());
        let positions = rest.positions[start..][..count].iter();
        let boxes: Vec<Aabb> = positions.clone().map(|&x| Aabb::around([x])).collect();
        // Positions of a skin are finite.
        let tree = BoxTree::new(&boxes).unwrap_or_default();
        Self { patch, start, tree, around: Aabb::around(positions.copied()), count }
    }

    /// The distance of its box from that of another one, in m.
    fn gap(&self, other: &Self) -> f64 {
        let (a, b) = (&self.around, &other.around);
        (a.lo - b.hi).max(b.lo - a.hi).max(glam::DVec3::ZERO).length()
    }

    /// The distance of the nearest pair of taxels, at most `most`, and the pair; of equally near ones the first.
    fn nearest(&self, other: &Self, rest: &Rest, most: f64) -> Option<(f64, [BodyTaxel; 2])> {
        let mut best = None;
        let mut reach = most;
        for k in self.start..self.start + self.count {
            let at = rest.positions[k];
            if other.around.least_distance(at) > reach {
                continue;
            }
            other.tree.each_near(at, reach, |near| {
                let near = other.start + near;
                let (a, b) = (rest.taxels[k], rest.taxels[near]);
                let pair = (at.distance(rest.positions[near]), [a.min(b), a.max(b)]);
                if pair.0 <= most && best.is_none_or(|best| pair < best) {
                    best = Some(pair);
                    reach = reach.min(pair.0);
                }
                reach
            });
        }
        best
    }
}

/// Links between the nearest taxels of patches that are apart: first of patches that may be joined, then of any, until
/// all are one.
fn nearest_links(skin: &Skin, rest: &Rest, links: &[[BodyTaxel; 2]]) -> Vec<[BodyTaxel; 2]> {
    let are_joined = are_joined(skin);
    let mut sets = DisjointSets::<PatchId>::new(skin.patches.len());
    links.iter().for_each(|[a, b]| {
        sets.join(a.patch, b.patch);
    });
    let sheets: Vec<Sheet> = skin.patches.ids().map(|patch| Sheet::new(skin, rest, patch)).collect();
    let mut added = Vec::new();
    for is_strict in [true, false] {
        loop {
            let labels = sets.labels();
            if labels.count < 2 {
                return added;
            }
            let may_join =
                |a: PatchId, b: PatchId| labels.of[a] != labels.of[b] && (!is_strict || are_joined(a, b));
            // Of each set its nearest pair.
            let mut best: Vec<(f64, [BodyTaxel; 2])> =
                vec![(f64::INFINITY, [BodyTaxel::default(); 2]); labels.count];
            for (a, own) in sheets.iter().enumerate() {
                let others = sheets[a + 1..].iter().filter(|other| may_join(own.patch, other.patch));
                let mut others: Vec<(f64, &Sheet)> = others.map(|other| (own.gap(other), other)).collect();
                // Near ones first: they leave the others out.
                others.sort_by(|a, b| a.0.total_cmp(&b.0));
                for (gap, other) in others {
                    let sets = [own, other].map(|sheet| labels.of[sheet.patch]);
                    let most = best[sets[0]].0.max(best[sets[1]].0);
                    let Some(pair) = (gap <= most).then(|| own.nearest(other, rest, most)).flatten() else {
                        continue;
                    };
                    for set in sets {
                        if pair < best[set] {
                            best[set] = pair;
                        }
                    }
                }
            }
            let before = added.len();
            best.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for (_, ends) in best.into_iter().filter(|(distance, _)| distance.is_finite()) {
                let [a, b] = ends.map(|end| end.patch);
                if sets.root(a) != sets.root(b) {
                    sets.join(a, b);
                    added.push(ends);
                }
            }
            if added.len() == before {
                break;
            }
        }
    }
    added
}
