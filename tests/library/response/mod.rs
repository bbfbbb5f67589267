//! Gains from touches, curves from steps of pressure, and the scale from known forces, on simulated skins whose truth is
//! known.

mod tables;

use dermatome::id::{IdVec, VertexId};
use dermatome::mesh::shapes;
use dermatome::response::{
    Curves, GainEstimator, Gains, ResponseError, ScaleEstimator, StepEstimator, TaxelGain,
};
use dermatome::run::Run;
use dermatome::signal::{Frame, Quantity, Touch, TouchOptions, TouchSimulation};
use dermatome::skin::{PatchId, Skin};

/// Numbers between 0 and 1 that look random.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.next()).ln()).sqrt() * (std::f64::consts::TAU * self.next()).cos()
    }
}

/// Ellipsoids that roll on a cover that blurs, as hands and objects do.
fn usual(radii: &[f64], presses: usize, seed: u64) -> TouchOptions {
    TouchOptions {
        radii: radii.to_vec(),
        depths: [0.001, 0.004],
        aspect: 2.5,
        wobble: 0.1,
        presses,
        duration: 1.25,
        pause: 0.25,
        rate: 20.0,
        blur: 0.0015,
        exponent: 0.85,
        hysteresis: 0.05,
        quantity: Quantity::Intensive,
        seed,
        ..TouchOptions::default()
    }
}

/// The logarithms of the true sensitivities, and what is found from touches; every twentieth taxel is dead.
fn estimate(skin: &Skin, options: &TouchOptions) -> (Vec<f64>, Result<Gains, ResponseError>) {
    estimate_as(skin, options, |_, _| ())
}

/// The same of pressures that `change` turns into others.
fn estimate_as(
    skin: &Skin,
    options: &TouchOptions,
    change: impl Fn(&mut Frame, &[Touch]),
) -> (Vec<f64>, Result<Gains, ResponseError>) {
    let mut numbers = Numbers(options.seed.wrapping_mul(77).wrapping_add(5));
    let taxels: usize = skin.patches.iter().map(|patch| patch.mesh.positions.len()).sum();
    let truth: Vec<f64> = (0..taxels).map(|_| 0.4 * numbers.normal()).collect();
    let is_dead: Vec<bool> = (0..taxels).map(|_| numbers.next() < 0.05).collect();
    let mut simulation = TouchSimulation::new(skin, options).unwrap();
    let mut estimator = GainEstimator::new(skin).unwrap();
    while let Some((frame, touches)) = simulation.next_frame() {
        let mut frame: Frame = frame.clone();
        change(&mut frame, touches);
        let all = frame.values.iter_mut().flat_map(|channels| channels[0].iter_mut());
        for ((x, log), dead) in all.zip(&truth).zip(&is_dead) {
            *x = if *dead { f64::NAN } else { *x * log.exp() + 2000.0 * numbers.normal() };
        }
        estimator.see(&frame);
    }
    (truth, estimator.solve(Run::default()))
}

/// Errors of gains relative to their mean: rms over usable taxels and over all, the share of these, and the mean square
/// over sigma.
fn errors(truth: &[f64], gains: &IdVec<PatchId, IdVec<VertexId, TaxelGain>>) -> [f64; 4] {
    let all: Vec<(f64, &TaxelGain)> = truth.iter().copied().zip(gains.iter().flatten()).collect();
    let live = all.iter().filter(|(_, taxel)| taxel.presses > 0).count() as f64;
    let usable: Vec<(f64, f64)> =
        all.iter().filter(|(_, t)| !t.gain.is_nan()).map(|(log, t)| (log + t.gain.ln(), t.sigma)).collect();
    let count = usable.len() as f64;
    let mean = usable.iter().map(|(x, _)| x).sum::<f64>() / count;
    let square = usable.iter().map(|(x, _)| (x - mean).powi(2)).sum::<f64>() / count;
    let chi = usable.iter().map(|(x, s)| ((x - mean) / s).powi(2)).sum::<f64>() / count;
    [square.sqrt(), count / live, live, chi]
}

/// A part of a forearm: a sheet that is bent by a third of a turn.
fn forearm(columns: u32, rows: u32) -> Skin {
    let spacing = 0.0077;
    let radius = 0.04;
    let bent = shapes::sheet(columns, rows, |i, j| {
        let x = spacing * (f64::from(i) + 0.5 * f64::from(j % 2));
        let angle = spacing * 0.866 * f64::from(j) / radius;
        glam::DVec3::new(x, radius * angle.sin(), radius * angle.cos())
    });
    Skin::from_mesh("forearm", bent)
}

