//! Where the bodies are: `x = M P_k D_m X` for a taxel `X` of module `m` on patch `k`, each a small motion about
//! the centre of its body, and the error of a touch with its derivatives.

use glam::{DMat3, DQuat, DVec3};

use super::cad::{CadSkin, ModuleId};
use super::options::{BodyLevel, BodyOptions, Tolerance};
use super::touches::{Touch, Touches};
use crate::calib::pose::{exp, hat};
use crate::id::{IdVec, VertexId, define_id};

define_id!(
    /// A rigid body: the mount, then the patches, then the modules.
    pub BodyId, "body"
);

/// A motion about the centre of a body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Motion {
    pub(super) translation: DVec3,
    pub(super) rotation: DQuat,
}

/// The bodies that carry a taxel, from the mount outwards.
pub(super) type Chain = [BodyId; 3];

/// The drawing as bodies: what does not change in a fit.
#[derive(Debug, Clone)]
pub(super) struct Hierarchy {
    pub(super) positions: IdVec<VertexId, DVec3>,
    /// Unit normals; zero where they are not known.
    pub(super) normals: IdVec<VertexId, DVec3>,
    modules: IdVec<VertexId, ModuleId>,
    /// Whether a taxel of the module is touched.
    is_touched: IdVec<ModuleId, bool>,
    /// The bodies of every module.
    pub(super) chains: IdVec<ModuleId, Chain>,
    pub(super) levels: IdVec<BodyId, BodyLevel>,
    pub(super) centres: IdVec<BodyId, DVec3>,
}

impl Hierarchy {
    pub(super) fn new(cad: &CadSkin, touches: &Touches) -> Self {
        let mut levels: IdVec<BodyId, BodyLevel> = IdVec::default();
        let mount = levels.push(BodyLevel::Mount);
        let patches = cad.patches.map(|_| levels.push(BodyLevel::Patch));
        let chains = cad.modules.map(|module| {
            let body = levels.push(BodyLevel::Module);
            [mount, patches[module.patch], body]
        });
        let mut is_touched = cad.modules.map(|_| false);
        for &(v, _) in touches.all.iter().flat_map(|touch| &touch.taxels) {
            is_touched[cad.taxels[v].module] = true;
        }
        let mut hierarchy = Self {
            is_touched,
            positions: cad.taxels.map(|t| t.position),
            normals: cad.taxels.map(|t| t.normal.unwrap_or(DVec3::ZERO)),
            modules: cad.taxels.map(|t| t.module),
            chains,
            centres: levels.map(|_| DVec3::ZERO),
            levels,
        };
        hierarchy.find_centres();
        hierarchy
    }

    /// Moves the centre of every body to the mean of its taxels, of the mount to that of the patches that are touched: others have
    /// no part in its motion.
    pub(super) fn find_centres(&mut self) {
        let is_touched = self.touched();
        let mut sums = self.levels.map(|_| (DVec3::ZERO, 0.0));
        for (v, &position) in self.positions.enumerate() {
            let [mount, patch, module] = self.chain(v);
            let bodies =
                [patch, module].into_iter().chain((is_touched[patch] == is_touched[mount]).then_some(mount));
            for body in bodies {
                sums[body].0 += position;
                sums[body].1 += 1.0;
            }
        }
        // A patch may have no module.
        self.centres = sums.map(|(sum, count)| *sum / f64::max(*count, 1.0));
    }

    /// Whether a taxel that the body carries is touched.
    pub(super) fn touched(&self) -> IdVec<BodyId, bool> {
        let mut bodies = self.levels.map(|_| false);
        for (chain, &is_touched) in self.chains.iter().zip(&self.is_touched) {
            chain.iter().for_each(|&body| bodies[body] |= is_touched);
        }
        bodies
    }

    pub(super) fn chain(&self, taxel: VertexId) -> Chain {
        self.chains[self.modules[taxel]]
    }

    pub(super) fn module_of(&self, taxel: VertexId) -> ModuleId {
        self.modules[taxel]
    }
}

/// The unknowns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placement {
    pub(super) motions: IdVec<BodyId, Motion>,
    /// Offset of the probe in its own frame, in m.
    pub(super) offset: DVec3,
    /// Distance of touches from taxels along their normals, in m.
    pub(super) standoff: f64,
    /// The linear unknowns: offsets of the joints from their values, in rad or m, and the delay of the readings, in s, if they are fitted.
    pub(super) linear: Vec<f64>,
}

/// A taxel as placed.
pub(super) struct PlacedTaxel {
    pub(super) position: DVec3,
    pub(super) normal: DVec3,
    /// The taxel from the centre of the mount, patch and module, and its normal, in the frame of the parent.
    levers: [(DVec3, DVec3); 3],
}

/// The change of a touch's error by the six unknowns of a body, in columns.
pub(super) type Columns = [DVec3; 6];

/// The error of a touch and its derivatives.
pub(super) struct TouchError {
    pub(super) error: DVec3,
    /// The bodies that carry its taxels.
    pub(super) bodies: Vec<(BodyId, Columns)>,
    /// By the offset of the probe and the standoff; two columns are zero.
    pub(super) probe: Columns,
}

