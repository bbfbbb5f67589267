//! Single taxels: which moved relative to those around them, and which have other ids.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::bvh::PointTree;
use crate::diff::comparison::{Comparison, LEAST, Test, mirror};
use crate::diff::modules::Module;
use crate::diff::pairs::{FileLink, Place};
use crate::diff::spread::{Spread, spread};
use crate::diff::{Change, ChangeKind, Subject};
use crate::id::VertexId;
use crate::numeric::median;
use crate::skin::TaxelId;

/// A taxel is at the place of another within this share of the distance between neighbours.
const SAME_PLACE: f64 = 0.25;

/// Nearest taxels among which that at a place is searched: more are at one place in no layout.
const NEAR: usize = 16;

impl<'p> Comparison<'p> {
    /// `is_moved`: whether the link moved as a whole.
    pub(super) fn of_taxels(&self, modules: &[Module<'_>], is_moved: bool) -> Vec<Change> {
        let is_changed = self.is_in_changed(modules);
        let count = self.expected.len();
        let is_independent = self.is_independent();
        let mut left: Vec<DVec3> = if is_independent {
            self.differences.clone()
        } else {
            (0..count).map(|k| self.beside_neighbours(k, |other| !is_changed[other])).collect()
        };
        let expected: Vec<f64> = (0..count).map(|k| self.stated[k] / self.touching(k).sqrt()).collect();
        let still = || (0..count).filter(|&k| !is_changed[k]);
        let spread = spread(still().map(|k| (left[k], expected[k]))).or(self.local);
        for module in modules.iter().filter(|module| module.is_changed) {
            for &k in &module.members {
                left[k] = self.link.pairs[k].after.position - module.motion.apply(self.expected[k]);
            }
        }
        let factor = spread.map(Spread::enlarged);
        let mut test = |k: usize| {
            let pair = &self.link.pairs[k];
            // An exact taxel is compared with itself.
            if pair.sigma == Some(0.0) && !is_moved && !is_changed[k] {
                left[k] = pair.after.position - pair.before.position;
                Test::new(left[k], LEAST)
            } else if is_independent {
                self.test_of_taxel(k, left[k])
            } else {
                Test::new(left[k], self.sigma(expected[k], factor))
            }
        };
        let tests: Vec<Test> = (0..count).map(&mut test).collect();
        let moved: Vec<usize> = (0..count).filter(|&k| tests[k].p < self.chance_of_taxel).collect();
        let spacing: Vec<f64> = moved.iter().map(|&k| self.spacing(k)).collect();
        let places: Vec<DVec3> = moved.iter().map(|&k| self.expected[k]).collect();
        let tree = PointTree::new(&places, |_| DVec3::ZERO);
        let widest = spacing.iter().copied().filter(|x| x.is_finite()).fold(0.0, f64::max);
        // The moved taxel at whose place each is now, by its number among them.
        let there = |number: usize| {
            let now = self.link.pairs[moved[number]].after.position;
            let mut near: Vec<(VertexId, f64)> = Vec::new();
            tree.nearest(now, NEAR, SAME_PLACE * widest, &mut near);
            let is_at = |&(other, squared): &(VertexId, f64)| {
                let most = SAME_PLACE * spacing[other.index()];
                other.index() != number && squared < most * most
            };
            near.into_iter().find(is_at).map(|(other, _)| other.index())
        };
        let there: Vec<Option<usize>> = (0..moved.len()).map(there).collect();
        let mut changes = Vec::new();
        for (number, &k) in moved.iter().enumerate() {
            let other = there[number];
            let is_swapped = other.is_some_and(|other| there[other] == Some(number));
            if is_swapped && other < Some(number) {
                continue;
            }
            let kind = if is_swapped { ChangeKind::Swapped } else { ChangeKind::Moved };
            let name = |k: usize| self.link.pairs[k].before.id.to_string();
            changes.push(Change {
                other: other.map(|other| name(moved[other])),
                distance: left[k].length(),
                ..self.change(kind, Subject::Taxel, &name(k), &[k], tests[k])
            });
        }
        changes
    }

    /// How many taxels are next to one: of a taxel at a border, which has few, less is known.
    fn touching(&self, k: usize) -> f64 {
        let near = 1.5 * self.spacing(k);
        let is_near = |&&other: &&usize| self.expected[k].distance(self.expected[other]) < near;
        self.neighbours[k].iter().filter(is_near).count().max(1) as f64
    }

    /// The distance from a taxel to its nearest neighbour that is not at the same place.
    fn spacing(&self, k: usize) -> f64 {
        let distance = |&other: &usize| self.expected[k].distance(self.expected[other]);
        self.neighbours[k].iter().map(distance).filter(|&d| d > LEAST).fold(f64::INFINITY, f64::min)
    }

    /// Taxels of the first file alone, at whose places are taxels of the second file alone: they leave both lists.
    pub(super) fn renumbered(&self, missing: &mut Vec<&'p Place>, new: &mut Vec<&'p Place>) -> Vec<Change> {
        let spacings: Vec<f64> = (0..self.expected.len()).map(|k| self.spacing(k)).collect();
        let spacing = median(spacings.into_iter()).unwrap_or(0.0);
        let mut groups: BTreeMap<(&str, &str), Vec<(&'p Place, TaxelId)>> = BTreeMap::new();
        let places: Vec<DVec3> = new.iter().map(|place| place.position).collect();
        let tree = PointTree::new(&places, |_| DVec3::ZERO);
        let mut is_taken: Vec<bool> = new.iter().map(|place| Some(place.link) != self.link.there).collect();
        let mut near: Vec<(VertexId, f64)> = Vec::new();
        missing.retain(|place| {
            let at =
                self.motion.apply(if self.is_mirrored { mirror(place.position) } else { place.position });
            near.clear();
            tree.nearest(at, NEAR, SAME_PLACE * spacing, &mut near);
            let found = near.iter().map(|(other, _)| other.index()).find(|&other| !is_taken[other]);
            let Some(found) = found else { return true };
            is_taken[found] = true;
            let module = place.module.as_deref().unwrap_or("");
            groups.entry((&place.patch, module)).or_default().push((place, new[found].id));
            false
        });
        let is_renumbered: Vec<bool> = is_taken
            .iter()
            .zip(&*new)
            .map(|(taken, place)| *taken && Some(place.link) == self.link.there)
            .collect();
        let mut is_renumbered = is_renumbered.into_iter();
        new.retain(|_| !is_renumbered.next().unwrap_or_default());
        let change = |((patch, module), all): ((&str, &str), Vec<(&Place, TaxelId)>)| {
            let places: Vec<&Place> = all.iter().map(|(place, _)| *place).collect();
            let others = all.iter().map(|(_, id)| *id).collect();
            let change = group(ChangeKind::Renumbered, (self.name, patch, module), &places);
            Change { others, after: change.before.clone(), ..change }
        };
        groups.into_iter().map(change).collect()
    }
}

/// Places of one file alone, whose links are `links`, by patch and module.
pub(super) fn in_one_file(places: &[&Place], kind: ChangeKind, links: &[FileLink]) -> Vec<Change> {
    let mut groups: BTreeMap<(&str, &str, &str), Vec<&Place>> = BTreeMap::new();
    for place in places {
        let module = place.module.as_deref().unwrap_or("");
        groups.entry((&links[place.link].name, &place.patch, module)).or_default().push(place);
    }
    groups.into_iter().map(|(of, places)| group(kind, of, &places)).collect()
}

/// A change of a module, or of a part of a patch without modules, that was not measured. Places of the second file are
/// not moved back.
pub(super) fn group(
    kind: ChangeKind,
    (link, patch, module): (&str, &str, &str),
    places: &[&Place],
) -> Change {
    let (subject, name) = if module.is_empty() { (Subject::Patch, patch) } else { (Subject::Module, module) };
    let at: Vec<DVec3> = places.iter().map(|place| place.position).collect();
    let (before, after) = if kind == ChangeKind::New { (Vec::new(), at) } else { (at, Vec::new()) };
    Change {
        kind,
        subject,
        name: name.to_owned(),
        other: None,
        link: link.to_owned(),
        patch: patch.to_owned(),
        taxels: places.iter().map(|place| place.id).collect(),
        others: Vec::new(),
        before,
        after,
        distance: 0.0,
        angle: 0.0,
        sigmas: f64::NAN,
        p: f64::NAN,
    }
}
