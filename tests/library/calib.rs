//! Laws of calibration, and the statistics of the simulated experiment.

use crate::common::data;
use dermatome::calib::{
    CalibError, CalibOptions, CalibratedSkin, Calibration, ContactMeasurement, ContactObservation,
    ContactObservationId, Displacement, DisplacementId, DisplacementMeasurement, Information, Initialization,
    Loss, Model, Observations, Pose, PoseMeasurement, ResidualConvention, SheetDefect, SimulateOptions,
    Simulation, TaxelVariable, Termination, Verdict, calibrate, calibrated_skin, compare, simulate,
};
use dermatome::id::{IdVec, VertexId};
use dermatome::io::read_observations;
use dermatome::least_squares::Options;
use dermatome::mesh::Adjacency;
use dermatome::skin::{TaxelId, Taxels};
use glam::{DMat3, DQuat, DVec3};

fn solve(observations: &Observations, options: &CalibOptions) -> Calibration {
    let found = calibrate(observations, options).unwrap();
    assert!(found.termination.is_converged(), "{:?}", found.termination);
    found
}

fn fit(observations: &Observations) -> Calibration {
    solve(observations, &CalibOptions::default())
}

fn observed(options: &SimulateOptions) -> Observations {
    simulate(options).unwrap().observations
}

/// What an edge observed in the positions model, and its information.
fn offset(observations: &mut Observations, edge: usize) -> (&mut DVec3, &mut Information<3>) {
    match &mut observations.edges[DisplacementId::new(edge)].measurement {
        DisplacementMeasurement::Offset { offset, information } => (offset, information),
        DisplacementMeasurement::Relative(_) => panic!("offsets in the positions model"),
    }
}

/// Where a contact observed its taxel, and its information.
fn touched(observations: &mut Observations, contact: usize) -> (&mut DVec3, &mut Information<3>) {
    match &mut observations.contacts[ContactObservationId::new(contact)].measurement {
        ContactMeasurement::Position { position, information }
        | ContactMeasurement::PositionNormal { position, information, .. } => (position, information),
        ContactMeasurement::Pose { .. } => panic!("positions are touched"),
    }
}

/// Adds an edge of the positions model.
fn join(observations: &mut Observations, [from, to]: [usize; 2], offset: DVec3, information: f64) {
    let information = Information::diagonal([information; 3]);
    let measurement = DisplacementMeasurement::Offset { offset, information };
    let (from, to) = (VertexId::new(from), VertexId::new(to));
    observations.edges.push(Displacement { from, to, measurement });
}

/// Adds a touched position.
fn touch(observations: &mut Observations, taxel: usize, position: DVec3, information: [f64; 3]) {
    let information = Information::diagonal(information);
    let measurement = ContactMeasurement::Position { position, information };
    observations.contacts.push(ContactObservation { taxel: VertexId::new(taxel), measurement });
}

fn robust(loss: Loss) -> CalibOptions {
    CalibOptions { robust: Some(loss), ..CalibOptions::default() }
}

fn poses(seed: u64) -> SimulateOptions {
    SimulateOptions { model: Model::Poses, seed, ..SimulateOptions::default() }
}

fn small(model: Model) -> SimulateOptions {
    SimulateOptions { model, taxels: 40, seed: 3, ..SimulateOptions::default() }
}

/// Square root of the trace of the position covariance of every taxel.
fn sigmas(found: &Calibration) -> IdVec<VertexId, f64> {
    found.marginals.as_ref().unwrap().positions.map(|c| c.sigma())
}

fn mean(numbers: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = numbers.fold((0.0, 0.0), |(s, n), x| (s + x, n + 1.0));
    sum / count
}

/// Means over 20 seeds of the simulated experiment.
struct Statistics {
    /// In mm; after rigid alignment if no contact holds the skin.
    rmse: f64,
    /// Chi-square over degrees of freedom.
    chi2: f64,
    /// Normalised squared error of positions after the alignment of the covariance: 3 if the
    /// covariances are right.
    nees: f64,
}

fn statistics(options: &SimulateOptions, degrees_of_freedom: usize) -> Statistics {
    let runs: Vec<[f64; 3]> = (0..20)
        .map(|seed| {
            let simulation = simulate(&SimulateOptions { seed, ..*options }).unwrap();
            let found = fit(&simulation.observations);
            assert_eq!(found.fit.degrees_of_freedom, degrees_of_freedom);
            assert_eq!(found.free.is_empty(), options.anchors > 0, "contacts hold the skin");
            let comparison = compare(&found.poses, &simulation.truth).unwrap();
            let (rmse, motion) = match (found.free.is_empty(), options.model) {
                (true, _) => (comparison.absolute, Pose::default()),
                (false, Model::Poses) => (comparison.rigid, comparison.alignment),
                // Only translations are free in this model.
                (false, Model::Positions) => {
                    let position = mean_position(&simulation.truth) - mean_position(&found.poses);
                    (comparison.rigid, Pose { position, ..Pose::default() })
                }
            };
            let covariances = &found.marginals.as_ref().unwrap().positions;
            let nees = mean(simulation.truth.enumerate().map(|(v, t)| {
                // The error is turned into the frame of the calibration, where the covariance is given.
                let e =
                    motion.rotation.conjugate() * (t.position - motion.position) - found.poses[v].position;
                e.dot(DMat3::from(covariances[v]).inverse() * e)
            }));
            [rmse * 1e3, found.fit.chi2 / degrees_of_freedom as f64, nees]
        })
        .collect();
    let [rmse, chi2, nees] = [0, 1, 2].map(|k| mean(runs.iter().map(|run| run[k])));
    Statistics { rmse, chi2, nees }
}

/// The laws of the experiment: RMSE at the Cramer-Rao bound, cost and errors as the noise says.
#[test]
fn the_experiment_reaches_its_bounds() {
    let plain = SimulateOptions::default();
    let normals = SimulateOptions { anchors: 50, normal_noise: Some(2_f64.to_radians()), ..poses(0) };
    for (options, degrees_of_freedom, expected, tolerance) in [
        (plain, 3 * 1419 - 3 * 499, 1.12, 0.04),
        (SimulateOptions { anchors: 500, ..plain }, 3 * 1419, 0.775, 0.02),
        (poses(0), 6 * 1419 - 6 * 499, 1.0, 0.5),
        (normals, 6 * 1419 + 5 * 50 - 6 * 500, 1.0, 0.5),
    ] {
        let Statistics { rmse, chi2, nees } = statistics(&options, degrees_of_freedom);
        assert!((rmse - expected).abs() < tolerance, "RMSE {rmse} mm of {options:?}");
        assert!((chi2 - 1.0).abs() < 0.02, "chi-square over degrees {chi2} of {options:?}");
        assert!((2.7..3.3).contains(&nees), "NEES {nees} of {options:?}");
    }
}

fn mean_position(poses: &IdVec<VertexId, Pose>) -> DVec3 {
    poses.iter().map(|p| p.position).sum::<DVec3>() / poses.len() as f64
}

#[test]
fn wrong_attributions_are_rejected() {
    // Measured with truncated least squares: 1.14, 1.18 and 1.53 mm; with the wrong edges known, about
    // 1.17 and 1.41 mm.
    for (share, bound) in [(0.0, 1.20), (0.05, 1.30), (0.20, 1.60)] {
        for robust in [Some(Loss::Truncated), Some(Loss::Tukey)] {
            let rmse = mean((0..20).map(|seed| {
                let options = SimulateOptions { outliers: share, seed, ..SimulateOptions::default() };
                let simulation = simulate(&options).unwrap();
                let options = CalibOptions { robust, ..CalibOptions::default() };
                let found = solve(&simulation.observations, &options);
                compare(&found.poses, &simulation.truth).unwrap().rigid * 1e3
            }));
            assert!(rmse < bound, "{robust:?} at {share}: {rmse} mm");
        }
    }
}

