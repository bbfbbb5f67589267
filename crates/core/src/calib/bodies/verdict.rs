//! Whether a fit can be believed as a whole. *Heuristic*: the bounds were chosen on 57 simulated logs with every trouble
//! that a robot gives, which explain 0.90 to 0.999 and pass, and on logs with shuffled taxels, which explain at most 0.63.
//!
//! The share of rejected touches says little of a wrong log, since noise is estimated: everything becomes noise.

use super::options::BodyLevel;
use super::result::BodyCalibration;
use crate::calib::JointMotion;

/// Least share of the spread of the touches that the fit explains.
const LEAST_EXPLAINED: f64 = 0.85;

/// The same of the touches of one patch: at least 0.6 where its taxels are right and their noise is below their distances, at most 0 where
/// they are exchanged at random.
const LEAST_EXPLAINED_OF_PATCH: f64 = 0.3;

/// Most touches that may be outliers.
const MOST_REJECTED: f64 = 0.5;

/// A fit that predicts held-back contacts no better than the drawing, by one standard error, may be one of a right drawing;
/// not if the noise that it finds is above so many times the stated one.
const LEAST_GAIN: f64 = 1.0;
const MOST_NOISE: f64 = 2.0;

/// Readings that fall so many standard deviations against the normals are those of a mirrored drawing: right ones have 40 and more,
/// mirrored ones -40 and less.
const LEAST_SIDE: f64 = -4.0;

/// Noise over the stated one, above which a fit is doubtful.
const DOUBTFUL_NOISE: f64 = 3.0;

/// How far learned tolerances and the mount may be beyond what was given, before a fit is doubtful.
const DOUBTFUL_TIMES: f64 = 3.0;

impl BodyCalibration {
    /// Why the fit cannot be believed, a sentence each; empty if it can, or if there are too few contacts to judge it.
    pub fn faults(&self) -> Vec<String> {
        let mut said = Vec::new();
        if self.side < LEAST_SIDE {
            said.push(format!(
                "readings grow as the sphere moves outwards by the normals of the fit ({:.0} standard deviations): the drawing is \
                 mirrored, or its normals point inwards",
                -self.side
            ));
        } else {
            for (patch, side) in self.sides.iter().filter(|(_, side)| *side < LEAST_SIDE) {
                said.push(format!(
                    "readings on the patch {patch} grow as the sphere moves outwards by the normals of the fit ({:.0} standard \
                     deviations): it is mirrored, or its normals point inwards",
                    -side
                ));
            }
        }
        let Some(held_back) = &self.held_back else { return said };
        if held_back.explained.is_nan() || held_back.explained < LEAST_EXPLAINED {
            said.push(format!(
                "the fit explains {:.2} of where the touches are (needed: {LEAST_EXPLAINED}): taxels or poses are not those of \
                 the drawing",
                held_back.explained
            ));
        }
        let patches = self.bodies.iter().filter(|body| body.level == BodyLevel::Patch);
        for (patch, explained) in patches.zip(&held_back.explained_of_patches) {
            if let Some(explained) = explained.filter(|explained| *explained < LEAST_EXPLAINED_OF_PATCH) {
                said.push(format!(
                    "the fit explains {explained:.2} of where the touches of the patch {} are (needed: {LEAST_EXPLAINED_OF_PATCH}): its \
                     taxels are not those of the drawing",
                    patch.name
                ));
            }
        }
        let rejected = self.rejected.len() as f64 / self.counts[0] as f64;
        if rejected > MOST_REJECTED {
            said.push(format!("{:.0} % of the touches are outliers", 1e2 * rejected));
        }
        if held_back.gain < LEAST_GAIN && self.noise_over_stated > MOST_NOISE {
            said.push(format!(
                "contacts are predicted no better than by the drawing, and the noise is {:.1} times the stated one",
                self.noise_over_stated
            ));
        }
        said
    }

    /// What makes the fit doubtful, a sentence each.
    pub fn doubts(&self) -> Vec<String> {
        let mut said = Vec::new();
        if self.noise_over_stated > DOUBTFUL_NOISE {
            said.push(format!("the noise is {:.1} times the stated one", self.noise_over_stated));
        }
        for (level, given, learned) in &self.tolerances {
            for (given, learned, unit, scale) in [
                (given.translation, learned.translation, "mm", 1e3),
                (given.rotation, learned.rotation, "degrees", 1_f64.to_degrees()),
            ] {
                if learned > DOUBTFUL_TIMES * given {
                    said.push(format!(
                        "bodies of the level {level} moved by {:.1} {unit}, far beyond their tolerance of {:.1}",
                        scale * learned,
                        scale * given
                    ));
                }
            }
        }
        if let Some((mount, of)) = self.bodies.first().map(|mount| (mount, self.mount_tolerance)) {
            for (moved, given, unit, scale) in [
                (mount.translation.length(), of.translation, "mm", 1e3),
                (mount.rotation.length(), of.rotation, "degrees", 1_f64.to_degrees()),
            ] {
                if moved > DOUBTFUL_TIMES * given {
                    said.push(format!(
                        "the mount moved by {:.1} {unit}, far beyond its tolerance of {:.1}",
                        scale * moved,
                        scale * given
                    ));
                }
            }
        }
        if let Some(([standoff, _], given)) = self.standoff.zip(self.standoff_tolerance)
            && standoff.abs() > DOUBTFUL_TIMES * given
        {
            said.push(format!(
                "touches are {:.1} mm farther from the taxels than the radius says, far beyond the tolerance of {:.1}",
                1e3 * standoff,
                1e3 * given
            ));
        }
        for found in &self.joints {
            if found.offset.abs() > DOUBTFUL_TIMES * found.tolerance {
                let (unit, scale) = match found.joint.motion {
                    JointMotion::Turns => ("degrees", 1_f64.to_degrees()),
                    JointMotion::Slides => ("mm", 1e3),
                };
                said.push(format!(
                    "the joint {} is off by {:.1} {unit}, far beyond its tolerance of {:.1}",
                    found.joint.name,
                    scale * found.offset,
                    scale * found.tolerance
                ));
            }
        }
        said
    }
}
