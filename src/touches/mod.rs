//! From touches to contacts: what a robot that touches its skin with a known body says about the positions of its
//! taxels.
//!
//! A [`TouchLog`] has, frame by frame, the pose of the link that carries the skin, the position of the body
//! that touches it, and the active taxels with their readings. The answer is a table of contacts
//! ([`TouchContact`]): for each touch and taxel a position in the frame of the link with its information
//! (inverse covariance), for [`calibrate()`](crate::calib::calibrate()). The source paper `(cannata)` begins with such
//! a table, and does not say how it is made.
//!
//! ```text
//! log -- samples of each taxel -- first guess -- fit of the profile -- normals <-> bundle -- contacts
//!         lone ones left out      means              gains, noise
//! ```
//!
//! 1. Samples (`gather`): the position `p` of the body in the frame of the link, and a reading `r`.
//! 2. First guess (`estimate`): the mean of `p`, weighted by `r^2`. It is wrong by a millimetre or more where few touches
//!    are unevenly around a taxel, and by the depth of the contacts.
//! 3. Normals (`surface`): of quadrics through the taxels around, unless a drawing has them.
//! 4. The fit (`fit`): a taxel at `x` with normal `n` reads `g D(p - x)`, `D` the mean depth to which a sphere presses
//!    the skin on its disc (`profile`). Orthogonal distance regression over all samples gives `x` and `g`, so
//!    the depth need not be known; noise of arm and readings and the spread of gains follow from all taxels.
//! 5. The bundle adjustment (`bundle`): the true position of each frame is unknown too, and follows from all its
//!    readings.
//! 6. Contacts (`contacts`): each touch gets its terms of the normal equations. Sums over the touches of a taxel give back
//!    the estimate.
//!
//! Without readings, or without the radius of the body, steps 3 to 5 are left out: a contact is the mean of the
//! positions of the body.
//!
//! [`simulate_arm`] makes logs with a known truth. Not modelled: friction, the response of taxels that is not a straight
//! line, errors that a frame has in common for several taxels.

mod arm;
mod bundle;
mod contacts;
mod error;
mod estimate;
mod fit;
mod gather;
mod log;
mod profile;
mod rows;
mod surface;

use std::collections::{BTreeMap, BTreeSet};

use glam::{DQuat, DVec3};

pub use arm::{ArmOptions, ArmSimulation, simulate_arm, simulate_arm_with};
pub use error::TouchesError;
pub use log::{TouchBody, TouchFrame, TouchLog};
pub use rows::{LogOfRows, RowSources, TouchReadings, TouchRow, log_of_rows, pose_in_motion};

use crate::calib::Information;
use crate::id::VertexId;
use crate::run::Run;
use crate::skin::TaxelId;
use contacts::Rows;
use estimate::{Known, estimate};
use gather::Samples;

/// What is known about the taxels and the robot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TouchesOptions {
    /// Radius of the disc on which a taxel feels, in m; `None`: 2 mm.
    pub taxel_radius: Option<f64>,
    /// Readings over mean depths, in 1/m: the stiffness times the area of a taxel for forces, the
    /// stiffness for pressures. `None`: estimated.
    pub gain: Option<f64>,
    /// Standard deviation of the position of the arm, per axis, in m; `None`: estimated from the fit, or else 1 mm.
    pub arm_noise: Option<f64>,
    /// A drawing of the skin: where taxels should be, and their normals, in the frame of the link.
    pub drawing: Option<Drawing>,
    /// Taxels that are left out, such as faulty ones.
    pub left_out: BTreeSet<TaxelId>,
}

/// A drawing of a skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Drawing {
    /// Positions of the taxels, in m. Only their distances are used.
    pub positions: BTreeMap<TaxelId, DVec3>,
    /// Normals of the taxels, which point outwards; of all taxels that it has.
    pub normals: BTreeMap<TaxelId, DVec3>,
    /// Pairs of neighbours.
    pub neighbours: BTreeSet<[TaxelId; 2]>,
}

/// What one touch says about one taxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchContact {
    /// The taxel.
    pub taxel: TaxelId,
    /// The number of the touch in the log.
    pub touch: u64,
    /// The number of its contact in the log, if it has one.
    pub contact: Option<u64>,
    /// Where the taxel is, in the frame of the link, in m.
    pub position: DVec3,
    /// Its information (inverse covariance), in 1/m^2. Directions about which the touch says nothing have none.
    pub information: Information<3>,
    /// How much it counts in the mean of its touch: its share of the readings, times the number of taxels.
    pub weight: f64,
    /// The orientation of the body in the frame of the link, if the log has it.
    pub body_rotation: Option<DQuat>,
}

/// Contacts, and how they were found.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchContacts {
    /// By touch in the order of the log, then by taxel.
    pub contacts: Vec<TouchContact>,
    /// Numbers for messages.
    pub summary: TouchesSummary,
}