#[test]
fn rejected_edges_are_the_wrong_ones() {
    let options = SimulateOptions { outliers: 0.05, ..poses(1) };
    let simulation = simulate(&options).unwrap();
    let options = robust(Loss::Truncated);
    let found = solve(&simulation.observations, &options);
    let rejected: Vec<_> = found.rejected().0;
    let caught = simulation.outliers.iter().filter(|e| rejected.contains(e)).count();
    assert!(caught + 2 >= simulation.outliers.len(), "{caught} of {} outliers", simulation.outliers.len());
    // One good edge in a hundred is beyond the bound by chance.
    assert!(rejected.len() - caught < 1419 / 40, "{} good edges rejected", rejected.len() - caught);
}

#[test]
fn graduation_rejects_nothing_clean() {
    let clean = simulate(&SimulateOptions { noise: 0.0, ..small(Model::Positions) }).unwrap();
    let options = robust(Loss::Truncated);
    let found = solve(&clean.observations, &options);
    assert_eq!(found.rejected().0.len(), 0);
    assert!(compare(&found.poses, &clean.truth).unwrap().rigid < 1e-12);
}

/// Minima of public pose graphs in the three conventions.
///
/// The quaternion minimum of parking-garage is lower than the 1.238988 that is often quoted for
/// twice the cost: three starts agree on it, the last step being 1e-6 m.
#[test]
fn public_pose_graphs_reach_their_minima() {
    let minima = [
        ("sphere2500", 675.700_962_9, 675.681_163_3, 727.149_667_2 / 2.0),
        ("parking-garage", 0.634_192_399_6, 0.634_192_200_6, 1.238_690_58 / 2.0),
        ("smallGrid3D", 517.925_332_4, 516.947_201_7, 458.153_784_3 / 2.0),
    ];
    for (name, log, split, quaternion) in minima {
        let Some(path) = data(&format!("g2o/{name}.g2o")) else { continue };
        let observations = read_observations(&path, &[]).unwrap().0;
        for (residual, expected) in [
            (ResidualConvention::Log, log),
            (ResidualConvention::Split, split),
            (ResidualConvention::Quaternion, quaternion),
        ] {
            let options = CalibOptions { residual, ..CalibOptions::default() };
            let cost = solve(&observations, &options).cost;
            assert!((cost / expected - 1.0).abs() < 1e-6, "{name} {residual:?}: {cost} is not {expected}");
        }
    }
}

#[test]
fn both_starts_lead_to_the_same_minimum() {
    let simulation = simulate(&poses(2)).unwrap();
    let cost = |initialization| {
        solve(&simulation.observations, &CalibOptions { initialization, ..CalibOptions::default() }).cost
    };
    let [expected, found] = [Initialization::Chordal, Initialization::InitialValues].map(cost);
    assert!((found / expected - 1.0).abs() < 1e-9, "{found}, not {expected}");
}

/// Observations without noise fit exactly, whichever six numbers the error of a pose becomes.
#[test]
fn perfect_observations_have_no_error() {
    let options = SimulateOptions { noise: 0.0, rotation_noise: 0.0, ..small(Model::Poses) };
    let simulation = simulate(&options).unwrap();
    for residual in [ResidualConvention::Split, ResidualConvention::Log, ResidualConvention::Quaternion] {
        let found = solve(&simulation.observations, &CalibOptions { residual, ..CalibOptions::default() });
        assert!(found.cost < 1e-12, "{residual}: {}", found.cost);
    }
}

/// The same observations with taxels in reverse order.
fn reversed(observations: &Observations) -> Observations {
    let last = observations.taxels.len() - 1;
    let turn = |v: VertexId| VertexId::new(last - v.index());
    let mut out = observations.clone();
    out.taxels = observations.taxels.iter().rev().copied().collect();
    for edge in out.edges.iter_mut() {
        (edge.from, edge.to) = (turn(edge.from), turn(edge.to));
    }
    for contact in out.contacts.iter_mut() {
        contact.taxel = turn(contact.taxel);
    }
    out
}

/// Permuting taxels also changes which of them holds the gauge: neither cost, shape nor covariance
/// may notice.
#[test]
fn order_and_gauge_taxel_change_nothing() {
    for model in [Model::Positions, Model::Poses] {
        let simulation = simulate(&small(model)).unwrap();
        let (a, b) = (simulation.observations.clone(), reversed(&simulation.observations));
        let (a, b) = (fit(&a), fit(&b));
        assert_ne!(a.free[0].gauge, b.free[0].gauge, "another taxel holds the gauge");
        assert!((a.cost / b.cost - 1.0).abs() < 1e-9, "{} and {}", a.cost, b.cost);
        let back: IdVec<VertexId, Pose> = b.poses.iter().rev().copied().collect();
        let shape = compare(&a.poses, &back).unwrap();
        assert!(shape.rigid < 1e-8, "{model:?}: shapes differ by {} m", shape.rigid);
        for (x, y) in sigmas(&a).iter().zip(sigmas(&b).iter().rev()) {
            assert!((x / y - 1.0).abs() < 1e-6, "{model:?}: sigma {x} became {y}");
        }
    }
}

/// Observations moved as a whole give the same skin, moved.
#[test]
fn moving_the_frame_moves_the_skin() {
    let options = SimulateOptions { anchors: 10, normal_noise: Some(0.03), ..small(Model::Poses) };
    let simulation = simulate(&options).unwrap();
    let motion = Pose {
        position: DVec3::new(0.3, -1.0, 2.0),
        rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.3),
    };
    let mut moved = simulation.observations.clone();
    for taxel in moved.taxels.iter_mut() {
        taxel.initial = taxel.initial.map(|p| motion * p);
    }
    for contact in moved.contacts.iter_mut() {
        if let ContactMeasurement::PositionNormal { position, normal, .. } = &mut contact.measurement {
            *position = motion.rotation * *position + motion.position;
            *normal = (motion.rotation * *normal).normalize();
        }
    }
    let a = fit(&simulation.observations);
    let b = fit(&moved);
    assert!((a.cost / b.cost - 1.0).abs() < 1e-9);
    for (x, y) in a.poses.iter().zip(&b.poses) {
        assert!((motion * *x).position.distance(y.position) < 1e-9);
    }
}

/// Applies `f` to every information matrix of the edges.
fn scale_information(observations: &mut Observations, factor: impl Fn(usize) -> f64) {
    for (k, edge) in observations.edges.iter_mut().enumerate() {
        match &mut edge.measurement {
            DisplacementMeasurement::Offset { information, .. } => {
                information.0.iter_mut().flatten().for_each(|x| *x *= factor(k));
            }
            DisplacementMeasurement::Relative(m) => {
                m.information.0.iter_mut().flatten().for_each(|x| *x *= factor(k))
            }
        }
    }
}

#[test]
fn information_scales_the_cost() {
    for model in [Model::Positions, Model::Poses] {
        let simulation = simulate(&small(model)).unwrap();
        let plain = &robust(Loss::Squared);
        let mut scaled = simulation.observations.clone();
        scale_information(&mut scaled, |_| 4.0);
        let a = solve(&simulation.observations, plain);
        let b = solve(&scaled, plain);
        assert!((b.cost / a.cost - 4.0).abs() < 1e-8, "{} and {}", a.cost, b.cost);
        let sigma = |c: &Calibration| sigmas(c)[VertexId::new(7)];
        assert!((sigma(&a) / sigma(&b) - 2.0).abs() < 1e-6, "half the uncertainty");
    }
}

