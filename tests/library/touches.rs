//! From touches to positions of taxels: the source paper's experiment with readings, and its laws.

use std::collections::BTreeMap;

use dermatome::calib::Pose;
use dermatome::id::IdVec;
use dermatome::io::{read_observations, write_touch_contacts};
use dermatome::mesh::shapes;
use dermatome::signal::Channel;
use dermatome::skin::{Draft, Link, LinkId, Motion, MotionFrame, Sheet, Skin, TaxelId};
use dermatome::touches::{
    ArmOptions, ArmSimulation, Drawing, LeftOutReading, LogFaults, LogFindingKind, RowSources, TouchBody,
    TouchContact, TouchFrame, TouchLog, TouchReadings, TouchRow, TouchesOptions, contacts_of_touches,
    examine_log, links_of_rows, log_of_rows, simulate_arm,
};
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// The weighted mean of the contacts of each taxel, and how many there are.
fn positions(contacts: &[TouchContact]) -> BTreeMap<TaxelId, (DVec3, usize)> {
    let mut sums: BTreeMap<TaxelId, (DMat3, DVec3, usize)> = BTreeMap::new();
    for contact in contacts {
        let information = DMat3::from_cols_array_2d(&contact.information.0);
        let sum = sums.entry(contact.taxel).or_insert((DMat3::ZERO, DVec3::ZERO, 0));
        sum.0 += information;
        sum.1 += information * contact.position;
        sum.2 += 1;
    }
    sums.into_iter().map(|(id, (m, b, count))| (id, (m.inverse() * b, count))).collect()
}

/// Position and truth of the taxels with five or more touches.
fn pairs(simulation: &ArmSimulation, contacts: &[TouchContact]) -> Vec<(DVec3, DVec3)> {
    let truth = |id: TaxelId| simulation.truth[id.0.into()].position;
    let found = positions(contacts).into_iter().filter(|(_, (_, count))| *count >= 5);
    found.map(|(id, (position, _))| (position, truth(id))).collect()
}

