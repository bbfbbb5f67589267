//! The experiment of the source paper's section IV `(cannata)`: a skin of known truth, its displacements and
//! its contacts with a sphere.

use glam::{DMat3, DQuat, DVec3};

use crate::calib::pose::exp;
use crate::calib::sensor_layout::{Neighbourhoods, SensorLayout};
use crate::calib::solve::initial::spanning_tree;
use crate::calib::{
    CalibError, ContactMeasurement, ContactObservation, Displacement, DisplacementId,
    DisplacementMeasurement, Information, Model, Observations, Pose, PoseMeasurement, TaxelVariable,
};
use crate::id::{IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::numeric::Random;
use crate::run::{Cancelled, Run};
use crate::skin::TaxelId;

/// Parameters of the experiment of the source paper's section IV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulateOptions {
    /// The unknowns of every taxel.
    pub model: Model,
    /// Number of taxels.
    pub taxels: usize,
    /// Distance of lattice neighbours, in m.
    pub spacing: f64,
    /// Radius of the sphere that carries the taxels, in m.
    pub radius: f64,
    /// Noise of displacements per axis, in m.
    pub noise: f64,
    /// Noise of relative rotations per axis, in rad; poses model only.
    pub rotation_noise: f64,
    /// Number of taxels with an absolute contact observation, spread over the skin.
    pub anchors: usize,
    /// Noise of absolute contacts per axis, in m.
    pub anchor_noise: f64,
    /// Noise of the normals of absolute contacts per tangent axis, in rad; `None`: positions alone.
    pub normal_noise: Option<f64>,
    /// How deep the elastic skin is pressed in, in m: contacts are observed that much below the
    /// taxel.
    pub indentation: f64,
    /// Noise of the position of the arm that carries the skin, per axis, in m.
    pub arm_noise: f64,
    /// Noise of the orientation of the arm, per axis, in rad.
    pub arm_rotation_noise: f64,
    /// Chance that a displacement is attributed to a wrong taxel nearby.
    pub outliers: f64,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for SimulateOptions {
    fn default() -> Self {
        Self {
            model: Model::Positions,
            taxels: 500,
            spacing: 5e-3,
            radius: 0.1,
            noise: 1e-3,
            rotation_noise: 1_f64.to_radians(),
            anchors: 0,
            anchor_noise: 1e-3,
            normal_noise: None,
            indentation: 0.0,
            arm_noise: 0.0,
            arm_rotation_noise: 0.0,
            outliers: 0.0,
            seed: 0,
        }
    }
}

/// Centre and radius of the ball that taxels touch, in the frame of the arm's base, in m.
const PROBE: DVec3 = DVec3::new(0.4, 0.1, 0.3);
const PROBE_RADIUS: f64 = 0.01;

/// The largest accepted noise, in m and rad.
const MOST_NOISE: f64 = 1e3;

impl SimulateOptions {
    fn validate(&self) -> Result<(), CalibError> {
        let sizes = [
            ("the noise", self.noise),
            ("the rotation noise", self.rotation_noise),
            ("the anchor noise", self.anchor_noise),
            ("the noise of normals", self.normal_noise.unwrap_or(0.0)),
            ("the indentation", self.indentation),
            ("the position noise of the end effector", self.arm_noise),
            ("the rotation noise of the end effector", self.arm_rotation_noise),
        ];
        for (option, x) in sizes {
            if !(0.0..=MOST_NOISE).contains(&x) {
                return Err(CalibError::BadOption { option, found: x, needed: "0 to 1000 m or rad" });
            }
        }
        if !(0.0..=1.0).contains(&self.outliers) {
            let found = self.outliers;
            return Err(CalibError::BadOption { option: "the share of outliers", found, needed: "0 to 1" });
        }
        if self.anchors > self.taxels {
            let (option, found) = ("the number of anchors", self.anchors as f64);
            return Err(CalibError::BadOption { option, found, needed: "at most the number of taxels" });
        }
        Ok(())
    }
}

/// Observations with their truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// The observations; ids count from 0. Initial values are the displacements chained from the first
    /// taxel, which has its true pose.
    pub observations: Observations,
    /// The true poses of the taxels.
    pub truth: IdVec<VertexId, Pose>,
    /// The true skin.
    pub mesh: TriMesh,
    /// The displacements that were attributed to a wrong taxel.
    pub outliers: Vec<DisplacementId>,
}