#[test]
fn edges_without_information_change_nothing() {
    for model in [Model::Positions, Model::Poses] {
        let simulation = simulate(&small(model)).unwrap();
        let mut silent = simulation.observations.clone();
        scale_information(&mut silent, |k| if k % 10 == 0 { 0.0 } else { 1.0 });
        let mut without = simulation.observations.clone();
        let edges = without.edges.enumerate().filter(|(e, _)| e.index() % 10 != 0);
        without.edges = edges.map(|(_, e)| e.clone()).collect();
        let a = fit(&silent);
        let b = fit(&without);
        assert!((a.cost / b.cost - 1.0).abs() < 1e-9, "{} and {}", a.cost, b.cost);
        assert_eq!(a.fit.degrees_of_freedom, b.fit.degrees_of_freedom);
        assert!(compare(&a.poses, &b.poses).unwrap().absolute < 1e-9);
    }
}

/// A silent edge between two sheets joins nothing.
#[test]
fn edges_without_information_join_no_components() {
    for model in [Model::Positions, Model::Poses] {
        let one = observed(&small(model));
        let both = side_by_side(&one, &one);
        let mut joined = both.clone();
        let mut silent = one.edges[DisplacementId::new(0)].clone();
        silent.to = VertexId::new(one.taxels.len() + 3);
        match &mut silent.measurement {
            DisplacementMeasurement::Offset { information, .. } => {
                *information = Information::diagonal([0.0; 3])
            }
            DisplacementMeasurement::Relative(m) => m.information = Information::diagonal([0.0; 6]),
        }
        joined.edges.push(silent);
        let (a, b) = (fit(&both), fit(&joined));
        assert!((a.cost / b.cost - 1.0).abs() < 1e-12, "{} and {}", a.cost, b.cost);
        assert_eq!((a.fit.degrees_of_freedom, a.free), (b.fit.degrees_of_freedom, b.free));
    }
}

/// A translation known to a micrometre takes nothing from a rotation known to two degrees.
#[test]
fn units_do_not_change_the_degrees_of_freedom() {
    let options = SimulateOptions { noise: 1e-6, rotation_noise: 2_f64.to_radians(), ..poses(1) };
    let found = fit(&observed(&options));
    assert_eq!(found.fit.degrees_of_freedom, 6 * 1419 - 6 * 499);
    assert!(found.fit.p.unwrap() > 1e-3, "{:?}", found.fit);
}

/// However well its position is known, a prior that tells all six numbers of a pose holds the whole
/// skin.
#[test]
fn a_full_prior_leaves_nothing_free() {
    let base = observed(&small(Model::Poses));
    for translation in [1e2, 1e6, 1e10, 1e14] {
        let mut observations = base.clone();
        let taxel = VertexId::new(39);
        let information = Information::diagonal([translation, translation, translation, 1e2, 1e2, 1e2]);
        let pose = Pose { position: DVec3::new(100.0, 50.0, -3.0), ..Pose::default() };
        let seen = Box::new(PoseMeasurement { pose, information });
        observations.contacts.push(ContactObservation {
            taxel,
            measurement: ContactMeasurement::Pose { offset: Pose::default(), seen },
        });
        let found = fit(&observations);
        assert_eq!(found.free, [], "{translation}");
        assert!(found.poses[taxel].position.distance(pose.position) < 1e-6, "{translation}");
    }
}

/// One touched point and no edge: the place is known, the turn is not.
#[test]
fn one_touched_point_leaves_the_rotation_free() {
    let position = DVec3::new(1.0, 2.0, 3.0);
    let taxel = TaxelVariable { id: TaxelId(4), initial: None, fixed: false };
    let mut observations =
        Observations { model: Model::Poses, taxels: vec![taxel].into(), ..Observations::default() };
    touch(&mut observations, 0, position, [1e6; 3]);
    let found = fit(&observations);
    assert_eq!((found.free[0].free_motions, found.fit.degrees_of_freedom), (3, 0));
    assert!(found.poses[VertexId::new(0)].position.distance(position) < 1e-12);
}

/// Where all taxels start at one point the contacts seem to leave the rotation free; once they have moved apart, the
/// same contacts do not.
#[test]
fn gauge_freedom_is_that_of_the_result() {
    let options = SimulateOptions { anchors: 12, ..poses(3) };
    let mut observations = observed(&options);
    let expected = solve(&observations, &CalibOptions::default());
    observations.taxels.iter_mut().for_each(|t| t.initial = Some(Pose::default()));
    let start = CalibOptions { initialization: Initialization::InitialValues, ..CalibOptions::default() };
    let found = solve(&observations, &start);
    let sigmas = [&found, &expected].map(|found| sigmas(found)[VertexId::new(3)]);
    assert!((sigmas[0] / sigmas[1] - 1.0).abs() < 1e-3, "{sigmas:?} m");
    assert_eq!((found.free, found.fit.degrees_of_freedom), (expected.free, expected.fit.degrees_of_freedom));
    assert!((found.cost / expected.cost - 1.0).abs() < 1e-6, "{} is not {}", found.cost, expected.cost);
}

#[test]
fn an_overflowing_cost_is_not_converged() {
    let mut observations = observed(&small(Model::Positions));
    for edge in 0..observations.edges.len() {
        *offset(&mut observations, edge).1 = Information::diagonal([1e300; 3]);
    }
    *offset(&mut observations, 3).0 = DVec3::X * 1e9;
    let found = calibrate(&observations, &CalibOptions::default()).unwrap();
    assert_eq!(found.termination, Termination::Overflow);
}

/// Observations of fixed taxels can be wrong, too.
#[test]
fn observations_between_fixed_taxels_are_judged() {
    let mut observations = observed(&small(Model::Positions));
    observations.taxels.iter_mut().for_each(|t| t.fixed = true);
    let edges = observations.edges.len();
    let found = solve(&observations, &robust(Loss::Squared));
    assert_eq!(found.fit.degrees_of_freedom, 3 * edges);
}

/// Rejection is for outliers at any noise scale: not for noise that is larger than stated.
#[test]
fn the_default_rejects_outliers_alone() {
    let chosen = |outliers: f64, stated: f64| {
        let simulation =
            simulate(&SimulateOptions { outliers, seed: 4, ..SimulateOptions::default() }).unwrap();
        let mut observations = simulation.observations;
        scale_information(&mut observations, |_| stated.powi(-2));
        let found = fit(&observations);
        assert!(found.rejected().0.len() < 1419 / 2, "{outliers}, {stated}");
        found.loss
    };
    for stated in [0.02, 0.5, 0.85, 0.92, 1.0, 2.0] {
        assert_eq!(chosen(0.0, stated), Loss::Squared, "nothing is wrong but the noise, stated {stated}");
    }
    for seed in 100..106 {
        let simulation =
            simulate(&SimulateOptions { taxels: 200, seed, ..SimulateOptions::default() }).unwrap();
        let mut observations = simulation.observations;
        scale_information(&mut observations, |_| 0.35_f64.powi(-2));
        let found = fit(&observations);
        assert_eq!(found.loss, Loss::Squared, "seed {seed}, noise understated by a third");
    }
    for (outliers, stated) in [(0.02, 2.0), (0.05, 0.85), (0.05, 1.0), (0.2, 0.85), (0.2, 1.0)] {
        assert_eq!(chosen(outliers, stated), Loss::Truncated, "{outliers} wrong, stated {stated}");
    }
}

