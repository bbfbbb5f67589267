//! Laws of simulated touch: what the taxels feel is what the sphere does.

use std::f64::consts::PI;

use dermatome::id::VertexId;
use dermatome::mesh::shapes;
use dermatome::signal::{
    FaultCounts, Frame, Quantity, ReadoutOptions, Scale, SignalError, TaxelState, Touch, TouchOptions,
    TouchSimulation,
};
use dermatome::skin::{LinkId, PatchId, Presence, Skin, TaxelId};
use glam::DVec3;

fn record(skin: &Skin, options: &TouchOptions) -> Vec<(Frame, Option<Touch>)> {
    let mut simulation = TouchSimulation::new(skin, options).unwrap();
    let mut frames = Vec::new();
    while let Some((frame, touches)) = simulation.next_frame() {
        assert!(touches.len() <= options.touches);
        frames.push((frame.clone(), touches.first().copied()));
    }
    assert_eq!(frames.len(), simulation.frames());
    frames
}

/// Readings of the first patch's taxels, with their places.
fn readings<'a>(skin: &'a Skin, frame: &'a Frame) -> impl Iterator<Item = (f64, DVec3, f64)> + 'a {
    let patch = &skin.patches[PatchId::new(0)];
    let places = patch.mesh.positions.iter().zip(&patch.taxels.areas);
    let values = frame.values[PatchId::new(0)][0].iter();
    values.zip(places).map(|(&x, (&p, &area))| (x, p, area))
}

/// On a plane the force is the stiffness times the volume of the cap below it.
#[test]
fn a_press_on_a_plane_has_the_force_of_its_cap() {
    let skin = Skin::from_mesh("plane", shapes::lattice(60, 60, 0.004));
    let options = TouchOptions { seed: 4, ..TouchOptions::default() };
    let cap = PI * options.depths[0].powi(2) * (options.radii[0] - options.depths[0] / 3.0);
    let mut inside = 0;
    for (_, touch) in record(&skin, &options) {
        let Some(touch) = touch else { continue };
        let depth = options.radii[0] - touch.sphere.z;
        let near_border = touch.sphere.min_element().min(touch.sphere.y) < 0.0
            || [touch.sphere.x, 0.236 - touch.sphere.x, touch.sphere.y, 0.204 - touch.sphere.y]
                .iter()
                .any(|d| *d < 0.012);
        // Shallow contacts are small against the parts that triangles are divided into.
        if near_border || depth < 0.5 * options.depths[0] {
            continue;
        }
        inside += 1;
        let volume = PI * depth * depth * (options.radii[0] - depth / 3.0);
        assert!((touch.force / (options.stiffness * volume) - 1.0).abs() < 4e-3, "{touch:?}");
        assert!(touch.centre.distance(touch.sphere.with_z(0.0)) < 2e-5, "{touch:?}");
        assert!(touch.force <= options.stiffness * cap * 1.004);
    }
    assert!(inside > 100, "{inside}");
}