/// Touches alone give gains to their sigma. A taxel without a gain, and one whose readings fall, are not known: neither
/// has a gain of 1.
#[test]
fn touches_alone_give_relative_gains() {
    let skin = forearm(9, 12);
    let options = usual(&[0.008, 0.015, 0.04], 120, 1);
    let [none, negative] = [40, 60].map(VertexId::new);
    let (truth, found) = estimate_as(&skin, &options, |frame, _| {
        let values = &mut frame.values[PatchId::new(0)][0];
        (values[none], values[negative]) = (0.0, -values[negative]);
    });
    let (gains, report) = found.unwrap();
    for taxel in [none, negative].map(|v| gains[PatchId::new(0)][v]) {
        assert!(taxel.gain.is_nan() && taxel.presses == 0, "{taxel:?}");
    }
    let [error, share, _, chi] = errors(&truth, &gains);
    println!("{error:.3} {share:.2} {chi:.2} {report:?}");
    assert!(report.has_converged && report.steps <= 25, "{report:?}");
    assert!(error < 0.09 && share > 0.7, "{error}, {share}");
    assert!((0.3..1.6).contains(&chi), "{chi}");
}

/// One reading of thousands that is a hundred times too large, in a press or between two, changes no gain and is named.
#[test]
fn a_spike_changes_no_gain() {
    let skin = forearm(9, 12);
    let options = usual(&[0.008, 0.015, 0.04], 60, 1);
    let estimate = |at: Option<usize>| {
        let count = std::cell::Cell::new(0);
        let (_, found) = estimate_as(&skin, &options, |frame, _| {
            if Some(count.replace(count.get() + 1)) == at {
                frame.values[PatchId::new(0)][0][VertexId::new(50)] = 4e6;
            }
        });
        found.unwrap()
    };
    let (gains, report) = estimate(None);
    assert_eq!((report.spikes, report.first_spike), (0, None));
    for frame in [165, 189] {
        let (found, spiked) = estimate(Some(frame));
        assert_eq!(spiked.presses, report.presses);
        let first = spiked.first_spike.unwrap();
        assert_eq!((spiked.spikes, first.taxel, first.recording, first.frame), (1, 50, 0, frame));
        for (a, b) in gains.iter().flatten().zip(found.iter().flatten()) {
            assert!(
                (a.gain.is_nan() && b.gain.is_nan()) || (a.gain / b.gain - 1.0).abs() < 0.03,
                "{a:?} {b:?}"
            );
        }
    }
}

/// What touches cannot tell is an error.
#[test]
fn recordings_without_presses_are_refused() {
    let skin = forearm(9, 12);
    let mut none = GainEstimator::new(&skin).unwrap();
    let mut held = GainEstimator::new(&skin).unwrap();
    let mut simulation = TouchSimulation::new(
        &skin,
        &TouchOptions {
            presses: 1,
            roll: 0.0,
            noise: 500.0,
            rate: 20.0,
            quantity: Quantity::Intensive,
            ..TouchOptions::default()
        },
    )
    .unwrap();
    let mut pressed = Frame::default();
    let mut inverted = GainEstimator::new(&skin).unwrap();
    while let Some((frame, touches)) = simulation.next_frame() {
        let mut opposite = frame.clone();
        opposite.values.iter_mut().flatten().for_each(|values| values.iter_mut().for_each(|x| *x = -*x));
        inverted.see(&opposite);
        if touches.is_empty() {
            none.see(frame);
        } else {
            pressed = frame.clone();
        }
    }
    (0..1000).for_each(|_| held.see(&pressed));
    let mut missing = GainEstimator::new(&skin).unwrap();
    let mut nothing = pressed.clone();
    nothing.values.iter_mut().flatten().for_each(|values| values.iter_mut().for_each(|x| *x = f64::NAN));
    (0..1000).for_each(|_| missing.see(&nothing));
    for (estimator, touches) in [(none, 0), (held, 1), (missing, 0), (inverted, 0)] {
        let refused = estimator.solve(Run::default());
        assert!(
            matches!(refused, Err(ResponseError::TooFewPresses { touches: found, .. }) if found == touches),
            "{refused:?}"
        );
    }
}