/// One gross error among many hardly changes the sum of squares.
#[test]
fn one_gross_error_is_found() {
    let mut observations = observed(&SimulateOptions { seed: 4, ..SimulateOptions::default() });
    offset(&mut observations, 700).0.x += 9e-3;
    let found = fit(&observations);
    assert!(found.rejected().0.contains(&DisplacementId::new(700)), "{:?}", found.fit);
}

/// Two edges that contradict each other, and nothing to tell which is wrong: both count.
#[test]
fn undecidable_contradictions_are_kept() {
    let mut observations = observed(&SimulateOptions { taxels: 3, ..SimulateOptions::default() });
    offset(&mut observations, 0).0.x += 20e-3;
    let found = fit(&observations);
    assert_eq!((found.loss, found.fit.degrees_of_freedom), (Loss::Squared, 3));
    assert!(found.fit.to_string().contains("disagree"), "{:?}", found.fit);
}

/// Rejected contacts anchor nothing: the skin is free, and covariances are those of a free skin.
#[test]
fn rejected_contacts_are_no_anchors() {
    let options = SimulateOptions { anchors: 2, seed: 2, ..SimulateOptions::default() };
    let simulation = simulate(&options).unwrap();
    let mut observations = simulation.observations;
    touched(&mut observations, 0).0.x += 0.03;
    let found = solve(&observations, &robust(Loss::Truncated));
    assert_eq!(found.rejected().1.len(), 2);
    let free = &found.free[0];
    assert_eq!((found.free.len(), free.free_motions, free.rejected_contacts), (1, 3, 2));
    assert_eq!(found.fit.degrees_of_freedom, 3 * 1419 - 3 * 499 - 3 * found.rejected().0.len());
    let most = sigmas(&found).iter().fold(0.0_f64, |m, s| m.max(*s));
    assert!(most < 5e-3, "{most} m");
}

/// A skin of precise edges whose two coarse contacts contradict each other: rejecting both must not
/// leave the system singular, nor give up what least squares finds.
#[test]
fn contradicting_weak_contacts_converge() {
    let options = SimulateOptions {
        noise: 5e-5,
        anchors: 2,
        anchor_noise: 1e-2,
        seed: 1,
        ..SimulateOptions::default()
    };
    let mut observations = observed(&options);
    touched(&mut observations, 0).0.x += 0.5;
    for robust in [None, Some(Loss::Truncated), Some(Loss::Tukey)] {
        solve(&observations, &CalibOptions { robust, ..CalibOptions::default() });
    }
    assert_eq!(fit(&observations).loss, Loss::Squared, "one of two: who can tell");
}

/// Huber's loss rejects nothing completely: contacts that contradict each other hold the skin all
/// the same.
#[test]
fn contacts_under_the_loss_of_huber_are_anchors() {
    let options = SimulateOptions { anchors: 2, seed: 2, ..small(Model::Positions) };
    let mut observations = observed(&options);
    touched(&mut observations, 0).0.x += 0.03;
    let found = solve(&observations, &robust(Loss::Huber));
    assert!(!found.rejected().1.is_empty());
    assert!(found.free.is_empty(), "{:?}", found.free);
}

/// Contacts five times noisier than stated are no wrong contacts, however many good edges stand
/// beside them.
#[test]
fn most_contacts_of_a_noisy_arm_are_kept() {
    for seed in 0..4 {
        let mut options = SimulateOptions { anchors: 20, seed, ..SimulateOptions::default() };
        options.arm_noise = 5e-3;
        let simulation = simulate(&options).unwrap();
        let error = |robust| {
            let found = solve(&simulation.observations, &CalibOptions { robust, ..CalibOptions::default() });
            let rejected = found.rejected().1.len();
            assert!(robust == Some(Loss::Squared) || rejected <= 5, "seed {seed}: {rejected}");
            compare(&found.poses, &simulation.truth).unwrap().absolute
        };
        let (default, plain) = (error(None), error(Some(Loss::Squared)));
        assert!(default < 1.25 * plain, "seed {seed}: {default} m, least squares {plain} m");
    }
}

/// Two of four contacts agree: these are right. One of two: no telling, and no tearing of the skin
/// either.
#[test]
fn half_of_the_contacts_may_be_wrong() {
    for (anchors, seed) in [(4, 1), (6, 2), (8, 2), (2, 2)] {
        let options = SimulateOptions { taxels: 120, anchors, seed, ..SimulateOptions::default() };
        let simulation = simulate(&options).unwrap();
        let mut observations = simulation.observations;
        for k in 0..anchors / 2 {
            let (sin, cos) = (2.0 * k as f64).sin_cos();
            *touched(&mut observations, k).0 += 0.05 * DVec3::new(cos, sin, 0.4 * k as f64);
        }
        let found = fit(&observations);
        // Noise alone makes one in three hundred as large.
        assert!(found.rejected().0.len() < 4, "{anchors} contacts");
        if anchors == 2 {
            assert_eq!(found.loss, Loss::Squared);
        } else {
            let rejected: Vec<usize> = found.rejected().1.iter().map(|c| c.index()).collect();
            assert_eq!(rejected, (0..anchors / 2).collect::<Vec<_>>());
            assert!(compare(&found.poses, &simulation.truth).unwrap().rigid < 1.5e-3);
        }
    }
}

/// Two sheets side by side and two long edges between them, which name the distance of the second
/// from the first and the same plus `apart`.
fn bridged(apart: f64) -> Observations {
    let one = observed(&SimulateOptions { outliers: 0.05, ..small(Model::Positions) });
    let other = SimulateOptions { outliers: 0.05, seed: 9, ..small(Model::Positions) };
    let mut both = side_by_side(&one, &observed(&other));
    let truth = simulate(&small(Model::Positions)).unwrap().truth;
    let away = DVec3::new(0.07, 0.0, 0.0);
    for (from, to, more) in [(3, 8, 0.0), (20, 25, apart)] {
        let [a, b] = [from, to].map(|v| truth[VertexId::new(v)].position);
        join(&mut both, [from, one.taxels.len() + to], b - a + away + DVec3::X * more, 1e6);
    }
    both
}

/// Edges unlike all others that hold two sheets together: alone their length speaks against them.
#[test]
fn edges_that_join_sheets_are_not_rejected() {
    for (apart, widest) in [(0.0, 5e-3), (0.06, 0.1)] {
        let observations = bridged(apart);
        let found = solve(&observations, &robust(Loss::Truncated));
        assert_eq!(found.free.len(), 1, "one piece");
        let bridges = [observations.edges.len() - 2, observations.edges.len() - 1].map(DisplacementId::new);
        let kept = bridges.map(|e| found.diagnostics.edges[e].verdict);
        if apart == 0.0 {
            assert_eq!(kept, [Verdict::Inlier; 2]);
        } else {
            assert!(bridges.iter().all(|&e| found.diagnostics.edges[e].weight > 1e-4));
        }
        let mut sigmas = sigmas(&found).as_slice().to_vec();
        sigmas.sort_by(f64::total_cmp);
        let middle = sigmas[sigmas.len() / 2];
        assert!(middle < widest, "{middle} m");
    }
}