/// Pressure times the taxels' areas adds up to the force, forces to the discs' share of it, and
/// their mean place is that of the pressure.
#[test]
fn readings_add_up_to_the_force() {
    for mesh in [shapes::lattice(60, 60, 0.003), shapes::cap(6000, 0.1, 1.2)] {
        let skin = Skin::from_mesh("skin", mesh);
        for quantity in [Quantity::Intensive, Quantity::Extensive] {
            let options = TouchOptions { quantity, rate: 25.0, seed: 2, ..TouchOptions::default() };
            let disc = PI * options.taxel_radius.powi(2);
            let mut checked = 0;
            for (frame, touch) in record(&skin, &options) {
                let total: f64 = readings(&skin, &frame).map(|(x, _, _)| x).sum();
                let Some(touch) = touch else {
                    assert_eq!(total, 0.0, "nothing is touched");
                    continue;
                };
                let felt: Vec<_> = readings(&skin, &frame).filter(|(x, _, _)| *x > 0.0).collect();
                assert_eq!(felt.len(), touch.taxels);
                let force = |(x, _, area): (f64, DVec3, f64)| match quantity {
                    Quantity::Intensive => x * area,
                    Quantity::Extensive => x * area / disc,
                };
                let sum: f64 = felt.iter().copied().map(force).sum();
                let centre = felt.iter().map(|&r| force(r) * r.1).sum::<DVec3>() / sum;
                // Where the skin ends, a disc feels what is not skin.
                if touch.taxels < 15
                    || touch.centre.distance(touch.sphere) > options.radii[0] - 0.5 * options.depths[0]
                {
                    continue;
                }
                checked += 1;
                assert!((sum / touch.force - 1.0).abs() < 0.05, "{sum} N of {} N", touch.force);
                assert!(centre.distance(touch.centre) < 4e-4, "{centre} for {}", touch.centre);
            }
            assert!(checked > 20, "{checked}");
        }
    }
}

/// The same seed gives the same recording; noise, drift and dead taxels leave the places as they
/// are.
#[test]
fn noise_drift_and_dead_taxels_move_no_press() {
    let mut skin = Skin::from_mesh("skin", shapes::cap(800, 0.1, 1.0));
    let absent = 7.into();
    skin.patches[PatchId::new(0)].taxels.presence[absent] = Presence::Absent;
    let plain = TouchOptions { rate: 20.0, presses: 2, ..TouchOptions::default() };
    let disturbed = TouchOptions { noise: 100.0, drift: 50.0, dead: 0.1, ..plain.clone() };
    let (a, b) = (record(&skin, &plain), record(&skin, &disturbed));
    assert_eq!(format!("{a:?}"), format!("{:?}", record(&skin, &plain)));
    assert_ne!(format!("{a:?}"), format!("{:?}", record(&skin, &TouchOptions { seed: 1, ..plain.clone() })));
    let area = PI * plain.taxel_radius.powi(2);
    let (mut squares, mut count, mut dead) = (0.0, 0.0, 0);
    for ((clean, one), (noisy, other)) in a.iter().zip(&b) {
        let place = |touch: &Option<Touch>| touch.map(|t| (t.press, t.sphere, t.centre, t.force));
        assert_eq!(place(one), place(other));
        let pairs = clean.values[PatchId::new(0)][0].enumerate().zip(&noisy.values[PatchId::new(0)][0]);
        for ((taxel, x), y) in pairs {
            assert_eq!(x.is_nan(), taxel == absent, "{taxel}");
            dead += usize::from(y.is_nan() && !x.is_nan());
            if clean.time == 0.0 && !y.is_nan() {
                squares += ((y - x) / area).powi(2);
                count += 1.0;
            }
        }
    }
    let sigma = (squares / count).sqrt();
    assert!((80.0..120.0).contains(&sigma), "noise of {sigma} Pa in the first frame");
    let share = dead as f64 / (a.len() * 800 / 2) as f64;
    assert!((0.02..0.25).contains(&share), "{share}");
}

