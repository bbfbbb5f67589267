//! The experiment of the source paper's section IV `(cannata)`: an arm carries an elastic sphere with taxels and rolls
//! it over a small fixed sphere, with a constant force; its log has the pose of the arm and the readings, frame by frame.
//!
//! The skin is an elastic foundation, as in [`TouchSimulation`](crate::signal::TouchSimulation): under each of its points
//! is a spring along the normal, and a taxel reads the exact force on its disc. The arm touches along the lines of a
//! raster, half a spacing apart, which extends over the taxels at the rim until these feel nothing. Contacts are on
//! the top of the fixed sphere, give or take [`TILT`]; without friction rolling and sliding read alike.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::calib::{CalibError, Pose, SensorLayout, exp};
use crate::id::{IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::numeric::Random;
use crate::run::Run;
use crate::signal::Sphere;
use crate::skin::TaxelId;
use crate::touches::TouchesError;
use crate::touches::log::{TouchBody, TouchFrame, TouchLog};

/// An arm that rolls its skin over a fixed sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmOptions {
    /// Number of taxels.
    pub taxels: usize,
    /// Distance of lattice neighbours, in m.
    pub spacing: f64,
    /// Radius of the sphere that carries the taxels, in m.
    pub radius: f64,
    /// Radius of the disc on which a taxel feels, in m.
    pub taxel_radius: f64,
    /// Radius of the fixed sphere, in m.
    pub probe_radius: f64,
    /// Stiffness of the skin: pressure over depth, in Pa/m.
    pub stiffness: f64,
    /// The force of the contact, in N: what the force control of the arm keeps.
    pub force: f64,
    /// How well it keeps it: the standard deviation over the force.
    pub force_noise: f64,
    /// How fast the contact travels over the skin, in m/s.
    pub speed: f64,
    /// Frames per second, in Hz.
    pub rate: f64,
    /// Noise of the position of the arm, per axis, in m; new in each frame.
    pub arm_noise: f64,
    /// Noise of the orientation of the arm, per axis, in rad; new in each frame.
    pub arm_rotation_noise: f64,
    /// Noise of the readings: the standard deviation of the mean pressure on a taxel, in Pa.
    pub noise: f64,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for ArmOptions {
    /// The sensor of the source paper, pressed in by 1 mm.
    fn default() -> Self {
        Self {
            taxels: 500,
            spacing: 5e-3,
            radius: 0.1,
            taxel_radius: 2e-3,
            probe_radius: 0.01,
            stiffness: 2e7,
            force: 0.6,
            force_noise: 0.0,
            speed: 0.05,
            rate: 20.0,
            arm_noise: 0.0,
            arm_rotation_noise: 0.0,
            noise: 0.0,
            seed: 0,
        }
    }
}

impl ArmOptions {
    /// The force of a contact of this depth (m), in N: the pressure integrated over the skin, which is a sphere.
    pub fn force_at(&self, depth: f64) -> f64 {
        /// Rings of the midpoint rule: the force is exact to a hundred thousandth.
        const RINGS: u32 = 64;
        let Self { radius, probe_radius, stiffness, .. } = *self;
        let sphere = Sphere { centre: DVec3::Z * (radius + probe_radius - depth), radius: probe_radius };
        let effective = radius * probe_radius / (radius + probe_radius);
        let widest = (2.0 * effective * depth).sqrt().min(probe_radius) * 1.1 / radius;
        let ring = |k: u32| {
            let (angle, step) = ((f64::from(k) + 0.5) / f64::from(RINGS) * widest, widest / f64::from(RINGS));
            let normal = DVec3::new(libm::sin(angle), 0.0, libm::cos(angle));
            sphere.depth(radius * normal, normal) * 2.0 * PI * radius * radius * libm::sin(angle) * step
        };
        stiffness * (0..RINGS).map(ring).sum::<f64>()
    }

    fn validate(&self) -> Result<(), CalibError> {
        let bad = |option, found, needed| Err(CalibError::BadOption { option, found, needed });
        for (option, metres) in [
            ("the radius of a taxel in m", self.taxel_radius),
            ("the radius of the fixed sphere in m", self.probe_radius),
        ] {
            if !(1e-6..=1e3).contains(&metres) {
                return bad(option, metres, "0.000001 to 1000");
            }
        }
        for (option, number) in [
            ("the stiffness in Pa/m", self.stiffness),
            ("the force in N", self.force),
            ("the speed in m/s", self.speed),
            ("the rate in Hz", self.rate),
        ] {
            if !(1e-9..=1e15).contains(&number) {
                return bad(option, number, "a positive number up to 1e15");
            }
        }
        for (option, number) in [
            ("the position noise of the end effector", self.arm_noise),
            ("the rotation noise of the end effector", self.arm_rotation_noise),
        ] {
            if !(0.0..=1e3).contains(&number) {
                return bad(option, number, "0 to 1000 m or rad");
            }
        }
        if !(0.0..=0.5).contains(&self.force_noise) {
            return bad("the noise of the force", self.force_noise, "0 to 0.5");
        }
        if !(0.0..=1e9).contains(&self.noise) {
            return bad("the noise in Pa", self.noise, "0 to 1e9");
        }
        Ok(())
    }
}

/// A log with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmSimulation {
    /// The frames in which a taxel feels something; each line of the raster is a touch. Ids of taxels count from 0.
    pub log: TouchLog,
    /// The true poses of the taxels, in the frame of the link that carries them.
    pub truth: IdVec<VertexId, Pose>,
    /// The true skin.
    pub mesh: TriMesh,
    /// The depth to which the force presses the skin in, in m.
    pub depth: f64,
}

