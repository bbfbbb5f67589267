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
//!         lone ones and           means              gains, noise         spikes left out
//!         gross spikes left out
//! ```
//!
//! 1. Samples (`gather`): the position `p` of the body in the frame of the link, and a reading `r`.
//! 2. First guess (`estimate`): the mean of `p`, weighted by `r^2`. It is wrong by a millimetre or more where few touches
//!    are unevenly around a taxel, and by the depth of the contacts.
//! 3. Normals (`surface`, `sides`): of quadrics through the positions of the body around, then through the taxels; to the side to which
//!    readings fall. A drawing has them.
//! 4. The fit (`fit`): a taxel at `x` with normal `n` reads `g D(p - x)`, `D` the mean depth to which a sphere presses
//!    the skin on its disc (`profile`). Orthogonal distance regression over all samples gives `x` and `g`, so
//!    the depth need not be known; noise of arm and readings and the spread of gains follow from all taxels.
//! 5. The bundle adjustment (`bundle`): the true position of each frame is unknown too, and follows from all its
//!    readings. A reading far from the profile of its taxel is a spike (`spikes`): it is left out, and named. The delay of the
//!    readings (`border`) is one unknown more; where there is one, all begins again with poses at their times.
//! 6. Contacts (`contacts`): each touch gets its terms of the normal equations. Sums over the touches of a taxel give back
//!    the estimate.
//!
//! Without readings, or without the radius of the body, steps 3 to 5 are left out: a contact is the mean of the
//! positions of the body.
//!
//! [`simulate_arm`] makes logs with a known truth, and [`LogFaults`] makes them wrong as real ones are. Not modelled: friction, the response of taxels that is not a straight
//! line, errors that a frame has in common for several taxels.

mod arm;
mod border;
mod bundle;
mod contacts;
mod delay;
mod drawing;
mod elbow_arm;
mod error;
mod estimate;
mod examine;
mod faults;
mod fit;
mod gather;
#[cfg(feature = "robots")]
mod joints;
mod log;
mod options;
mod profile;
mod remarks;
mod rows;
mod sides;
mod spikes;
mod surface;
mod unfit;

pub use arm::{ArmOptions, ArmSimulation, simulate_arm, simulate_arm_with};
pub use contacts::{TouchContact, TouchContacts, TouchesSummary};
pub use delay::LogDelay;
pub use drawing::Drawing;
pub use elbow_arm::{ARM_DESCRIPTION, ARM_JOINTS, arm_joint_values};
pub use error::TouchesError;
pub use examine::{LogFinding, LogFindingKind, LogReport, examine_log};
pub use faults::{FaultyLog, LogFaults};
#[cfg(feature = "robots")]
pub use joints::JointColumns;
pub use log::{TouchBody, TouchFrame, TouchLog};
pub use options::TouchesOptions;
pub use rows::{
    ByJointsAt, JointSource, LogOfRows, RowSources, TouchReadings, TouchRow, links_of_rows, log_of_rows,
};
pub use spikes::LeftOutReading;

use std::borrow::Cow;

use crate::run::Run;
use contacts::Rows;
use delay::{DELAY_ROUNDS, MOST_DELAY, without_delay};
use estimate::{Estimates, estimate};
use gather::Samples;

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
/// taxel is active, a delay is given and a frame has no time, it is not known on which side of the skin a sphere is, lengths or the
/// radius of the body are those of another unit, or more than half of the touches, taxels or readings give no contact.
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
    unfit::check_lengths(log)?;
    run.check()?;
    let mut removed = options.delay.unwrap_or(0.0);
    let mut fitted = fit(log, removed, options, run)?;
    if options.delay.is_none() {
        for _ in 0..DELAY_ROUNDS {
            let Some(left) = fitted.2.delay.filter(|left| left.is_worth_removing(removed)) else { break };
            removed = (removed + left.seconds).clamp(-MOST_DELAY, MOST_DELAY);
            fitted = fit(log, removed, options, run)?;
        }
    }
    let (used, samples, mut estimates) = fitted;
    run.check()?;
    if !estimates.has_outside && !estimates.profiles.is_empty() {
        let detail = "they are flat, and their link has its origin in their plane";
        return Err(TouchesError::NoOutside { detail });
    }
    estimates.delay = estimates.delay.map(|left| left.after(removed));
    let rows = Rows { log: &used, samples: &samples, estimates: &estimates, options };
    let mut found = rows.collect();
    found.summary.frames = log.frames.len();
    found.summary.untimed = log.frames.len() - used.frames.len();
    found.check(log, options.drawing.is_some())?;
    Ok(found)
}

/// Estimates everything from a log whose readings are late by `delay`, in s.
fn fit<'l>(
    log: &'l TouchLog,
    delay: f64,
    options: &TouchesOptions,
    run: Run<'_>,
) -> Result<(Cow<'l, TouchLog>, Samples, Estimates), TouchesError> {
    let log = without_delay(log, delay)?;
    let mut samples = Samples::new(&log, |id| !options.left_out.contains(&id));
    if samples.ids.is_empty() {
        return Err(TouchesError::NothingFelt { frames: log.frames.len() });
    }
    let known = options.known(&samples);
    let estimates = estimate(&mut samples, &known, &log, run)?;
    Ok((log, samples, estimates))
}