/// Spheres that press at once never overlap, each has its own number, and taxels feel all of them;
/// where there is no room for a second one, one presses.
#[test]
fn spheres_at_once_stay_apart() {
    let skin = Skin::from_mesh("skin", shapes::lattice(60, 60, 0.004));
    let options = TouchOptions { touches: 3, rate: 25.0, seed: 3, ..TouchOptions::default() };
    let mut simulation = TouchSimulation::new(&skin, &options).unwrap();
    let mut presses = std::collections::BTreeSet::new();
    while let Some((frame, touches)) = simulation.next_frame() {
        let force: f64 = touches.iter().map(|touch| touch.force).sum();
        let felt: f64 = readings(&skin, frame).map(|(x, _, _)| x).sum();
        assert_eq!(felt > 0.0, touches.iter().any(|touch| touch.taxels > 0), "{force}");
        assert!(felt <= force * 1.3, "{felt} N of {force} N");
        presses.extend(touches.iter().map(|touch| touch.press));
        for (k, touch) in touches.iter().enumerate() {
            assert!(
                touch.press / 3 == touches[0].press / 3 && (k == 0 || touch.press > touches[k - 1].press)
            );
            for other in &touches[..k] {
                let apart = touch.sphere.distance(other.sphere);
                assert!(apart > 2.0 * options.radii[0] - 0.004, "{apart} m at {} s", touch.time);
            }
        }
    }
    assert_eq!(presses.len(), 15);
    let small = Skin::from_mesh("small", shapes::lattice(6, 6, 0.004));
    for (_, touch) in record(&small, &TouchOptions { touches: 2, ..options }) {
        assert!(touch.is_none_or(|touch| touch.press % 2 == 0));
    }
}

#[test]
fn invalid_options_are_refused() {
    let skin = Skin::from_mesh("skin", shapes::square());
    let d = TouchOptions::default();
    for options in [
        TouchOptions { radii: vec![-1.0], ..d.clone() },
        TouchOptions { radii: Vec::new(), ..d.clone() },
        TouchOptions { depths: [0.002, 0.001], ..d.clone() },
        TouchOptions { aspect: 0.5, ..d.clone() },
        TouchOptions { exponent: 0.0, ..d.clone() },
        TouchOptions { hysteresis: -0.1, ..d.clone() },
        TouchOptions { steps: vec![0.0], ..d.clone() },
        TouchOptions { depths: [0.015; 2], ..d.clone() },
        TouchOptions { rate: 0.0, ..d.clone() },
        TouchOptions { duration: f64::NAN, ..d.clone() },
        TouchOptions { noise: -1.0, ..d.clone() },
        TouchOptions { dead: 1.0, ..d.clone() },
        TouchOptions { presses: usize::MAX, ..d.clone() },
        TouchOptions { touches: 0, ..d.clone() },
        TouchOptions { touches: 101, ..d.clone() },
        TouchOptions { readout: ReadoutOptions { gain_spread: -0.1, ..d.readout }, ..d.clone() },
        TouchOptions { readout: ReadoutOptions { flicker: f64::NAN, ..d.readout }, ..d.clone() },
        TouchOptions {
            readout: ReadoutOptions { faults: d.readout.faults.with(TaxelState::Swapped, 3), ..d.readout },
            ..d.clone()
        },
    ] {
        let refused = TouchSimulation::new(&skin, &options);
        assert!(matches!(refused, Err(SignalError::Option { .. })), "{options:?}");
    }
    let mut none = skin;
    for presence in none.patches[PatchId::new(0)].taxels.presence.iter_mut() {
        *presence = Presence::Absent;
    }
    assert!(matches!(TouchSimulation::new(&none, &d), Err(SignalError::NoTaxels)));
}

/// All readings of one taxel.
fn readings_of(skin: &Skin, frames: &[(Frame, Option<Touch>)], id: TaxelId) -> Vec<f64> {
    let patch = PatchId::new(0);
    let at = skin.patches[patch].taxels.ids.iter().position(|other| *other == id).unwrap();
    frames.iter().map(|(frame, _)| frame.values[patch][0][VertexId::new(at)]).collect()
}

