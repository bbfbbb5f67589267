//! What changed between two files of one skin: laws of `diff`, and the command as a user runs it.

use std::collections::BTreeMap;

use dermatome::calib::{CalibOptions, SimulateOptions, calibrate, simulate};
use dermatome::diff::{Change, ChangeKind, Diff, DiffError, DiffOptions, MatchedBy, Subject, diff};
use dermatome::skin::{Covariance, Draft, Link, LinkId, Presence, Sheet, TaxelId};
use glam::{DAffine3, DQuat, DVec3};

use crate::common;

/// Taxels of a file.
#[derive(Clone)]
struct Taxels(Sheet);

impl Taxels {
    /// A bent sheet of 12 x 12 taxels, 5 mm apart, in modules of 3 x 3.
    fn sheet() -> Self {
        let bend = |k: u32| {
            let [x, y] = [k % 12, k / 12].map(|x| 0.005 * f64::from(x));
            DVec3::new(0.1 * (x / 0.1).sin(), y, 0.1 * (x / 0.1).cos())
        };
        let positions: Vec<DVec3> = (0..144).map(bend).collect();
        let module = |k: u32| (k / 12) / 3 * 4 + (k % 12) / 3;
        Self(Sheet {
            name: "palm".into(),
            ids: Some((1..=144).map(TaxelId).collect()),
            modules: Some((0..144).map(module).collect()),
            positions,
            ..Sheet::default()
        })
    }

    /// A calibration of the paper's skin with 10 contacts, with covariances, in modules of about 15 mm.
    fn calibrated(seed: u64) -> Self {
        let options = SimulateOptions { anchors: 10, seed, ..SimulateOptions::default() };
        let simulation = simulate(&options).unwrap();
        let found = calibrate(&simulation.observations, &CalibOptions::default()).unwrap();
        let mut numbers = BTreeMap::new();
        let mut number = |x: DVec3| {
            #[expect(clippy::cast_possible_truncation, reason = "a few cells")]
            let cell = [x.x, x.y].map(|x| (x / 0.0175).round() as i32);
            let next = u32::try_from(numbers.len()).unwrap();
            *numbers.entry(cell).or_insert(next)
        };
        Self(Sheet {
            name: "cap".into(),
            ids: Some((1..=500).map(TaxelId).collect()),
            modules: Some(simulation.truth.iter().map(|pose| number(pose.position)).collect()),
            positions: found.poses.iter().map(|pose| pose.position).collect(),
            covariances: found.marginals.map(|all| all.positions.iter().copied().map(Some).collect()),
            ..Sheet::default()
        })
    }

    fn draft(&self) -> Draft {
        Draft { sheets: vec![self.0.clone()], ..Draft::default() }
    }

    fn members(&self, module: u32) -> Vec<usize> {
        let modules = self.0.modules.as_ref().unwrap();
        (0..modules.len()).filter(|&k| modules[k] == module).collect()
    }

    fn centre(&self, module: u32) -> DVec3 {
        let members = self.members(module);
        members.iter().map(|&k| self.0.positions[k]).sum::<DVec3>() / members.len() as f64
    }

    /// Modules with at least four taxels.
    fn large_modules(&self) -> Vec<u32> {
        let all: std::collections::BTreeSet<u32> = self.0.modules.iter().flatten().copied().collect();
        all.into_iter().filter(|&module| self.members(module).len() >= 6).collect()
    }

    fn move_module(&mut self, module: u32, motion: impl Fn(DVec3) -> DVec3) {
        for k in self.members(module) {
            self.0.positions[k] = motion(self.0.positions[k]);
        }
    }

    fn turn(&mut self, module: u32, axis: DVec3, degrees: f64) {
        let (centre, turn) =
            (self.centre(module), DQuat::from_axis_angle(axis.normalize(), degrees.to_radians()));
        self.move_module(module, |x| centre + turn * (x - centre));
    }
}

fn compared(before: &Taxels, after: &Taxels) -> Diff {
    diff(&before.draft(), &after.draft(), &DiffOptions::default()).unwrap()
}