/// Readings that are often at their limit say nothing of gains, whether most of them are there or the rest fits no power.
#[test]
fn saturated_recordings_are_refused() {
    let skin = forearm(9, 12);
    for (limit, kind) in [(1000.0, "saturated"), (5000.0, "foreign_power")] {
        let mut simulation = TouchSimulation::new(&skin, &usual(&[0.015], 40, 4)).unwrap();
        let mut estimator = GainEstimator::new(&skin).unwrap();
        while let Some((frame, _)) = simulation.next_frame() {
            let mut frame = frame.clone();
            let all = frame.values.iter_mut().flatten().flat_map(|values| values.iter_mut());
            all.for_each(|x| *x = x.min(limit));
            estimator.see(&frame);
        }
        let refused = estimator.solve(Run::default()).err().map(|error| error.kind());
        assert_eq!(refused, Some(kind), "{limit} Pa");
    }
}

/// Twelve taxels of different curves in a bag: gains and exponents come back, taxels at their limit keep what is below it,
/// and those that are dead, do not react, fall, or rise and fall are not known.
#[test]
fn steps_of_pressure_give_gain_and_exponent() {
    let skin = forearm(4, 3);
    let exponent = |k: usize| 0.8 + 0.02 * k as f64;
    let gain = |k: usize| 50.0 + 10.0 * k as f64;
    let rows = [[0.5, 1e3], [1.0, 5e3], [2.0, 2e4], [3.0, 6e4], [4.0, 2e4], [5.0, 0.0]];
    let mut estimator = StepEstimator::new(&skin, &rows).unwrap();
    for tenth in 0..60 {
        let time = 0.1 * f64::from(tenth);
        let pressure = rows.iter().rev().find(|row| row[0] <= time).map_or(0.0, |row| row[1]);
        let noise = |k: usize| 1.0 + 1e-3 * (((tenth as usize * 7 + k) % 3) as f64 - 1.0);
        let reading = |k: usize| match k {
            0 => f64::NAN,
            1 => (pressure / gain(k)).powf(exponent(k).recip()).min(600.0),
            2 => 1e-13,
            3 => -(pressure / gain(k)).powf(exponent(k).recip()),
            4 => noise(k) * (600.0 - pressure / 200.0),
            5 => noise(k) * pressure.min(1e8 / pressure) / 10.0,
            _ => noise(k) * (pressure / gain(k)).powf(exponent(k).recip()),
        };
        let values = IdVec::from(vec![vec![(0..12).map(reading).collect()]]);
        estimator.see(&Frame { time, values, ..Frame::default() });
    }
    let (curves, report) = estimator.solve().unwrap();
    assert_eq!((report.steps, report.placements, report.pressures), (5, 1, [1e3, 6e4]));
    let curves: Vec<_> = curves.iter().flatten().collect();
    assert_eq!(curves.iter().filter(|curve| !curve.gain.is_nan()).count(), 7);
    for k in [0, 2, 3, 4, 5] {
        let curve = curves[k];
        assert!(curve.gain.is_nan() && curve.exponent.is_nan() && curve.sigma.is_nan(), "{k}: {curve:?}");
        assert_eq!(curve.is_dead, k == 2, "only what never changes is dead: {k}");
    }
    for (k, curve) in curves.iter().enumerate().filter(|(_, curve)| !curve.gain.is_nan()) {
        let found = curve.gain * (2e4 / gain(k)).powf(curve.exponent / exponent(k));
        assert!((found / 2e4 - 1.0).abs() < 0.03, "{k}: {found} Pa of 20000");
        assert!((curve.exponent / exponent(k) - 1.0).abs() < 0.05, "{k}: {curve:?}");
    }
}