/// The inverse of the true response of a taxel gives the pressure that it felt; presses stay where they are.
#[test]
fn readings_follow_the_true_response() {
    let skin = Skin::from_mesh("skin", shapes::cap(400, 0.1, 1.0));
    let quantity = Quantity::Intensive;
    let plain = TouchOptions { rate: 20.0, quantity, ..TouchOptions::default() };
    let readout = ReadoutOptions {
        gain_spread: 0.4,
        exponent_spread: 0.1,
        is_inverted: true,
        ..ReadoutOptions::default()
    };
    let spread = TouchOptions { readout, ..plain.clone() };
    let (felt, read) = (record(&skin, &plain), record(&skin, &spread));
    let truth = TouchSimulation::new(&skin, &spread).unwrap().response().clone();
    let count = skin.patches[PatchId::new(0)].mesh.positions.len();
    assert_eq!((truth.scale, truth.taxels.len()), (Some(Scale::Pascals), count));
    let (mut touched, mut squares) = (0, 0.0);
    for known in &truth.taxels {
        let (gain, exponent) = (known.gain.unwrap(), known.exponent.unwrap());
        assert!(gain < 0.0 && known.state == TaxelState::Ok, "{known:?}");
        let pairs =
            readings_of(&skin, &felt, known.taxel).into_iter().zip(readings_of(&skin, &read, known.taxel));
        for (p, c) in pairs {
            let found = gain.abs() * (gain.signum() * c).max(0.0).powf(exponent);
            assert!((found - p).abs() <= 1e-9 * p, "{found} Pa of {p}");
            touched += usize::from(p > 0.0);
        }
        squares += gain.abs().ln().powi(2) / count as f64;
    }
    assert!(touched > 100 && squares.sqrt() > 0.3, "{touched}, {squares}");
}

/// Each fault does what its name says, and is in the truth.
#[test]
fn faults_are_what_the_truth_says() {
    let skin = Skin::from_mesh("skin", shapes::cap(400, 0.1, 1.0));
    let plain = TouchOptions { rate: 20.0, presses: 60, noise: 100.0, seed: 3, ..TouchOptions::default() };
    let faults = FaultCounts::kinds().iter().fold(FaultCounts::default(), |all, &kind| all.with(kind, 3));
    let faulty =
        TouchOptions { readout: ReadoutOptions { faults, ..ReadoutOptions::default() }, ..plain.clone() };
    let (clean, frames) = (record(&skin, &plain), record(&skin, &faulty));
    let truth = TouchSimulation::new(&skin, &faulty).unwrap().response().clone();
    let others =
        truth.taxels.iter().filter(|known| known.state == TaxelState::Turned).map(|known| known.other);
    let distinct: std::collections::HashSet<_> = others.clone().collect();
    assert_eq!(
        others.count(),
        distinct.len() + 2,
        "each place of a turned module is read once, and three centres"
    );
    let area = PI * plain.taxel_radius.powi(2);
    let (press, sigma) = (area * plain.stiffness * plain.depths[0], area * plain.noise);
    for kind in FaultCounts::kinds() {
        let count = truth.taxels.iter().filter(|known| known.state == *kind).count();
        let needed = match kind {
            TaxelState::Swapped => 6,
            TaxelState::ModuleStep => 36,
            TaxelState::Turned => {
                truth.taxels.iter().filter(|known| known.state == *kind).count().clamp(15, 30)
            }
            _ => 3,
        };
        assert_eq!(count, needed, "{kind}");
    }
    let correlation = |a: &[f64], b: &[f64]| {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
    };
    for known in &truth.taxels {
        let [own, was] = [&frames, &clean].map(|all| readings_of(&skin, all, known.taxel));
        let most = own.iter().copied().fold(0.0, f64::max);
        let same = own.windows(2).filter(|pair| pair[0] == pair[1]).count();
        let jumps = own.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > 0.7 * press).count();
        let moved = own.iter().zip(&was).filter(|(x, y)| (*x - *y).abs() > 0.7 * press).count();
        let rest = own.iter().map(|x| x.abs()).fold(f64::INFINITY, f64::min);
        match known.state {
            TaxelState::Dead => assert!(own.iter().all(|x| *x == 0.0)),
            TaxelState::Stuck => assert!(same * 2 >= own.len() - 2, "{same}"),
            TaxelState::Silent => assert!(most < 0.02 * press + 6.0 * sigma),
            TaxelState::Saturated => assert!(most <= 0.5 * press),
            TaxelState::Jumping => assert!(moved > 12 && (2..=24).contains(&jumps), "{moved} {jumps}"),
            TaxelState::Chattering => assert!((60..=80).contains(&jumps) && moved <= 40, "{jumps} {moved}"),
            TaxelState::ModuleStep => assert!(moved * 3 >= own.len(), "{moved}"),
            TaxelState::Noisy => {
                let quiet: Vec<_> = own.iter().zip(&was).filter(|(_, y)| y.abs() < 4.0 * sigma).collect();
                let noise = (quiet.iter().map(|(x, _)| x.powi(2)).sum::<f64>() / quiet.len() as f64).sqrt();
                assert!((4.0..6.0).contains(&(noise / sigma)), "{noise}");
            }
            TaxelState::Turned if known.other.is_none() => assert!(own == was, "the centre"),
            TaxelState::Swapped | TaxelState::Turned => {
                let other = readings_of(&skin, &clean, known.other.unwrap());
                let is_touched = other.iter().any(|x| *x > 0.2 * press);
                assert!(!is_touched || correlation(&own, &other) > 0.9, "{known:?}");
            }
            TaxelState::Crosstalk => {
                let other = readings_of(&skin, &clean, known.other.unwrap());
                let added: Vec<f64> = own.iter().zip(&was).map(|(x, y)| x - y).collect();
                let is_touched = other.iter().any(|x| *x > 0.2 * press);
                assert!(!is_touched || correlation(&added, &other) > 0.8, "{known:?}");
            }
            _ => assert!(rest < press),
        }
    }
}

