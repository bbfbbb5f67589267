//! The result of [`fit_bodies`](crate::calib::fit_bodies()): plain data.

use std::collections::BTreeSet;

use glam::{DMat3, DQuat, DVec3};

use super::cad::{CadSkin, CadTaxel, ModuleId};
use super::covariance::{BodyCovariances, added, derivatives, of_taxel};
use super::delay::TouchDelay;
use super::folds::HeldBack;
use super::misassembly::Misassembled;
use super::options::{BodyLevel, BodyOptions, Tolerance};
use super::placement::{BodyId, Hierarchy, precision};
use super::solve::Solved;
use super::system::deviation;
use super::touches::{Touch, TouchId, Touches};
use crate::calib::TouchJoint;
use crate::id::{IdVec, VertexId};
use crate::numeric::{Covariance, Matrix6, chi_square_tail, median, symmetric_eigen};
use crate::skin::TaxelId;

/// A taxel where the fit places it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibratedTaxel {
    /// The vendor's id.
    pub id: TaxelId,
    /// Its position, in m.
    pub position: DVec3,
    /// Its unit normal, if the drawing has one.
    pub normal: Option<DVec3>,
    /// Covariance of the position, in m^2, from those of the bodies that carry it.
    pub covariance: Covariance,
}

/// Whether the motion of a body is as small as its tolerance says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionTest {
    /// Squared motion over its expected covariance: that of the tolerance less that of the result.
    pub chi2: f64,
    /// Numbers of the motion that the touches determine.
    pub degrees_of_freedom: usize,
    /// Probability of a larger motion if the tolerance is right.
    pub p: f64,
}

impl MotionTest {
    /// Whether the drawing is believable: one true drawing in a thousand is not.
    pub fn is_believable(&self) -> bool {
        self.p >= 1e-3
    }
}

/// Where a module is in the frame of the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModulePose {
    /// Mean of its taxels, in m.
    pub centre: DVec3,
    /// Its rotation from the drawing.
    pub rotation: DQuat,
    /// Covariance of the centre in m^2 and of the rotation vector in rad^2, in the frame of the link.
    pub covariance: [[f64; 6]; 6],
}

/// What the fit says about a body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFit {
    /// The level of the body.
    pub level: BodyLevel,
    /// Name of the patch or module; `mount` for the mount.
    pub name: String,
    /// Contacts of its taxels, without rejected ones.
    pub contacts: usize,
    /// Motion of its centre relative to its parent, in m.
    pub translation: DVec3,
    /// Rotation vector relative to its parent, in rad.
    pub rotation: DVec3,
    /// Standard deviations of the length of both, in m and rad; `None` if the body does not move.
    pub sigmas: Option<[f64; 2]>,
    /// The test of the motion; `None` without a contact, or if the body does not move.
    pub test: Option<MotionTest>,
    /// Where a module is; `None` for other bodies.
    pub pose: Option<ModulePose>,
}

/// The offset of the probe in its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbeOffset {
    /// The offset, in m.
    pub offset: DVec3,
    /// Standard deviation of each axis, in m.
    pub sigmas: DVec3,
}

/// The offset of a joint from its values.
#[derive(Debug, Clone, PartialEq)]
pub struct JointOffset {
    /// The joint.
    pub joint: TouchJoint,
    /// What is to be added to its values, in rad if it turns and in m if it slides.
    pub offset: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// The standard deviation that was given: near it touches do not tell the offset.
    pub tolerance: f64,
}