/// Steps that are none, or those of another recording, are refused.
#[test]
fn steps_that_do_not_fit_are_refused() {
    let skin = forearm(4, 3);
    let kind = |rows: &[[f64; 2]]| StepEstimator::new(&skin, rows).err().map(|error| error.kind());
    assert_eq!(kind(&[]), Some("no_steps"));
    assert_eq!(kind(&[[0.0, 0.0]]), Some("no_steps"));
    assert_eq!(kind(&[[0.0, 5.0]]), Some("step_pressure"), "kPa");
    assert_eq!(kind(&[[0.0, -2e4]]), Some("step_pressure"));
    assert_eq!(kind(&[[0.0, f64::NAN]]), Some("step_pressure"));
    assert_eq!(kind(&[[1.0, 2e4], [0.5, 3e4]]), Some("step_time"));
    assert_eq!(kind(&[[f64::NAN, 2e4]]), Some("step_time"));
    let solve = |reading: fn(f64) -> f64, seconds: u32| {
        let mut estimator = StepEstimator::new(&skin, &[[1.0, 5e3], [2.0, 2e4], [3.0, 0.0]]).unwrap();
        for tenth in 0..10 * seconds {
            let time = 0.1 * f64::from(tenth);
            let values = IdVec::from(vec![vec![(0..12).map(|_| reading(time)).collect()]]);
            estimator.see(&Frame { time, values, ..Frame::default() });
        }
        estimator.solve().err().map(|error| error.kind())
    };
    assert_eq!(solve(|_| 1.0, 2), Some("steps_outside"));
    assert_eq!(solve(|_| 1.0, 4), Some("steps_do_not_fit"), "always one reading");
    assert_eq!(solve(|_| f64::NAN, 4), Some("steps_outside"), "no reading");
    assert_eq!(solve(|_| 0.0, 4), Some("steps_do_not_fit"), "no gain");
    assert_eq!(solve(|time| -time, 4), Some("steps_do_not_fit"), "a negative gain");
    assert_eq!(solve(|time| if time < 2.0 { 9.0 } else { 1.0 }, 4), Some("steps_do_not_fit"), "falls");
    assert_eq!(solve(|time| if time < 2.0 { 1.0 } else { 4.0 }, 4), None);
}

/// The scale of pressures in units of 2500 Pa, and their exponent, come back from forces.
#[test]
fn known_forces_give_the_scale_and_the_exponent() {
    let skin = forearm(9, 12);
    let options = TouchOptions { noise: 0.0, roll: 0.0, ..usual(&[0.015], 110, 3) };
    let options = TouchOptions { exponent: 1.0, hysteresis: 0.0, ..options };
    let mut simulation = TouchSimulation::new(&skin, &options).unwrap();
    let (mut frames, mut forces) = (Vec::new(), Vec::new());
    while let Some((frame, touches)) = simulation.next_frame() {
        forces.push([frame.time, touches.iter().map(|touch| touch.force).sum()]);
        frames.push(frame.clone());
    }
    let solve = |finds_exponent: bool, power: f64, forces: Vec<[f64; 2]>, most: usize| {
        let mut estimator = ScaleEstimator::new(&skin, finds_exponent, forces)?;
        for frame in frames.iter().take(most) {
            let mut frame = frame.clone();
            let all = frame.values.iter_mut().flatten().flat_map(|values| values.iter_mut());
            all.for_each(|x| *x = (*x / 2500.0).powf(power));
            estimator.see(&frame);
        }
        estimator.solve()
    };
    let twenty = solve(false, 1.0, forces.clone(), 20 * 30).unwrap();
    assert!((twenty.scale / 2500.0 - 1.0).abs() < 0.1 && twenty.exponent.is_nan(), "{twenty:?}");
    assert!((15..=20).contains(&twenty.touches) && twenty.sigma < 0.05, "{twenty:?}");
    let all = solve(true, 1.25, forces.clone(), usize::MAX).unwrap();
    assert!((all.exponent - 0.8).abs() < 0.1, "{all:?}");
    let kind = |forces: Vec<[f64; 2]>, most| solve(false, 1.0, forces, most).err().map(|error| error.kind());
    let milli = forces.iter().map(|[time, force]| [*time, 1e3 * force]).collect();
    assert_eq!(kind(milli, usize::MAX), Some("force_unit"));
    assert_eq!(kind(forces.iter().map(|[t, f]| [t + 1e4, *f]).collect(), 600), Some("too_few_forces"));
    let kilo = forces.iter().map(|[time, force]| [*time, 1e-3 * force]).collect();
    assert_eq!(kind(kilo, usize::MAX), Some("force_unit"));
    assert_eq!(kind(vec![[0.0, -1.0]], 600), Some("force"));
    assert_eq!(kind(vec![[0.0, f64::NAN]], 600), Some("force"));
    assert_eq!(kind(vec![[f64::NAN, 1.0]], 600), Some("force_time"));
    for factor in [f64::NAN, 0.0, -1.0] {
        let mut estimator = ScaleEstimator::new(&skin, false, forces.clone()).unwrap();
        for frame in &frames {
            let mut frame = frame.clone();
            frame.values.iter_mut().flatten().flat_map(|values| values.iter_mut()).for_each(|x| *x *= factor);
            estimator.see(&frame);
        }
        let refused = estimator.solve().err().map(|error| error.kind());
        assert_eq!(refused, Some("too_few_forces"), "readings times {factor}");
    }
}