/// The centre of the fixed sphere, in the frame of the arm's base, in m.
const PROBE: DVec3 = DVec3::new(0.4, 0.1, 0.3);

/// How far contacts are from the top of the fixed sphere, in rad.
const TILT: f64 = 0.5;

/// The deepest press, over the radius of the fixed sphere.
const DEEPEST: f64 = 0.9;

/// Time between two lines, in s, in which the arm is lifted.
const PAUSE: f64 = 0.5;

/// A taxel is active from this many standard deviations of its noise on.
const ACTIVE_SIGMAS: f64 = 4.0;

/// Most frames of a log.
const MOST_FRAMES: f64 = 1e7;

/// Streams of random numbers: one for each source.
mod stream {
    pub(crate) const ARM: u64 = 0;
    pub(crate) const FORCE: u64 = 1;
    pub(crate) const READINGS: u64 = 2;
    pub(crate) const TILTS: u64 = 3;
}

/// Simulates the log of an arm that rolls its skin over a fixed sphere.
///
/// ```
/// use dermatome::touches::{ArmOptions, simulate_arm};
///
/// let simulation = simulate_arm(&ArmOptions { taxels: 50, ..ArmOptions::default() })?;
/// assert!((simulation.depth - 0.00103).abs() < 1e-5, "0.6 N");
/// assert!(simulation.log.frames.iter().all(|frame| !frame.felt.is_empty()));
/// # Ok::<(), dermatome::touches::TouchesError>(())
/// ```
///
/// # Errors
/// If an option is out of its range, the force presses the fixed sphere in by more than 0.9 of its radius, or the
/// log has more than ten million frames.
pub fn simulate_arm(options: &ArmOptions) -> Result<ArmSimulation, TouchesError> {
    simulate_arm_with(options, Run::default())
}

/// As [`simulate_arm`], in a [`Run`].
///
/// # Errors
/// As [`simulate_arm`], and if it is cancelled.
pub fn simulate_arm_with(options: &ArmOptions, run: Run<'_>) -> Result<ArmSimulation, TouchesError> {
    options.validate()?;
    let layout = SensorLayout::new(options.taxels, options.spacing, options.radius)?;
    let depth = depth_of(options, options.force)?;
    let arm = Arm { options, layout: &layout, depth };
    let log = arm.log(run)?;
    Ok(ArmSimulation { log, mesh: layout.mesh(), truth: layout.frames, depth })
}

struct Arm<'a> {
    options: &'a ArmOptions,
    layout: &'a SensorLayout,
    depth: f64,
}