/// The cost is that of every edge, whichever stage judged it.
#[test]
fn rejected_edges_have_a_cost() {
    for outliers in [0.05, 0.2] {
        let simulation =
            simulate(&SimulateOptions { outliers, seed: 3, ..SimulateOptions::default() }).unwrap();
        let found = solve(&simulation.observations, &robust(Loss::Truncated));
        let rejected = found.rejected().0.len() as f64;
        let more = 2.0 * found.cost - found.fit.chi2;
        assert!(more > 0.5 * rejected, "{more} for {rejected} edges");
    }
}

/// A touched height that is 3.5 standard deviations off: too much for one number, not for three.
#[test]
fn outlier_bounds_follow_the_rank_of_an_observation() {
    let mut observations = observed(&small(Model::Positions));
    let at = simulate(&small(Model::Positions)).unwrap().truth;
    for k in 0..10 {
        let off = if k == 9 { 3.5e-3 } else { 0.0 };
        let position = at[VertexId::new(4 * k)].position + DVec3::Z * off;
        touch(&mut observations, 4 * k, position, [0.0, 0.0, 1e6]);
    }
    // Edges that are sure: all of the error is the contact's.
    scale_information(&mut observations, |_| 1e4);
    for k in 0..observations.edges.len() {
        let Displacement { from, to, .. } = observations.edges[DisplacementId::new(k)];
        let exact = at[to].position - at[from].position;
        *offset(&mut observations, k).0 = exact + DVec3::X * 1e-6 * (k % 3) as f64;
    }
    let found = solve(&observations, &robust(Loss::Truncated));
    let rejected: Vec<usize> = found.rejected().1.iter().map(|c| c.index()).collect();
    assert_eq!(rejected, [9], "{:?}", found.diagnostics.contacts);
}

/// What one method may not finish, another must not either.
#[test]
fn the_default_keeps_the_limit_of_iterations() {
    let observations = observed(&SimulateOptions { outliers: 0.1, ..poses(4) });
    let limits = Options { max_iterations: 1, ..Options::default() };
    let found = calibrate(&observations, &CalibOptions { limits, ..CalibOptions::default() }).unwrap();
    assert_eq!(found.termination, Termination::OutOfIterations);
    // Enough for least squares, not for what they leave in doubt: what there is has the weights of
    // its last step.
    let observations = observed(&SimulateOptions { outliers: 0.05, seed: 3, ..SimulateOptions::default() });
    let limits = Options { max_iterations: 10, ..Options::default() };
    let found = calibrate(&observations, &CalibOptions { limits, ..CalibOptions::default() }).unwrap();
    assert_eq!((found.termination, found.loss), (Termination::OutOfIterations, Loss::Truncated));
    assert!(found.rejected().0.len() > 20);
    assert!(2.0 * found.cost < 1.2 * observations.edges.len() as f64 * 3.0, "{}", found.cost);
}

/// The goodness of fit of a large clean skin does not depend on whether outliers were looked for.
#[test]
fn goodness_of_fit_does_not_depend_on_the_loss() {
    let options = SimulateOptions { taxels: 20_000, spacing: 1e-3, ..SimulateOptions::default() };
    let observations = observed(&options);
    for robust in [Some(Loss::Squared), Some(Loss::Truncated)] {
        let options = CalibOptions { robust, covariances: false, ..CalibOptions::default() };
        let fit = solve(&observations, &options).fit;
        assert_eq!(fit.to_string(), "the stated noise is believable", "{robust:?}: {fit:?}");
    }
}

/// Pushes every number that was observed by one standard deviation and adds up what that does to
/// the position of every taxel, after the alignment of the covariance: at a perfect fit that is the
/// covariance.
#[test]
fn covariances_of_poses_are_what_noise_does_after_alignment() {
    for anchors in [0, 1, 4] {
        let options = SimulateOptions {
            model: Model::Poses,
            taxels: 7,
            noise: 0.0,
            rotation_noise: 0.0,
            anchors,
            anchor_noise: 0.0,
            ..SimulateOptions::default()
        };
        let simulation = simulate(&options).unwrap();
        let found = fit(&simulation.observations);
        let place = simulation.observations.contacts.iter().next().map(|c| found.poses[c.taxel].position);
        let mut sums = vec![DMat3::ZERO; 7];
        let mut push = |change: &dyn Fn(&mut Observations, f64)| {
            // The estimate bends: the mean of both directions leaves an error of third order.
            let moved = [1e-2, -1e-2].map(|sigmas| {
                let mut changed = simulation.observations.clone();
                change(&mut changed, sigmas);
                let options = CalibOptions { covariances: false, ..CalibOptions::default() };
                let poses = solve(&changed, &options).poses;
                if found.free.is_empty() { poses } else { aligned(&poses, &found, place) }
            });
            for (k, sum) in sums.iter_mut().enumerate() {
                let v = VertexId::new(k);
                let e = (moved[0][v].position - moved[1][v].position) / 2e-2;
                *sum += DMat3::from_cols(e * e.x, e * e.y, e * e.z);
            }
        };
        for edge in simulation.observations.edges.ids() {
            for axis in 0..6 {
                push(&|o, sigmas| {
                    if let DisplacementMeasurement::Relative(m) = &mut o.edges[edge].measurement {
                        let size = m.information.0[axis][axis].powf(-0.5) * sigmas;
                        let mut twist = [DVec3::ZERO; 2];
                        twist[axis / 3][axis % 3] = size;
                        m.pose.position += m.pose.rotation * twist[0];
                        m.pose.rotation *= DQuat::from_scaled_axis(twist[1]);
                    }
                });
            }
        }
        for contact in simulation.observations.contacts.ids() {
            for axis in 0..3 {
                push(&|o, sigmas| {
                    let (position, information) = touched(o, contact.index());
                    position[axis] += information.0[axis][axis].powf(-0.5) * sigmas;
                });
            }
        }
        for (c, sum) in found.marginals.unwrap().positions.iter().zip(&sums) {
            let told = DMat3::from(*c);
            let off = (told - *sum).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            assert!(off < 1e-5 * (c.xx + c.yy + c.zz).max(1e-8), "{anchors} anchors: {told} is not {sum}");
        }
    }
}

/// `poses` after the free motion that brings their positions closest to those found: about a touched
/// point only a rotation is free.
fn aligned(
    poses: &IdVec<VertexId, Pose>,
    found: &Calibration,
    touched: Option<DVec3>,
) -> IdVec<VertexId, Pose> {
    // With every point mirrored at the touched one that one is the centroid of either set.
    let doubled = |poses: &IdVec<VertexId, Pose>| -> IdVec<VertexId, Pose> {
        let mirrored = touched
            .iter()
            .flat_map(|t| poses.iter().map(|p| Pose { position: 2.0 * *t - p.position, ..Pose::default() }));
        poses.iter().copied().chain(mirrored).collect()
    };
    let motion = compare(&doubled(poses), &doubled(&found.poses)).unwrap().alignment;
    poses.iter().map(|p| motion * *p).collect()
}