/// Where the bodies of a skin are.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyCalibration {
    /// The taxels, in the order of the drawing.
    pub taxels: IdVec<VertexId, CalibratedTaxel>,
    /// The mount, then the patches, then the modules.
    pub bodies: Vec<BodyFit>,
    /// The probe's offset, if it is fitted.
    pub probe: Option<ProbeOffset>,
    /// The standoff and its standard deviation, in m, if it is fitted.
    pub standoff: Option<[f64; 2]>,
    /// The offsets of the joints, if they are fitted.
    pub joints: Vec<JointOffset>,
    /// How late the readings are next to the poses, if contacts have velocities.
    pub delay: Option<TouchDelay>,
    /// Standard deviation of a touch per axis, in m, as it is estimated: the median over the touches.
    pub noise: f64,
    /// The same over what is stated.
    pub noise_over_stated: f64,
    /// Whether readings fall along the normals of the fit, as a sphere moves outwards, in standard deviations: far above 0 for
    /// the right drawing, far below for a mirrored one; 0 if the touches do not tell.
    pub side: f64,
    /// The same of each patch, by its name, from the touches of its taxels alone.
    pub sides: Vec<(String, f64)>,
    /// Touches that have a centre without a radius: theirs is taken from the others.
    pub assumed_radii: usize,
    /// The tolerances of the mount and, if it is fitted, of the standoff, in m.
    pub mount_tolerance: Tolerance,
    /// See [`Self::mount_tolerance`].
    pub standoff_tolerance: Option<f64>,
    /// Levels below the mount, down to that of the options, with their tolerance as given and as learned from the touches.
    pub tolerances: Vec<(BodyLevel, Tolerance, Tolerance)>,
    /// Number of touches and of contacts.
    pub counts: [usize; 2],
    /// Touches that are outliers, numbered in the order of their first rows.
    pub rejected: Vec<TouchId>,
    /// Weighted sum of the squared whitened errors of inliers and of the motions over their tolerances.
    pub chi2: f64,
    /// Numbers that the contacts of inliers observe. The motions have as many unknowns as priors.
    pub degrees_of_freedom: f64,
    /// Modules without a touch: they keep their drawn pose relative to their patch.
    pub untouched: Vec<ModuleId>,
    /// Modules that look exchanged or turned.
    pub misassembled: Misassembled,
    /// Prediction of contacts that were held back, if that was asked for.
    pub held_back: Option<HeldBack>,
    /// Gauss-Newton steps of the last fit.
    pub steps: usize,
    /// Whether the last step was negligible.
    pub converged: bool,
}

/// A fit and what it is of.
pub(super) struct Fit<'f> {
    pub(super) cad: &'f CadSkin,
    pub(super) options: &'f BodyOptions,
    /// The options with the tolerances of the covariances.
    pub(super) certain: &'f BodyOptions,
    /// The last level that moves.
    pub(super) level: BodyLevel,
    pub(super) hierarchy: &'f Hierarchy,
    pub(super) touches: &'f Touches,
    pub(super) solved: &'f Solved,
    /// Squared motions over their tolerances.
    pub(super) prior: f64,
    pub(super) delay: Option<TouchDelay>,
}