/// Noise that is stated for observations without noise, in m and rad.
const NO_NOISE: f64 = 1e-3;

/// Least stated noise, in m and rad: files of observations do not accept less.
const LEAST_STATED: f64 = 1e-9;

/// Streams of random numbers: one for each source.
mod stream {
    pub(crate) const DISPLACEMENTS: u64 = 0;
    pub(crate) const OUTLIERS: u64 = 1;
    pub(crate) const ANCHORS: u64 = 2;
    pub(crate) const ARM: u64 = 3;
}

/// Simulates displacements between lattice neighbours with independent noise, and absolute contacts
/// of some taxels.
///
/// ```
/// use dermatome::calib::{SimulateOptions, simulate};
///
/// let simulation = simulate(&SimulateOptions::default())?;
/// assert_eq!(simulation.observations.edges.len(), 1419);
/// assert_eq!(simulation.mesh.triangles.len(), 920);
/// # Ok::<(), dermatome::calib::CalibError>(())
/// ```
///
/// The source paper prints `t = s + 2` for `s` triangles and `t` taxels; that holds only without
/// interior vertices. In general a disk has `s = 2t - 2 - b` triangles with `b` boundary vertices:
/// here 920 = 2 * 500 - 2 - 78.
///
/// # Errors
/// [`CalibError::BadOption`] for lengths below 1 um or above 1 km, noise that is negative or above
/// 1 km, a chance outside 0 to 1.
pub fn simulate(options: &SimulateOptions) -> Result<Simulation, CalibError> {
    simulate_with(options, Run::default())
}

/// As [`simulate`], in a [`Run`].
///
/// # Errors
/// As [`simulate`], and if it is cancelled.
pub fn simulate_with(options: &SimulateOptions, run: Run<'_>) -> Result<Simulation, CalibError> {
    options.validate()?;
    let layout = SensorLayout::new(options.taxels, options.spacing, options.radius)?;
    let indentation = options.indentation;
    if indentation >= options.radius {
        let (option, needed) = ("the indentation in m", "less than the radius of the sphere");
        return Err(CalibError::BadOption { option, found: indentation, needed });
    }
    let unknown = |v: VertexId| TaxelVariable { id: TaxelId(v.raw()), initial: None, fixed: false };
    let mut observations = Observations {
        model: options.model,
        taxels: layout.frames.ids().map(unknown).collect(),
        ..Observations::default()
    };
    let outliers = displacements(options, &layout, &mut observations);
    contacts(options, &layout, &mut observations, run)?;

    let first = VertexId::new(0);
    let known = match options.model {
        Model::Positions => Pose::at(layout.frames[first].position),
        Model::Poses => layout.frames[first],
    };
    observations.taxels[first].initial = Some(known);
    let chained = spanning_tree(&observations);
    for (taxel, pose) in observations.taxels.iter_mut().zip(chained) {
        taxel.initial = Some(pose);
    }
    Ok(Simulation { observations, mesh: layout.mesh(), truth: layout.frames, outliers })
}

/// The stated information of observations with this noise.
fn information_of_noise(noise: f64) -> f64 {
    if noise > 0.0 { noise.max(LEAST_STATED).powi(-2) } else { NO_NOISE.powi(-2) }
}