fn rms(of: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = of.map(|x| x * x).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

fn error(pairs: &[(DVec3, DVec3)]) -> f64 {
    rms(pairs.iter().map(|(a, b)| a.distance(*b)))
}

/// Indentation in m: force that presses so deep.
fn pressed(depth: f64, options: ArmOptions) -> ArmSimulation {
    simulate_arm(&ArmOptions { force: options.force_at(depth), ..options }).unwrap()
}

/// Without noise positions are exact to much less than 0.1 mm, from the readings alone, and however deep the skin is pressed
/// in.
#[test]
fn indentation_moves_no_taxel() {
    let mut all = Vec::new();
    for depth in [5e-4, 1e-3, 2e-3] {
        let simulation = pressed(depth, ArmOptions { taxels: 120, speed: 0.04, ..ArmOptions::default() });
        assert!((simulation.depth - depth).abs() < 1e-6, "{} m", simulation.depth);
        let found = contacts_of_touches(&simulation.log, &TouchesOptions::default()).unwrap();
        assert_eq!(found.summary.fitted, 120, "at {depth} m");
        let pairs: Vec<_> = positions(&found.contacts)
            .into_iter()
            .map(|(id, (position, _))| (position, simulation.truth[id.0.into()].position))
            .collect();
        let error = error(&pairs);
        println!("{depth} m deep: {:.4} mm", error * 1e3);
        assert!(error < 2e-5, "{error} m at {depth} m");
        all.push(pairs);
    }
    let moved = all[0].iter().zip(&all[2]).map(|((a, _), (b, _))| a.distance(*b)).fold(0.0, f64::max);
    println!("moved by at most {:.4} mm", moved * 1e3);
    assert!(moved < 1e-4, "{moved} m");
}

/// With 1 mm of noise on the arm in each frame, a taxel cannot be known better from its own frames than
/// `1 mm sqrt(3 / frames)` if each of them showed where on the body it is (Cramer-Rao). Since the readings of a frame also say where
/// its taxels are to each other, all taxels together are better than that.
#[test]
fn noise_of_the_arm_is_within_the_bound() {
    let sigma = 1e-3;
    for seed in 0..2 {
        let options = ArmOptions { taxels: 150, arm_noise: sigma, seed, ..ArmOptions::default() };
        let simulation = simulate_arm(&options).unwrap();
        let found = contacts_of_touches(&simulation.log, &TouchesOptions::default()).unwrap();
        let mut frames: BTreeMap<TaxelId, usize> = BTreeMap::new();
        for (id, _) in simulation.log.frames.iter().flat_map(|frame| &frame.felt) {
            *frames.entry(*id).or_default() += 1;
        }
        let bound = rms(frames.values().map(|&n| sigma * (3.0 / n as f64).sqrt()));
        let error = error(&pairs(&simulation, &found.contacts));
        let arm = found.summary.arm_noise;
        println!("seed {seed}: {:.3} mm, bound {:.3} mm, arm {:.3} mm", error * 1e3, bound * 1e3, arm * 1e3);
        assert!(error < 1.1 * bound, "{error} m, bound {bound} m");
        assert!((arm / sigma - 1.0).abs() < 0.1, "the noise of the arm is found: {arm} m");
    }
}

/// What goes to the calibration at once is what the table of contacts says.
#[test]
fn observations_of_contacts_are_those_of_their_table() {
    let simulation = simulate_arm(&ArmOptions { taxels: 60, ..ArmOptions::default() }).unwrap();
    let found = contacts_of_touches(&simulation.log, &TouchesOptions::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("contacts.csv");
    write_touch_contacts(path.as_path(), &found).unwrap();
    let (read, remarks) = read_observations(&path, &[]).unwrap();
    assert_eq!((read, remarks), (found.observations(), Vec::new()));
}

/// The sum of readings over the whole skin is the force, where discs cover it: each reads the pressure of its disc, of which
/// there is one in a cell of the lattice. Discs are flat, so that on a sphere of radius `R` they lie
/// `r^2 / 4R` above it on average, and read that much more depth.
#[test]
fn readings_add_up_to_the_force() {
    let simulation = simulate_arm(&ArmOptions { taxels: 300, force: 1.2, ..ArmOptions::default() }).unwrap();
    let cell = 0.75_f64.sqrt() * 0.005 * 0.005;
    let disc = std::f64::consts::PI * 0.002 * 0.002;
    let inner = simulation.log.frames.iter().filter(|frame| {
        let TouchBody::Sphere { centre, .. } = frame.body else { return false };
        let at = frame.link.rotation.conjugate() * (centre - frame.link.position);
        at.x.hypot(at.y) < 0.03
    });
    let forces: Vec<f64> = inner.map(|frame| frame.felt.iter().map(|(_, x)| x * cell / disc).sum()).collect();
    let mean = forces.iter().sum::<f64>() / forces.len() as f64;
    let area = 2.0 * std::f64::consts::PI * (0.1 * 0.01 / 0.11) * simulation.depth;
    let expected = 1.2 + 2e7 * area * 0.002 * 0.002 / (4.0 * 0.1);
    println!("{mean} N of {expected} N in {} frames", forces.len());
    assert!((mean / expected - 1.0).abs() < 0.01, "{mean} N of {expected} N");
}

fn frame(row: usize, touch: u64, felt: &[(u32, f64)]) -> TouchFrame {
    TouchFrame {
        row,
        time: Some(row as f64),
        touch,
        contact: None,
        link: Pose::default(),
        body: TouchBody::Sphere { centre: DVec3::new(0.0, 0.0, 0.012), radius: 0.0 },
        body_rotation: None,
        felt: felt.iter().map(|&(id, x)| (TaxelId(id), x)).collect(),
        by_joints: Vec::new(),
    }
}

/// A log in disorder is refused with the row.
#[test]
fn logs_in_disorder_are_refused() {
    let log = |frames: Vec<TouchFrame>| TouchLog { frames, has_readings: true, ..TouchLog::default() };
    let felt = [(3, 1.0), (4, 2.0)];
    let kind = |log: TouchLog| {
        let error = contacts_of_touches(&log, &TouchesOptions::default()).unwrap_err();
        (error.kind(), error.to_string())
    };
    let backwards = TouchFrame { time: Some(0.5), ..frame(2, 0, &felt) };
    let turned = TouchFrame {
        link: Pose { position: DVec3::ZERO, rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 1.1) },
        ..frame(2, 0, &felt)
    };
    for (frames, expected) in [
        (vec![frame(1, 0, &felt), backwards], "out_of_order"),
        (vec![frame(1, 0, &felt), frame(2, 1, &felt), frame(3, 0, &felt)], "resumed"),
        (vec![frame(1, 0, &felt), turned], "invalid_frame"),
        (vec![frame(1, 0, &[(3, 1.0), (3, 2.0)])], "taxel_twice"),
        (vec![frame(1, 0, &[(3, -1.0)])], "bad_reading"),
        (vec![frame(1, 0, &[])], "nothing_felt"),
    ] {
        let (found, message) = kind(log(frames));
        assert_eq!(found, expected, "{message}");
        assert!(expected == "nothing_felt" || message.contains("line "), "{message}");
    }
    let drawing = Some(Drawing { normals: [(TaxelId(3), DVec3::Z)].into(), ..Drawing::default() });
    let options = TouchesOptions { drawing, ..TouchesOptions::default() };
    let error = contacts_of_touches(&log(vec![frame(7, 0, &felt)]), &options).unwrap_err().to_string();
    assert!(error.contains("line 7: taxel 4 is not in the drawing"), "{error}");
}

/// Without readings and radius a contact is where the body was, all taxels alike, each touch by itself.
#[test]
fn without_readings_contacts_are_where_the_body_was() {
    let log = TouchLog {
        frames: vec![frame(1, 5, &[(3, 1.0), (4, 1.0)]), frame(2, 6, &[(4, 1.0)])],
        ..TouchLog::default()
    };
    let found = contacts_of_touches(&log, &TouchesOptions::default()).unwrap();
    let rows: Vec<_> = found.contacts.iter().map(|c| (c.touch, c.taxel.0, c.weight)).collect();
    assert_eq!(rows, [(5, 3, 1.0), (5, 4, 1.0), (6, 4, 1.0)]);
    assert!(found.contacts.iter().all(|c| c.position == DVec3::new(0.0, 0.0, 0.012)));
    assert_eq!((found.summary.fitted, found.summary.lone), (0, 0));
}

/// The position that contacts of a taxel have together.
fn only_position(contacts: &[TouchContact]) -> DVec3 {
    positions(contacts).into_values().next().unwrap().0
}

/// A plane says how high a taxel is and nothing else; planes of three normals say where it is.
#[test]
fn planes_of_three_normals_place_a_taxel() {
    let at = DVec3::new(0.02, -0.03, 0.05);
    let normals = [DVec3::X, DVec3::Y, DVec3::new(0.0, 0.6, 0.8)];
    let plane = |(row, normal): (usize, DVec3)| {
        // Its point is anywhere on it.
        let point = at + 0.2 * normal.any_orthonormal_vector();
        TouchFrame { body: TouchBody::Plane { point, normal }, ..frame(row + 1, row as u64, &[(3, 1.0)]) }
    };
    let frames = normals.into_iter().enumerate().map(plane).collect();
    let log = TouchLog { frames, has_readings: false, ..TouchLog::default() };
    let found = contacts_of_touches(&log, &TouchesOptions::default()).unwrap();
    for (contact, normal) in found.contacts.iter().zip(normals) {
        let information = DMat3::from_cols_array_2d(&contact.information.0);
        let (along, across) = (information * normal, information * normal.any_orthonormal_vector());
        assert!(along.length() > 1.0 && across.length() < 1e-9 * along.length(), "{information}");
    }
    let away = only_position(&found.contacts).distance(at);
    assert!(away < 1e-9, "{away} m");
}

/// Gains of taxels need not be known, nor alike.
#[test]
fn gains_that_differ_move_no_taxel() {
    let mut simulation = pressed(1e-3, ArmOptions { taxels: 120, speed: 0.04, ..ArmOptions::default() });
    for (id, reading) in simulation.log.frames.iter_mut().flat_map(|frame| &mut frame.felt) {
        *reading *= 1.0 + 0.3 * f64::from(id.0).sin();
    }
    let found = contacts_of_touches(&simulation.log, &TouchesOptions::default()).unwrap();
    let error = error(&pairs(&simulation, &found.contacts));
    println!("{:.4} mm", error * 1e3);
    assert!(error < 1e-4, "{error} m");
}

/// A sphere below a drawn skin is named with its row.
#[test]
fn spheres_inside_the_drawing_are_named() {
    let felt = [(3, 1.0), (4, 2.0)];
    let inside = TouchBody::Sphere { centre: DVec3::new(0.0, 0.0, -0.012), radius: 0.015 };
    let outside = TouchBody::Sphere { centre: DVec3::new(0.0, 0.0, 0.012), radius: 0.015 };
    let frames = vec![
        TouchFrame { body: outside, ..frame(2, 0, &felt) },
        TouchFrame { body: inside, ..frame(3, 1, &felt) },
    ];
    let drawing = Drawing {
        positions: [(TaxelId(3), DVec3::ZERO), (TaxelId(4), DVec3::new(0.005, 0.0, 0.0))].into(),
        normals: [(TaxelId(3), DVec3::Z), (TaxelId(4), DVec3::Z)].into(),
        neighbours: [[TaxelId(3), TaxelId(4)]].into(),
    };
    let options = TouchesOptions { drawing: Some(drawing), ..TouchesOptions::default() };
    let found =
        contacts_of_touches(&TouchLog { frames, has_readings: true, ..TouchLog::default() }, &options)
            .unwrap();
    assert_eq!(found.summary.inside, [3]);
}

/// The result does not depend on the number of threads.
#[test]
fn threads_change_nothing() {
    let options = ArmOptions { taxels: 60, arm_noise: 5e-4, seed: 4, ..ArmOptions::default() };
    let simulation = simulate_arm(&options).unwrap();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| contacts_of_touches(&simulation.log, &TouchesOptions::default()).unwrap())
    };
    assert_eq!(on(1), on(3));
}

