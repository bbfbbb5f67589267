//! How to cut and flatten.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::ValueEnum;
use dermatome::Error;
use dermatome::cut::Cut;
use dermatome::flatten::{Boundary, Energy, FlattenOptions, Method, Overlap};
use dermatome::io::{NotInSkin, Unused, read_boundary, read_seams};
use dermatome::skin::Skin;
use glam::DVec3;

use crate::console::errors::advise;
use crate::console::notes::{note_unused, rows_of};
use crate::options::values::{direction, number};
use crate::options::{Choice, Common, one_of};

/// How to flatten.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Map")]
pub(crate) struct FlattenArgs {
    /// Method that computes the map
    #[arg(long, value_enum, default_value_t = MethodArg::Intrinsic)]
    method: MethodArg,
    /// What the intrinsic method minimises [default: sum, and symmetric-dirichlet for patches without a usable map]
    #[arg(long, value_enum, hide_short_help = true)]
    energy: Option<EnergyArg>,
    /// Weight of the angle term [default: 1]
    #[arg(long, value_name = "W", value_parser = weight, hide_short_help = true)]
    angle: Option<f64>,
    /// Weight of the area term [default: 1]
    #[arg(long, value_name = "W", value_parser = weight, hide_short_help = true)]
    area: Option<f64>,
    /// Weight of the perimeter term, for lengths along the rim that are as on the skin, as where maps are joined [default: 0]
    #[arg(long, value_name = "W", value_parser = weight)]
    perimeter: Option<f64>,
    /// Magnification of dense skin: 0 true to the area, 1 equal map area per taxel [default: 0]
    #[arg(long, value_name = "GAMMA", value_parser = finite, allow_negative_numbers = true)]
    magnify: Option<f64>,
    /// What to do where the map of least distortion overlaps itself [default: prevent]
    #[arg(long, value_parser = one_of(&OVERLAPS), hide = true)]
    overlap: Option<Overlap>,
    /// Where to cut first: auto (only where flattening needs it or gains much),
    /// none, all (every boundary loop is joined), or a table of edges with the columns from,to (ids
    /// of taxels); nothing is cut within a table of --boundary
    #[arg(long, value_name = "auto|none|all|FILE.csv", default_value = "auto")]
    cut: CutArg,
    /// Cut more, a plain disk too, until no triangle of the map is larger or smaller than on the skin
    /// by more than this factor; a note says so where cuts that leave the map in one piece cannot
    /// reach it
    #[arg(long, value_name = "X", value_parser = area_ratio)]
    max_area_ratio: Option<f64>,
    /// Prefer seams on the side that faces DIR, as the inner side of an arm: x, -x, y, -y, z, -z, or three
    /// numbers X,Y,Z
    #[arg(long, value_name = "DIR", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) seam_side: Option<DVec3>,
    /// Where the outer boundary lies: free; circle, as large as the skin; or a table with
    /// columns taxel_id,u,v (m), counter-clockwise [default: free]
    #[arg(long, value_name = "SHAPE|FILE.csv", value_parser = boundary)]
    boundary: Option<BoundaryArg>,
}

/// Where to cut.
#[derive(Debug, Clone)]
pub(crate) enum CutArg {
    Auto,
    None,
    All,
    Table(PathBuf),
}

impl From<OsString> for CutArg {
    fn from(text: OsString) -> Self {
        match text.to_str() {
            Some("auto") => Self::Auto,
            Some("none") => Self::None,
            Some("all") => Self::All,
            _ => Self::Table(text.into()),
        }
    }
}

/// Where the boundary lies; taxels are looked up once the skin is read.
#[derive(Debug, Clone)]
pub(crate) enum BoundaryArg {
    Shape(Boundary),
    Table(PathBuf),
}

