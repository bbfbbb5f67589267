//! The fit of rigid bodies to touches that come one by one.
//!
//! Each fit begins at the drawing: its robust loss must find outliers among all touches so far.

use glam::DVec3;

use super::cad::CadSkin;
use super::options::BodyOptions;
use super::result::BodyCalibration;
use super::touches::Touches;
use crate::calib::follow::TouchStream;
use crate::calib::{CalibError, FollowedSolve, FollowedTouch, Observations, TouchRow, fit_bodies_with};
use crate::run::Run;

/// Fits the bodies of a drawn skin to a growing set of touches.
///
/// ```
/// use dermatome::calib::{
///     BodyFollower, BodyOptions, CadSkin, ContactMeasurement, ContactObservation, Information, NamedTaxel,
///     Observations, TaxelVariable,
/// };
/// use dermatome::{id::VertexId, run::Run, skin::TaxelId};
/// use glam::DVec3;
///
/// // One taxel, which is mounted 2 mm too high.
/// let taxel = NamedTaxel {
///     id: TaxelId(7), position: DVec3::X, normal: Some(DVec3::Z), module: "0", patch: "skin",
/// };
/// let mut follower = BodyFollower::new(CadSkin::new([taxel])?, &BodyOptions::default(), 1)?;
/// let mut touch = Observations::default();
/// let taxel: VertexId = touch.taxels.push(TaxelVariable { id: TaxelId(7), initial: None, fixed: false });
/// let position = DVec3::X + 0.002 * DVec3::Z;
/// let measurement = ContactMeasurement::Position { position, information: Information::diagonal([1e8; 3]) };
/// touch.contacts.push(ContactObservation { taxel, measurement });
/// let followed = follower.push(&touch, Run::default())?;
/// assert_eq!((followed.touch, followed.taxels), (1, vec![TaxelId(7)]));
/// let found = follower.finish(Run::default())?;
/// assert!((found.taxels[taxel].position.z - 0.002).abs() < 1e-5);
/// # Ok::<(), dermatome::calib::CalibError>(())
/// ```
#[derive(Debug, Clone)]
pub struct BodyFollower {
    cad: CadSkin,
    options: BodyOptions,
    stream: TouchStream,
    solution: Option<Solution>,
}

/// The last fit.
#[derive(Debug, Clone)]
struct Solution {
    /// How many touches it is of.
    touches: usize,
    found: BodyCalibration,
}

impl BodyFollower {
    /// Fits after every `every` touches. [`BodyOptions::folds`] are left to [`finish`](Self::finish).
    ///
    /// # Errors
    /// If the drawing breaks a rule ([`CadSkin::validate`]) or an option is out of range.
    pub fn new(cad: CadSkin, options: &BodyOptions, every: usize) -> Result<Self, CalibError> {
        cad.validate()?;
        options.validate()?;
        Ok(Self { cad, options: *options, stream: TouchStream::new(every), solution: None })
    }

    /// The drawing.
    pub fn cad(&self) -> &CadSkin {
        &self.cad
    }

    /// Adds a touch, and fits if it is time. All its rows are one touch, whatever their numbers; a contact that they name may
    /// be that of other touches. Taxels that were not touched yet follow their module.
    ///
    /// # Errors
    /// If the touch breaks a rule or names a taxel that the drawing does not have, then it is not added; rows are counted over
    /// all touches. As [`fit_bodies`](crate::calib::fit_bodies()).
    pub fn push(&mut self, touch: &Observations, run: Run<'_>) -> Result<FollowedTouch, CalibError> {
        let mut touch = touch.clone();
        let number = self.stream.count as u64;
        let row = |contact| TouchRow { touch: Some(number), ..touch.touch_of(contact) };
        touch.touches = touch.contacts.ids().map(row).collect();
        touch.validate()?;
        Touches::of_rows(&touch, &self.cad, &self.options, self.stream.observations.contacts.len())?;
        let options = &BodyOptions { folds: None, ..self.options };
        let (cad, last) = (&self.cad, &mut self.solution);
        self.stream.add(&touch, None, |stream| {
            let found = fit_bodies_with(&stream.observations, cad, options, run)?;
            let before: Vec<DVec3> = match last {
                Some(last) => last.found.taxels.iter().map(|taxel| taxel.position).collect(),
                None => cad.taxels.iter().map(|taxel| taxel.position).collect(),
            };
            let after = found.taxels.iter().map(|taxel| taxel.position);
            let sigmas = found.taxels.iter().map(|taxel| (taxel.id, taxel.covariance.sigma()));
            let solved = FollowedSolve::of(before.into_iter(), after, sigmas);
            *last = Some(Solution { touches: stream.count, found });
            Ok(solved)
        })
    }

    /// The last fit.
    pub fn solution(&self) -> Option<&BodyCalibration> {
        self.solution.as_ref().map(|solution| &solution.found)
    }

    /// The fit to all touches, which is the last one if that has all of them and no contacts are held back.
    ///
    /// # Errors
    /// As [`fit_bodies`](crate::calib::fit_bodies()); without a touch there is nothing to fit.
    pub fn finish(mut self, run: Run<'_>) -> Result<BodyCalibration, CalibError> {
        let is_last = |last: &Solution| last.touches == self.stream.count && self.options.folds.is_none();
        match self.solution.take().filter(is_last) {
            Some(last) => Ok(last.found),
            None => fit_bodies_with(&self.stream.observations, &self.cad, &self.options, run),
        }
    }
}