/// One reading of a log, multiplied by ten or more as by a fault of a converter, is left out and named; it moved its
/// taxel by 3 to 11 mm. Of a log without a fault no more than one reading in 500 is left out.
#[test]
fn one_spiked_reading_is_left_out_and_named() {
    let options = ArmOptions { taxels: 80, arm_noise: 1e-3, seed: 3, ..ArmOptions::default() };
    let simulation = simulate_arm(&options).unwrap();
    let found = |log: &TouchLog| contacts_of_touches(log, &TouchesOptions::default()).unwrap();
    let clean = found(&simulation.log);
    let readings: usize = simulation.log.frames.iter().map(|frame| frame.felt.len()).sum();
    assert!(500 * clean.summary.spikes.len() <= readings, "{:?} of {readings}", clean.summary.spikes);
    let clean = positions(&clean.contacts);
    let middle = simulation.log.frames.len() / 2;
    for (frame, factor) in [(middle, 10.0), (middle + 5, 10.0), (middle + 1, 100.0), (middle + 3, 1e50)] {
        let mut log = simulation.log.clone();
        let felt = &mut log.frames[frame].felt;
        felt.sort_by(|a, b| a.1.total_cmp(&b.1));
        let at = felt.len() / 2;
        felt[at].1 *= factor;
        let (taxel, reading) = felt[at];
        let spiked = found(&log);
        let row = log.frames[frame].row;
        let named = spiked.summary.spikes.contains(&LeftOutReading { row, taxel, reading });
        assert!(named, "times {factor}: {:?}", spiked.summary.spikes);
        let of_taxel = positions(&spiked.contacts)[&taxel].0.distance(clean[&taxel].0);
        assert!(of_taxel < 1e-3, "times {factor}: taxel {taxel} moves by {of_taxel} m");
    }
}