const OVERLAPS: [Choice<Overlap>; 2] = [
    ("prevent", Overlap::Prevent, "Map it one to one, at more distortion"),
    ("allow", Overlap::Allow, "Keep it"),
];

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MethodArg {
    /// Least distortion, no flips
    Intrinsic,
    /// Spectral natural conformal map
    Conformal,
    /// Linear mix of conformal and authalic rows; on curved skin --area 0 distorts least
    Linear,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum EnergyArg {
    /// Weighted sum of angle, area and perimeter
    Sum,
    /// Symmetric Dirichlet
    SymmetricDirichlet,
}

impl FlattenArgs {
    /// The options for a skin; a table of --boundary needs one with a single patch.
    pub(crate) fn options_for(&self, skin: &Skin, common: &Common) -> anyhow::Result<FlattenOptions> {
        let mut options = self.options()?;
        let Some(BoundaryArg::Table(path)) = &self.boundary else {
            return Ok(options);
        };
        let [patch] = skin.patches.as_slice() else {
            let found = skin.patches.len();
            return Err(advise(
                format!("the taxels of --boundary need a skin with one patch, not {found}"),
                "choose one with --patch NAME, or prescribe a circle",
            ));
        };
        let rows = rows_of(path, read_boundary(path), common)?;
        options.boundary = Boundary::through(&patch.taxels.ids, rows)
            .map_err(Error::from)
            .with_context(|| format!("cannot use {}", path.display()))?;
        Ok(options)
    }

    /// The options but for a table of --boundary.
    /// Fails if an option is given that has no effect with the others.
    pub(crate) fn options(&self) -> anyhow::Result<FlattenOptions> {
        let (angle, area) = (self.angle.unwrap_or(1.0), self.area.unwrap_or(1.0));
        let magnify = self.magnify.unwrap_or(0.0);
        let method = match (self.method, self.energy) {
            (MethodArg::Conformal, _) => {
                self.allow_only(&[], "--method conformal")?;
                Method::Conformal
            }
            (MethodArg::Linear, _) => {
                self.allow_only(&["--angle", "--area", "--boundary"], "--method linear")?;
                Method::Linear { angle, area }
            }
            (MethodArg::Intrinsic, Some(EnergyArg::SymmetricDirichlet)) => {
                self.allow_only(
                    &["--energy", "--magnify", "--overlap", "--boundary"],
                    "--energy symmetric-dirichlet",
                )?;
                Method::Intrinsic { energy: Energy::SymmetricDirichlet, magnify }
            }
            (MethodArg::Intrinsic, Some(EnergyArg::Sum) | None) => {
                let perimeter = self.perimeter.unwrap_or(0.0);
                Method::Intrinsic { energy: Energy::Sum { angle, area, perimeter }, magnify }
            }
        };
        let overlap = self.overlap.unwrap_or_default();
        let boundary = match &self.boundary {
            Some(BoundaryArg::Shape(shape)) => shape.clone(),
            Some(BoundaryArg::Table(_)) | None => Boundary::Free,
        };
        Ok(FlattenOptions { method, overlap, boundary })
    }

    /// Where to cut; reads the table if one is named.
    pub(crate) fn cut(&self, common: &Common) -> anyhow::Result<Cut> {
        let table = matches!(self.boundary, Some(BoundaryArg::Table(_)));
        match self.max_area_ratio {
            Some(ratio) if matches!(self.cut, CutArg::Auto) && !table => return Ok(Cut::AreaRatio(ratio)),
            Some(_) => {
                let with = if table { "a table of --boundary" } else { "--cut other than auto" };
                let why = format!("--max-area-ratio changes nothing with {with}");
                return Err(advise(why, "leave out one of the two"));
            }
            None => {}
        }
        if table {
            if matches!(self.cut, CutArg::Auto | CutArg::None) {
                return Ok(Cut::None);
            }
            let why = "a table of --boundary has no places for the copies of taxels along a cut";
            return Err(advise(why, "use --cut none or --boundary circle"));
        }
        Ok(match &self.cut {
            CutArg::Auto => Cut::Auto,
            CutArg::None => Cut::None,
            CutArg::All => Cut::All,
            CutArg::Table(file) => Cut::Along(rows_of(file, read_seams(file), common)?),
        })
    }

    /// Leaves out the given seams of taxels that the file has and the skin has not; a note counts them.
    pub(crate) fn keep_seams(&self, cut: &mut Cut, others: &NotInSkin, common: &Common) {
        let (Cut::Along(pairs), CutArg::Table(file)) = (cut, &self.cut) else { return };
        let before = pairs.len();
        pairs.retain(|ends| !ends.iter().all(|id| others.taxels.contains(id)));
        note_unused(file, &Unused { columns: Vec::new(), rows: before - pairs.len() }, common);
    }

    /// Refuses every given option that is not among `used`.
    fn allow_only(&self, used: &[&str], with: &str) -> anyhow::Result<()> {
        let given = [
            ("--energy", self.energy.is_some()),
            ("--angle", self.angle.is_some()),
            ("--area", self.area.is_some()),
            ("--perimeter", self.perimeter.is_some()),
            ("--magnify", self.magnify.is_some()),
            ("--overlap", self.overlap.is_some()),
            ("--boundary", self.boundary.is_some()),
        ];
        match given.into_iter().find(|(name, given)| *given && !used.contains(name)) {
            None => Ok(()),
            Some((name, _)) => {
                Err(advise(format!("{name} changes nothing with {with}"), "leave out one of the two"))
            }
        }
    }
}

fn boundary(text: &str) -> Result<BoundaryArg, String> {
    match text {
        "free" => Ok(BoundaryArg::Shape(Boundary::Free)),
        "circle" => Ok(BoundaryArg::Shape(Boundary::Circle)),
        _ if Path::new(text).extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) => {
            Ok(BoundaryArg::Table(text.into()))
        }
        _ => Err("needed: free, circle or a table FILE.csv".to_owned()),
    }
}

fn area_ratio(text: &str) -> Result<f64, String> {
    number(text, "a number above 1", |x| x > 1.0)
}

fn weight(text: &str) -> Result<f64, String> {
    number(text, "a number of at least 0", |x| x >= 0.0)
}

fn finite(text: &str) -> Result<f64, String> {
    number(text, "a finite number", |_| true)
}