impl Arm<'_> {
    fn log(&self, run: Run<'_>) -> Result<TouchLog, TouchesError> {
        let options = self.options;
        let [mut arm, mut force, mut noise, mut tilts] =
            [stream::ARM, stream::FORCE, stream::READINGS, stream::TILTS]
                .map(|stream| Random::new(options.seed, stream));
        let mut frames = Vec::new();
        let (mut time, mut touch) = (0.0, 0);
        for line in self.raster()? {
            run.check()?;
            let top = exp(TILT * (2.0 * tilts.uniform() - 1.0) * DVec3::X)
                * exp(TILT * (2.0 * tilts.uniform() - 1.0) * DVec3::Y)
                * DVec3::Z;
            let spin = exp(2.0 * PI * tilts.uniform() * DVec3::Z);
            let before = frames.len();
            for normal in line {
                let mut depth = self.depth;
                if options.force_noise > 0.0 {
                    let kept = (1.0 + options.force_noise * force.normal()).max(0.01);
                    depth = depth_of(options, kept * options.force)?;
                }
                let pose = self.pose(normal, top, spin, depth);
                let believed = Pose {
                    position: pose.position + arm.vector(options.arm_noise),
                    rotation: (exp(arm.vector(options.arm_rotation_noise)) * pose.rotation).normalize(),
                };
                let felt = self.readings(pose.inverse().apply(PROBE), &mut noise);
                if !felt.is_empty() {
                    frames.push(TouchFrame {
                        row: frames.len(),
                        time: Some(time),
                        touch,
                        contact: None,
                        link: believed,
                        body: TouchBody::Sphere { centre: PROBE, radius: options.probe_radius },
                        body_rotation: None,
                        felt,
                        by_joints: Vec::new(),
                    });
                }
                time += options.rate.recip();
            }
            time += PAUSE;
            touch += u64::from(frames.len() > before);
        }
        Ok(TouchLog { frames, has_readings: true, joints: Vec::new() })
    }

    /// The directions, from the centre of the sphere, in which the fixed sphere touches, line by line.
    fn raster(&self) -> Result<Vec<Vec<DVec3>>, CalibError> {
        let ArmOptions { spacing, radius, probe_radius, taxel_radius, speed, rate, .. } = *self.options;
        // Beyond the rim by as much as a contact of this depth reaches.
        let effective = radius * probe_radius / (radius + probe_radius);
        let beyond = (2.0 * effective * self.depth).sqrt() + taxel_radius;
        let places = self.layout.frames.iter().map(|frame| flat(frame.position, radius));
        let reach = places.map(|p| p.length()).fold(0.0, f64::max) + beyond;
        let (between, step) = (0.5 * spacing, speed / rate);
        if reach * reach * PI / (between * step) > MOST_FRAMES {
            let found = reach * reach * PI / (between * step);
            return Err(CalibError::BadOption {
                option: "the number of frames",
                found,
                needed: "at most 1e7",
            });
        }
        #[expect(clippy::cast_possible_truncation, reason = "at most 1e7 frames")]
        let lines = (reach / between).ceil() as i32;
        let line = |k: i32| {
            let y = (f64::from(k) + 0.31) * between;
            let half = (reach * reach - y * y).max(0.0).sqrt();
            #[expect(clippy::cast_possible_truncation, reason = "at most 1e7 frames")]
            let steps = (half / step).floor() as i32;
            // Every other line goes back.
            let side = if k % 2 == 0 { 1.0 } else { -1.0 };
            let place = move |j: i32| DVec2::new(side * f64::from(j) * step, y);
            let on_sphere = |p: &DVec2| p.length() < 2.0 * radius;
            (-steps..=steps).map(place).filter(on_sphere).map(|p| lift(p, radius) / radius).collect()
        };
        Ok((-lines..=lines).map(line).collect())
    }

    /// The pose of the link where the fixed sphere touches along this normal of the skin (a unit vector), with
    /// the contact in direction `top` from the fixed sphere's centre.
    fn pose(&self, normal: DVec3, top: DVec3, spin: DQuat, depth: f64) -> Pose {
        let rotation = DQuat::from_rotation_arc(DVec3::Z, -top) * spin * turn_to_z(normal);
        let centre = PROBE + (self.options.radius + self.options.probe_radius - depth) * top;
        Pose { position: centre, rotation: rotation.normalize() }
    }

    /// What the active taxels read, in N, where the fixed sphere's centre is there in the frame of the link.
    fn readings(&self, centre: DVec3, noise: &mut Random) -> Vec<(TaxelId, f64)> {
        let ArmOptions { probe_radius, taxel_radius, stiffness, noise: sigma, .. } = *self.options;
        let sphere = Sphere { centre, radius: probe_radius };
        let sigma = sigma * PI * taxel_radius * taxel_radius;
        let reach = (probe_radius + taxel_radius).powi(2);
        let mut felt = Vec::new();
        for (taxel, frame) in self.layout.frames.enumerate() {
            let mut reading = 0.0;
            if frame.position.distance_squared(centre) < reach {
                let volume =
                    sphere.volume_under_disc(frame.position, frame.rotation * DVec3::Z, taxel_radius);
                reading = stiffness * volume;
            }
            if sigma > 0.0 {
                reading += sigma * noise.normal();
            }
            if reading > ACTIVE_SIGMAS * sigma {
                felt.push((TaxelId(taxel.raw()), reading));
            }
        }
        felt
    }
}

/// The rotation by the shortest way from a direction on the lower half of the sphere to z.
fn turn_to_z(normal: DVec3) -> DQuat {
    // First to -z, which is near; then around x.
    let down = DQuat::from_rotation_arc(normal, -DVec3::Z);
    (DQuat::from_mat3(&DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z)) * down).normalize()
}

/// Lambert's equal-area projection about the south pole.
fn flat(position: DVec3, radius: f64) -> DVec2 {
    let above = 1.0 + position.z / radius;
    DVec2::new(position.x, position.y) * (2.0 / (2.0 - above)).max(1.0).sqrt()
}

/// Its inverse.
fn lift(p: DVec2, radius: f64) -> DVec3 {
    let s2 = p.length_squared() / (4.0 * radius * radius);
    let stretch = (1.0 - s2).max(0.0).sqrt();
    DVec3::new(p.x * stretch, p.y * stretch, -radius * (1.0 - 2.0 * s2))
}

/// How deep a force presses the fixed sphere into the skin, in m: the inverse of [`ArmOptions::force_at`].
fn depth_of(options: &ArmOptions, force: f64) -> Result<f64, CalibError> {
    let (mut least, mut most) = (0.0, DEEPEST * options.probe_radius);
    if force > options.force_at(most) {
        let needed = "less than what presses the fixed sphere in by 0.9 of its radius";
        return Err(CalibError::BadOption { option: "the force in N", found: force, needed });
    }
    for _ in 0..40 {
        let middle = 0.5 * (least + most);
        if options.force_at(middle) < force {
            least = middle;
        } else {
            most = middle;
        }
    }
    Ok(0.5 * (least + most))
}