/// A late or early clock is found within 10 ms at 1 mm of noise, and taken off, which brings taxels nearer to where they
/// are. A log without one has none.
#[test]
fn late_readings_are_found_and_taken_off() {
    let options = ArmOptions { taxels: 80, arm_noise: 1e-3, seed: 5, ..ArmOptions::default() };
    let simulation = simulate_arm(&options).unwrap();
    let found = |log: &TouchLog| contacts_of_touches(log, &TouchesOptions::default()).unwrap();
    let clean = found(&simulation.log);
    let delay = clean.summary.delay.unwrap();
    assert!(!delay.is_significant() && delay.removed == 0.0 && delay.seconds.abs() < 0.01, "{delay:?}");
    let usual = self::error(&pairs(&simulation, &clean.contacts));
    for late in [0.04, -0.04, 0.12] {
        let faulty = LogFaults { late, ..LogFaults::default() }.apply(&simulation.log).unwrap();
        let found = found(&faulty.log);
        let delay = found.summary.delay.unwrap();
        let error = self::error(&pairs(&simulation, &found.contacts));
        println!("late {late} s: {delay:?}, {:.3} mm for {:.3} mm", 1e3 * error, 1e3 * usual);
        assert!((delay.seconds - late).abs() < 0.01 && (delay.removed - late).abs() < 0.01, "{delay:?}");
        let none = TouchesOptions { delay: Some(0.0), ..TouchesOptions::default() };
        let worse = contacts_of_touches(&faulty.log, &none).unwrap();
        let worse = self::error(&pairs(&simulation, &worse.contacts));
        assert!(error < 0.6 * worse, "{error} m, {worse} m with the delay, {usual} m in the clean log");
        let given = TouchesOptions { delay: Some(late), ..TouchesOptions::default() };
        let given = contacts_of_touches(&faulty.log, &given).unwrap().summary.delay.unwrap();
        assert!(
            (given.removed - late).abs() < 1e-12 && (given.seconds - late).abs() < 0.01,
            "as given: {given:?}"
        );
    }
}