/// A sheet of taxels this far apart, flat or on a cylinder of 40 mm radius, and whether each is near its border.
fn sheet(spacing: f64, [columns, rows]: [u32; 2], is_bent: bool) -> (Skin, Vec<bool>) {
    let step = spacing * 0.75_f64.sqrt();
    let mesh = shapes::sheet(columns, rows, |i, j| {
        let (x, y) = (spacing * (f64::from(i) + 0.5 * f64::from(j % 2)), step * f64::from(j));
        let angle = y / 0.04;
        if is_bent { DVec3::new(x, 0.04 * angle.sin(), 0.04 * angle.cos()) } else { DVec3::new(x, y, 0.0) }
    });
    let is_near = |k: u32, count: u32| k < 2 || k + 2 >= count;
    let near = (0..rows).flat_map(|j| (0..columns).map(move |i| is_near(i, columns) || is_near(j, rows)));
    (Skin::from_mesh("sheet", mesh), near.collect())
}

/// The force is the pressure integrated over the skin: on a plane and on a cylinder, for taxels near each other and
/// as far apart as those of a forearm, with and without a cover. A cover keeps it, and facets do not change it.
#[test]
fn forces_are_the_pressure_over_the_skin() {
    for is_bent in [false, true] {
        let mut most = Vec::new();
        for (spacing, size, presses) in [(0.002, [70, 81], 8), (0.0077, [20, 23], 100)] {
            let (skin, is_near_border) = sheet(spacing, size, is_bent);
            for (blur, aspect) in [(0.0, 1.0), (0.0015, 2.5)] {
                let options = TouchOptions {
                    quantity: Quantity::Intensive,
                    blur,
                    aspect,
                    presses,
                    roll: 0.0,
                    rate: 4.0,
                    seed: 9,
                    ..TouchOptions::default()
                };
                let (mut felt, mut forces) = (0.0, Vec::new());
                for (frame, touch) in record(&skin, &options) {
                    let values = &frame.values[PatchId::new(0)][0];
                    let is_cut = values.iter().zip(&is_near_border).any(|(x, near)| *near && *x > 0.0);
                    let Some(touch) = touch.filter(|_| !is_cut) else { continue };
                    felt += readings(&skin, &frame).map(|(x, _, area)| x * area).sum::<f64>();
                    forces.push(touch.force);
                }
                let force: f64 = forces.iter().sum();
                let case = format!("bent {is_bent}, {spacing} m, blur {blur} m");
                assert!(forces.len() > 5, "{case}: {} frames", forces.len());
                assert!((felt / force - 1.0).abs() < 0.01, "{case}: {felt} N felt of {force} N");
                if aspect == 1.0 {
                    forces.sort_by(f64::total_cmp);
                    most.push(forces[3 * forces.len() / 4]);
                }
            }
        }
        assert!((most[1] / most[0] - 1.0).abs() < 0.01, "bent {is_bent}: {most:?} N");
    }
}

