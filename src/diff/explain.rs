//! From pairs to changes: links, then modules, then single taxels, then what is in one file alone.

use crate::diff::comparison::Comparison;
use crate::diff::modules::members_of_modules;
use crate::diff::pairs::{LinkPairs, Pairs, Place};
use crate::diff::taxels::in_one_file;
use crate::diff::{AlignedLink, Change, ChangeKind, DiffOptions};

/// The links, and all changes.
pub(super) fn explain(pairs: &Pairs, options: &DiffOptions) -> (Vec<AlignedLink>, Vec<Change>) {
    let links: Vec<&LinkPairs> = pairs.links.iter().filter(|link| !link.pairs.is_empty()).collect();
    let taxels: usize = links.iter().map(|link| link.pairs.len()).sum();
    let modules: usize = links.iter().map(|link| members_of_modules(&link.pairs).len()).sum();
    // Half of it for a shift and a turn of each link and module, half for a shift of each taxel.
    let half = 0.5 * options.chance;
    let chances = [half / (2 * (links.len() + modules)) as f64, half / taxels as f64];
    let (mut aligned, mut changes) = (Vec::new(), Vec::new());
    let mut comparisons = Vec::new();
    let mut new: Vec<&Place> = pairs.new.iter().collect();
    for link in &pairs.links {
        let mut missing: Vec<&Place> = link.missing.iter().collect();
        if !link.pairs.is_empty() {
            let comparison = Comparison::new(link, options, chances);
            changes.extend(comparison.of_link());
            let modules = comparison.modules();
            changes.extend(comparison.of_modules(&modules));
            changes.extend(comparison.of_taxels(&modules));
            changes.extend(comparison.renumbered(&mut missing, &mut new));
            aligned.push(comparison.aligned(&modules));
            comparisons.push(comparison);
        }
        changes.extend(in_one_file(&missing, ChangeKind::Missing));
    }
    for mut change in in_one_file(&new, ChangeKind::New) {
        if let Some(comparison) = comparisons.iter().find(|comparison| comparison.link.name == change.link) {
            change.after.iter_mut().for_each(|place| *place = comparison.back(*place));
        }
        changes.push(change);
    }
    (aligned, changes)
}