/// Lines that all go one way say nothing of the delay: it is a motion of all taxels along them.
#[test]
fn one_direction_does_not_tell_a_delay() {
    let options = ArmOptions { taxels: 80, arm_noise: 1e-3, seed: 5, ..ArmOptions::default() };
    let simulation = simulate_arm(&options).unwrap();
    let mut log = LogFaults { late: 0.04, ..LogFaults::default() }.apply(&simulation.log).unwrap().log;
    // Every other line of the raster goes back.
    log.frames.retain(|frame| frame.touch % 2 == 0);
    let delay = contacts_of_touches(&log, &TouchesOptions::default()).unwrap().summary.delay;
    println!("{delay:?}");
    // Of lines both ways it is 1.7 ms.
    assert!(delay.is_none_or(|delay| delay.sigma > 5e-3 && delay.removed == 0.0), "{delay:?}");
}

/// What is not a reading is refused with its line; squares of what is accepted are numbers.
#[test]
fn readings_beyond_all_units_are_refused() {
    let simulation = simulate_arm(&ArmOptions { taxels: 30, ..ArmOptions::default() }).unwrap();
    let at = simulation.log.frames.iter().position(|frame| frame.felt.len() > 1).unwrap();
    let found = |reading: f64| {
        let mut log = simulation.log.clone();
        log.frames[at].felt[1].1 = reading;
        contacts_of_touches(&log, &TouchesOptions::default()).map(|_| ()).map_err(|error| error.to_string())
    };
    for reading in [f64::NAN, f64::INFINITY, 1e200, 0.0, -1.0, 1e-200] {
        let said = found(reading).unwrap_err();
        assert!(said.contains(&format!("line {}", simulation.log.frames[at].row)), "{reading}: {said}");
    }
    assert_eq!(found(1e99), Ok(()));
}