/// Covariances against differences: the estimate is linear in the observations, so its covariance
/// is the sum over observations of what each does to it; where no contact holds the skin, to its
/// distance from the centroid.
#[test]
fn covariances_are_what_noise_does_to_the_estimate() {
    for (anchors, stretch) in [(0, 1.0), (2, 1.0), (0, 4.0), (2, 4.0)] {
        let options = SimulateOptions { taxels: 7, anchors, ..SimulateOptions::default() };
        let mut observations = observed(&options);
        offset(&mut observations, 0).1.0[0][0] *= stretch;
        let centred = |observations: &Observations| {
            let options = robust(Loss::Squared);
            let found = solve(observations, &options);
            let origin = if anchors == 0 { mean_position(&found.poses) } else { DVec3::ZERO };
            (found.poses.map(|p| p.position - origin), found.marginals.unwrap().positions)
        };
        let (base, covariances) = centred(&observations);
        let mut sums = vec![[0.0; 6]; 7];
        let mut push = |change: &dyn Fn(&mut Observations, usize)| {
            for axis in 0..3 {
                let mut changed = observations.clone();
                change(&mut changed, axis);
                for (sum, (a, b)) in sums.iter_mut().zip(centred(&changed).0.iter().zip(&base)) {
                    let [x, y, z] = (*a - *b).to_array();
                    let product = [x * x, x * y, x * z, y * y, y * z, z * z];
                    sum.iter_mut().zip(product).for_each(|(sum, p)| *sum += p);
                }
            }
        };
        // A push of one standard deviation.
        for edge in observations.edges.ids() {
            push(&|o, axis| {
                let (offset, information) = offset(o, edge.index());
                offset[axis] += information.0[axis][axis].powf(-0.5);
            });
        }
        for contact in observations.contacts.ids() {
            push(&|o, axis| {
                let (position, information) = touched(o, contact.index());
                position[axis] += information.0[axis][axis].powf(-0.5);
            });
        }
        for (c, sum) in covariances.iter().zip(&sums) {
            for (found, expected) in <[f64; 6]>::from(*c).iter().zip(sum) {
                assert!(
                    (found - expected).abs() < 1e-9 * c.sigma().powi(2),
                    "{anchors} anchors: {found} is not {expected}"
                );
            }
        }
    }
}

#[test]
fn anisotropic_information_with_equal_directions_is_isotropic_information() {
    let simulation = simulate(&SimulateOptions { anchors: 3, ..small(Model::Positions) }).unwrap();
    let mut nearly = simulation.observations.clone();
    // One direction that differs in the last digits takes the path of blocks.
    offset(&mut nearly, 0).1.0[0][0] *= 1.0 + 1e-12;
    let a = fit(&simulation.observations);
    let b = fit(&nearly);
    assert!((a.cost / b.cost - 1.0).abs() < 1e-9);
    let of = |c: &Calibration| c.marginals.as_ref().unwrap().positions[VertexId::new(5)];
    for (x, y) in <[f64; 6]>::from(of(&a)).into_iter().zip(<[f64; 6]>::from(of(&b))) {
        assert!((x - y).abs() < 1e-15, "{x} is not {y}");
    }
}

/// Two touched points leave the rotation about the line between them open: five motions of six are
/// held.
#[test]
fn partly_anchored_poses_keep_what_is_held() {
    for (anchors, directions) in [(1, 3), (2, 1), (3, 0)] {
        let simulation = simulate(&SimulateOptions { anchors, ..small(Model::Poses) }).unwrap();
        let found = fit(&simulation.observations);
        assert_eq!(found.free.iter().map(|f| f.free_motions).sum::<usize>(), directions, "{anchors} anchors");
        let observed = 6 * simulation.observations.edges.len() + 3 * anchors;
        assert_eq!(found.fit.degrees_of_freedom, observed - (6 * 40 - directions));
        if anchors < 3 {
            // One or two points fit exactly or stretch: the cost is that of the edges and the
            // distance between them.
            assert!(compare(&found.poses, &simulation.truth).unwrap().rigid < 3e-3);
        }
    }
}

/// Both graphs in one, with nothing between them; the ids of the second count from 1000.
fn side_by_side(one: &Observations, other: &Observations) -> Observations {
    let mut both = one.clone();
    let shift = |v: VertexId| VertexId::new(v.index() + one.taxels.len());
    for taxel in &other.taxels {
        let id = TaxelId(taxel.id.0 + 1000);
        both.taxels.push(TaxelVariable { id, ..*taxel });
    }
    for edge in &other.edges {
        both.edges.push(Displacement {
            from: shift(edge.from),
            to: shift(edge.to),
            measurement: edge.measurement.clone(),
        });
    }
    both
}

/// Two sheets that nothing joins, one of them anchored.
#[test]
fn components_are_calibrated_each_in_its_own_gauge() {
    let one = observed(&small(Model::Positions));
    let other = observed(&SimulateOptions { seed: 9, ..small(Model::Positions) });
    let first = one.taxels.len();
    let shift = |v: VertexId| VertexId::new(v.index() + first);
    let mut both = side_by_side(&one, &other);
    let position = DVec3::new(1.0, 2.0, 3.0);
    touch(&mut both, first + 4, position, [1e6; 3]);
    let found = fit(&both);
    assert_eq!(found.free.len(), 1, "{:?}", found.free);
    assert_eq!((found.free[0].gauge.0, found.free[0].taxels), (0, 40));
    assert!(found.poses[shift(VertexId::new(4))].position.distance(position) < 1e-12, "the contact holds it");
    let alone = fit(&other);
    let part: IdVec<VertexId, Pose> = found.poses.iter().skip(first).copied().collect();
    assert!(compare(&part, &alone.poses).unwrap().rigid < 1e-12, "one does not feel the other");
}

/// Reversing the order of taxels turns the first triangle of a sheet over: sheets must be turned
/// one by one.
#[test]
fn every_sheet_of_a_skin_is_seen_from_outside() {
    let one = observed(&small(Model::Poses));
    for other in [&one, &reversed(&one)] {
        let both = side_by_side(&one, other);
        let made = calibrated_skin(&fit(&both), &both, None).unwrap();
        assert_eq!(made.assumed, 0);
        for patch in &made.skin.patches {
            for face in patch.mesh.triangles.ids() {
                let normal = patch.taxels.normals[patch.mesh.triangles[face][0]];
                assert!(patch.mesh.face_cross(face).dot(normal) > 0.0, "{face:?} of {}", patch.name);
            }
        }
    }
}

/// The whole rotation of a pose arrives at the skin; positions alone tell no tangent.
#[test]
fn tangents_are_the_x_axes_of_calibrated_frames() {
    for model in [Model::Poses, Model::Positions] {
        let simulation = simulate(&small(model)).unwrap();
        let found = fit(&simulation.observations);
        let made = calibrated_skin(&found, &simulation.observations, None).unwrap();
        let taxels = &made.skin.patches.iter().next().unwrap().taxels;
        assert_eq!(made.skin.validate(), Ok(()));
        assert_eq!(taxels.tangents.is_some(), model == Model::Poses);
        for (v, t) in taxels.tangents.iter().flat_map(IdVec::enumerate) {
            let taxel = found.ids.enumerate().find(|(_, id)| **id == taxels.ids[v]).unwrap().0;
            assert_eq!(*t, found.poses[taxel].rotation * DVec3::X);
        }
    }
}

/// A normal on one sheet says nothing of the other.
#[test]
fn sheets_without_normals_look_away_from_the_origin() {
    let simulation = simulate(&small(Model::Positions)).unwrap();
    let one = simulation.observations;
    for other in [&one, &reversed(&one)] {
        let mut both = side_by_side(&one, other);
        let taxel = VertexId::new(4);
        let position = simulation.truth[taxel].position;
        let information = Information::diagonal([1e6; 3]);
        // The skin seen from inside.
        let normal = -position.normalize();
        let touch =
            ContactMeasurement::PositionNormal { position, information, normal, normal_information: 1.0 };
        both.contacts.push(ContactObservation { taxel, measurement: touch });
        let made = calibrated_skin(&fit(&both), &both, None).unwrap();
        assert_eq!(made.assumed, 1, "nothing touched the second sheet");
        for (patch, side) in made.skin.patches.iter().zip([-1.0, 1.0]) {
            for face in patch.mesh.triangles.ids() {
                let seen = patch.mesh.face_cross(face).dot(patch.mesh.corners(face)[0]);
                assert!(seen * side > 0.0, "{face:?} of {}", patch.name);
            }
        }
    }
}