impl Placement {
    /// Everything as drawn.
    pub(super) fn drawn(hierarchy: &Hierarchy) -> Self {
        let motions = hierarchy.levels.map(|_| Motion::default());
        Self { motions, offset: DVec3::ZERO, standoff: 0.0, linear: Vec::new() }
    }

    pub(super) fn taxel(&self, of: &Hierarchy, taxel: VertexId) -> PlacedTaxel {
        let (mut position, mut normal) = (of.positions[taxel], of.normals[taxel]);
        let mut levers = [(DVec3::ZERO, DVec3::ZERO); 3];
        for (lever, body) in levers.iter_mut().zip(of.chain(taxel)).rev() {
            let (motion, centre) = (self.motions[body], of.centres[body]);
            let arm = motion.rotation * (position - centre);
            normal = motion.rotation * normal;
            *lever = (arm, normal);
            position = centre + motion.translation + arm;
        }
        PlacedTaxel { position, normal, levers }
    }

    /// `p + R o + J q - d v`: where the body of a touch is.
    pub(super) fn body(&self, touch: &Touch) -> DVec3 {
        let moved = touch.columns.iter().zip(&self.linear).map(|(column, x)| *column * *x);
        touch.position + touch.probe * self.offset + moved.sum::<DVec3>()
    }

    /// The same, less the expected centre of the touch.
    fn seen(&self, touch: &Touch) -> DVec3 {
        self.body(touch) - touch.expected
    }

    /// `e = p + R o + J q - d v - b - sum w_i (x_i + h n_i)`, `h` the standoff and the lift of the touch; and the mean normal.
    pub(super) fn error(&self, of: &Hierarchy, touch: &Touch) -> (DVec3, DVec3) {
        let (mut error, standoff) = (self.seen(touch), self.standoff + touch.lift);
        let mut normal = DVec3::ZERO;
        for &(v, weight) in &touch.taxels {
            let placed = self.taxel(of, v);
            error -= weight * (placed.position + standoff * placed.normal);
            normal += weight * placed.normal;
        }
        (error, normal.normalize_or_zero())
    }

    /// As [`Placement::error`], with derivatives by all bodies down to `level`: translations in the parent's frame,
    /// and rotation vectors that multiply from the left.
    pub(super) fn linearised(&self, of: &Hierarchy, touch: &Touch, level: BodyLevel) -> TouchError {
        let (mut error, standoff) = (self.seen(touch), self.standoff + touch.lift);
        let mut normal = DVec3::ZERO;
        // Weight and weighted lever of every body.
        let mut sums: Vec<(BodyId, DMat3, f64, DVec3)> = Vec::new();
        for &(v, weight) in &touch.taxels {
            let placed = self.taxel(of, v);
            error -= weight * (placed.position + standoff * placed.normal);
            normal += weight * placed.normal;
            let mut parent = DMat3::IDENTITY;
            for (body, (arm, normal)) in of.chain(v).into_iter().zip(placed.levers) {
                if of.levels[body] > level {
                    break;
                }
                let lever = weight * (arm + standoff * normal);
                match sums.iter_mut().find(|sum| sum.0 == body) {
                    Some(sum) => (sum.2, sum.3) = (sum.2 + weight, sum.3 + lever),
                    None => sums.push((body, parent, weight, lever)),
                }
                parent *= DMat3::from_quat(self.motions[body].rotation);
            }
        }
        let columns = |parent: DMat3, weight: f64, lever: DVec3| {
            let (t, r) = (parent * -weight, parent * hat(lever));
            [t.x_axis, t.y_axis, t.z_axis, r.x_axis, r.y_axis, r.z_axis]
        };
        let bodies =
            sums.into_iter().map(|(body, parent, w, lever)| (body, columns(parent, w, lever))).collect();
        let [x, y, z] = [touch.probe.x_axis, touch.probe.y_axis, touch.probe.z_axis];
        let probe = [x, y, z, -normal, DVec3::ZERO, DVec3::ZERO];
        TouchError { error, bodies, probe }
    }

    /// Moves a body by six numbers.
    pub(super) fn advance(&mut self, body: BodyId, step: &[f64]) {
        let motion = &mut self.motions[body];
        motion.translation += DVec3::from_slice(step);
        motion.rotation = (exp(DVec3::from_slice(&step[3..])) * motion.rotation).normalize();
    }

    /// The rotation of the bodies above `level` in a chain, which maps the frame of that body's parent to the link.
    pub(super) fn parent_rotation(&self, chain: Chain, depth: usize) -> DMat3 {
        let turns = chain.into_iter().take(depth).map(|body| self.motions[body].rotation);
        DMat3::from_quat(turns.fold(DQuat::IDENTITY, |all, next| all * next))
    }
}

/// The prior of a motion: its squared deviations, and the inverse variances of its six numbers.
pub(super) fn precision(options: &BodyOptions, level: BodyLevel) -> [f64; 6] {
    let Tolerance { translation, rotation } = options.tolerance(level);
    let (t, r) = (translation.powi(-2), rotation.powi(-2));
    [t, t, t, r, r, r]
}