/// A sphere that presses and slides: the readings fall upwards, as far as the touch tells.
#[test]
fn readings_show_which_side_is_outside() {
    let frame = |k: usize, height: f64, depth: f64| TouchFrame {
        row: k,
        time: Some(0.1 * k as f64),
        touch: 0,
        contact: None,
        link: Pose::default(),
        body: TouchBody::Sphere {
            centre: DVec3::new(1e-3 * (k as f64 * 1.7).sin(), 0.0, height),
            radius: 0.01,
        },
        body_rotation: None,
        felt: (0..3).map(|id| (TaxelId(id), depth * f64::from(id + 1))).collect(),
        by_joints: Vec::new(),
    };
    let frames = (0..9).map(|k| {
        let depth = 1e-4 * (1.0 + (4.0 - (k as f64 - 4.0).abs()));
        frame(k, 0.01 - depth, depth)
    });
    let log = TouchLog { frames: frames.collect(), has_readings: true, ..TouchLog::default() };
    let ids = [0, 1, 2].map(TaxelId);
    let drawing = Drawing {
        positions: ids.iter().map(|id| (*id, DVec3::X * 4e-3 * f64::from(id.0))).collect(),
        normals: ids.iter().map(|id| (*id, DVec3::Z)).collect(),
        neighbours: [[ids[0], ids[1]], [ids[1], ids[2]]].into(),
    };
    let options = TouchesOptions { drawing: Some(drawing), ..TouchesOptions::default() };
    let found = contacts_of_touches(&log, &options).unwrap();
    let outward = found.contacts[0].outward.unwrap();
    assert!(outward.z > 10.0 && outward.normalize().z > 0.9, "{outward}");
    let body = found.contacts[0].body.unwrap();
    assert!((body.radius - 0.01).abs() < 1e-9 && (body.centre.z - 0.0097).abs() < 1e-4, "{body:?}");
}

/// The arm of the tests of whole logs: 60 taxels, 0.5 mm of noise.
fn small_arm() -> ArmSimulation {
    simulate_arm(&ArmOptions { taxels: 60, arm_noise: 5e-4, ..ArmOptions::default() }).unwrap()
}

/// A robot that rolls over its skin without lifting has one touch, which does not tell the side.
#[test]
fn one_long_touch_does_not_decide_the_side() {
    let mut simulation = small_arm();
    simulation.log.frames.iter_mut().for_each(|frame| frame.touch = 0);
    let found = contacts_of_touches(&simulation.log, &TouchesOptions::default()).unwrap();
    let truth = |id: TaxelId| simulation.truth[id.0.into()].position;
    let far = rms(positions(&found.contacts).into_iter().map(|(id, (at, _))| at.distance(truth(id))));
    println!("{:.2} mm", 1e3 * far);
    assert!(far < 2e-3, "{far} m");
}

/// Lengths of another unit, also of the radius alone, and a log that is mostly left out are refused.
#[test]
fn what_is_no_log_of_a_skin_in_metres_is_refused() {
    let simulation = small_arm();
    let kind = |change: &dyn Fn(&mut TouchFrame)| {
        let mut log = simulation.log.clone();
        log.frames.iter_mut().for_each(change);
        let error = contacts_of_touches(&log, &TouchesOptions::default()).unwrap_err();
        (error.kind(), examine_log(&log).unwrap().findings[0].kind)
    };
    let scaled = |by: f64| {
        move |frame: &mut TouchFrame| {
            if let TouchBody::Sphere { radius, .. } = &mut frame.body {
                *radius *= by;
            }
        }
    };
    assert_eq!(kind(&scaled(1e3)), ("radius", LogFindingKind::Radius));
    assert_eq!(kind(&scaled(10.0)), ("profile", LogFindingKind::Readings));
    // With a drawing the fit of bodies judges them: noise of the arm makes readings unlike those of spheres, too.
    let mut log = simulation.log.clone();
    let placed = || (0..).map(TaxelId).zip(&simulation.truth);
    let drawing = Drawing {
        positions: placed().map(|(id, pose)| (id, pose.position)).collect(),
        normals: placed().map(|(id, pose)| (id, pose.rotation * DVec3::Z)).collect(),
        ..Drawing::default()
    };
    let drawn = TouchesOptions { drawing: Some(drawing), ..TouchesOptions::default() };
    let is_unlike = |log: &TouchLog| contacts_of_touches(log, &drawn).unwrap().summary.unlike_spheres;
    assert!(!is_unlike(&log));
    log.frames.iter_mut().for_each(scaled(10.0));
    assert!(is_unlike(&log));
    let in_mm = |frame: &mut TouchFrame| {
        if let TouchBody::Sphere { centre, .. } = &mut frame.body {
            *centre *= 1e3;
        }
    };
    assert_eq!(kind(&in_mm), ("lengths", LogFindingKind::Unit));
    let options = TouchesOptions { left_out: [TaxelId(999)].into(), ..TouchesOptions::default() };
    let error = contacts_of_touches(&simulation.log, &options).unwrap_err();
    assert_eq!(error.kind(), "unknown_left_out");
    assert!(options.left_out_of(&simulation.log).left_out.is_empty());
}