/// Two sheets of a link with one taxel distance between them, or on two links.
fn side_by_side(links: usize) -> Skin {
    let mut skin = Skin::from_mesh("a", shapes::lattice(12, 12, 0.004));
    for number in 1..links {
        let pose = glam::DAffine3::IDENTITY;
        skin.links.push(dermatome::skin::Link { name: format!("l{number}"), parent: None, pose });
    }
    let mut mesh = shapes::lattice(12, 12, 0.004);
    mesh.positions.iter_mut().for_each(|x| x.x += 0.048);
    let mut patch = dermatome::skin::Patch::from_mesh("b", LinkId::new(links - 1), mesh);
    patch.taxels.ids.iter_mut().for_each(|id| id.0 += 144);
    skin.patches.push(patch);
    skin
}

/// A body over two patches of one link presses both, and its force is that on both; those of another link are elsewhere.
#[test]
fn bodies_press_all_patches_of_their_link() {
    let options = TouchOptions {
        radii: vec![0.03],
        presses: 20,
        quantity: Quantity::Intensive,
        rate: 20.0,
        ..TouchOptions::default()
    };
    for links in [1, 2] {
        let skin = side_by_side(links);
        let mut both = 0;
        for (frame, touch) in record(&skin, &options) {
            let sums = [0, 1].map(|k| frame.values[PatchId::new(k)][0].iter().sum::<f64>());
            both += usize::from(sums.iter().all(|sum| *sum > 0.0));
            let Some(touch) = touch else { continue };
            let felt = frame.values.iter().flatten().flatten().filter(|x| **x > 0.0).count();
            assert_eq!(touch.taxels, felt, "{links} links");
            let areas = skin.patches.iter().flat_map(|patch| &patch.taxels.areas);
            let pressures = frame.values.iter().flat_map(|patch| &patch[0]);
            let force: f64 = pressures.zip(areas).map(|(pressure, area)| pressure * area).sum();
            assert!(felt < 20 || (touch.force / force - 1.0).abs() < 0.2, "{} N, {force} N", touch.force);
        }
        assert_eq!(both > 10, links == 1, "{both} frames on both patches of {links} links");
    }
}

/// A response names an id once: of taxels of one id that differ no number is known, and a fault of one is a fault.
#[test]
fn the_true_response_of_shared_ids_has_what_they_share() {
    let mut skin = side_by_side(2);
    let ids = skin.patches[PatchId::new(0)].taxels.ids.clone();
    skin.patches[PatchId::new(1)].taxels.ids = ids;
    let faults = FaultCounts::default().with(TaxelState::Dead, 3);
    let readout = |gain_spread| ReadoutOptions { gain_spread, faults, ..ReadoutOptions::default() };
    for spread in [0.0, 0.3] {
        let options = TouchOptions {
            readout: readout(spread),
            quantity: Quantity::Intensive,
            ..TouchOptions::default()
        };
        let simulation = TouchSimulation::new(&skin, &options).unwrap();
        let taxels = &simulation.response().taxels;
        assert_eq!(taxels.len(), 144);
        assert_eq!(taxels.iter().filter(|taxel| taxel.state == TaxelState::Dead).count(), 3);
        assert!(taxels.iter().all(|taxel| taxel.gain.is_some() == (spread == 0.0) && taxel.zero.is_some()));
    }
}
