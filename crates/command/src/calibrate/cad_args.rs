//! The arguments of `calibrate --cad`.

use dermatome::calib::{BodyLevel, BodyOptions, Folds, Misassembly, Tolerance};

use crate::options::{Choice, InPath, number, one_of, side_mm};

/// Options of a calibration with a drawing.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "With a drawing (--cad)")]
pub(crate) struct CadArgs {
    /// The skin as drawn, with ids of taxels: touches move its mount, patches and modules
    ///
    /// Any skin, or a table taxel_id,x,y,z with nx,ny,nz, module and patch where they are known, in m, in the frame of the
    /// contacts. The contacts may have the columns touch, contact, weight, qx,qy,qz,qw, px,py,pz,radius and outx,outy,outz. Of the
    /// stated uncertainty only the shape counts: its scale is estimated.
    #[arg(long, value_name = "SKIN", conflicts_with_all = [
        "contacts", "triangles", "inliers", "robust", "residual", "initial", "iterations",
        "clip_information", "no_covariance",
    ])]
    pub(super) cad: Option<InPath>,
    /// The modules of the taxels, taxel_id,module [default: a column of the drawing, else its pieces]
    #[arg(long, value_name = "M.csv", requires = "cad")]
    pub(super) modules: Option<InPath>,
    /// The last bodies that may move
    #[arg(long, value_parser = one_of(&LEVELS), default_value = "module", requires = "cad")]
    level: BodyLevel,
    /// How far the mount may be from the drawing: standard deviation per axis
    #[arg(long = "mount-mm", value_name = "MM", default_value = "50", value_parser = side_mm, requires = "cad")]
    mount: f64,
    /// How far it may be turned
    #[arg(long, value_name = "DEG", default_value = "30", value_parser = turn, requires = "cad")]
    mount_deg: f64,
    /// How far a patch may be from where the mount carries it
    #[arg(long = "patch-mm", value_name = "MM", default_value = "3", value_parser = side_mm, requires = "cad")]
    patch: f64,
    /// How far it may be turned
    #[arg(long, value_name = "DEG", default_value = "6", value_parser = turn, requires = "cad")]
    patch_deg: f64,
    /// How far a module may be from where its patch carries it
    #[arg(long = "module-mm", value_name = "MM", default_value = "1", value_parser = side_mm, requires = "cad")]
    module: f64,
    /// How far it may be turned
    #[arg(long, value_name = "DEG", default_value = "4.5", value_parser = turn, requires = "cad")]
    module_deg: f64,
    /// Fit a constant offset of the probe in its own frame, of this standard deviation per axis
    #[arg(long = "fit-probe", value_name = "MM", num_args = 0..=1, require_equals = true,
          default_missing_value = "20", value_parser = side_mm, requires = "cad")]
    probe: Option<f64>,
    /// Fit a constant distance between taxels and touches along the normals, of this standard deviation
    #[arg(long = "fit-standoff", value_name = "MM", num_args = 0..=1, require_equals = true,
          default_missing_value = "10", value_parser = side_mm, requires = "cad")]
    standoff: Option<f64>,
    /// Fit constant offsets of the joints from their values, of this standard deviation: degrees where they turn, mm where
    /// they slide. `touches --fit-joints` writes how each touch moves with them
    #[arg(long = "fit-joints", value_name = "DEG", num_args = 0..=1, require_equals = true,
          default_missing_value = "1", value_parser = turn, requires = "cad")]
    joints: Option<f64>,
    /// Fit modules that look exchanged or turned as they are drawn
    #[arg(long, requires = "cad")]
    as_drawn: bool,
    /// Groups of contacts, each predicted from the others: the bodies that the touches support move, and the fit is judged
    ///
    /// Fewer than ten contacts are not judged by 5 groups.
    #[arg(long, value_name = "K", default_value_t = Folds::default().count, requires = "cad")]
    folds: usize,
    /// Seed of the groups
    #[arg(long, value_name = "S", default_value_t = 0, requires = "cad")]
    seed: u64,
}

const LEVELS: [Choice<BodyLevel>; 3] = [
    ("mount", BodyLevel::Mount, "The skin as a whole"),
    ("patch", BodyLevel::Patch, "Its patches, too"),
    ("module", BodyLevel::Module, "And its modules"),
];

/// An angle in degrees above 0.
fn turn(text: &str) -> Result<f64, String> {
    number(text, "degrees, above 0 and at most 180", |x| x > 0.0 && x <= 180.0)
}

impl CadArgs {
    pub(super) fn options(&self) -> BodyOptions {
        let tolerance =
            |translation: f64, degrees: f64| Tolerance { translation, rotation: degrees.to_radians() };
        BodyOptions {
            mount: tolerance(self.mount, self.mount_deg),
            patch: tolerance(self.patch, self.patch_deg),
            module: tolerance(self.module, self.module_deg),
            level: self.level,
            probe: self.probe,
            standoff: self.standoff,
            joints: self.joints.map(|number| Tolerance::mm_deg(number, number)),
            misassembly: if self.as_drawn { Misassembly::Reported } else { Misassembly::Corrected },
            folds: Some(Folds { count: self.folds, seed: self.seed }),
        }
    }
}
