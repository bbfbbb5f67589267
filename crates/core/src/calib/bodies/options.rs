//! What the fit of rigid bodies may move, and by how much.

use crate::calib::{CalibError, JointMotion};

/// How far a body may be from where its parent carries it: standard deviations of a prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Of its position, per axis, in m.
    pub translation: f64,
    /// Of its rotation, per axis, in rad.
    pub rotation: f64,
}

impl Tolerance {
    /// From mm and degrees.
    pub const fn mm_deg(mm: f64, degrees: f64) -> Self {
        Self { translation: 1e-3 * mm, rotation: degrees.to_radians() }
    }

    /// That of the value of a joint, in rad or m.
    pub(super) fn of_joint(self, motion: JointMotion) -> f64 {
        match motion {
            JointMotion::Turns => self.rotation,
            JointMotion::Slides => self.translation,
        }
    }
}

/// The bodies of a skin, each carried by the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum BodyLevel {
    /// The skin as a whole, on its link.
    Mount,
    /// A patch.
    Patch,
    /// A module.
    Module,
}

impl BodyLevel {
    /// All of them, from the link outwards.
    pub const ALL: [Self; 3] = [Self::Mount, Self::Patch, Self::Module];
}

/// Whether modules that look exchanged or turned are fitted as the touches place them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Misassembly {
    /// They are reported, and fitted in each other's place and as turned.
    #[default]
    Corrected,
    /// They are reported, and fitted as drawn.
    Reported,
}

/// A split of the contacts for the prediction of those that are held back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Folds {
    /// Number of groups of contacts; each is predicted from the others.
    pub count: usize,
    /// Seed of the random split.
    pub seed: u64,
}

/// Five groups, which fits of fewer than ten contacts do without.
impl Default for Folds {
    fn default() -> Self {
        Self { count: 5, seed: 0 }
    }
}

/// Options of [`fit_bodies`](crate::calib::fit_bodies()).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyOptions {
    /// Tolerance of the mount.
    pub mount: Tolerance,
    /// Tolerance of every patch on the mount.
    pub patch: Tolerance,
    /// Tolerance of every module on its patch.
    pub module: Tolerance,
    /// The last level that moves.
    pub level: BodyLevel,
    /// Standard deviation per axis, in m, of a constant offset of the probe in its own frame; `None`: no offset.
    pub probe: Option<f64>,
    /// Standard deviation, in m, of a constant distance between taxels and touches along the normals; `None`: no
    /// such distance. A shift of the mount has almost the same effect.
    pub standoff: Option<f64>,
    /// Standard deviations of constant offsets of the joints from their values, in rad where they turn and in m where they slide;
    /// `None`: the values are exact.
    pub joints: Option<Tolerance>,
    /// What is done about exchanged and turned modules.
    pub misassembly: Misassembly,
    /// Whether, and how, contacts are held back to choose the level and to judge the fit; `None`: neither, and the last
    /// level that moves is [`level`](Self::level).
    pub folds: Option<Folds>,
}

/// Those of patches and modules are the bounds of the toolbox of `(rustler2021)` for a Nao, but 1 mm instead of 0.5 mm for a
/// module: held-back contacts of a Nao are predicted within 0.1 mm of each other by both.
impl Default for BodyOptions {
    fn default() -> Self {
        Self {
            mount: Tolerance::mm_deg(50.0, 30.0),
            patch: Tolerance::mm_deg(3.0, 6.0),
            module: Tolerance::mm_deg(1.0, 4.5),
            level: BodyLevel::Module,
            probe: None,
            standoff: None,
            joints: None,
            misassembly: Misassembly::default(),
            folds: None,
        }
    }
}

impl BodyOptions {
    pub(super) fn tolerance(&self, level: BodyLevel) -> Tolerance {
        match level {
            BodyLevel::Mount => self.mount,
            BodyLevel::Patch => self.patch,
            BodyLevel::Module => self.module,
        }
    }

    pub(super) fn validate(&self) -> Result<(), CalibError> {
        let lengths = [
            ("the tolerance of the mount in m", Some(self.mount.translation)),
            ("the tolerance of the mount in rad", Some(self.mount.rotation)),
            ("the tolerance of a patch in m", Some(self.patch.translation)),
            ("the tolerance of a patch in rad", Some(self.patch.rotation)),
            ("the tolerance of a module in m", Some(self.module.translation)),
            ("the tolerance of a module in rad", Some(self.module.rotation)),
            ("the tolerance of the probe's offset in m", self.probe),
            ("the tolerance of the standoff in m", self.standoff),
            ("the tolerance of the offset of a joint in m", self.joints.map(|joints| joints.translation)),
            ("the tolerance of the offset of a joint in rad", self.joints.map(|joints| joints.rotation)),
        ];
        for (option, found) in lengths {
            // Also refuses NaN.
            if let Some(found) = found.filter(|x| !(1e-9..=1e3).contains(x)) {
                return Err(CalibError::BadOption { option, found, needed: "1e-9 to 1e3" });
            }
        }
        match self.folds {
            Some(Folds { count, .. }) if count < 2 => {
                let option = "the number of folds";
                Err(CalibError::BadOption { option, found: count as f64, needed: "at least 2" })
            }
            _ => Ok(()),
        }
    }
}
