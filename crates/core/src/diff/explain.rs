//! From pairs to changes: links, then modules, then single taxels, then what is in one file alone.

use crate::diff::attributes::{moved_frames, of_attributes, relinked, renamed};
use crate::diff::comparison::Comparison;
use crate::diff::modules::members_of_modules;
use crate::diff::pairs::{Pairs, Place};
use crate::diff::spread::spread;
use crate::diff::taxels::in_one_file;
use crate::diff::{AlignedLink, Change, ChangeKind, DiffOptions};

/// The links, and all changes.
pub(super) fn explain(pairs: &Pairs, options: &DiffOptions) -> (Vec<AlignedLink>, Vec<Change>) {
    let [names, names_there] = &pairs.names;
    let links = || pairs.links.iter().filter(|(_, link)| !link.pairs.is_empty());
    let taxels: usize = links().map(|(_, link)| link.pairs.len()).sum();
    let modules: usize = links().map(|(_, link)| members_of_modules(&link.pairs).len()).sum();
    // Half of it for a shift and two tests of the turn of each link and module, half for a shift of each taxel.
    let half = 0.5 * options.chance;
    let chances = [half / (3 * (links().count() + modules)) as f64, half / taxels as f64];
    let mut comparisons: Vec<(usize, Comparison<'_>)> = links()
        .map(|(&number, link)| {
            let name = &*names[number].name;
            (number, Comparison::new((link, name), options, pairs.typical_sigma, chances))
        })
        .collect();
    // Links with few taxels differ as all do.
    let all = || comparisons.iter().map(|(_, comparison)| comparison);
    let local = spread(all().flat_map(|of| of.beside_all_neighbours()));
    let total = spread(all().flat_map(|of| of.differences_over_stated()));
    for (_, comparison) in &mut comparisons {
        comparison.local = comparison.local.or(local);
        comparison.total = comparison.total.or(total);
    }
    let (mut aligned, mut changes) = (Vec::new(), Vec::new());
    let mut new: Vec<&Place> = pairs.new.iter().collect();
    for (&number, link) in &pairs.links {
        let mut missing: Vec<&Place> = link.missing.iter().collect();
        let there = link.there.map(|there| &names_there[there]);
        if let Some((_, comparison)) = comparisons.iter().find(|(of, _)| *of == number) {
            changes.extend(there.and_then(|there| renamed(comparison, [&names[number], there])));
            let frames = there.and_then(|there| moved_frames(comparison, [&names[number], there]));
            let of_link = comparison.of_link(frames);
            let is_moved = of_link.is_some();
            changes.extend(of_link);
            let modules = comparison.modules();
            changes.extend(comparison.of_modules(&modules));
            changes.extend(comparison.of_taxels(&modules, is_moved));
            changes.extend(of_attributes(comparison));
            changes.extend(comparison.renumbered(&mut missing, &mut new));
            aligned.push(comparison.aligned(&modules));
        }
        changes.extend(relinked(link, &pairs.names));
        changes.extend(in_one_file(&missing, ChangeKind::Missing, names));
    }
    // What is new on a link that the first file has is moved back with it.
    let of_links = |place: &&Place| comparisons.iter().find(|(_, of)| of.link.there == Some(place.link));
    let mut groups: Vec<(Option<usize>, Vec<&Place>)> = Vec::new();
    for place in new {
        let on = of_links(&place).map(|(number, _)| *number);
        match groups.iter_mut().find(|(of, _)| *of == on) {
            Some((_, group)) => group.push(place),
            None => groups.push((on, vec![place])),
        }
    }
    for (on, places) in groups {
        let on = on.and_then(|on| comparisons.iter().find(|(number, _)| *number == on));
        for mut change in in_one_file(&places, ChangeKind::New, names_there) {
            if let Some((_, comparison)) = on {
                change.after.iter_mut().for_each(|place| *place = comparison.back(*place));
            }
            changes.push(change);
        }
    }
    (aligned, changes)
}