/// How contacts were found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TouchesSummary {
    /// Number of frames of the log.
    pub frames: usize,
    /// Number of touches with an active taxel that is not left out.
    pub touches: usize,
    /// How many of these have no contact.
    pub empty_touches: usize,
    /// Number of taxels with a contact.
    pub taxels: usize,
    /// How many of them were found from the profile of their readings; the others are means of positions.
    pub fitted: usize,
    /// Readings that were left out since no neighbour of their taxel was active.
    pub lone: usize,
    /// Standard deviation of the position of the arm, per axis, in m, as estimated or given.
    pub arm_noise: f64,
    /// Standard deviation of readings, in their unit, if they were fitted.
    pub reading_noise: Option<f64>,
    /// Distance of neighbouring taxels, in m, if there are several.
    pub spacing: Option<f64>,
}

/// The radius of the disc on which a taxel feels, unless another is given, in m.
const TAXEL_RADIUS: f64 = 2e-3;

/// The noise of the arm where it is neither given nor can be estimated, in m.
const ARM_NOISE: f64 = 1e-3;

/// What the touches of a log say about the positions of its taxels.
///
/// ```
/// use dermatome::touches::{ArmOptions, TouchesOptions, contacts_of_touches, simulate_arm};
///
/// let simulation = simulate_arm(&ArmOptions { taxels: 60, ..ArmOptions::default() })?;
/// let found = contacts_of_touches(&simulation.log, &TouchesOptions::default())?;
/// assert_eq!(found.summary.fitted, 60);
/// # Ok::<(), dermatome::touches::TouchesError>(())
/// ```
///
/// # Errors
/// As [`TouchLog::validate`]; if an option is out of its range, the log names a taxel that the drawing does not have, no
/// taxel is active, or it is not known on which side of the skin a sphere is.
pub fn contacts_of_touches(log: &TouchLog, options: &TouchesOptions) -> Result<TouchContacts, TouchesError> {
    contacts_of_touches_with(log, options, Run::default())
}

/// As [`contacts_of_touches`], in a [`Run`].
///
/// # Errors
/// As [`contacts_of_touches`], and if it is cancelled.
pub fn contacts_of_touches_with(
    log: &TouchLog,
    options: &TouchesOptions,
    run: Run<'_>,
) -> Result<TouchContacts, TouchesError> {
    log.validate()?;
    options.validate(log)?;
    run.check()?;
    let mut samples = Samples::new(log, |id| !options.left_out.contains(&id));
    if samples.ids.is_empty() {
        return Err(TouchesError::NothingFelt { frames: log.frames.len() });
    }
    let known = options.known(&samples);
    let estimates = estimate(&mut samples, &known, log.has_readings, log.frames.len(), run)?;
    run.check()?;
    if !estimates.has_outside && !estimates.profiles.is_empty() {
        let detail = "they are flat, and their link has its origin in their plane";
        return Err(TouchesError::NoOutside { detail });
    }
    let rows = Rows { log, samples: &samples, estimates: &estimates, options };
    Ok(rows.collect())
}

impl TouchesOptions {
    fn validate(&self, log: &TouchLog) -> Result<(), TouchesError> {
        for (option, range, found) in [
            ("the radius of a taxel in m", 1e-6..=1e3, self.taxel_radius),
            ("the gain", 1e-15..=1e15, self.gain),
            ("the noise of the arm in m", 0.0..=1e3, self.arm_noise),
        ] {
            if let Some(found) = found.filter(|found| !range.contains(found)) {
                return Err(TouchesError::BadOption { option, found, range: [*range.start(), *range.end()] });
            }
        }
        let Some(drawing) = &self.drawing else { return Ok(()) };
        for frame in &log.frames {
            let is_unknown = |id: &TaxelId| !drawing.normals.contains_key(id) && !self.left_out.contains(id);
            if let Some(id) = frame.felt.iter().map(|(id, _)| *id).find(is_unknown) {
                return Err(TouchesError::UnknownTaxel { row: frame.row, id });
            }
        }
        Ok(())
    }

    /// What is known of the taxels of some samples.
    fn known(&self, samples: &Samples) -> Known {
        let ids = &samples.ids;
        let index: BTreeMap<TaxelId, VertexId> = ids.enumerate().map(|(v, &id)| (id, v)).collect();
        let normals = self
            .drawing
            .as_ref()
            .map(|drawing| ids.map(|id| drawing.normals.get(id).copied().unwrap_or(DVec3::ZERO)));
        let neighbours =
            self.drawing.as_ref().filter(|drawing| !drawing.neighbours.is_empty()).map(|drawing| {
                let mut lists = ids.map(|_| Vec::new());
                for pair in &drawing.neighbours {
                    if let [Some(&a), Some(&b)] = pair.map(|id| index.get(&id)) {
                        lists[a].push(b);
                        lists[b].push(a);
                    }
                }
                lists
            });
        let spacing = self
            .drawing
            .as_ref()
            .and_then(|drawing| surface::spacing(&drawing.positions.values().copied().collect()));
        Known {
            spacing,
            normals,
            neighbours,
            taxel_radius: self.taxel_radius.unwrap_or(TAXEL_RADIUS),
            gain: self.gain,
            arm_noise: self.arm_noise,
        }
    }
}