/// Rows of a log, a frame each, of one taxel; `x` is where the body is.
fn row(row: usize, time: f64, x: f64) -> TouchRow {
    TouchRow {
        row,
        time: Some(time),
        touch: None,
        contact: None,
        link: "arm".into(),
        pose: Some(Pose::default()),
        body: TouchBody::Sphere { centre: DVec3::new(x, 0.0, 0.0), radius: 0.0 },
        body_rotation: None,
        body_link: None,
        felt: Some(vec![(TaxelId(3), Some(1.0))]),
    }
}

/// Without numbers a touch ends at a pause and at rows of another link, not where a few frames are missing.
#[test]
fn touches_end_at_pauses_and_rows_of_other_links() {
    let at = |times: &[f64]| times.iter().zip(2..).map(|(t, k)| row(k, *t, 0.0)).collect::<Vec<_>>();
    let numbers = |rows: &[TouchRow]| {
        let sources = RowSources { link: Some("arm"), ..RowSources::default() };
        log_of_rows(rows, &sources).unwrap().log.frames.iter().map(|frame| frame.touch).collect::<Vec<_>>()
    };
    assert_eq!(numbers(&at(&[0.0, 0.1, 0.2, 0.5, 0.6, 3.0, 3.1])), [0, 0, 0, 0, 0, 1, 1]);
    let mut rows = at(&[0.0, 0.1, 0.2, 0.3]);
    rows[2].link = "hand".into();
    assert_eq!(numbers(&rows), [0, 0, 1]);
}

/// Poses that a table has at these times, of a link that moves by 1 m/s along x.
fn moving(times: &[f64]) -> (Motion, IdVec<LinkId, Link>) {
    let links = links_of_rows(&[row(2, 0.0, 0.0)], []);
    let mut motion = Motion::default();
    let keys: Vec<(f64, DAffine3)> =
        times.iter().map(|&t| (t, DAffine3::from_translation(DVec3::new(t, 0.0, 0.0)))).collect();
    motion.set(LinkId::from(0), MotionFrame::World, &keys).unwrap();
    (motion, links)
}

/// Where a link was in a pause of its poses is not known: such rows are left out. A clock that begins anew is refused.
#[test]
fn poses_are_not_invented() {
    let (motion, links) = moving(&[0.0, 0.1, 0.2, 0.3, 2.0, 2.1, 2.2]);
    let log = |times: &[f64]| {
        let rows: Vec<TouchRow> = times
            .iter()
            .zip(2..)
            .map(|(t, k)| TouchRow { pose: None, touch: Some(k as u64), ..row(k, *t, 0.0) })
            .collect();
        log_of_rows(&rows, &RowSources { motion: Some((&motion, &links)), ..RowSources::default() })
    };
    let made = log(&[0.05, 0.25, 1.0, 1.5, 2.05]).unwrap();
    assert_eq!((made.unposed, made.log.frames.len()), (2, 3));
    assert!(made.remarks()[0].contains("in a pause of the poses"), "{:?}", made.remarks());
    assert_eq!(log(&[0.05, 0.25, 0.1]).unwrap_err().kind(), "clock_restarts");
}

