//! What else differs between taxels that are matched: their links, the frames of these, normals, areas, modules, what they sense, and
//! regions.

use std::collections::BTreeMap;

use glam::DAffine3;

use crate::calib::Pose;
use crate::diff::comparison::{Comparison, LEAST, mirror};
use crate::diff::pairs::{FileLink, LinkPairs, Pair, Place, differ};
use crate::diff::taxels::group;
use crate::diff::{Change, ChangeKind, Subject};
use crate::numeric::nth_smallest;

/// A normal differs if it is turned by more than this, in rad (10 degrees): two programs compute them differently.
const LEAST_TILT: f64 = 0.17;

/// It always does by more than a right angle, however much all differ.
const MOST_TILT: f64 = std::f64::consts::FRAC_PI_2;

/// The lower quartile of Rayleigh's distribution, of angles between two noisy normals, and of the sizes of normal
/// numbers. The lower quartile stays that of noise until three quarters of the taxels changed.
const QUARTILE_OF_RAYLEIGH: f64 = 0.758_528;
const QUARTILE_OF_NORMAL: f64 = 0.318_639;

/// An area differs by a factor above 2; always by one above 8.
const LEAST_RATIO: f64 = std::f64::consts::LN_2;
const MOST_RATIO: f64 = 3.0 * std::f64::consts::LN_2;

/// Standard deviations beyond which normals and areas differ: one of 3 million taxels does by noise.
const SIGMAS: f64 = 5.5;

/// That a link has another name.
pub(super) fn renamed(comparison: &Comparison<'_>, [before, after]: [&FileLink; 2]) -> Option<Change> {
    let places: Vec<_> = comparison.link.pairs.iter().map(|pair| &pair.before).collect();
    let change = || group(ChangeKind::Relinked, (comparison.name, "", ""), &places);
    let patch = || places.first().map_or(String::new(), |place| place.patch.clone());
    differ(before, after).then(|| Change {
        subject: Subject::Link,
        name: before.name.clone(),
        other: Some(after.name.clone()),
        patch: patch(),
        ..change()
    })
}

/// The frames of a link in both files, if its taxels are elsewhere for them.
pub(super) fn moved_frames(comparison: &Comparison<'_>, links: [&FileLink; 2]) -> Option<[Pose; 2]> {
    let [from, to] = links.map(|link| link.pose);
    let is_elsewhere = |pair: &Pair| {
        let at = pair.before.position;
        from.transform_point3(at).distance(to.transform_point3(at)) > LEAST
    };
    let pose = |frame: DAffine3| Pose {
        position: frame.translation,
        rotation: glam::DQuat::from_mat3(&frame.matrix3).normalize(),
    };
    comparison.link.pairs.iter().any(is_elsewhere).then(|| [from, to].map(pose))
}

/// Taxels that are on another link in the second file, by patch, module and that link; how far they lie apart in the
/// world.
pub(super) fn relinked(link: &LinkPairs, [before, after]: &[Vec<FileLink>; 2]) -> Vec<Change> {
    let mut groups: BTreeMap<(&str, &str, usize), Vec<&Pair>> = BTreeMap::new();
    for pair in &link.relinked {
        let module = pair.before.module.as_deref().unwrap_or("");
        groups.entry((&pair.before.patch, module, pair.after.link)).or_default().push(pair);
    }
    let change = |((patch, module, to), pairs): ((&str, &str, usize), Vec<&Pair>)| {
        let places: Vec<_> = pairs.iter().map(|pair| &pair.before).collect();
        let from = pairs.first().map_or("", |pair| &before[pair.before.link].name);
        let change = group(ChangeKind::Relinked, (from, patch, module), &places);
        Change { other: Some(after[to].name.clone()), ..change }
    };
    groups.into_iter().map(change).collect()
}

/// Taxels of a link whose normals, areas, modules, modalities or regions differ, by patch and module.
pub(super) fn of_attributes(comparison: &Comparison<'_>) -> Vec<Change> {
    let pairs = &comparison.link.pairs;
    let tilt = |pair: &Pair| {
        let before = pair.before.normal?;
        let before = if comparison.is_mirrored { mirror(before) } else { before };
        Some((comparison.motion.rotation * before).angle_between(pair.after.normal?))
    };
    let ratio = |pair: &Pair| Some((pair.after.area? / pair.before.area?).ln().abs());
    let tilts: Vec<Option<f64>> = pairs.iter().map(tilt).collect();
    let ratios: Vec<Option<f64>> = pairs.iter().map(ratio).collect();
    let mut changes = Vec::new();
    for (kind, sizes, [least, most], quartile) in [
        (ChangeKind::Tilted, tilts, [LEAST_TILT, MOST_TILT], QUARTILE_OF_RAYLEIGH),
        (ChangeKind::Resized, ratios, [LEAST_RATIO, MOST_RATIO], QUARTILE_OF_NORMAL),
    ] {
        let known: Vec<f64> = sizes.iter().copied().flatten().collect();
        let rank = known.len() / 4;
        let Some(lower) = nth_smallest(known, rank) else { continue };
        let limit = (SIGMAS * lower / quartile).clamp(least, most);
        let changed = pairs.iter().zip(&sizes).filter_map(|(pair, size)| Some((pair, (*size)?)));
        let changed: Vec<(&Pair, f64)> = changed.filter(|(_, size)| *size > limit).collect();
        changes.extend(by_module(comparison.name, kind, &changed));
    }
    let labels: [(ChangeKind, Label); 3] = [
        (ChangeKind::Regrouped, |place| place.module.clone()),
        (ChangeKind::Modality, |place| Some(place.senses.clone())),
        (ChangeKind::Region, |place| place.region.clone()),
    ];
    for (kind, label) in labels {
        let both = |pair: &Pair| Some([label(&pair.before)?, label(&pair.after)?]);
        let mut others: BTreeMap<[String; 2], Vec<(&Pair, f64)>> = BTreeMap::new();
        for (pair, labels) in pairs.iter().filter_map(|pair| Some((pair, both(pair)?))) {
            if labels[0] != labels[1] {
                others.entry(labels).or_default().push((pair, f64::NAN));
            }
        }
        for ([_, to], pairs) in others {
            let changed = by_module(comparison.name, kind, &pairs);
            changes.extend(changed.into_iter().map(|change| Change { other: Some(to.clone()), ..change }));
        }
    }
    changes
}

/// What a taxel is in one regard, in words, if that is known.
type Label = fn(&Place) -> Option<String>;

/// A change of each patch and module that has some of these taxels; `angle` is the largest tilt.
fn by_module(link: &str, kind: ChangeKind, changed: &[(&Pair, f64)]) -> Vec<Change> {
    let mut groups: BTreeMap<(&str, &str), Vec<(&Pair, f64)>> = BTreeMap::new();
    for &(pair, size) in changed {
        let module = pair.before.module.as_deref().unwrap_or("");
        groups.entry((&pair.before.patch, module)).or_default().push((pair, size));
    }
    let change = |((patch, module), pairs): ((&str, &str), Vec<(&Pair, f64)>)| {
        let places: Vec<_> = pairs.iter().map(|(pair, _)| &pair.before).collect();
        let largest = pairs.iter().map(|(_, size)| *size).fold(0.0, f64::max);
        let angle = if kind == ChangeKind::Tilted { largest } else { 0.0 };
        Change { angle, ..group(kind, (link, patch, module), &places) }
    };
    groups.into_iter().map(change).collect()
}