fn the_change(before: &Taxels, after: &Taxels) -> Change {
    let mut found = compared(before, after).changes;
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

#[test]
fn files_that_are_equal_up_to_rounding_do_not_differ() {
    let before = Taxels::sheet();
    let mut after = before.clone();
    after.0.positions.iter_mut().for_each(|x| *x = (*x * 1e4).round() / 1e4);
    for (a, b) in [(&before, &before), (&before, &after), (&after, &before)] {
        let found = compared(a, b);
        assert_eq!(
            (found.changes.len(), found.matched, found.links[0].unchanged),
            (0, 144, 144),
            "{found:?}"
        );
    }
}

#[test]
fn a_module_is_moved_turned_or_mirrored() {
    let before = Taxels::sheet();
    let mut after = before.clone();
    after.move_module(5, |x| x + DVec3::new(0.0, 0.003, 0.0));
    let change = the_change(&before, &after);
    assert_eq!((change.kind, change.subject, &*change.name), (ChangeKind::Moved, Subject::Module, "5"));
    assert!((change.distance - 0.003).abs() < 1e-5 && change.p < 1e-6, "{change:?}");

    let outward = before.centre(6).normalize();
    for degrees in [120.0, -120.0, 30.0] {
        let mut after = before.clone();
        after.turn(6, outward, degrees);
        let change = the_change(&before, &after);
        assert_eq!((change.kind, &*change.name, &*change.patch), (ChangeKind::Turned, "6", "palm"));
        assert!((change.angle.to_degrees() - degrees.abs()).abs() < 0.1, "{change:?}");
    }
    let mut after = before.clone();
    after.turn(9, DVec3::Y, 180.0);
    assert_eq!(the_change(&before, &after).kind, ChangeKind::Mirrored);
}

#[test]
fn two_modules_or_taxels_are_swapped() {
    let before = Taxels::sheet();
    for [a, b] in [[0, 15], [5, 6]] {
        let mut after = before.clone();
        let [from, to] = [a, b].map(|module| before.members(module));
        for (&i, &j) in from.iter().zip(&to) {
            after.0.positions.swap(i, j);
        }
        let change = the_change(&before, &after);
        assert_eq!((change.kind, change.subject), (ChangeKind::Swapped, Subject::Module));
        assert_eq!((change.name, change.other), (a.to_string(), Some(b.to_string())));
    }
    let mut after = before.clone();
    after.0.positions.swap(20, 100);
    let change = the_change(&before, &after);
    assert_eq!((change.kind, change.subject), (ChangeKind::Swapped, Subject::Taxel));
    assert_eq!((&*change.name, change.other.as_deref()), ("21", Some("101")));
}

#[test]
fn taxels_are_moved_missing_new_or_renumbered() {
    let before = Taxels::sheet();
    let mut after = before.clone();
    after.0.positions[70].y += 0.001;
    let change = the_change(&before, &after);
    assert_eq!(
        (change.kind, change.subject, change.taxels),
        (ChangeKind::Moved, Subject::Taxel, vec![TaxelId(71)])
    );
    assert!((change.distance - 0.001).abs() < 1e-6);

    let mut after = before.clone();
    let ids = after.0.ids.as_mut().unwrap();
    for k in before.members(3) {
        ids[k] = TaxelId(1000 + ids[k].0);
    }
    let change = the_change(&before, &after);
    assert_eq!((change.kind, &*change.name), (ChangeKind::Renumbered, "3"));
    assert!(change.taxels.iter().zip(&change.others).all(|(old, new)| new.0 == old.0 + 1000));

    let keep = |taxels: &Taxels, module: u32| {
        let mut kept = taxels.clone();
        let members = taxels.members(module);
        let is_kept = |k: &usize| !members.contains(k);
        let all: Vec<usize> = (0..144).filter(is_kept).collect();
        kept.0.positions = all.iter().map(|&k| taxels.0.positions[k]).collect();
        kept.0.ids = taxels.0.ids.as_ref().map(|ids| all.iter().map(|&k| ids[k]).collect());
        kept.0.modules = taxels.0.modules.as_ref().map(|m| all.iter().map(|&k| m[k]).collect());
        kept
    };
    let less = keep(&before, 7);
    let (missing, new) = (the_change(&before, &less), the_change(&less, &before));
    assert_eq!((missing.kind, new.kind), (ChangeKind::Missing, ChangeKind::New));
    assert_eq!((missing.taxels.len(), &missing.taxels), (9, &new.taxels));
    assert!(missing.p.is_nan() && missing.sigmas.is_nan());
    assert!(missing.after.is_empty() && new.before.is_empty() && missing.before == new.after);
}

#[test]
fn a_link_is_moved_or_mirrored_as_a_whole() {
    let before = Taxels::sheet();
    let turn = DQuat::from_rotation_z(0.1);
    let mut after = before.clone();
    after.0.positions.iter_mut().for_each(|x| *x = turn * *x + DVec3::new(0.02, 0.0, 0.0));
    after.move_module(2, |x| x + DVec3::new(0.0, 0.0, 0.002));
    let found = compared(&before, &after);
    let kinds: Vec<_> = found.changes.iter().map(|change| (change.kind, change.subject)).collect();
    assert_eq!(kinds, [(ChangeKind::Frame, Subject::Link), (ChangeKind::Moved, Subject::Module)]);
    assert!((found.changes[0].angle - 0.1).abs() < 1e-4 && found.links[0].unchanged == 135, "{found:?}");
    // The places of the second file are moved back: what is left is the motion of the module.
    let Change { taxels, before: from, after: to, .. } = &found.changes[1];
    let expected = turn.inverse() * DVec3::new(0.0, 0.0, 0.002);
    assert!(taxels.len() == 9 && from.len() == 9 && to.len() == 9);
    assert!(from.iter().zip(to).all(|(a, b)| (*b - *a).distance(expected) < 1e-6), "{from:?} {to:?}");

    let mut after = before.clone();
    after.0.positions.iter_mut().for_each(|x| x.y = -x.y);
    let change = the_change(&before, &after);
    assert_eq!((change.kind, change.subject), (ChangeKind::Mirrored, Subject::Link));
}

#[test]
fn two_calibrations_of_one_skin_do_not_differ() {
    let all: Vec<Taxels> = (0..16).map(Taxels::calibrated).collect();
    for pair in all.chunks(2) {
        let found = compared(&pair[0], &pair[1]);
        assert!(found.changes.is_empty(), "{:?}", found.changes);
    }
}

/// The same of a hundred pairs, which no other test uses.
#[test]
#[ignore = "takes a minute: run it after a change of how differences are judged"]
fn a_hundred_pairs_of_calibrations_do_not_differ() {
    let mut found = Vec::new();
    for seed in (3000..3200).step_by(2) {
        let [before, after] = [seed, seed + 1].map(Taxels::calibrated);
        found.extend(compared(&before, &after).changes.into_iter().map(|change| (seed, change)));
    }
    for (seed, Change { kind, subject, name, distance, angle, sigmas, p, taxels, .. }) in &found {
        println!("{seed}: {kind} {subject} {name} of {}: {distance} m, {angle}, {sigmas}, {p}", taxels.len());
    }
    assert_eq!(found.len(), 0);
}

/// Of modules of two calibrations with different noise: those that moved by 5 mm, and that turned, are named; by 3 mm
/// at least half.
#[test]
fn changes_are_found_between_two_calibrations() {
    let (before, after) = (Taxels::calibrated(100), Taxels::calibrated(101));
    let (mut tried, mut named) = (0, [0; 2]);
    for &module in before.large_modules().iter().step_by(3) {
        let outward = -before.centre(module).normalize();
        let sideways = outward.any_orthonormal_vector();
        let name = module.to_string();
        tried += 1;
        for (distance, named) in [0.003, 0.005].into_iter().zip(&mut named) {
            let mut moved = after.clone();
            moved.move_module(module, |x| x + distance * sideways);
            let changes = compared(&before, &moved).changes;
            let is_named = |change: &Change| change.name == name && change.kind == ChangeKind::Moved;
            *named += usize::from(changes.len() == 1 && is_named(&changes[0]));
        }
        let mut turned = after.clone();
        turned.turn(module, outward, 120.0);
        let change = the_change(&before, &turned);
        assert_eq!((change.kind, &*change.name), (ChangeKind::Turned, &*name), "{change:?}");
    }
    println!("named of {tried}: moved by 3 mm {}, by 5 mm {}", named[0], named[1]);
    assert!(2 * named[0] >= tried && named[1] == tried, "{named:?} of {tried}");
}

#[test]
fn files_without_a_common_taxel_are_refused() {
    let before = Taxels::sheet();
    let mut after = before.clone();
    after.0.ids = Some((1001..=1144).map(TaxelId).collect());
    let refused =
        |after: &Taxels, options: &DiffOptions| diff(&before.draft(), &after.draft(), options).unwrap_err();
    let error = refused(&after, &DiffOptions::default());
    assert_eq!(error, DiffError::NothingShared { before: 144, after: 144, by: MatchedBy::Id });
    let options = DiffOptions { sigma: Some(0.0), ..DiffOptions::default() };
    assert!(matches!(refused(&before, &options), DiffError::Option { name: "sigma", .. }));
    // Without ids, rows of patches are matched; ids that are not unique are left out.
    after.0.ids = None;
    assert_eq!(compared(&before, &after).by, MatchedBy::Row);
    after.0.ids = Some((0..144).map(|k| TaxelId(k.max(2))).collect());
    let found = compared(&before, &after);
    // Which of them the taxel of the first file is, is not known: it is not missing.
    assert_eq!((found.ambiguous, found.matched), ([1, 3], 141));
    assert!(found.changes.iter().all(|change| !change.taxels.contains(&TaxelId(2))), "{:?}", found.changes);
}

/// Taxels that share ids are told apart by their links, and where these share them by their patches; where the names of two files do
/// not tell, they are counted.
#[test]
fn shared_ids_are_told_apart_by_link_and_patch() {
    let links = |names| {
        let mut draft = on_two_links(names);
        draft.sheets[1].ids = draft.sheets[0].ids.clone();
        draft
    };
    let before = links(["upper", "lower"]);
    let mut after = before.clone();
    assert_eq!(diff(&before, &after, &DiffOptions::default()).unwrap().matched, 72);
    after.sheets[1].positions[7].x += 0.002;
    let found = diff(&before, &after, &DiffOptions::default()).unwrap();
    let [Change { kind: ChangeKind::Moved, link, taxels, .. }] = &found.changes[..] else {
        panic!("{:?}", found.changes)
    };
    assert_eq!((&**link, &taxels[..], found.ambiguous), ("lower", &[TaxelId(8)][..], [0, 0]));
    // Two patches of one link.
    let of_one = |draft: &Draft| {
        let mut one = draft.clone();
        one.sheets[1].link = one.sheets[0].link;
        one.sheets[1].positions.iter_mut().for_each(|x| x.y += 0.1);
        one
    };
    let found = diff(&of_one(&before), &of_one(&after), &DiffOptions::default()).unwrap();
    assert_eq!((found.matched, found.changes.len(), &*found.changes[0].patch), (72, 1, "p1"));
    // A patch less is missing; a file that shares no id is compared where names agree.
    let mut less = before.clone();
    less.sheets[1].positions.truncate(30);
    less.sheets[1].ids.as_mut().unwrap().truncate(30);
    let found = diff(&before, &less, &DiffOptions::default()).unwrap();
    assert_eq!((found.changes[0].kind, found.changes[0].taxels.len()), (ChangeKind::Missing, 6));
    let found = diff(&on_two_links(["upper", "lower"]), &before, &DiffOptions::default()).unwrap();
    let kinds: Vec<ChangeKind> = found.changes.iter().map(|change| change.kind).collect();
    assert_eq!((found.matched, kinds), (36, vec![ChangeKind::Missing, ChangeKind::New]));
    let renamed = diff(&before, &links(["upper", "other"]), &DiffOptions::default()).unwrap();
    assert_eq!((renamed.matched, renamed.ambiguous, renamed.changes.len()), (36, [36, 36], 0));
}

/// What taxels sense is compared, without a word on it touch; regions are if both files have them.
#[test]
fn modalities_and_regions_are_compared() {
    let before = Taxels::sheet();
    let pads = before.members(3);
    let mut after = before.clone();
    let presence = |k| if pads.contains(&k) { Presence::ThermalPad } else { Presence::Present };
    after.0.presence = Some((0..144).map(presence).collect());
    let change = the_change(&before, &after);
    assert_eq!(
        (change.kind, change.other.as_deref(), change.taxels.len()),
        (ChangeKind::Modality, Some("thermal"), 9)
    );
    let mut named = before.clone();
    named.0.modalities =
        Some((0..144).map(|k| Some(if pads.contains(&k) { "thermal" } else { "touch" }.into())).collect());
    assert_eq!(compared(&after, &named).changes, [], "two ways to say it");
    let [mut first, mut second] = [before.clone(), before.clone()];
    first.0.regions = Some(vec![None; 144]);
    second.0.regions = Some((0..144).map(|k| pads.contains(&k).then(|| "thumb".into())).collect());
    let change = the_change(&first, &second);
    assert_eq!((change.kind, change.other.as_deref()), (ChangeKind::Region, Some("thumb")));
    assert_eq!(compared(&before, &second).changes, [], "a file without regions");
}

/// Normal numbers from a seed.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn vector(&mut self, sigma: f64) -> DVec3 {
        let mut normal = || (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0;
        sigma * DVec3::new(normal(), normal(), normal())
    }
}

