//! Laws of the fit of rigid bodies: touches of simulated skins find where their modules are.

use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

use dermatome::calib::{
    BodyCalibration, BodyFit, BodyFollower, BodyLevel, BodyOptions, CadSkin, CalibOptions, Calibration,
    ContactMeasurement, ContactObservation, ContactObservationId as ContactId, Folds, Information,
    JointMotion, Misassembly, NamedTaxel, Observations, TaxelVariable, Tolerance, TouchJoint, TouchRow,
    TouchingBody, fit_bodies,
};
use dermatome::id::{IdVec, VertexId};
use dermatome::mesh::shapes;
use dermatome::run::Run;
use dermatome::skin::{Draft, PatchId, Presence, Sheet, Skin, TaxelId};
use glam::{DQuat, DVec3};

/// Random numbers of a seed (splitmix64).
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    #[expect(clippy::cast_possible_truncation, reason = "below `count`, not negative")]
    fn below(&mut self, count: usize) -> usize {
        (self.uniform() * count as f64) as usize
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (TAU * self.uniform()).cos()
    }

    fn vector(&mut self, sigma: f64) -> DVec3 {
        sigma * DVec3::new(self.normal(), self.normal(), self.normal())
    }

    fn direction(&mut self) -> DVec3 {
        self.vector(1.0).normalize()
    }
}

/// A motion about a centre.
#[derive(Clone, Copy)]
struct Motion {
    centre: DVec3,
    translation: DVec3,
    rotation: DQuat,
}

impl Motion {
    fn apply(&self, x: DVec3) -> DVec3 {
        self.centre + self.translation + self.rotation * (x - self.centre)
    }

    /// Standard deviations per axis, in mm and degrees.
    fn random(random: &mut Random, centre: DVec3, mm: f64, degrees: f64) -> Self {
        let translation = random.vector(1e-3 * mm);
        Self { centre, translation, rotation: DQuat::from_scaled_axis(random.vector(degrees.to_radians())) }
    }
}

/// Modules side by side on a cylinder: triangles of 28 taxels 14 mm apart, ten modules to a patch.
struct Drawn {
    /// Positions by module.
    modules: Vec<Vec<DVec3>>,
    normals: Vec<DVec3>,
}

const TAXELS: usize = 28;
const PER_PATCH: usize = 10;

