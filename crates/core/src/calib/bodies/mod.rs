//! The fit of rigid bodies: a skin as it was drawn is the prior, and touches move the bodies that carry its taxels.
//!
//! A taxel `X` of module `m` on patch `k` is at `x = M P_k D_m X`: small motions of the mount, the patch and the
//! module about the centres of their taxels, each with a tolerance ([`Tolerance`]), as in the toolbox of
//! `(rustler2021)`. A touch at `p` of a probe with the orientation `R`, felt by taxels `i` of weights `w_i`, has the error
//!
//! ```text
//! e = p + R o + J q - d v - b - sum w_i (x_i + h n_i)
//! ```
//!
//! with the probe's offset `o`, a standoff `h` along the normals `n_i` and the offsets `q` of joints from their values, if these are fitted; `J` is
//! how the touch moves with the joints, to first order. Where the mean velocity `v` of the body in each touch is known, the delay `d` of the readings is
//! one unknown more (`delay`). Where `p` is the centre of a
//! sphere, `h` begins at nine tenths of its radius, along the normals of the fit. `b` is the expected centre of the touch (`expected`): after a fit it
//! follows from the model of a press there, and all is fitted again, twice; without the path of the sphere it is zero. The fit minimises
//! `sum w rho(e' C^-1 e)`, `C = a^2 I + f^2 S` with the stated covariance `S` and a scale that is estimated, plus the squared motions over their tolerances: touches move the highest body that
//! explains them, since moving one body costs less than moving all that it carries. Touches that repeat a contact
//! weigh as one together, so standard deviations follow from the number of contacts.
//!
//! ```text
//! CadSkin, Observations -- touches --> start -- misassembly --> solve -- covariance --> BodyCalibration
//!                                                                 +--> folds: held-back contacts --> level, verdict
//! ```
//!
//! What touches of 3 mm noise per axis reach, 20 for each of 40 modules that are 5 mm and 5 degrees from the drawing, mean of 20
//! skins (`tests/library/bodies.rs`): centres within 1.17 mm, rotations within 1.8 degrees per axis on modules of 84 mm and 2.1 on modules of
//! 60 mm, squared errors 0.97 of their covariances. Rotations are worse on smaller modules: touches of 20 mm of skin determine badly
//! how it is turned.
//!
//! Guaranteed: the same result on any number of threads; a module without a touch keeps its drawn pose relative to
//! its patch. Not guaranteed: the global minimum. Covariances are those of the linearised problem at the
//! weights of the solution.
//!
//! In reading order: `cad`, `drawing`, `options`, `touches`, `placement`, `system`, `noise`, `solve`, `start`, `covariance`,
//! `delay`, `expected`, `misassembly`, `result`, `folds`, `verdict`, `follow`.

mod cad;
mod covariance;
mod delay;
mod drawing;
mod expected;
mod folds;
mod follow;
mod misassembly;
mod noise;
mod options;
mod placement;
mod result;
mod solve;
mod start;
mod system;
mod touches;
mod verdict;

pub use cad::{CadModule, CadSkin, CadTaxel, ModuleId, NamedTaxel};
pub use delay::TouchDelay;
pub use drawing::ModuleNames;
pub use folds::{HeldBack, LevelScore};
pub use follow::BodyFollower;
pub use misassembly::{Misassembled, TurnedModule};
pub use options::{BodyLevel, BodyOptions, Folds, Misassembly, Tolerance};
pub use result::{
    BodyCalibration, BodyFit, CalibratedTaxel, JointOffset, ModulePose, MotionTest, ProbeOffset,
};
pub use touches::TouchId;

use crate::calib::{CalibError, Observations};
use crate::run::Run;
use covariance::covariances;
use misassembly::Assembled;
use solve::{Solved, solve};
use start::down_to;
use system::BodySystem;
use touches::Touches;

/// Fits after which the expected centres of the touches are found.
const EXPECTED_ROUNDS: usize = 2;