impl Fit<'_> {
    pub(super) fn result(
        &self,
        covariances: &BodyCovariances,
        misassembled: Misassembled,
        held_back: Option<HeldBack>,
    ) -> BodyCalibration {
        let Self { cad, options, hierarchy, touches, solved, prior, delay, .. } = self;
        let contacts = self.contacts_of_bodies();
        let chains = hierarchy.chains.enumerate();
        let is_untouched = |module: &ModuleId| {
            !touches.all.iter().any(|t| t.taxels.iter().any(|&(v, _)| hierarchy.module_of(v) == *module))
        };
        let of_inliers = touches.all.enumerate().filter(|(id, _)| solved.inliers[*id]);
        let errors: f64 = of_inliers.clone().map(|(id, touch)| touch.weight * solved.chi2[id]).sum();
        let (probe, standoff) = covariances.probe;
        let diagonal = DVec3::new(probe.x_axis.x, probe.y_axis.y, probe.z_axis.z);
        let sigmas = |touch: &Touch| Some([solved.noise.sigma(&touch.stated)?, touch.stated.sigma()?]);
        let sigmas: Vec<[f64; 2]> = touches.all.iter().filter_map(sigmas).collect();
        let tolerances = [BodyLevel::Patch, BodyLevel::Module]
            .into_iter()
            .filter(|level| *level <= options.level)
            .map(|level| (level, options.tolerance(level), solved.learned.tolerance(level)));
        let rejected = solved.inliers.enumerate().filter(|(_, is_inlier)| !**is_inlier);
        BodyCalibration {
            taxels: self.taxels(covariances),
            bodies: hierarchy.levels.ids().map(|body| self.body(body, contacts[body], covariances)).collect(),
            probe: options.probe.map(|_| ProbeOffset {
                offset: solved.placement.offset,
                sigmas: diagonal.map(|variance| variance.max(0.0).sqrt()),
            }),
            standoff: options.standoff.map(|_| [solved.placement.standoff, standoff.max(0.0).sqrt()]),
            joints: self.joints(covariances),
            delay: *delay,
            noise: median(sigmas.iter().map(|[found, _]| *found)).unwrap_or(f64::NAN),
            noise_over_stated: median(sigmas.iter().map(|[found, stated]| found / stated))
                .unwrap_or(f64::NAN),
            side: self.side(|_| true),
            sides: self.sides(),
            assumed_radii: touches.assumed_radii,
            mount_tolerance: options.mount,
            standoff_tolerance: options.standoff,
            tolerances: tolerances.collect(),
            counts: [touches.all.len(), touches.contacts],
            rejected: rejected.map(|(touch, _)| touch).collect(),
            chi2: errors + prior,
            degrees_of_freedom: 3.0 * of_inliers.map(|(_, touch)| touch.weight).sum::<f64>(),
            untouched: chains.map(|(module, _)| module).filter(is_untouched).collect(),
            misassembled,
            held_back,
            steps: solved.steps,
            converged: solved.converged,
        }
        .named_as(cad)
    }

    fn joints(&self, covariances: &BodyCovariances) -> Vec<JointOffset> {
        let offsets = self.solved.placement.linear.iter().zip(&covariances.linear);
        let all = self.touches.joints.iter().zip(offsets).zip(self.options.joints.iter().cycle());
        let offset =
            |((joint, (&offset, variance)), tolerance): ((&TouchJoint, (&f64, &f64)), &Tolerance)| {
                let (joint, tolerance) = (joint.clone(), tolerance.of_joint(joint.motion));
                JointOffset { joint, offset, sigma: variance.max(0.0).sqrt(), tolerance }
            };
        all.map(offset).collect()
    }

    /// The sum over some touches of how their readings fall along the normals, each bounded.
    fn side(&self, is_taken: impl Fn(&Touch) -> bool) -> f64 {
        /// A touch counts at most this many standard deviations.
        const MOST_SIGMAS: f64 = 6.0;
        /// The sum decides only if their mean is beyond this: presses have 4.7, a sphere that rolls with a constant force 0.9.
        const LEAST_MEAN: f64 = 1.5;
        /// Fewer touches do not tell the side: readings of one that moves along the skin change with the force, too.
        const LEAST_TOUCHES: usize = 3;
        let told = self.touches.all.iter().filter(|touch| touch.outward != DVec3::ZERO && is_taken(touch));
        let falls = told.map(|touch| {
            let normal = self.solved.placement.error(self.hierarchy, touch).1;
            normal.dot(touch.outward).clamp(-MOST_SIGMAS, MOST_SIGMAS)
        });
        let falls: Vec<f64> = falls.collect();
        let (sum, count) = (falls.iter().sum::<f64>(), falls.len() as f64);
        let is_told = falls.len() >= LEAST_TOUCHES && sum.abs() > LEAST_MEAN * count;
        if is_told { sum / count.sqrt() } else { 0.0 }
    }

    /// The side of each patch: those of patches with other normals cancel in the sum of all.
    fn sides(&self) -> Vec<(String, f64)> {
        let patches = self.cad.patches.enumerate();
        let side = |patch| {
            let on_patch =
                |&(v, _): &(VertexId, f64)| self.cad.modules[self.cad.taxels[v].module].patch == patch;
            self.side(|touch| touch.taxels.iter().all(on_patch))
        };
        patches.map(|(patch, name)| (name.clone(), side(patch))).collect()
    }

    /// Number of contacts of inliers that each body carries.
    fn contacts_of_bodies(&self) -> IdVec<BodyId, usize> {
        let mut contacts = self.hierarchy.levels.map(|_| BTreeSet::new());
        for (touch, _) in self.touches.all.iter().zip(&self.solved.inliers).filter(|(_, inlier)| **inlier) {
            for body in touch.taxels.iter().flat_map(|&(v, _)| self.hierarchy.chain(v)) {
                contacts[body].insert(touch.contact);
            }
        }
        contacts.map(BTreeSet::len)
    }

    fn taxels(&self, covariances: &BodyCovariances) -> IdVec<VertexId, CalibratedTaxel> {
        let centres = self.hierarchy.chains.map(|chain| self.centre(*chain));
        let of = |(v, taxel): (VertexId, &CadTaxel)| {
            let placed = self.solved.placement.taxel(self.hierarchy, v);
            let module = taxel.module;
            CalibratedTaxel {
                id: taxel.id,
                position: placed.position,
                normal: placed.normal.try_normalize(),
                covariance: of_taxel(
                    &added(&covariances.modules[module], &self.unmoved(v)),
                    placed.position - centres[module],
                ),
            }
        };
        self.cad.taxels.enumerate().map(of).collect()
    }

    /// What the tolerances of bodies that carry a taxel and do not move leave open, of the centre of its module.
    fn unmoved(&self, taxel: VertexId) -> Matrix6 {
        let (at, of) = (&self.solved.placement, self.hierarchy);
        let chain = of.chain(taxel);
        let derivatives = derivatives(of, at, chain);
        let mut sum = Matrix6::ZERO;
        for (body, derivative) in chain.into_iter().zip(derivatives) {
            let level = of.levels[body];
            if level > self.level {
                let tolerance = self.solved.learned.tolerance(level);
                let [t, r] = [tolerance.translation, tolerance.rotation]
                    .map(|sigma| DMat3::from_diagonal(DVec3::splat(sigma * sigma)));
                let own = Matrix6([[t, DMat3::ZERO], [DMat3::ZERO, r]]);
                sum = added(&sum, &(derivative * own * derivative.transpose()));
            }
        }
        sum
    }

    /// Where the centre of a module is.
    fn centre(&self, chain: [BodyId; 3]) -> DVec3 {
        let at = &self.solved.placement;
        chain.into_iter().rev().fold(self.hierarchy.centres[chain[2]], |position, body| {
            let (motion, centre) = (at.motions[body], self.hierarchy.centres[body]);
            centre + motion.translation + motion.rotation * (position - centre)
        })
    }

    fn body(&self, body: BodyId, contacts: usize, covariances: &BodyCovariances) -> BodyFit {
        let at = &self.solved.placement;
        let level = self.hierarchy.levels[body];
        let motion = deviation(at, body);
        let covariance = covariances.bodies[body];
        let root = |part: DMat3| (part.x_axis.x + part.y_axis.y + part.z_axis.z).max(0.0).sqrt();
        let chain = self.hierarchy.chains.enumerate().find(|(_, chain)| chain[2] == body);
        let pose = chain.map(|(module, chain)| ModulePose {
            centre: self.centre(*chain),
            rotation: chain.iter().fold(DQuat::IDENTITY, |all, &b| all * at.motions[b].rotation),
            covariance: rows(&covariances.modules[module]),
        });
        let test = covariance.filter(|_| contacts > 0).map(|c| self.test(level, motion, &c));
        BodyFit {
            level,
            name: String::new(),
            contacts,
            translation: DVec3::from_slice(&motion),
            rotation: DVec3::from_slice(&motion[3..]),
            sigmas: covariance.map(|c| [root(c.0[0][0]), root(c.0[1][1])]),
            test,
            pose,
        }
    }

    /// A motion of variance `s` under the tolerance `t` of the fit is the share `k = 1 - s / t` of what it would be without a
    /// tolerance. If the given tolerance `g` is right, its variance about the drawing is `k^2 g + k (1 - k) t`.
    fn test(&self, level: BodyLevel, motion: [f64; 6], covariance: &Matrix6) -> MotionTest {
        let scale = precision(self.certain, level).map(f64::sqrt);
        let given = precision(self.options, level).map(f64::sqrt);
        let shrunk = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                f64::from(u8::from(i == j)) - scale[i] * covariance.entry(i, j) * scale[j]
            })
        });
        let (values, vectors) = symmetric_eigen::<6>(&shrunk);
        let (mut chi2, mut degrees_of_freedom) = (0.0, 0);
        for (k, &value) in values.iter().enumerate().filter(|(_, value)| **value > LEAST_DETERMINED) {
            let along: f64 = (0..6).map(|i| vectors[i][k] * motion[i] * scale[i]).sum();
            let given: f64 = (0..6).map(|i| (vectors[i][k] * scale[i] / given[i]).powi(2)).sum();
            chi2 += along * along / (value * value * given + value * (1.0 - value));
            degrees_of_freedom += 1;
        }
        let p = if degrees_of_freedom == 0 { 1.0 } else { chi_square_tail(chi2, degrees_of_freedom as f64) };
        MotionTest { chi2, degrees_of_freedom, p }
    }
}

/// A direction of a motion counts as determined if touches remove this share of the variance of its tolerance.
const LEAST_DETERMINED: f64 = 0.05;

fn rows(matrix: &Matrix6) -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix.entry(i, j)))
}

impl BodyCalibration {
    fn named_as(mut self, cad: &CadSkin) -> Self {
        let names = ["mount"].into_iter().chain(cad.patches.iter().map(String::as_str));
        let names = names.chain(cad.modules.iter().map(|module| module.name.as_str()));
        self.bodies.iter_mut().zip(names).for_each(|(body, name)| body.name = name.to_owned());
        self
    }
}