/// A bent sheet of taxels in modules of about ten, with white noise of `sigma` along each axis.
fn noisy(noise: &mut Noise, [columns, rows]: [u32; 2], sigma: f64) -> Taxels {
    let bend = |k: u32| {
        let [x, y] = [k % columns, k / columns].map(|x| 0.005 * f64::from(x));
        DVec3::new(0.08 * (x / 0.08).sin(), y, 0.08 * (x / 0.08).cos())
    };
    let module = |k: u32| (k / columns) / 3 * (columns * 3).div_ceil(10) + (k % columns) * 3 / 10;
    let count = columns * rows;
    let positions: Vec<DVec3> = (0..count).map(|k| bend(k) + noise.vector(sigma)).collect();
    Taxels(Sheet {
        name: "palm".into(),
        ids: Some((1..=count).map(TaxelId).collect()),
        modules: Some((0..count).map(module).collect()),
        positions,
        ..Sheet::default()
    })
}

/// Of pairs of one skin with white noise at most 3 in 100 show a change, and a module that moved by 8 standard deviations
/// of its mean is named in 95 of 100, of skins of any size, whether the deviation is stated or not.
#[test]
fn white_noise_is_no_change_and_a_module_that_moved_is_one() {
    let mut wrong = Vec::new();
    for (size, tries) in [([8, 6], 100), ([20, 6], 100), ([20, 15], 100), ([40, 30], 40)] {
        for sigma in [1e-4, 3e-4, 1e-3, 2e-3] {
            for stated in [None, Some(sigma * 2.0_f64.sqrt())] {
                let options = DiffOptions { sigma: stated, ..DiffOptions::default() };
                let (mut alarms, mut named) = (0, 0);
                for seed in 0..tries {
                    let mut noise = Noise(seed as u64 * 7919 + 1);
                    let [before, mut after] = [(); 2].map(|()| noisy(&mut noise, size, sigma));
                    let found = diff(&before.draft(), &after.draft(), &options).unwrap();
                    alarms += usize::from(!found.changes.is_empty());
                    let modules = after.large_modules();
                    let module = modules[(7 * seed) % modules.len()];
                    let count = after.members(module).len() as f64;
                    let by = 8.0 * sigma * (2.0 / count).sqrt() * noise.vector(1.0).normalize();
                    after.move_module(module, |x| x + by);
                    let found = diff(&before.draft(), &after.draft(), &options).unwrap();
                    let name = module.to_string();
                    let is_it = |change: &Change| change.name == name && change.subject == Subject::Module;
                    named += usize::from(found.changes.iter().any(is_it));
                }
                let said = format!(
                    "{size:?}, {sigma} m, stated {stated:?}: {alarms} alarms, {named} named of {tries}"
                );
                println!("{said}");
                // Of 48 taxels less is known of how they spread, and of what is around a module.
                let is_named = 100 * named >= 95 * tries || size[0] == 8;
                if 100 * alarms > 3 * tries || !is_named {
                    wrong.push(said);
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A draft of two sheets of 6 x 6 taxels on two links.
fn on_two_links(names: [&str; 2]) -> Draft {
    let link = |(name, z): (&str, f64)| Link {
        name: name.into(),
        parent: None,
        pose: DAffine3::from_translation(DVec3::Z * z),
    };
    let sheet = |k: u32| Sheet {
        name: format!("p{k}"),
        link: Some(LinkId::from(k)),
        ids: Some((36 * k + 1..36 * k + 37).map(TaxelId).collect()),
        positions: (0..36).map(|k| 0.005 * DVec3::new(f64::from(k % 6), f64::from(k / 6), 0.0)).collect(),
        ..Sheet::default()
    };
    Draft {
        links: [(names[0], 0.0), (names[1], 0.3)].map(link).into_iter().collect(),
        sheets: vec![sheet(0), sheet(1)],
        ..Draft::default()
    }
}

fn kinds(before: &Draft, after: &Draft) -> Vec<(ChangeKind, Subject, String)> {
    let found = diff(before, after, &DiffOptions::default()).unwrap();
    found.changes.into_iter().map(|change| (change.kind, change.subject, change.name)).collect()
}

#[test]
fn links_are_matched_by_name_and_number() {
    let before = on_two_links(["upper", "lower"]);
    assert_eq!(kinds(&before, &before), []);
    let mut after = before.clone();
    after.sheets[1].link = Some(LinkId::from(0));
    // It lies elsewhere in the world, too.
    let [relinked, frame] =
        [ChangeKind::Relinked, ChangeKind::Frame].map(|kind| (kind, Subject::Link, "lower".into()));
    assert_eq!(kinds(&before, &after), [relinked, frame]);
    let mut after = before.clone();
    let half = after.sheets[1].clone();
    after.sheets[1].ids.as_mut().unwrap().truncate(18);
    after.sheets[1].positions.truncate(18);
    let rest = Sheet {
        link: Some(LinkId::from(0)),
        ids: half.ids.map(|ids| ids[18..].to_vec()),
        positions: half.positions[18..].to_vec(),
        ..half
    };
    after.sheets.push(rest);
    let found = diff(&before, &after, &DiffOptions::default()).unwrap();
    let [Change { kind: ChangeKind::Relinked, link, other, taxels, .. }] = &found.changes[..] else {
        panic!("{:?}", found.changes)
    };
    assert_eq!((&**link, other.as_deref(), taxels.len()), ("lower", Some("upper"), 18));

    // Unnamed links, and links that share a name, are told apart.
    for names in [["upper", "lower"], ["", ""], ["finger", "finger"]] {
        let before = on_two_links(names);
        let mut after = before.clone();
        after.sheets[1].positions.iter_mut().for_each(|x| x.x += 0.003);
        let found = diff(&before, &after, &DiffOptions::default()).unwrap();
        let [Change { kind: ChangeKind::Frame, distance, ref taxels, .. }] = found.changes[..] else {
            panic!("{names:?}: {:?}", found.changes)
        };
        assert!((distance - 0.003).abs() < 1e-9 && taxels.len() == 36, "{names:?}: {distance}");
        // Its frame moves in the world.
        let mut after = before.clone();
        after.links[LinkId::from(1)].pose.translation.z += 0.3;
        let found = diff(&before, &after, &DiffOptions::default()).unwrap();
        let [Change { kind: ChangeKind::Frame, distance, .. }] = found.changes[..] else {
            panic!("{names:?}: {:?}", found.changes)
        };
        assert!((distance - 0.3).abs() < 1e-9, "{names:?}: {distance}");
        // The same places in a file without frames are the same skin.
        let mut after = before.clone();
        after.sheets[1].positions.iter_mut().for_each(|x| x.z += 0.3);
        after.links[LinkId::from(1)].pose.translation.z = 0.0;
        assert_eq!(kinds(&before, &after), [], "{names:?}");
    }
    let mut after = before.clone();
    after.sheets[0].link = Some(LinkId::from(7));
    assert!(matches!(diff(&before, &after, &DiffOptions::default()), Err(DiffError::Skin(_))));
}

#[test]
fn normals_areas_and_modules_are_compared() {
    let mut before = Taxels::sheet();
    before.0.normals =
        Some(before.0.positions.iter().map(|x| DVec3::new(x.x, 0.0, x.z).normalize()).collect());
    before.0.areas = Some(vec![2e-5; 144]);
    let turn = DQuat::from_rotation_y(0.3);
    let turned = |taxels: &Taxels| {
        let mut all = taxels.clone();
        all.0.positions.iter_mut().chain(all.0.normals.iter_mut().flatten()).for_each(|x| *x = turn * *x);
        all
    };
    assert_eq!(the_change(&before, &turned(&before)).kind, ChangeKind::Frame, "and normals moved with it");
    let mut after = before.clone();
    after.0.normals.as_mut().unwrap().iter_mut().for_each(|n| *n = -*n);
    let found = compared(&before, &after).changes;
    assert!(
        found.len() == 16 && found.iter().all(|c| c.kind == ChangeKind::Tilted && c.angle > 3.1),
        "{found:?}"
    );
    let mut after = before.clone();
    let tilt = DQuat::from_rotation_x(0.9);
    (0..72).for_each(|k| after.0.normals.as_mut().unwrap()[k] = tilt * before.0.normals.as_ref().unwrap()[k]);
    let found = compared(&before, &after).changes;
    let tilted: usize = found.iter().map(|change| change.taxels.len()).sum();
    assert!(tilted == 72 && found.iter().all(|c| c.kind == ChangeKind::Tilted), "{found:?}");
    let mut after = before.clone();
    after.0.areas.as_mut().unwrap().iter_mut().for_each(|area| *area *= 20.0);
    assert!(compared(&before, &after).changes.iter().all(|change| change.kind == ChangeKind::Resized));
    assert_eq!(compared(&before, &after).changes.len(), 16);
    let mut after = before.clone();
    for k in before.members(3) {
        after.0.modules.as_mut().unwrap()[k] = 99;
    }
    let change = the_change(&before, &after);
    assert_eq!(
        (change.kind, &*change.name, change.other.as_deref()),
        (ChangeKind::Regrouped, "3", Some("99"))
    );
}

/// A taxel without covariance hides no change of the others, and none of its own.
#[test]
fn a_covariance_of_zero_is_exact() {
    let mut before = Taxels::sheet();
    let known = Covariance { xx: 1e-8, yy: 1e-8, zz: 1e-8, ..Covariance::default() };
    before.0.covariances = Some(vec![Some(known); 144]);
    before.0.covariances.as_mut().unwrap()[0] = Some(Covariance::default());
    assert_eq!(compared(&before, &before).changes, []);
    let mut after = before.clone();
    after.0.positions.iter_mut().for_each(|x| x.y += 0.03);
    let change = the_change(&before, &after);
    assert_eq!((change.kind, change.subject), (ChangeKind::Frame, Subject::Link));
    let mut after = before.clone();
    after.0.positions[0].y += 0.0003;
    let change = the_change(&before, &after);
    assert_eq!((change.kind, change.taxels), (ChangeKind::Moved, vec![TaxelId(1)]));
}

#[test]
fn one_sheet_each_are_a_pair_by_row() {
    let mut before = Taxels::sheet();
    (before.0.ids, before.0.modules) = (None, None);
    let mut after = before.clone();
    (before.0.name, after.0.name) = ("monday".into(), "tuesday".into());
    after.0.positions[70].y += 0.001;
    let found = compared(&before, &after);
    assert_eq!((found.by, found.matched, found.changes.len()), (MatchedBy::Row, 144, 1));
}

/// A table of taxels with another turned module: exit code 1, a sentence, a table and JSON.
#[test]
fn the_command_lists_changes() {
    use std::fmt::Write;
    let folder = tempfile::tempdir().unwrap();
    let before = Taxels::sheet();
    let mut after = before.clone();
    after.turn(6, before.centre(6).normalize(), 120.0);
    for (name, taxels) in [("a.csv", &before), ("b.csv", &after)] {
        let mut text = String::from("taxel_id,x,y,z\n");
        for (k, x) in taxels.0.positions.iter().enumerate() {
            writeln!(text, "{},{},{},{}", k + 1, x.x, x.y, x.z).unwrap();
        }
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let mut modules = String::from("taxel_id,module\n");
    for (k, module) in before.0.modules.iter().flatten().enumerate() {
        writeln!(modules, "{},m{module}", k + 1).unwrap();
    }
    std::fs::write(folder.path().join("m.csv"), &modules).unwrap();
    let run = common::dermatome(&folder, "diff a.csv b.csv --modules m.csv -o d.csv").assert().code(1);
    let said = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    assert!(said.contains("module m6 of a turned by 120.0 deg at its place"), "{said}");
    let table = std::fs::read_to_string(folder.path().join("d.csv")).unwrap();
    assert!(
        table.starts_with(
            "kind,what,patch,taxels,distance_mm,angle_deg,sigmas,p,link,other\nturned,module m6,"
        ),
        "{table}"
    );
    let run = common::dermatome(&folder, "diff a.csv b.csv --modules m.csv --json").assert().code(1);
    let json = common::json(&run.get_output().stdout);
    assert_eq!(
        (&json["schema"], &json["changes"][0]["kind"]),
        (&"dermatome.diff/1".into(), &"turned".into())
    );
    assert_eq!(json["changes"][0]["taxels"].as_array().unwrap().len(), 9);
    let run = common::dermatome(&folder, "diff a.csv a.csv --modules 12").assert().success();
    assert_eq!(run.get_output().stdout, b"144 taxels compared by id, 0 changes\n");
    common::refuses(&folder, "diff a.csv b.csv --modules 0", &["from 1 on"]);
    for option in ["--spacing 3mm", "--outer", "--repair", "--gap 3", "--outside z", "--weld all"] {
        let name = option.split(' ').next().unwrap();
        common::refuses(&folder, &format!("diff a.csv a.csv {option}"), &[name, "changes nothing"]);
    }
    let twice = std::fs::read_to_string(folder.path().join("a.csv")).unwrap().replace("\n2,", "\n1,");
    std::fs::write(folder.path().join("twice.csv"), twice).unwrap();
    let run = common::dermatome(&folder, "diff twice.csv twice.csv").assert().code(1);
    assert!(String::from_utf8_lossy(&run.get_output().stderr).contains("2 taxels not compared"));
    let text = std::fs::read_to_string(folder.path().join("a.csv")).unwrap();
    let with_modules: String = text
        .lines()
        .zip(modules.lines())
        .map(|(a, m)| format!("{a},{}\n", m.rsplit(',').next().unwrap()))
        .collect();
    std::fs::write(folder.path().join("named.csv"), with_modules).unwrap();
    let run = common::dermatome(&folder, "diff named.csv b.csv").assert().code(1);
    assert!(String::from_utf8_lossy(&run.get_output().stdout).contains("module m6"));

    common::dermatome(&folder, "build a.csv -o m --quiet").assert().success();
    let plot = "diff m/map.glb b.csv --modules m.csv --plot";
    let run = common::dermatome(&folder, &format!("{plot} d.svg")).assert().code(1);
    assert!(String::from_utf8_lossy(&run.get_output().stdout).contains("module m6"));
    let svg = std::fs::read_to_string(folder.path().join("d.svg")).unwrap();
    assert!(svg.contains("turned 1") && svg.contains(">m6<"), "{svg}");
    let run = common::dermatome(&folder, &format!("{plot} - -o p.csv")).assert().code(1);
    assert_eq!(String::from_utf8_lossy(&run.get_output().stdout).trim(), svg.trim());
    common::dermatome(&folder, &format!("{plot} d.png")).assert().code(1);
    assert!(std::fs::read(folder.path().join("d.png")).unwrap().starts_with(b"\x89PNG"));
    common::refuses(&folder, "diff a.csv b.csv --plot x.svg", &["a.csv", "needed: a map"]);
    common::refuses(&folder, "diff m/map.glb b.csv --plot x.pdf", &["x.pdf", ".svg, .png"]);
    common::refuses(&folder, "diff m/map.glb b.csv -o x.csv --plot ./x.csv", &["x.csv"]);
}
