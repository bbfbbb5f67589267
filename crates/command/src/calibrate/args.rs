//! The arguments of `calibrate`.

use dermatome::calib::{CalibOptions, Initialization, Loss, ResidualConvention};
use dermatome::least_squares::Options;

use crate::calibrate::cad_args::CadArgs;
use crate::options::{Choice, InPath, OutFile, Unit, one_of, whole};

/// Arguments of `calibrate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The observations: .g2o, or a table .csv; - is standard input
    ///
    /// A table names its columns: i,j,dx,dy,dz for displacements or i,x,y,z for contacts, which may
    /// have nx,ny,nz and sigma_n in rad; then, for either, sigma in m, or sx,sy,sz, or the
    /// information ixx,ixy,ixz,iyy,iyz,izz in 1/m^2; 1 mm if none is given. Contacts may have the columns touch,
    /// contact, weight, qx,qy,qz,qw, px,py,pz,radius and outx,outy,outz, which --cad uses. No other columns and no empty cells.
    pub(super) observations: InPath,
    /// Where to write: a table .csv, the graph with calibrated poses .g2o, or a skin .glb, .gltf,
    /// .json, .obj, .off, .ply, .stl; may be given more than once
    #[arg(short, long, value_name = "OUT", required = true)]
    pub(super) output: Vec<OutFile>,
    /// Absolute contacts in a file of their own: a table i,x,y,z[,nx,ny,nz], or a graph .g2o whose
    /// FIX lines and initial values count, too
    #[arg(long, value_name = "C.csv")]
    pub(super) contacts: Vec<InPath>,
    /// Unit of all lengths in the observations, contacts and truth, also of those in information;
    /// results are in m
    #[arg(long, value_enum, default_value_t = Unit::M, value_name = "UNIT")]
    pub(super) unit: Unit,
    /// Triangles of the skin: a table of taxel ids, id0,id1,id2 [default: those that the edges form]
    #[arg(long, value_name = "TRI.csv")]
    pub(super) triangles: Option<InPath>,
    /// Compare with where the taxels truly are: id,x,y,z[,qx,qy,qz,qw]
    #[arg(long, value_name = "T.csv")]
    pub(super) truth: Option<InPath>,
    /// Write how well every observation fits, how much it counts, and whether it is an inlier:
    /// i,j,sigmas,weight,inlier
    #[arg(long, value_name = "OUT.csv")]
    pub(super) inliers: Option<OutFile>,
    /// How to treat outliers: observations that the stated noise does not explain
    #[arg(long, value_parser = one_of(&ROBUST), default_value = "auto", help_heading = "Solver")]
    pub(super) robust: Robust,
    /// How the error of a relative pose becomes six numbers
    #[arg(long, value_parser = one_of(&RESIDUALS), default_value = "split", help_heading = "Solver")]
    pub(super) residual: ResidualConvention,
    /// Where to start
    #[arg(long, value_parser = one_of(&STARTS), default_value = "chordal", help_heading = "Solver")]
    pub(super) initial: Initialization,
    /// Most iterations of one solve; robust estimation solves several times
    #[arg(long, value_name = "N", default_value_t = CalibOptions::default().limits.max_iterations, help_heading = "Solver")]
    pub(super) iterations: usize,
    /// Replace information that is not positive semi-definite by the nearest that is
    #[arg(long, help_heading = "Solver")]
    pub(super) clip_information: bool,
    /// No covariances
    #[arg(long, help_heading = "Solver")]
    pub(super) no_covariance: bool,
    /// Write the result even if the solve did not converge, or if the fit of a drawing cannot be believed
    #[arg(long)]
    pub(super) keep: bool,
    /// Solve after each touch of a table that is still being written, and print a line of JSON for each
    ///
    /// A touch is a row, or the rows with one number in a column touch. The last result is that of all touches at once.
    #[arg(long, conflicts_with_all = ["contacts", "triangles", "truth", "json", "clip_information"])]
    pub(super) follow: bool,
    /// Solve after every N touches
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = touches, requires = "follow")]
    pub(super) every: usize,
    /// Print the result as JSON
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) cad: CadArgs,
}

/// The loss function; `None`: chosen by what the observations need.
pub(super) type Robust = Option<Loss>;

pub(super) const ROBUST: [Choice<Robust>; 5] = [
    ("auto", None, "Least squares, or gnc if that finds outliers"),
    ("none", Some(Loss::Squared), "Least squares"),
    ("huber", Some(Loss::Huber), "Huber's loss: outliers keep a bounded influence"),
    ("tukey", Some(Loss::Tukey), "Tukey's biweight loss: outliers lose their influence"),
    ("gnc", Some(Loss::Truncated), "Truncated least squares by graduated non-convexity: for many outliers"),
];

const RESIDUALS: [Choice<ResidualConvention>; 3] = [
    ("split", ResidualConvention::Split, "Translation and rotation vector apart"),
    ("log", ResidualConvention::Log, "Logarithm of SE(3), as GTSAM"),
    ("quaternion", ResidualConvention::Quaternion, "Translation and half-angle quaternion, as g2o"),
];

const STARTS: [Choice<Initialization>; 2] = [
    ("chordal", Initialization::Chordal, "Two linear systems"),
    ("file", Initialization::InitialValues, "The values in the file"),
];

/// A number of touches.
fn touches(text: &str) -> Result<usize, String> {
    whole(text, "a number of touches, at least 1")
}

impl Args {
    pub(super) fn options(&self) -> CalibOptions {
        CalibOptions {
            robust: self.robust,
            residual: self.residual,
            initialization: self.initial,
            limits: Options { max_iterations: self.iterations, ..Options::default() },
            covariances: !self.no_covariance,
        }
    }
}