/// Adds the displacements; returns those that were attributed to a wrong taxel.
fn displacements(
    options: &SimulateOptions,
    layout: &SensorLayout,
    observations: &mut Observations,
) -> Vec<DisplacementId> {
    let mut noise = Random::new(options.seed, stream::DISPLACEMENTS);
    let mut chance = Random::new(options.seed, stream::OUTLIERS);
    let translation = information_of_noise(options.noise);
    let rotation = information_of_noise(options.rotation_noise);
    let pose_information =
        Information::diagonal([translation, translation, translation, rotation, rotation, rotation]);
    let mut outliers = Vec::new();
    let cells = if options.outliers > 0.0 { Neighbourhoods::new(layout) } else { Neighbourhoods::default() };
    for &[from, to] in &layout.edges {
        let mut seen = to;
        if options.outliers > 0.0
            && chance.uniform() < options.outliers
            && let Some(wrong) = cells.misattributed(layout, from, to, &mut chance)
        {
            seen = wrong;
            outliers.push(DisplacementId::new(observations.edges.len()));
        }
        let motion = match options.model {
            Model::Positions => {
                let truth = layout.frames[seen].position - layout.frames[from].position;
                let offset = truth + noise.vector(options.noise);
                DisplacementMeasurement::Offset {
                    offset,
                    information: Information::diagonal([translation; 3]),
                }
            }
            Model::Poses => {
                let truth = layout.frames[from].inverse() * layout.frames[seen];
                let position = truth.position + noise.vector(options.noise);
                let rotation = (truth.rotation * exp(noise.vector(options.rotation_noise))).normalize();
                let pose = Pose { position, rotation };
                let measurement = PoseMeasurement { pose, information: pose_information };
                DisplacementMeasurement::Relative(Box::new(measurement))
            }
        };
        observations.edges.push(Displacement { from, to, measurement: motion });
    }
    outliers
}

/// Adds an absolute contact for each of the anchors.
fn contacts(
    options: &SimulateOptions,
    layout: &SensorLayout,
    observations: &mut Observations,
    run: Run<'_>,
) -> Result<(), Cancelled> {
    let mut noise = Random::new(options.seed, stream::ANCHORS);
    let mut arm = Random::new(options.seed, stream::ARM);
    let information = Information::diagonal([information_of_noise(options.anchor_noise); 3]);
    for taxel in layout.spread(options.anchors, run)? {
        let frame = &layout.frames[taxel];
        let [touched, outward] = simulate_contact(options, frame.rotation * DVec3::Z, &mut arm);
        let position = touched + noise.vector(options.anchor_noise);
        let touch = match options.normal_noise {
            None => ContactMeasurement::Position { position, information },
            Some(sigma) => {
                let x = outward.any_orthonormal_vector();
                let tilt = noise.normal() * x + noise.normal() * outward.cross(x);
                let normal = (outward + sigma * tilt).normalize();
                let normal_information = information_of_noise(sigma);
                ContactMeasurement::PositionNormal { position, information, normal, normal_information }
            }
        };
        observations.contacts.push(ContactObservation { taxel, measurement: touch });
    }
    Ok(())
}

/// Touches the probe with the taxel of normal `n` from a random direction: the contact forward
/// model of section IV.
///
/// A contact along `u` (from the probe to the end effector) means an end-effector rotation with `Q n = -u`
/// and centre `o = c_b + (R + r_b - depth) u`; the contact `c_b + r_b u` is observed at `Q' (c_b + r_b u -
/// o)`. Returns its position and normal in the frame of the end effector, as measured with the noise of the
/// arm.
fn simulate_contact(options: &SimulateOptions, n: DVec3, arm: &mut Random) -> [DVec3; 2] {
    let depth = options.indentation;
    let u = arm.direction();
    let spin = exp(std::f64::consts::TAU * arm.uniform() * DVec3::Z);
    let rotation = frame_of(-u) * spin * frame_of(n).conjugate();
    let centre = PROBE + (options.radius + PROBE_RADIUS - depth) * u;
    let believed_centre = centre + arm.vector(options.arm_noise);
    let believed_rotation = exp(arm.vector(options.arm_rotation_noise)) * rotation;
    let contact = PROBE + PROBE_RADIUS * u;
    let back = believed_rotation.conjugate();
    [back * (contact - believed_centre), (back * -u).normalize()]
}

/// A rotation from z to `direction`.
fn frame_of(direction: DVec3) -> DQuat {
    let x = direction.any_orthonormal_vector();
    DQuat::from_mat3(&DMat3::from_cols(x, direction.cross(x), direction)).normalize()
}