/// An edge to a neighbour's neighbour: a wrong one, or one that says nothing.
#[test]
fn rejected_and_empty_edges_form_no_triangles() {
    let whole = observed(&small(Model::Positions));
    let sound = calibrated_skin(&fit(&whole), &whole, None).unwrap();
    let joined = |a: VertexId, b: VertexId| {
        whole.edges.iter().any(|e| [[e.from, e.to], [e.to, e.from]].contains(&[a, b]))
    };
    // Two taxels with an edge in common that is inside the sheet.
    let (a, b) = whole
        .taxels
        .ids()
        .flat_map(|a| whole.taxels.ids().map(move |b| (a, b)))
        .find(|&(a, b)| {
            let common: Vec<_> = whole.taxels.ids().filter(|&v| joined(a, v) && joined(b, v)).collect();
            a < b && !joined(a, b) && common.len() == 2 && joined(common[0], common[1])
        })
        .unwrap();
    for (information, off) in [(0.0, 0.0), (1e6, 0.02)] {
        let mut observations = whole.clone();
        join(&mut observations, [a.index(), b.index()], DVec3::X * off, information);
        let found = solve(&observations, &robust(Loss::Truncated));
        let made = calibrated_skin(&found, &observations, None).unwrap();
        let triangles = |made: &CalibratedSkin| made.skin.patches[0.into()].mesh.triangles.len();
        assert_eq!(triangles(&made), triangles(&sound), "information {information}");
    }
}

/// Its 4 million triangles must not be listed to learn that it is no surface.
#[test]
fn a_graph_of_all_edges_is_no_skin() {
    let mut observations = observed(&SimulateOptions { taxels: 300, ..SimulateOptions::default() });
    observations.edges = IdVec::default();
    for from in 0..300 {
        (from + 1..300).for_each(|to| join(&mut observations, [from, to], DVec3::ZERO, 1e6));
    }
    let options = CalibOptions { robust: Some(Loss::Squared), covariances: false, ..CalibOptions::default() };
    let error = calibrated_skin(&solve(&observations, &options), &observations, None).unwrap_err();
    assert!(matches!(error, CalibError::NoTriangulation(SheetDefect::NonManifoldEdge { .. })), "{error}");
}

/// Frames know the outside better than the winding of a table.
#[test]
fn given_triangles_that_are_inside_out_are_turned() {
    let simulation = simulate(&small(Model::Poses)).unwrap();
    let observations = &simulation.observations;
    let found = fit(observations);
    let mut triangles = simulation.mesh.triangles.as_slice().to_vec();
    let right = calibrated_skin(&found, observations, Some(&triangles)).unwrap();
    triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let turned = calibrated_skin(&found, observations, Some(&triangles)).unwrap();
    assert_eq!((right.turned, turned.turned), (0, 1));
    let normals = |made: &CalibratedSkin| Taxels::from(&made.skin.patches[0.into()].mesh).normals;
    assert_eq!(normals(&right), normals(&turned));
    let again = triangles[7];
    triangles.push(again);
    let error = calibrated_skin(&found, observations, Some(&triangles)).unwrap_err();
    assert!(matches!(error, CalibError::BadTriangles(_)) && error.to_string().contains("taxel"), "{error}");
}

/// A triangle with a taxel in its middle and all six edges: four triangles, of which one is the
/// boundary.
#[test]
fn edges_whose_triangles_close_up_are_no_skin() {
    let places = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(-1.0, -1.0, 0.0)];
    let unknown = |k| TaxelVariable { id: TaxelId(k), initial: None, fixed: false };
    let mut observations =
        Observations { taxels: (10..14).map(unknown).collect(), ..Observations::default() };
    for i in 0..4 {
        for j in i + 1..4 {
            join(&mut observations, [i, j], places[j] - places[i], 1.0);
        }
    }
    let found = fit(&observations);
    let error = calibrated_skin(&found, &observations, None).unwrap_err();
    assert_eq!(error, CalibError::NoTriangulation(SheetDefect::Closed { id: TaxelId(10) }));
}

#[test]
fn fixed_taxels_stay_where_they_are() {
    for model in [Model::Positions, Model::Poses] {
        let mut observations = observed(&small(model));
        let fixed = [VertexId::new(3), VertexId::new(20)];
        for v in fixed {
            observations.taxels[v].fixed = true;
        }
        let found = fit(&observations);
        for v in fixed {
            assert_eq!(Some(found.poses[v]), observations.taxels[v].initial);
            assert_eq!(sigmas(&found)[v], 0.0, "known exactly");
        }
        assert!(found.free.is_empty());
    }
}

#[test]
fn undetermined_taxels_are_named() {
    let mut observations = observed(&small(Model::Poses));
    let lost = VertexId::new(5);
    let mut found = |information: [f64; 6]| {
        for edge in observations.edges.iter_mut().filter(|edge| edge.from == lost || edge.to == lost) {
            if let DisplacementMeasurement::Relative(m) = &mut edge.measurement {
                m.information = Information::diagonal(information);
            }
        }
        calibrate(&observations, &CalibOptions::default()).err()
    };
    let id = TaxelId(5);
    assert_eq!(found([0.0; 6]), Some(CalibError::Unobserved { id, others: 0 }));
    // Edges that say something, but not where.
    assert_eq!(found([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]), Some(CalibError::Undetermined { id }));
}

#[test]
fn invalid_observations_are_refused() {
    let whole = observed(&small(Model::Positions));
    let kind = |change: &dyn Fn(&mut Observations)| {
        let mut broken = whole.clone();
        change(&mut broken);
        calibrate(&broken, &CalibOptions::default()).unwrap_err().kind()
    };
    let (five, edge) = (VertexId::new(5), DisplacementId::new(5));
    let lonely = TaxelVariable { id: TaxelId(77), initial: None, fixed: false };
    let touched = |taxel: usize, information: f64, normal: DVec3| {
        let (position, information) = (DVec3::ZERO, Information::diagonal([information; 3]));
        let measurement =
            ContactMeasurement::PositionNormal { position, information, normal, normal_information: 1.0 };
        ContactObservation { taxel: VertexId::new(taxel), measurement }
    };
    assert_eq!(kind(&|o| offset(o, 0).0.y = f64::NAN), "invalid_edge");
    assert_eq!(kind(&|o| offset(o, 0).0.y = 1e160), "invalid_edge");
    assert_eq!(kind(&|o| offset(o, 0).1.0[1][1] = -1.0), "indefinite_edge");
    assert_eq!(kind(&|o| offset(o, 0).1.0[0][1] = 0.1), "asymmetric_edge");
    assert_eq!(kind(&|o| o.edges[edge].to = VertexId::new(99)), "dangling");
    assert_eq!(kind(&|o| o.edges[edge].to = o.edges[edge].from), "self_edge");
    assert_eq!(kind(&|o| o.taxels[five].id = TaxelId(4)), "duplicate_taxel");
    assert_eq!(kind(&|o| o.model = Model::Poses), "wrong_model");
    assert_eq!(kind(&|o| o.edges = IdVec::default()), "empty");
    assert_eq!(kind(&|o| _ = o.taxels.push(lonely)), "unobserved");
    assert_eq!(kind(&|o| _ = o.contacts.push(touched(4, 1.0, DVec3::ONE))), "invalid_contact");
    assert_eq!(kind(&|o| _ = o.contacts.push(touched(4, -1.0, DVec3::Z))), "invalid_contact");
    assert_eq!(kind(&|o| _ = o.contacts.push(touched(99, 1.0, DVec3::Z))), "dangling");
    let silent = |o: &mut Observations| {
        o.taxels.push(lonely);
        o.contacts.push(touched(40, 0.0, DVec3::Z));
    };
    assert_eq!(kind(&silent), "unobserved", "zero information is no observation");
    let nan = Some(Pose { position: DVec3::NAN, ..Pose::default() });
    assert_eq!(kind(&|o| (o.taxels[five].initial, o.taxels[five].fixed) = (None, true)), "fixed_nowhere");
    assert_eq!(kind(&|o| o.taxels[five].initial = nan), "invalid_initial");
    let far = Some(Pose { position: DVec3::X * 1e160, ..Pose::default() });
    assert_eq!(kind(&|o| o.taxels[five].initial = far), "invalid_initial");
}