/// No press joins two patches: what is known of how their gains compare is that bodies press both alike, not that their
/// gains are alike. Readings of the second one are three times larger.
#[test]
fn patches_that_no_press_joins_keep_their_ratio() {
    let mut skin = forearm(8, 8);
    let pose = glam::DAffine3::IDENTITY;
    skin.links.push(dermatome::skin::Link { name: "hand".into(), parent: None, pose });
    let mut hand = forearm(8, 8).patches[PatchId::new(0)].clone();
    hand.name = "hand".into();
    hand.link = dermatome::skin::LinkId::new(1);
    hand.taxels.ids.iter_mut().for_each(|id| id.0 += 64);
    skin.patches.push(hand);
    let options = usual(&[0.008, 0.015, 0.04], 160, 5);
    let (mut truth, found) = estimate_as(&skin, &options, |frame, _| {
        frame.values[PatchId::new(1)][0].iter_mut().for_each(|x| *x *= 3.0);
    });
    truth[64..].iter_mut().for_each(|log| *log += 3.0_f64.ln());
    let (gains, report) = found.unwrap();
    let [error, share, _, chi] = errors(&truth, &gains);
    let mean = |patch: usize| {
        let of = gains[PatchId::new(patch)].iter().zip(&truth[64 * patch..]);
        let left: Vec<f64> = of.filter(|(t, _)| !t.gain.is_nan()).map(|(t, log)| t.gain.ln() + log).collect();
        left.iter().sum::<f64>() / left.len() as f64
    };
    let ratio = mean(1) - mean(0);
    println!("{error:.3} {share:.2} {chi:.2}, the ratio is off by {ratio:.3}; {report:?}");
    assert!(report.has_converged && report.patches == 2, "{report:?}");
    assert!(ratio.abs() < 0.2 && error < 0.15 && share > 0.6, "{ratio}, {error}, {share}");
    assert!((0.2..2.0).contains(&chi), "{chi}");
}

/// Frames of a recording at 20 Hz under steps of pressure, with noise, of 12 taxels of which the first `pressed` feel them.
fn under_a_bag(
    skin: &Skin,
    rows: &[[f64; 2]],
    pressed: usize,
    clock: impl Fn(f64) -> f64,
) -> Result<Curves, ResponseError> {
    let mut numbers = Numbers(7);
    let mut estimator = StepEstimator::new(skin, rows).unwrap();
    for frame in 0..160 {
        let time = clock(0.05 * f64::from(frame));
        let pressure = rows.iter().rev().find(|row| row[0] <= time).map_or(0.0, |row| row[1]);
        let mut reading = |k: usize| if k < pressed { pressure } else { 0.0 } + 50.0 * numbers.normal();
        let values = IdVec::from(vec![vec![(0..12).map(&mut reading).collect()]]);
        estimator.see(&Frame { time, values, ..Frame::default() });
    }
    estimator.solve()
}

/// What a bag does not touch reads noise, which is no pressure; however few taxels it touches, steps and readings fit.
#[test]
fn what_a_bag_does_not_touch_has_no_curve() {
    let skin = forearm(4, 3);
    let rows = [[1.0, 2e3], [2.0, 5e3], [3.0, 1e4], [4.0, 2e4], [5.0, 4e4], [6.0, 6e4], [7.0, 0.0]];
    for pressed in [2, 4] {
        let (curves, report) = under_a_bag(&skin, &rows, pressed, |time| time).unwrap();
        assert!((report.exponent - 1.0).abs() < 0.02, "{report:?}");
        for (k, curve) in curves.iter().flatten().enumerate() {
            assert_eq!(!curve.gain.is_nan(), k < pressed, "{k} of {pressed}: {curve:?}");
            assert!(curve.gain.is_nan() || (curve.exponent - 1.0).abs() < 0.05, "{k}: {curve:?}");
        }
    }
}

/// Where times begin again, a reading is of two steps.
#[test]
fn steps_of_a_clock_that_goes_back_are_refused() {
    let rows = [[1.0, 2e3], [2.0, 5e3], [3.0, 1e4], [4.0, 0.0]];
    let clock = |time: f64| if time < 5.0 { time } else { time - 5.0 };
    let refused = under_a_bag(&forearm(4, 3), &rows, 12, clock);
    assert_eq!(refused.err().map(|error| error.kind()), Some("step_clocks"));
}
