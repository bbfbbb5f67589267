//! Single taxels: which moved relative to those around them, and which have other ids.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::diff::comparison::{Comparison, LEAST, Test, mirror};
use crate::diff::modules::Module;
use crate::diff::pairs::Place;
use crate::diff::spread::spread;
use crate::diff::{Change, ChangeKind, Subject};
use crate::numeric::median;
use crate::skin::TaxelId;

/// A taxel is at the place of another within this share of the distance between neighbours.
const SAME_PLACE: f64 = 0.25;

impl<'p> Comparison<'p> {
    pub(super) fn of_taxels(&self, modules: &[Module<'_>]) -> Vec<Change> {
        let is_changed = self.is_in_changed(modules);
        let count = self.expected.len();
        let mut left: Vec<DVec3> =
            (0..count).map(|k| self.beside_neighbours(k, |other| !is_changed[other])).collect();
        let expected: Vec<f64> = (0..left.len()).map(|k| self.stated[k] / self.touching(k).sqrt()).collect();
        let still = || (0..left.len()).filter(|&k| !is_changed[k]);
        let spread = spread(still().map(|k| (left[k], expected[k])));
        for module in modules.iter().filter(|module| module.is_changed) {
            for &k in &module.members {
                left[k] = self.link.pairs[k].after.position - module.motion.apply(self.expected[k]);
            }
        }
        let test = |k: usize| Test::new(left[k], self.sigma(expected[k], spread));
        let tests: Vec<Test> = (0..left.len()).map(test).collect();
        let moved: Vec<usize> = (0..left.len()).filter(|&k| tests[k].p < self.chance_of_taxel).collect();
        let mut changes = Vec::new();
        for &k in &moved {
            let is_at = |a: usize, b: usize| {
                self.link.pairs[a].after.position.distance(self.expected[b]) < SAME_PLACE * self.spacing(b)
            };
            let other = moved.iter().copied().find(|&other| other != k && is_at(k, other));
            let is_swapped = other.is_some_and(|other| is_at(other, k));
            if is_swapped && other < Some(k) {
                continue;
            }
            let kind = if is_swapped { ChangeKind::Swapped } else { ChangeKind::Moved };
            let name = |k: usize| self.link.pairs[k].before.id.to_string();
            changes.push(Change {
                other: other.map(name),
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
        missing.retain(|place| {
            let at =
                self.motion.apply(if self.is_mirrored { mirror(place.position) } else { place.position });
            let near = |other: &&Place| other.position.distance(at) < SAME_PLACE * spacing;
            let Some(found) = new.iter().position(near) else { return true };
            let module = place.module.as_deref().unwrap_or("");
            groups.entry((&place.patch, module)).or_default().push((place, new.remove(found).id));
            false
        });
        let change = |((patch, module), all): ((&str, &str), Vec<(&Place, TaxelId)>)| {
            let places: Vec<&Place> = all.iter().map(|(place, _)| *place).collect();
            let others = all.iter().map(|(_, id)| *id).collect();
            let change = group(ChangeKind::Renumbered, patch, module, &places);
            Change { others, after: change.before.clone(), ..change }
        };
        groups.into_iter().map(change).collect()
    }
}

/// Places of one file alone, by patch and module.
pub(super) fn in_one_file(places: &[&Place], kind: ChangeKind) -> Vec<Change> {
    let mut groups: BTreeMap<(&str, &str, &str), Vec<&Place>> = BTreeMap::new();
    for place in places {
        let module = place.module.as_deref().unwrap_or("");
        groups.entry((&place.link, &place.patch, module)).or_default().push(place);
    }
    groups.into_iter().map(|((_, patch, module), places)| group(kind, patch, module, &places)).collect()
}

/// A change of a module, or of a part of a patch without modules, that was not measured. Places of the second file are
/// not moved back.
fn group(kind: ChangeKind, patch: &str, module: &str, places: &[&Place]) -> Change {
    let (subject, name) = if module.is_empty() { (Subject::Patch, patch) } else { (Subject::Module, module) };
    let at: Vec<DVec3> = places.iter().map(|place| place.position).collect();
    let (before, after) = if kind == ChangeKind::New { (Vec::new(), at) } else { (at, Vec::new()) };
    Change {
        kind,
        subject,
        name: name.to_owned(),
        other: None,
        link: places.first().map_or(String::new(), |place| place.link.clone()),
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