/// Finds where the mount, the patches and the modules of a drawn skin are, from touches.
///
/// Normals of [`PositionNormal`](crate::calib::ContactMeasurement::PositionNormal) are not used.
///
/// ```
/// use dermatome::calib::{
///     BodyOptions, CadSkin, ContactMeasurement, ContactObservation, Information, NamedTaxel, Observations,
///     TaxelVariable, fit_bodies,
/// };
/// use dermatome::{id::VertexId, skin::TaxelId};
/// use glam::DVec3;
///
/// // Four taxels on one module, which is mounted 2 mm too high.
/// let drawn = [[0.0, 0.0], [0.02, 0.0], [0.0, 0.02], [0.02, 0.02]].map(|[x, y]| DVec3::new(x, y, 0.0));
/// let taxels = drawn.into_iter().zip(0..).map(|(position, id)| NamedTaxel {
///     id: TaxelId(id), position, normal: Some(DVec3::Z), module: "0", patch: "skin",
/// });
/// let cad = CadSkin::new(taxels)?;
/// let mut observations = Observations::default();
/// for (position, id) in drawn.into_iter().zip(0..) {
///     let taxel: VertexId =
///         observations.taxels.push(TaxelVariable { id: TaxelId(id), initial: None, fixed: false });
///     let position = position + 0.002 * DVec3::Z;
///     let measurement = ContactMeasurement::Position { position, information: Information::diagonal([1e8; 3]) };
///     observations.contacts.push(ContactObservation { taxel, measurement });
/// }
/// let found = fit_bodies(&observations, &cad, &BodyOptions::default())?;
/// let highest = found.taxels.iter().map(|t| t.position.z).fold(0.0, f64::max);
/// assert!((highest - 0.002).abs() < 1e-5, "{highest} m");
/// # Ok::<(), dermatome::calib::CalibError>(())
/// ```
///
/// # Errors
/// If the observations or the drawing break a rule ([`Observations::validate`], [`CadSkin::validate`]), a contact is
/// of a taxel that the drawing does not have, a contact has no position or no orientation of the probe although its
/// offset is fitted, a contact does not say how it moves with the joints although their offsets are, or an option is out of range.
pub fn fit_bodies(
    observations: &Observations,
    cad: &CadSkin,
    options: &BodyOptions,
) -> Result<BodyCalibration, CalibError> {
    fit_bodies_with(observations, cad, options, Run::default())
}

/// As [`fit_bodies`], in a [`Run`].
///
/// # Errors
/// As [`fit_bodies`], and if it is cancelled.
pub fn fit_bodies_with(
    observations: &Observations,
    cad: &CadSkin,
    options: &BodyOptions,
    run: Run<'_>,
) -> Result<BodyCalibration, CalibError> {
    observations.validate()?;
    cad.validate()?;
    options.validate()?;
    let mut touches = Touches::new(observations, cad, options)?;
    let options = &BodyOptions { standoff: options.standoff.or(touches.standoff()), ..*options };
    let Assembled { hierarchy, misassembled, mounted } = Assembled::new(options, cad, &touches, run)?;
    let mut solved: Solved = solve(options, options.level, &hierarchy, &touches, mounted.clone(), run)?;
    let rounds = if touches.are_expected() { EXPECTED_ROUNDS } else { 0 };
    for _ in 0..rounds {
        touches.expect(&hierarchy, &solved.placement);
        solved = solve(options, options.level, &hierarchy, &touches, solved.placement, run)?;
    }
    let delay = delay::judged(options, options.level, &hierarchy, &mut touches, &mut solved, run)?;
    let is_judged = |folds: &Folds| *folds != Folds::default() || touches.contacts >= 2 * folds.count;
    let folds = options.folds.filter(is_judged);
    let held_back = folds.map(|folds| folds::score(folds, &solved, &hierarchy, &touches, run)).transpose()?;
    let level = held_back.as_ref().map_or(options.level, |held_back| held_back.supported);
    if level < options.level {
        let from = down_to(&hierarchy, &mounted, level);
        // Levels that do not move keep the tolerances that were learned with them.
        let learned = solved.learned;
        solved = solve(options, level, &hierarchy, &touches, from, run)?;
        solved.learned.module = learned.module;
        if level == BodyLevel::Mount {
            solved.learned.patch = learned.patch;
        }
    }
    // A tolerance that was learned from few bodies is too small as often as too large.
    let certain = &solved.certain;
    let system = BodySystem::new(certain, level, &hierarchy, &touches)?;
    let factor = system.factor(&system.linearise(&solved.placement, &solved.weights))?;
    let covariances = covariances(&system, &factor, &solved.placement)?;
    let prior = system.prior_chi2(&solved.placement);
    let fit = result::Fit {
        cad,
        options,
        certain,
        level,
        hierarchy: &hierarchy,
        touches: &touches,
        solved: &solved,
        prior,
        delay,
    };
    Ok(fit.result(&covariances, misassembled, held_back))
}