impl Drawn {
    fn new(count: usize) -> Self {
        let (mut modules, mut normals) = (Vec::new(), Vec::new());
        for module in 0..count {
            let (row, column) = (module / PER_PATCH, module % PER_PATCH);
            let (angle, along) = (0.3 * column as f64, 0.08 * row as f64);
            let (sin, cos) = angle.sin_cos();
            let (normal, u, v) = (DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
            let centre = 0.3 * normal + along * v;
            let mut taxels = Vec::new();
            for i in 0..7 {
                for j in 0..7 - i {
                    // The centroid of the triangle is at i = j = 2.
                    let [x, y] =
                        [i as f64 - 2.0 + 0.5 * (j as f64 - 2.0), 0.75_f64.sqrt() * (j as f64 - 2.0)];
                    taxels.push(centre + 0.014 * (x * u + y * v));
                }
            }
            modules.push(taxels);
            normals.push(normal);
        }
        Self { modules, normals }
    }

    fn cad(&self) -> CadSkin {
        self.cad_without_normals(0)
    }

    /// The drawing, whose first taxels have no normals.
    fn cad_without_normals(&self, missing: usize) -> CadSkin {
        let names: Vec<String> = (0..self.modules.len()).map(|m| format!("m{m}")).collect();
        let patches: Vec<String> = (0..self.modules.len()).map(|m| format!("p{}", m / PER_PATCH)).collect();
        let taxels = self.modules.iter().enumerate().flat_map(|(m, taxels)| {
            let (names, patches, normal) = (&names, &patches, self.normals[m]);
            taxels.iter().enumerate().map(move |(k, &position)| NamedTaxel {
                id: taxel_id(m, k),
                position,
                normal: (m * TAXELS + k >= missing).then_some(normal),
                module: &names[m],
                patch: &patches[m],
            })
        });
        CadSkin::new(taxels).unwrap()
    }

    fn centre(&self, modules: impl Iterator<Item = usize>) -> DVec3 {
        let all: Vec<DVec3> = modules.flat_map(|m| self.modules[m].clone()).collect();
        all.iter().sum::<DVec3>() / all.len() as f64
    }

    /// A skin whose mount, patches and modules moved; `place` is where each module was put.
    fn spoiled(&self, random: &mut Random, spoil: &Spoil, place: impl Fn(usize) -> usize) -> Truth {
        let count = self.modules.len();
        let mount = Motion::random(random, self.centre(0..count), spoil.mount[0], spoil.mount[1]);
        let patches: Vec<Motion> = (0..count / PER_PATCH)
            .map(|p| {
                let centre = self.centre(p * PER_PATCH..(p + 1) * PER_PATCH);
                Motion::random(random, centre, spoil.patch[0], spoil.patch[1])
            })
            .collect();
        let mut truth = Truth { modules: Vec::new(), centres: Vec::new(), rotations: Vec::new() };
        for module in 0..count {
            let at = place(module);
            let centre = self.centre(at..at + 1);
            let own = Motion {
                centre,
                translation: 1e-3 * spoil.module[0] * random.direction(),
                rotation: DQuat::from_scaled_axis(spoil.module[1].to_radians() * random.direction()),
            };
            let patch = patches[at / PER_PATCH];
            let placed = |x: DVec3| mount.apply(patch.apply(own.apply(x)));
            let turn = if spoil.turned == Some(module) { TAU / 3.0 } else { 0.0 };
            let turn = DQuat::from_axis_angle(self.normals[at], turn);
            truth
                .modules
                .push(self.modules[at].iter().map(|&x| placed(centre + turn * (x - centre))).collect());
            truth.centres.push(placed(centre));
            truth.rotations.push(mount.rotation * patch.rotation * own.rotation);
        }
        truth
    }
}

fn taxel_id(module: usize, slot: usize) -> TaxelId {
    TaxelId(u32::try_from(100 * module + slot).unwrap())
}

/// How far the bodies are from the drawing, in mm and degrees: of mount and patches the standard deviation per axis, of
/// modules the length of the motion.
#[derive(Clone, Copy, Default)]
struct Spoil {
    mount: [f64; 2],
    patch: [f64; 2],
    module: [f64; 2],
    turned: Option<usize>,
}

/// Where taxels truly are, by module.
struct Truth {
    modules: Vec<Vec<DVec3>>,
    centres: Vec<DVec3>,
    rotations: Vec<DQuat>,
}

/// The probe that touches: noise per axis, in m, and its offset in its own frame.
#[derive(Clone, Copy)]
struct Probe {
    noise: f64,
    offset: DVec3,
}

const STILL: Probe = Probe { noise: 3e-3, offset: DVec3::ZERO };

/// `count` touches of each of the modules, each felt by one to three taxels, and repeated.
fn touches(
    truth: &Truth,
    random: &mut Random,
    modules: impl Iterator<Item = usize>,
    count: usize,
    probe: Probe,
    repeats: u64,
) -> Observations {
    let mut observations = Observations::default();
    let mut vertices = std::collections::HashMap::new();
    let mut number = 0;
    for module in modules {
        for contact in 0..count {
            let felt: Vec<usize> = (0..1 + random.below(3)).map(|_| random.below(TAXELS)).collect();
            let mut felt = felt;
            felt.sort_unstable();
            felt.dedup();
            let mean = felt.iter().map(|&k| truth.modules[module][k]).sum::<DVec3>() / felt.len() as f64;
            let orientation = DQuat::from_scaled_axis(random.vector(1.0));
            let position = mean + random.vector(probe.noise) - orientation * probe.offset;
            let sigma = probe.noise.max(1e-4);
            for _ in 0..repeats {
                for &k in &felt {
                    let id = taxel_id(module, k);
                    let taxel: VertexId = *vertices.entry(id).or_insert_with(|| {
                        observations.taxels.push(TaxelVariable { id, initial: None, fixed: false })
                    });
                    let information = Information::diagonal([sigma.powi(-2); 3]);
                    let measurement = ContactMeasurement::Position { position, information };
                    observations.contacts.push(ContactObservation { taxel, measurement });
                    observations.touches.push(TouchRow {
                        touch: Some(number),
                        contact: Some((module * 1000 + contact) as u64),
                        weight: 1.0,
                        probe: Some(orientation),
                        body: None,
                        outward: None,
                        path: None,
                        velocity: None,
                        by_joints: Vec::new(),
                    });
                }
                number += 1;
            }
        }
    }
    observations
}

fn modules(found: &BodyCalibration) -> Vec<&BodyFit> {
    found.bodies.iter().filter(|body| body.level == BodyLevel::Module).collect()
}

/// Errors of the pose of a module: of its centre in m, and its rotation vector in rad.
fn pose_error(body: &BodyFit, truth: &Truth, module: usize) -> [f64; 6] {
    let pose = body.pose.unwrap();
    let (t, r) = (
        truth.centres[module] - pose.centre,
        (truth.rotations[module] * pose.rotation.conjugate()).normalize().to_scaled_axis(),
    );
    [t.x, t.y, t.z, r.x, r.y, r.z]
}

/// `e' C^-1 e`, by elimination.
fn squared(mut c: [[f64; 6]; 6], error: [f64; 6]) -> f64 {
    let mut x = error;
    for k in 0..6 {
        for i in k + 1..6 {
            let factor = c[i][k] / c[k][k];
            let pivot = c[k];
            c[i].iter_mut().zip(pivot).skip(k).for_each(|(x, p)| *x -= factor * p);
            x[i] -= factor * x[k];
        }
    }
    for k in (0..6).rev() {
        for j in k + 1..6 {
            x[k] -= c[k][j] * x[j];
        }
        x[k] /= c[k][k];
    }
    x.iter().zip(error).map(|(x, e)| x * e).sum()
}

/// Tolerances that the spoiled skin keeps: a vector of a fixed length has a third of its square on each axis.
fn tolerant(spoil: &Spoil) -> BodyOptions {
    let third = 3.0_f64.sqrt().recip();
    BodyOptions {
        mount: Tolerance::mm_deg(spoil.mount[0], spoil.mount[1]),
        patch: Tolerance::mm_deg(spoil.patch[0], spoil.patch[1]),
        module: Tolerance::mm_deg(third * spoil.module[0], third * spoil.module[1]),
        ..BodyOptions::default()
    }
}

/// Forty modules, each 5 mm and 5 degrees from the drawing, two of them exchanged and one turned by 120 degrees, are found from
/// 20 touches each of 3 mm noise per axis, with true standard deviations. The bounds are those of the information in the
/// touches: 3 mm / sqrt(20) per axis of the centre, and 2 degrees per axis need modules of this size.
#[test]
fn spoiled_modules_are_found_and_named() {
    const SEEDS: u64 = 20;
    let drawn = Drawn::new(40);
    let cad = drawn.cad();
    let spoil = Spoil { mount: [20.0, 5.0], patch: [1.0, 1.0], module: [5.0, 5.0], turned: Some(23) };
    let place = |module| match module {
        7 => 31,
        31 => 7,
        other => other,
    };
    let (mut translation, mut rotation, mut normalised) = (0.0, 0.0, 0.0);
    let (mut chi2, mut degrees) = (0.0, 0.0);
    for seed in 0..SEEDS {
        let mut random = Random(seed);
        let truth = drawn.spoiled(&mut random, &spoil, place);
        let observations = touches(&truth, &mut random, 0..40, 20, STILL, 1);
        let found = fit_bodies(&observations, &cad, &tolerant(&spoil)).unwrap();
        let named = &found.misassembled;
        let exchanged: Vec<_> = named.exchanged.iter().map(|pair| pair.map(|m| m.index())).collect();
        let turned: Vec<_> = named.turned.iter().map(|t| (t.module.index(), t.degrees)).collect();
        assert_eq!(exchanged, [[7, 31]], "seed {seed}");
        assert_eq!(turned, [(23, 120.0)], "seed {seed}");
        assert!(found.converged, "seed {seed}");
        for (module, body) in modules(&found).into_iter().enumerate() {
            let error = pose_error(body, &truth, module);
            translation += error[..3].iter().map(|x| x * x).sum::<f64>();
            rotation += error[3..].iter().map(|x| x * x).sum::<f64>();
            normalised += squared(body.pose.unwrap().covariance, error);
        }
        chi2 += found.chi2;
        degrees += found.degrees_of_freedom;
    }
    let count = 40.0 * SEEDS as f64;
    let translation_mm = 1e3 * (translation / count).sqrt();
    let rotation_deg = (rotation / (3.0 * count)).sqrt().to_degrees();
    let (ratio, fit) = (normalised / (6.0 * count), chi2 / degrees);
    println!(
        "centre {translation_mm} mm, {rotation_deg} degrees per axis, {ratio} of dof, chi2 {fit} of dof"
    );
    assert!(translation_mm < 1.2, "{translation_mm} mm");
    assert!(rotation_deg < 2.0, "{rotation_deg} degrees per axis");
    assert!((0.9..1.1).contains(&ratio), "errors are {ratio} of their covariance");
    assert!((0.9..1.1).contains(&fit), "chi2 is {fit} of its degrees of freedom");
}

/// The standard deviation that all contacts state, in m.
fn state(observations: &mut Observations, sigma: f64) {
    for contact in observations.contacts.iter_mut() {
        if let ContactMeasurement::Position { information, .. } = &mut contact.measurement {
            *information = Information::diagonal([sigma.powi(-2); 3]);
        }
    }
}

/// The noise is estimated without bias from few touches of each module, whatever the table states, and standard deviations
/// are true with it.
#[test]
fn estimated_noise_is_that_of_the_touches() {
    const SEEDS: u64 = 5;
    let drawn = Drawn::new(20);
    let cad = drawn.cad();
    let spoil = Spoil { mount: [20.0, 5.0], patch: [1.0, 1.0], module: [5.0, 5.0], turned: None };
    let options = BodyOptions { misassembly: Misassembly::Reported, ..tolerant(&spoil) };
    let (mut noise, mut normalised) = (0.0, 0.0);
    for seed in 0..SEEDS {
        let mut random = Random(seed);
        let truth = drawn.spoiled(&mut random, &spoil, |module| module);
        let probe = Probe { noise: 2e-3, ..STILL };
        let mut observations = touches(&truth, &mut random, 0..20, 12, probe, 1);
        // The table states a fifth of it.
        state(&mut observations, 4e-4);
        let found = fit_bodies(&observations, &cad, &options).unwrap();
        noise += found.noise / 2e-3 / SEEDS as f64;
        assert!((found.noise_over_stated / 5.0 - 1.0).abs() < 0.2, "{}", found.noise_over_stated);
        for (module, body) in modules(&found).into_iter().enumerate() {
            normalised += squared(body.pose.unwrap().covariance, pose_error(body, &truth, module));
        }
    }
    let ratio = normalised / (6.0 * 20.0 * SEEDS as f64);
    println!("{noise} of the noise, errors {ratio} of their covariance");
    assert!((0.9..1.1).contains(&noise), "{noise} of the noise");
    assert!((0.9..1.1).contains(&ratio), "errors are {ratio} of their covariance");
}

/// Nothing is named that is not there.
#[test]
fn modules_in_their_places_are_not_named() {
    let drawn = Drawn::new(20);
    let spoil = Spoil { mount: [20.0, 5.0], patch: [1.0, 1.0], module: [5.0, 5.0], turned: None };
    let mut random = Random(100);
    let truth = drawn.spoiled(&mut random, &spoil, |module| module);
    let observations = touches(&truth, &mut random, 0..20, 20, STILL, 1);
    let found = fit_bodies(&observations, &drawn.cad(), &tolerant(&spoil)).unwrap();
    assert_eq!(found.misassembled, Default::default());
    // The tolerance of the modules is that of the spoil.
    let doubtful = modules(&found).iter().filter(|m| !m.test.unwrap().is_believable()).count();
    assert!(doubtful == 0, "{doubtful} modules are doubtful under their own tolerance");
    // With a tenth of it they are not believable.
    let strict = BodyOptions { module: Tolerance::mm_deg(0.3, 0.3), ..tolerant(&spoil) };
    let found = fit_bodies(&observations, &drawn.cad(), &strict).unwrap();
    let doubtful = modules(&found).iter().filter(|m| !m.test.unwrap().is_believable()).count();
    assert!(doubtful > 5, "only {doubtful} of 20 modules are doubtful");
}

/// An untouched module moves with its patch.
#[test]
fn an_untouched_module_keeps_its_drawn_pose_on_its_patch() {
    let drawn = Drawn::new(10);
    let spoil = Spoil { mount: [10.0, 3.0], patch: [1e-6, 1e-6], module: [1e-6, 1e-6], turned: None };
    let mut random = Random(1);
    let truth = drawn.spoiled(&mut random, &spoil, |module| module);
    let probe = Probe { noise: 1e-5, ..STILL };
    let observations = touches(&truth, &mut random, 1..10, 20, probe, 1);
    let found = fit_bodies(&observations, &drawn.cad(), &BodyOptions::default()).unwrap();
    assert_eq!(found.untouched.iter().map(|m| m.index()).collect::<Vec<_>>(), [0]);
    let module = modules(&found)[0];
    assert!(module.translation.length() < 1e-12 && module.rotation.length() < 1e-12, "it follows its patch");
    assert_eq!((module.contacts, module.test), (0, None));
    let error = pose_error(module, &truth, 0);
    let far = DVec3::from_slice(&error).length();
    assert!(far < 1e-4, "{far} m, although all others show where the patch is");
    let sigma = |k: usize| found.taxels[VertexId::new(k)].covariance.sigma();
    assert!(sigma(0) > 2.0 * sigma(TAXELS), "its taxels are less certain than those of a touched module");
}

/// Touches of a sphere of 10 mm whose centre is given, 1 mm less above the taxels than its radius.
fn spheres(truth: &Truth, drawn: &Drawn, observations: &mut Observations) {
    const RADIUS: f64 = 0.01;
    for number in observations.contacts.ids().collect::<Vec<_>>() {
        let contact = &observations.contacts[number];
        let ContactMeasurement::Position { position, .. } = contact.measurement else { continue };
        let id = observations.taxels[contact.taxel].id;
        let module = (0..drawn.normals.len()).find(|m| (0..TAXELS).any(|k| taxel_id(*m, k) == id)).unwrap();
        let centre = position + (RADIUS - 1e-3) * (truth.rotations[module] * drawn.normals[module]);
        observations.touches[number].body = Some(TouchingBody { centre, radius: RADIUS });
    }
}

/// The root mean square distance of the fitted taxels from the truth, in m.
fn error(found: &BodyCalibration, truth: &Truth) -> f64 {
    let at: std::collections::HashMap<TaxelId, DVec3> =
        found.taxels.iter().map(|taxel| (taxel.id, taxel.position)).collect();
    let each = truth.modules.iter().enumerate().flat_map(|(m, taxels)| {
        taxels.iter().enumerate().map(|(k, x)| at[&taxel_id(m, k)].distance_squared(*x)).collect::<Vec<_>>()
    });
    let squares: Vec<f64> = each.collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// The radius of a sphere is taken off along the normals of the fit, from whatever pose the drawing has: as drawn, or turned
/// by 90 degrees and 60 mm off. A taxel without a normal concerns its own touches.
#[test]
fn spheres_are_taken_off_along_the_normals_of_the_fit() {
    let drawn = Drawn::new(20);
    for (mount, missing) in [([25.0, 8.0], 0), ([60.0, 90.0], 0), ([25.0, 8.0], 10)] {
        let spoil = Spoil { mount, patch: [1.5, 2.0], module: [0.7, 2.0], turned: None };
        let mut random = Random(12);
        let truth = drawn.spoiled(&mut random, &spoil, |module| module);
        let offset = DVec3::new(0.0, -0.006, 0.008);
        let probe = Probe { noise: 1e-3, offset };
        let mut observations = touches(&truth, &mut random, 0..20, 15, probe, 1);
        spheres(&truth, &drawn, &mut observations);
        let options =
            BodyOptions { probe: Some(0.02), folds: Some(Folds::default()), ..BodyOptions::default() };
        let found = fit_bodies(&observations, &drawn.cad_without_normals(missing), &options).unwrap();
        let far = error(&found, &truth);
        println!("{mount:?}: {:.2} mm, {} rejected", 1e3 * far, found.rejected.len());
        assert!(far < 2e-3, "{far} m from {mount:?}");
        assert!(found.rejected.len() < 15, "{} of 300 touches", found.rejected.len());
        assert_eq!(found.faults(), Vec::<String>::new());
        let [standoff, sigma] = found.standoff.unwrap();
        assert!(standoff.abs() < 4.0 * sigma && sigma < 1.5e-3, "{standoff} m with {sigma} m");
    }
}

/// Makes the values of joints wrong by constant `offsets`, the last of a joint that slides: touches are not where the robot believes them.
fn joints_are_off(observations: &mut Observations, random: &mut Random, offsets: &[f64]) {
    let joint = |k: usize| TouchJoint {
        name: format!("j{k}"),
        motion: if k + 1 == offsets.len() { JointMotion::Slides } else { JointMotion::Turns },
    };
    observations.joints = (0..offsets.len()).map(joint).collect();
    let mut columns = std::collections::HashMap::new();
    for (contact, row) in observations.contacts.iter_mut().zip(observations.touches.iter_mut()) {
        row.by_joints.clone_from(columns.entry(row.touch).or_insert_with(|| {
            let turns = (1..offsets.len()).map(|_| random.vector(0.3)).collect::<Vec<_>>();
            turns.into_iter().chain([random.vector(1.0).normalize()]).collect::<Vec<DVec3>>()
        }));
        if let ContactMeasurement::Position { position, .. } = &mut contact.measurement {
            *position -= row.by_joints.iter().zip(offsets).map(|(j, q)| *j * *q).sum::<DVec3>();
        }
    }
}

/// Seven joints, one of which slides, are off by 0.4 degrees and 1 mm: their offsets are found within their standard deviations,
/// and the skin as from exact joints.
#[test]
fn offsets_of_joints_are_found() {
    let drawn = Drawn::new(20);
    let spoil = Spoil { mount: [25.0, 8.0], patch: [1.5, 2.0], module: [0.7, 2.0], turned: None };
    let (mut normalised, mut worst) = (0.0, 0.0_f64);
    for seed in 0..3 {
        let mut random = Random(seed);
        let truth = drawn.spoiled(&mut random, &spoil, |module| module);
        let mut observations =
            touches(&truth, &mut random, 0..20, 12, Probe { noise: 1e-3, offset: DVec3::ZERO }, 1);
        let options = BodyOptions { folds: Some(Folds::default()), ..BodyOptions::default() };
        let exact = error(&fit_bodies(&observations, &drawn.cad(), &options).unwrap(), &truth);
        let off = random.vector(0.4_f64.to_radians()).to_array().into_iter();
        let off: Vec<f64> = off.chain(random.vector(0.4_f64.to_radians()).to_array()).chain([1e-3]).collect();
        joints_are_off(&mut observations, &mut random, &off);
        let without = error(&fit_bodies(&observations, &drawn.cad(), &options).unwrap(), &truth);
        let options = BodyOptions { joints: Some(Tolerance::mm_deg(1.0, 1.0)), ..options };
        let found = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
        let with = error(&found, &truth);
        println!("{:.2} mm, without {:.2}, exact joints {:.2}", 1e3 * with, 1e3 * without, 1e3 * exact);
        assert!(with < 1.2 * exact && with < 0.8 * without, "{with} m, without {without} m, exact {exact} m");
        assert_eq!(found.joints.len(), 7);
        for (joint, off) in found.joints.iter().zip(&off) {
            let off = (joint.offset - off) / joint.sigma;
            normalised += off * off / 21.0;
            worst = worst.max(off.abs());
            assert!(joint.sigma < 0.2 * joint.tolerance, "{joint:?}");
        }
    }
    println!("errors of offsets over sigma: {normalised:.2} squared, {worst:.2} at most");
    assert!((0.4..2.0).contains(&normalised) && worst < 4.0, "{normalised}, {worst}");
}

/// Readings that are 40 ms late: touches that slide in all directions tell it, and the skin is as with a right clock. Of a right clock nothing
/// is taken off.
#[test]
fn late_readings_are_found_by_the_velocity_of_touches() {
    let drawn = Drawn::new(20);
    let spoil = Spoil { mount: [25.0, 8.0], patch: [1.5, 2.0], module: [0.7, 2.0], turned: None };
    for (seed, late) in [(0, 0.0), (1, 0.04), (2, -0.06)] {
        let mut random = Random(seed);
        let truth = drawn.spoiled(&mut random, &spoil, |module| module);
        let probe = Probe { noise: 1e-3, offset: DVec3::ZERO };
        let mut observations = touches(&truth, &mut random, 0..20, 12, probe, 1);
        let options = BodyOptions { folds: Some(Folds::default()), ..BodyOptions::default() };
        let exact = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
        assert_eq!(exact.delay, None);
        let mut velocities = std::collections::HashMap::new();
        for (contact, row) in observations.contacts.iter_mut().zip(observations.touches.iter_mut()) {
            let velocity = *velocities.entry(row.touch).or_insert_with(|| random.vector(0.015));
            row.velocity = Some(velocity);
            if let ContactMeasurement::Position { position, .. } = &mut contact.measurement {
                *position += velocity * late;
            }
        }
        let found = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
        let delay = found.delay.unwrap();
        println!(
            "{late} s: {delay:?}, {:.2} mm for {:.2}",
            1e3 * error(&found, &truth),
            1e3 * error(&exact, &truth)
        );
        assert!(
            (delay.seconds - late).abs() < 4.0 * delay.sigma && delay.sigma < 8e-3,
            "{delay:?} for {late} s"
        );
        assert_eq!(delay.removed, if late == 0.0 { 0.0 } else { delay.seconds });
        assert!(error(&found, &truth) < 1.1 * error(&exact, &truth));
    }
}

/// Offsets of joints need to know how each touch moves with them, and a joint far beyond its tolerance is named.
#[test]
fn offsets_of_joints_need_their_columns() {
    let drawn = Drawn::new(20);
    let mut random = Random(4);
    let truth = drawn.spoiled(&mut random, &Spoil::default(), |module| module);
    let mut observations = touches(&truth, &mut random, 0..20, 10, STILL, 1);
    let options = BodyOptions { joints: Some(Tolerance::mm_deg(1.0, 1.0)), ..BodyOptions::default() };
    let said = fit_bodies(&observations, &drawn.cad(), &options).unwrap_err().to_string();
    assert!(said.contains("row 1 ") && said.contains("dx:NAME"), "{said}");
    joints_are_off(&mut observations, &mut random, &[0.2, 0.0]);
    let doubts = fit_bodies(&observations, &drawn.cad(), &options).unwrap().doubts().join("; ");
    assert!(doubts.contains("the joint j0 is off by 11"), "{doubts}");
    let row = observations.touches.iter_mut().nth(2).unwrap();
    row.by_joints.pop();
    let said = fit_bodies(&observations, &drawn.cad(), &options).unwrap_err().to_string();
    assert!(said.contains("not known of each joint"), "{said}");
}

/// Touches of taxels whose ids are shuffled are those of no skin: the fit says so.
#[test]
fn a_wrong_log_is_not_believed() {
    let drawn = Drawn::new(20);
    let mut random = Random(9);
    let truth = drawn.spoiled(&mut random, &Spoil::default(), |module| module);
    let mut observations = touches(&truth, &mut random, 0..20, 10, STILL, 1);
    let options = BodyOptions { folds: Some(Folds::default()), ..BodyOptions::default() };
    let right = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
    assert_eq!(right.faults(), Vec::<String>::new());
    assert!(right.held_back.unwrap().explained > 0.97);
    let ids: Vec<TaxelId> = observations.taxels.iter().map(|taxel| taxel.id).collect();
    for (k, taxel) in observations.taxels.iter_mut().enumerate() {
        // A step that has no factor in common with the number of taxels, most of which is on other modules.
        taxel.id = ids[(k * 37 + 11) % ids.len()];
    }
    assert!(!ids.len().is_multiple_of(37), "the step visits every taxel");
    let wrong = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
    let explained = wrong.held_back.as_ref().unwrap().explained;
    assert!(explained < 0.85 && !wrong.faults().is_empty(), "{explained}: {:?}", wrong.faults());
}

/// Readings fall as a sphere moves outwards: normals that point inwards are found, which the distances do not show.
#[test]
fn normals_that_point_inwards_are_refused() {
    let drawn = Drawn::new(20);
    let mut random = Random(14);
    let truth = drawn.spoiled(&mut random, &Spoil::default(), |module| module);
    let mut observations = touches(&truth, &mut random, 0..20, 10, Probe { noise: 1e-3, ..STILL }, 1);
    for number in observations.contacts.ids().collect::<Vec<_>>() {
        let id = observations.taxels[observations.contacts[number].taxel].id;
        let module = (0..20).find(|m| (0..TAXELS).any(|k| taxel_id(*m, k) == id)).unwrap();
        let outward = truth.rotations[module] * drawn.normals[module];
        observations.touches[number].outward = Some(4.0 * outward + random.vector(0.3));
    }
    let options = BodyOptions { folds: Some(Folds::default()), ..BodyOptions::default() };
    let mut cad = drawn.cad();
    let right = fit_bodies(&observations, &cad, &options).unwrap();
    assert!(right.side > 20.0 && right.faults().is_empty(), "{}: {:?}", right.side, right.faults());
    cad.taxels.iter_mut().for_each(|taxel| taxel.normal = taxel.normal.map(|normal| -normal));
    let wrong = fit_bodies(&observations, &cad, &options).unwrap();
    assert!(wrong.side < -20.0, "{}", wrong.side);
    assert!(wrong.faults()[0].contains("mirrored"), "{:?}", wrong.faults());
    // One patch of two: the sum of all does not tell.
    let mut cad = drawn.cad();
    for taxel in cad.taxels.iter_mut().filter(|taxel| taxel.module.index() >= PER_PATCH) {
        taxel.normal = taxel.normal.map(|normal| -normal);
    }
    let mixed = fit_bodies(&observations, &cad, &options).unwrap();
    assert!(mixed.side > -4.0 && mixed.sides[0].1 > 10.0 && mixed.sides[1].1 < -10.0, "{:?}", mixed.sides);
    assert!(mixed.faults()[0].contains("patch p1"), "{:?}", mixed.faults());
    // Two touches do not tell, however certain.
    let few = |k: u64| k < 2;
    for row in observations.touches.iter_mut() {
        row.outward = row.outward.map(|outward| if few(row.touch.unwrap()) { -outward } else { DVec3::ZERO });
    }
    assert_eq!(fit_bodies(&observations, &drawn.cad(), &options).unwrap().side, 0.0);
}

/// Ids that are exchanged within each patch of a long link are seen, though the patches are where the touches are.
#[test]
fn ids_exchanged_within_patches_are_seen() {
    let mut drawn = Drawn::new(40);
    for (m, module) in drawn.modules.iter_mut().enumerate() {
        module.iter_mut().for_each(|x| x.z += 0.6 * (m / PER_PATCH) as f64);
    }
    let mut random = Random(21);
    let truth = drawn.spoiled(&mut random, &Spoil::default(), |module| module);
    let mut observations = touches(&truth, &mut random, 0..40, 10, STILL, 1);
    let options = BodyOptions { folds: Some(Folds::default()), ..BodyOptions::default() };
    let right = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
    let explained = &right.held_back.as_ref().unwrap().explained_of_patches;
    assert!(right.faults().is_empty() && explained.iter().all(|x| x.unwrap() > 0.9), "{explained:?}");
    // Each patch has ids 1000 p + 100 m + k; the ids of a patch are shuffled among themselves.
    let ids: Vec<TaxelId> = observations.taxels.iter().map(|taxel| taxel.id).collect();
    for patch in 0..4 {
        let own: Vec<usize> = (0..ids.len()).filter(|k| ids[*k].0 / 1000 == patch).collect();
        for (n, &k) in own.iter().enumerate() {
            observations.taxels[VertexId::new(k)].id = ids[own[(n * 37 + 11) % own.len()]];
        }
        assert!(!own.len().is_multiple_of(37));
    }
    let wrong = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
    let held_back = wrong.held_back.as_ref().unwrap();
    println!("{} of all, {:?}", held_back.explained, held_back.explained_of_patches);
    assert!(held_back.explained > 0.85, "{}", held_back.explained);
    assert!(
        wrong.faults().iter().any(|fault| fault.contains("touches of the patch p")),
        "{:?}",
        wrong.faults()
    );
}

/// A radius that touches lack is that of the others, if all agree.
#[test]
fn missing_radii_are_those_of_the_other_touches() {
    let drawn = Drawn::new(20);
    let mut random = Random(12);
    let truth =
        drawn.spoiled(&mut random, &Spoil { mount: [25.0, 8.0], ..Spoil::default() }, |module| module);
    let mut observations = touches(&truth, &mut random, 0..20, 10, Probe { noise: 1e-3, ..STILL }, 1);
    spheres(&truth, &drawn, &mut observations);
    let options = BodyOptions::default();
    let whole = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
    for row in observations.touches.iter_mut().filter(|row| row.touch.is_some_and(|number| number % 2 == 1)) {
        row.body = row.body.map(|body| TouchingBody { radius: 0.0, ..body });
    }
    let half = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
    assert_eq!((whole.assumed_radii, half.assumed_radii), (0, 100));
    assert!(half.taxels.iter().zip(&whole.taxels).all(|(a, b)| a.position.distance(b.position) < 1e-9));
    let first = ContactId::new(0);
    observations.touches[first].body.as_mut().unwrap().radius = 0.02;
    let number = observations.touches[first].touch;
    for row in observations.touches.iter_mut().filter(|row| row.touch == number) {
        row.body.as_mut().unwrap().radius = 0.02;
    }
    let error = fit_bodies(&observations, &drawn.cad(), &options).unwrap_err().to_string();
    assert!(error.contains("without its radius, as 100 touches"), "{error}");
}

/// Slots without a taxel and placeholders are no taxels of a drawing.
#[test]
fn empty_slots_of_a_drawing_are_left_out() {
    let slots = |presence: Option<Vec<Presence>>| Draft {
        sheets: vec![Sheet {
            name: "palm".into(),
            ids: Some([7, 8, u32::MAX, u32::MAX, 9].map(TaxelId).to_vec()),
            positions: [0.0, 0.01, 0.02, 0.03, f64::NAN].map(|x| DVec3::new(x, 0.0, 0.1)).to_vec(),
            modules: Some(vec![0, 0, 1, 1, 1]),
            presence,
            ..Sheet::default()
        }],
        ..Draft::default()
    };
    let absent =
        [Presence::Present, Presence::Present, Presence::Present, Presence::Absent, Presence::Absent];
    let cad = CadSkin::of_draft(&slots(Some(absent.to_vec())), None).unwrap();
    assert_eq!(cad.taxels.iter().map(|taxel| taxel.id.0).collect::<Vec<_>>(), [7, 8]);
    assert_eq!(cad.modules.len(), 1);
    assert!(CadSkin::of_draft(&slots(None), None).is_err(), "a taxel that is there needs a position");
}

/// Repeats of a contact change nothing: neither the result nor its covariances.
#[test]
fn repeats_of_a_contact_count_once() {
    let drawn = Drawn::new(10);
    let spoil = Spoil { mount: [20.0, 5.0], patch: [1.0, 1.0], module: [1.0, 1.0], turned: None };
    let fit = |repeats: u64| {
        let mut random = Random(5);
        let truth = drawn.spoiled(&mut random, &spoil, |module| module);
        let probe = Probe { offset: DVec3::new(0.0, -0.008, 0.014), ..STILL };
        let observations = touches(&truth, &mut random, 0..10, 10, probe, repeats);
        let options = BodyOptions { probe: Some(0.02), ..tolerant(&spoil) };
        fit_bodies(&observations, &drawn.cad(), &options).unwrap()
    };
    let (once, often) = (fit(1), fit(4));
    assert_eq!([once.counts, often.counts], [[100, 100], [400, 100]]);
    for (a, b) in once.taxels.iter().zip(&often.taxels) {
        let far = a.position.distance(b.position);
        assert!(far < 1e-9 && (a.covariance.sigma() / b.covariance.sigma() - 1.0).abs() < 1e-6, "{far} m");
    }
    let probes = [once.probe.unwrap(), often.probe.unwrap()];
    assert!(probes[0].sigmas.distance(probes[1].sigmas) < 1e-9, "sigmas of the offset are by contact");
    let off = probes[0].offset - DVec3::new(0.0, -0.008, 0.014);
    assert!((off / probes[0].sigmas).abs().max_element() < 4.0, "{off} with {}", probes[0].sigmas);
}

/// Contacts that were held back are predicted best by the bodies that moved.
#[test]
fn held_back_contacts_tell_which_bodies_moved() {
    let drawn = Drawn::new(20);
    let options = BodyOptions {
        module: Tolerance::mm_deg(3.0, 3.0),
        folds: Some(Folds { count: 4, seed: 1 }),
        ..BodyOptions::default()
    };
    let supported = |module: [f64; 2]| {
        let spoil = Spoil { mount: [20.0, 5.0], patch: [1e-6, 1e-6], module, turned: None };
        let mut random = Random(3);
        let truth = drawn.spoiled(&mut random, &spoil, |module| module);
        let probe = Probe { noise: 2e-3, ..STILL };
        let observations = touches(&truth, &mut random, 0..20, 12, probe, 1);
        let found = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
        assert!((1.5e-3..2.5e-3).contains(&found.noise), "estimated noise {} m of 2 mm", found.noise);
        assert_eq!(found.faults(), Vec::<String>::new());
        found.held_back.unwrap().supported
    };
    assert_eq!(supported([8.0, 5.0]), BodyLevel::Module);
    assert_eq!(supported([1e-6, 1e-6]), BodyLevel::Mount);
}

/// A constant distance along the normals of a skin that bends is told from a motion of the mount.
#[test]
fn a_standoff_is_found() {
    let drawn = Drawn::new(10);
    let mut random = Random(6);
    let mut truth = drawn.spoiled(&mut random, &Spoil::default(), |module| module);
    for (module, normal) in truth.modules.iter_mut().zip(&drawn.normals) {
        module.iter_mut().for_each(|x| *x += 0.008 * *normal);
    }
    let probe = Probe { noise: 1e-3, ..STILL };
    let observations = touches(&truth, &mut random, 0..10, 20, probe, 1);
    let options = BodyOptions { standoff: Some(0.01), ..BodyOptions::default() };
    let found = fit_bodies(&observations, &drawn.cad(), &options).unwrap();
    let [standoff, sigma] = found.standoff.unwrap();
    assert!((standoff - 0.008).abs() < 4.0 * sigma && sigma < 1e-3, "{standoff} m with {sigma} m");
}

/// A fifth of the touches at random places is rejected, and moves nothing by much.
#[test]
fn wrong_touches_are_rejected() {
    let drawn = Drawn::new(10);
    let spoil = Spoil { mount: [10.0, 3.0], patch: [1.0, 1.0], module: [1.0, 1.0], turned: None };
    let mut random = Random(8);
    let truth = drawn.spoiled(&mut random, &spoil, |module| module);
    let probe = Probe { noise: 1e-3, ..STILL };
    let mut observations = touches(&truth, &mut random, 0..10, 20, probe, 1);
    let shift = |random: &mut Random| 0.1 * random.direction();
    let mut shifts: Vec<DVec3> = Vec::new();
    let rows: Vec<u64> = observations.touches.iter().map(|row| row.touch.unwrap()).collect();
    (0..200).for_each(|k| shifts.push(if k % 5 == 0 { shift(&mut random) } else { DVec3::ZERO }));
    for (contact, touch) in observations.contacts.iter_mut().zip(rows) {
        if let ContactMeasurement::Position { position, .. } = &mut contact.measurement {
            *position += shifts[usize::try_from(touch).unwrap()];
        }
    }
    let found = fit_bodies(&observations, &drawn.cad(), &tolerant(&spoil)).unwrap();
    let wrong = found.rejected.iter().filter(|t| t.index() % 5 == 0).count();
    assert!(wrong == 40 && found.rejected.len() <= 44, "{wrong} of {}", found.rejected.len());
    for (module, body) in modules(&found).into_iter().enumerate() {
        let error = pose_error(body, &truth, module);
        assert!(DVec3::from_slice(&error).length() < 2e-3, "module {module}: {error:?}");
    }
}

/// Touches in the middle of a module do not tell whether it is turned, and one wrong touch at its corner, 60 mm away, does not decide.
#[test]
fn one_wrong_touch_turns_no_module() {
    let drawn = Drawn::new(10);
    let spoil = Spoil { mount: [10.0, 3.0], patch: [1.0, 1.0], module: [1.0, 1.0], turned: None };
    let mut random = Random(9);
    let truth = drawn.spoiled(&mut random, &spoil, |module| module);
    let probe = Probe { noise: 1e-3, ..STILL };
    let mut observations = touches(&truth, &mut random, (0..10).filter(|&module| module != 3), 20, probe, 1);
    let taxels = &truth.modules[3];
    let centre = taxels.iter().sum::<DVec3>() / TAXELS as f64;
    let own: Vec<VertexId> = (0..TAXELS)
        .map(|k| {
            let id = taxel_id(3, k);
            observations.taxels.push(TaxelVariable { id, initial: None, fixed: false })
        })
        .collect();
    // Beyond where a corner is after a third of a turn.
    let wrong = taxels[TAXELS - 1] + 0.06 * (taxels[TAXELS - 1] - centre).normalize();
    for touch in 0..6 {
        let (felt, position) =
            if touch == 0 { (0..1, wrong) } else { (0..TAXELS, centre + random.vector(1e-3)) };
        for k in felt {
            let measurement =
                ContactMeasurement::Position { position, information: Information::diagonal([1e6; 3]) };
            observations.contacts.push(ContactObservation { taxel: own[k], measurement });
            let touch = Some(5000 + touch);
            observations.touches.push(TouchRow { touch, contact: touch, ..TouchRow::default() });
        }
    }
    let found = fit_bodies(&observations, &drawn.cad(), &tolerant(&spoil)).unwrap();
    assert_eq!(found.misassembled, Default::default());
    assert_eq!(found.rejected.len(), 1, "{:?}", found.rejected);
}

/// The touches one by one, as a stream has them.
fn one_by_one(all: &Observations) -> Vec<Observations> {
    let mut touches: Vec<Observations> = Vec::new();
    for (number, contact) in all.contacts.enumerate() {
        let row = all.touches[number].clone();
        if touches.last().is_none_or(|last| last.touches[ContactId::new(0)].touch != row.touch) {
            touches.push(Observations::default());
        }
        let touch = touches.last_mut().unwrap();
        let taxel = touch.taxels.push(all.taxels[contact.taxel]);
        touch.contacts.push(ContactObservation { taxel, ..contact.clone() });
        touch.touches.push(row);
    }
    touches
}

#[test]
fn followed_touches_end_at_the_batch_fit_and_unknown_taxels_are_not_added() {
    let drawn = Drawn::new(10);
    let (cad, spoil) = (drawn.cad(), Spoil { mount: [5.0, 3.0], ..Spoil::default() });
    let mut random = Random(11);
    let truth = drawn.spoiled(&mut random, &spoil, |module| module);
    let all = touches(&truth, &mut random, 0..10, 3, STILL, 1);
    let options = BodyOptions::default();
    let batch = fit_bodies(&all, &cad, &options).unwrap();
    let mut follower = BodyFollower::new(cad.clone(), &options, 15).unwrap();
    let stream = one_by_one(&all);
    assert_eq!(stream.len(), 30);
    for (touch, number) in stream.iter().zip(1..) {
        let followed = follower.push(touch, Run::default()).unwrap();
        assert_eq!((followed.touch, followed.solved.is_some()), (number, number % 15 == 0));
    }
    let mut unknown = stream[0].clone();
    unknown.taxels[VertexId::new(0)].id = TaxelId(99_999);
    let said = follower.push(&unknown, Run::default()).unwrap_err().to_string();
    assert!(
        said.contains(&format!("row {} of the contacts is of taxel 99999", all.contacts.len() + 1)),
        "{said}"
    );
    // Nothing is left to fit: a run that is cancelled has no effect.
    let cancelled = AtomicBool::new(true);
    let found = follower.clone().finish(Run::default().cancelled_by(&cancelled)).unwrap();
    assert_eq!(found.taxels, batch.taxels);
    // A further touch is fitted.
    let mut further = follower;
    further.push(&stream[0], Run::default()).unwrap();
    further.finish(Run::default().cancelled_by(&cancelled)).unwrap_err();
    // Rows with one number are two touches if they come one after the other.
    let mut renumbered = BodyFollower::new(cad, &options, 15).unwrap();
    for touch in &stream {
        let mut touch = touch.clone();
        touch.touches.iter_mut().for_each(|row| row.touch = Some(1));
        renumbered.push(&touch, Run::default()).unwrap();
    }
    assert_eq!(renumbered.finish(Run::default()).unwrap().taxels, batch.taxels);
}

/// Contacts with and without the columns of touches may come in any order; those without are touches of their own.
#[test]
fn touches_with_and_without_rows_are_followed_together() {
    let drawn = Drawn::new(10);
    let mut random = Random(5);
    let truth = drawn.spoiled(&mut random, &Spoil::default(), |module| module);
    let stream = one_by_one(&touches(&truth, &mut random, 0..10, 2, STILL, 1));
    for has_rows in [|k: usize| k.is_multiple_of(2), |k: usize| !k.is_multiple_of(2)] {
        let (mut all, mut vertices) = (Observations::default(), std::collections::HashMap::new());
        let mut follower = Calibration::follow(&CalibOptions::default(), 1);
        for (k, touch) in stream.iter().enumerate() {
            let mut touch = touch.clone();
            if !has_rows(k) {
                touch.touches = IdVec::default();
            }
            follower.push(&touch, Run::default()).unwrap();
            all.append(&touch, &mut vertices);
        }
        assert_eq!(all.touches.len(), all.contacts.len());
        all.validate().unwrap();
        follower.finish(Run::default()).unwrap();
    }
}

/// The covariance of a taxel that the touches do not reach, since the drawing lacks it, is not 0.
#[test]
fn a_taxel_outside_the_fit_has_no_covariance() {
    let drawn = Drawn::new(10);
    let mut random = Random(6);
    let truth = drawn.spoiled(&mut random, &Spoil::default(), |module| module);
    let found =
        fit_bodies(&touches(&truth, &mut random, 0..10, 3, STILL, 1), &drawn.cad(), &BodyOptions::default());
    let mut skin = Skin::from_mesh("a", shapes::fan(6));
    let patch = PatchId::new(0);
    skin.patches[patch].taxels.ids[VertexId::new(0)] = taxel_id(9, 3);
    skin.patches[patch].taxels.ids[VertexId::new(1)] = TaxelId(77_777);
    found.unwrap().move_taxels(&mut skin);
    let covariances = skin.patches[patch].taxels.covariances.as_ref().unwrap();
    assert!(covariances[VertexId::new(0)].is_some_and(|c| c.sigma() > 0.0));
    assert_eq!(covariances[VertexId::new(1)], None);
}

#[test]
fn unfit_input_is_refused() {
    let drawn = Drawn::new(10);
    let (cad, spoil) = (drawn.cad(), Spoil { mount: [1.0, 1.0], ..Spoil::default() });
    let mut random = Random(2);
    let truth = drawn.spoiled(&mut random, &spoil, |module| module);
    let good = touches(&truth, &mut random, 0..10, 3, STILL, 1);
    let refused = |change: &dyn Fn(&mut Observations), options: &BodyOptions, said: &str| {
        let mut observations = good.clone();
        change(&mut observations);
        let error = fit_bodies(&observations, &cad, options).unwrap_err().to_string();
        assert!(error.contains(said), "{said:?} is not in {error}");
    };
    let options = BodyOptions::default();
    let last = ContactId::new(good.contacts.len() - 1);
    let number = good.contacts.len();
    refused(
        &|o| o.taxels[o.contacts[last].taxel].id = TaxelId(99_999),
        &options,
        "of taxel 99999, which the drawing does not have",
    );
    let probe = BodyOptions { probe: Some(0.02), ..options };
    refused(&|o| o.touches[last].probe = None, &probe, &format!("row {number} of the contacts"));
    refused(&|o| o.touches[last].weight = 0.0, &options, "its weight is not a number above 0");
    refused(
        &|o| o.touches[last].probe = Some(DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0)),
        &options,
        "not a quaternion of unit length",
    );
    refused(
        &|o| {
            let first = o.touches[ContactId::new(0)].touch;
            o.touches[last].touch = first;
        },
        &options,
        "are of one touch, but repeat different contacts",
    );
    refused(
        &|o| {
            // A log whose touches count from 0 again, behind the first one.
            let row = o.contacts[ContactId::new(0)].clone();
            o.contacts.push(row);
            let touch = o.touches[ContactId::new(0)].clone();
            o.touches.push(touch);
        },
        &options,
        &format!("rows 1 and following of the contacts are of one touch, and row {}", number + 1),
    );
    refused(
        &|_| (),
        &BodyOptions { module: Tolerance::mm_deg(0.0, 1.0), ..options },
        "the tolerance of a module in m is 0",
    );
    // What a table states as exact is not, if the touches differ.
    let mut exact = good.clone();
    state(&mut exact, 1e-9);
    let found = fit_bodies(&exact, &cad, &options).unwrap();
    assert!((1e-3..5e-3).contains(&found.noise), "{} m", found.noise);
    let folds = Some(Folds { count: 1000, seed: 0 });
    refused(&|_| (), &BodyOptions { folds, ..options }, "the number of folds is 1000");
    assert!(CadSkin::new([]).is_err(), "a drawing without taxels");
}