#[test]
fn threads_do_not_change_a_bit() {
    let simulation = simulate(&poses(4)).unwrap();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| fit(&simulation.observations));
        (found.poses, found.marginals, found.cost.to_bits())
    };
    assert!(run(1) == run(3), "one thread and three give the same bits");
}

/// The numbers of the experiment: 500 taxels at 5 mm on a sphere of 0.1 m.
#[test]
fn the_cap_of_the_experiment_has_its_edges_and_triangles() {
    let Simulation { observations, truth, mesh, .. } = simulate(&SimulateOptions::default()).unwrap();
    let (edges, triangles) = (observations.edges.len(), mesh.triangles.len());
    assert_eq!((edges, triangles), (1419, 920));
    assert_eq!(Adjacency::new(&mesh).unwrap().euler_characteristic(), 1, "a disk");
    let boundary = 2 * edges - 3 * triangles;
    assert_eq!(boundary, 78);
    assert_eq!(2 * 500 - 2 - boundary, 920, "triangles of a disk, closed form");
    for (v, frame) in truth.enumerate() {
        assert!((frame.position.length() - 0.1).abs() < 1e-15, "{v:?} is on the sphere");
        let normal = frame.rotation * DVec3::Z;
        assert!(normal.distance(frame.position / 0.1) < 1e-14, "{v:?} looks outwards");
    }
    for face in mesh.triangles.ids() {
        let [a, b, c] = mesh.triangles[face].map(|v| mesh.positions[v]);
        assert!((b - a).cross(c - a).dot(a) > 0.0, "{face:?} is seen from outside");
    }
    // The half-angle of a cap of this area.
    let area = 500.0 * 0.75_f64.sqrt() * 25e-6;
    let angle = (1.0 - area / (std::f64::consts::TAU * 0.01)).acos().to_degrees();
    assert!((angle - 34.1).abs() < 0.1, "{angle}");
}

/// Squares of the first two lengths are not finite; 6000 taxels wrap around the sphere.
#[test]
fn impossible_caps_are_refused() {
    let cases = [
        (500, 1e198, 1e200),
        (500, 1e-172, 1e-170),
        (500, 5e-3, 0.0),
        (500, f64::NAN, 0.1),
        (6000, 5e-3, 0.1),
    ];
    for (taxels, spacing, radius) in cases {
        let refused = simulate(&SimulateOptions { taxels, spacing, radius, ..SimulateOptions::default() });
        assert!(matches!(refused, Err(CalibError::BadOption { .. })), "{taxels}, {spacing}, {radius}");
    }
}

/// The generator and its logarithm are not the system's.
#[test]
fn a_seed_gives_the_same_bits_everywhere() {
    let mut observations = observed(&SimulateOptions { seed: 1, ..SimulateOptions::default() });
    let found = offset(&mut observations, 0).0.to_array();
    assert_eq!(found, [0.005416726228776905, 0.0002511261165057918, 0.000455105232372978]);
}

/// An information matrix is judged with its diagonal scaled to one: a micrometre next to two degrees
/// is 1e12/m^2 next to 800/rad^2.
#[test]
fn information_is_checked_with_a_unit_diagonal() {
    let accepts3 = |rows: [[f64; 3]; 3]| {
        let mut observations = observed(&small(Model::Positions));
        offset(&mut observations, 0).1.0 = rows;
        observations.validate().is_ok()
    };
    assert!(accepts3(Information::diagonal([1e6, 1e6, 0.0]).0), "zero is allowed");
    assert!(!accepts3([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), "a reflection");
    for tiny in [-0.009, -0.9] {
        assert!(!accepts3(Information::diagonal([1e8, 1e6, tiny]).0), "{tiny} is no rounding");
    }
    assert!(!accepts3([[1e308, 1.5e308, 0.0], [1.5e308, 1e308, 0.0], [0.0, 0.0, 1.0]]), "sums overflow");
    for (coupling, is_accepted) in [(1e7, true), (1e8, false)] {
        let mut observations = observed(&small(Model::Poses));
        if let DisplacementMeasurement::Relative(m) =
            &mut observations.edges[DisplacementId::new(0)].measurement
        {
            m.information = Information::diagonal([1e12, 1e12, 1e12, 800.0, 800.0, 0.0]);
            (m.information.0[0][3], m.information.0[3][0]) = (coupling, coupling);
        }
        assert_eq!(observations.validate().is_ok(), is_accepted, "{coupling}: correlated by more than one");
        if is_accepted {
            let all = observed(&small(Model::Poses));
            let [five, six] = [observations, all].map(|o| fit(&o).fit.measurements);
            assert_eq!(five, six - 1, "the direction without information is not counted");
        }
    }
}

/// Wrong edges are long: what is long is rejected whatever its residual, what is short is kept.
#[test]
fn the_length_prior_rejects_long_edges() {
    let mut simulation = simulate(&SimulateOptions { outliers: 0.1, ..SimulateOptions::default() }).unwrap();
    let rejected = fit(&simulation.observations).rejected().0;
    let [mut kept_long, mut lost_short, mut short] = [0; 3];
    for k in 0..simulation.observations.edges.len() {
        let (e, length) = (DisplacementId::new(k), offset(&mut simulation.observations, k).0.length());
        kept_long += usize::from(length > 15e-3 && !rejected.contains(&e));
        if length < 7e-3 && !simulation.outliers.contains(&e) {
            short += 1;
            lost_short += usize::from(rejected.contains(&e));
        }
    }
    assert_eq!(kept_long, 0);
    assert!(lost_short < short / 50, "{lost_short} of {short} short edges are lost");
}

/// Every fifth edge points the other way, as long as it was: length says nothing, and no right edge
/// is lost for it.
#[test]
fn the_length_prior_is_neutral_for_equal_lengths() {
    let mut observations = observed(&SimulateOptions::default());
    for k in (0..observations.edges.len()).step_by(5) {
        *offset(&mut observations, k).0 *= -1.0;
    }
    let found = fit(&observations);
    let (wrong, right): (Vec<_>, Vec<_>) = found.rejected().0.into_iter().partition(|e| e.index() % 5 == 0);
    assert!(wrong.len() > 1419 / 5 - 5, "{} of 284", wrong.len());
    assert!(right.len() < 1419 / 25, "{} right edges are lost", right.len());
}