/// Readings: the period is the usual step, ids are those of one column, most are 0 at rest, and the channel measures touches.
#[test]
fn readings_that_are_not_of_touches_are_refused() {
    let rows = |times: &[f64]| -> Vec<TouchRow> {
        times.iter().zip(2..).map(|(t, k)| TouchRow { felt: None, ..row(k, *t, 0.0) }).collect()
    };
    let readings = |ids: [u32; 2], rest: f64| {
        let mut readings =
            TouchReadings { ids: ids.map(TaxelId).to_vec(), threshold: 0.5, ..TouchReadings::default() };
        for k in 0..40 {
            // A pause of ten seconds, which a mean step would count.
            let time = 0.1 * f64::from(k) + if k < 20 { 0.0 } else { 10.0 };
            readings.push(time, &[rest + f64::from(u8::from(k % 4 == 0)), rest]).unwrap();
        }
        readings
    };
    let log = |times: &[f64], readings: &TouchReadings| {
        log_of_rows(&rows(times), &RowSources { readings: Some(readings), ..RowSources::default() })
    };
    assert_eq!(log(&[0.4, 12.4], &readings([3, 4], 0.0)).unwrap().log.frames.len(), 2);
    assert_eq!(log(&[0.4, 2.2], &readings([3, 4], 0.0)).unwrap_err().kind(), "off_clock");
    assert_eq!(log(&[0.4], &readings([3, 3], 0.0)).unwrap_err().kind(), "column_twice");
    assert_eq!(log(&[0.4], &readings([3, 4], 2000.0)).unwrap_err().kind(), "always_active");
    let mut of = readings([3, 4], 0.0);
    let heat = Channel::new("temperature", "degC").unwrap();
    assert_eq!(of.set_threshold(&heat, None, None).unwrap_err().kind(), "not_of_touch");
    let force = Channel::new("force", "N").unwrap();
    of.set_threshold(&force, None, Some(0.02)).unwrap();
    assert_eq!(of.threshold, 0.02);
    of.set_threshold(&force, Some(0.3), Some(0.02)).unwrap();
    assert_eq!(of.threshold, 0.3);
}

/// A log names a link of the skin, if that has several.
#[test]
fn a_link_that_the_skin_lacks_is_refused() {
    let mut skin = Skin::from_mesh("a", shapes::fan(6));
    assert!(Drawing::of_link(&skin, "Hand").is_ok(), "there is one");
    let other = skin.patches.iter().next().unwrap().clone();
    let link = |name: &str| Link { name: name.into(), parent: None, pose: DAffine3::IDENTITY };
    skin.links = vec![link("hand"), link("arm")].into();
    let mut other = other;
    other.link = LinkId::from(1);
    other.taxels.ids.iter_mut().for_each(|id| id.0 += 100);
    skin.patches.push(other);
    assert!(Drawing::of_link(&skin, "hand").is_ok() && Drawing::of_link(&skin, "").is_ok());
    let error = Drawing::of_link(&skin, "Hand").unwrap_err().to_string();
    assert!(error.contains("hand, arm"), "{error}");
    // Taxels in no triangle, too, are of one link of a name.
    let bare = |k: usize| Sheet {
        link: Some(LinkId::new(k)),
        ids: Some(vec![TaxelId(200)]),
        positions: vec![DVec3::ZERO],
        ..Sheet::default()
    };
    let mut draft =
        Draft { links: vec![link("hand"), link("hand")].into(), sheets: vec![bare(1)], ..Draft::default() };
    let mut drawing = Drawing::of_link(&skin, "hand").unwrap();
    assert!(drawing.add_bare(&draft, "hand").is_ok());
    draft.sheets.push(bare(0));
    let error = drawing.add_bare(&draft, "hand").unwrap_err().to_string();
    assert!(error.contains("hand"), "{error}");
}
