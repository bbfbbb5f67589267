//! Options that several subcommands share, and what they mean to the library.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::ValueEnum;
use dermatome::{
    Error,
    cut::Cut,
    flatten::{Boundary, Energy, FlattenOptions, Method, Overlap},
    io::{ReadParts, read_acuities, read_boundary, read_draft_with, read_faces, read_seams},
    pyramid::CoarsenOptions,
    skin::{AssembleOptions, Draft, Skin, TaxelId, Weld, world_pose},
};
use glam::{DAffine3, DVec3};
use glob::Pattern;

use crate::errors::advise;

/// How to read a skin.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Reading")]
pub(crate) struct ReadArgs {
    /// Unit of all lengths in the file, also of those in areas, densities and covariances
    #[arg(long, value_enum, default_value_t = Unit::M, value_name = "UNIT")]
    pub(crate) unit: Unit,
    /// Longest edge between taxels without triangles, divided by the local spacing; longer edges
    /// are real gaps and stay open
    #[arg(long, value_name = "K", default_value_t = AssembleOptions::default().gap, value_parser = gap)]
    gap: f64,
    /// Which vertices at exactly the same place become one [default: auto]
    #[arg(long, value_enum, value_name = "WHICH", conflicts_with = "seams")]
    weld: Option<WeldArg>,
    /// Cut along the seams of the texture of a glTF or OBJ file: where texture coordinates jump
    #[arg(long, value_enum, value_name = "uv")]
    seams: Option<SeamsArg>,
    /// Drop faces with the same corners as an earlier one, and split edges with more than two faces
    /// into sheets, or drop the faces that cannot be split off; each is listed
    #[arg(long)]
    repair: bool,
    /// Direction of the outside of taxels without triangles, where nothing in the file tells it: x, -x,
    /// y, -y, z, -z, or three numbers X,Y,Z
    #[arg(long, value_name = "DIR", value_parser = direction, allow_hyphen_values = true)]
    outside: Option<DVec3>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum WeldArg {
    /// Those split for normals or texture coordinates; a cut that opens a surface into a disk stays
    Auto,
    /// All of them: cuts close
    All,
    /// None: the mesh is taken as its indices join it (the corners of an .stl are always welded)
    None,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SeamsArg {
    /// Seams of the texture
    Uv,
}

impl ReadArgs {
    pub(crate) fn of(unit: Unit) -> Self {
        Self {
            unit,
            gap: AssembleOptions::default().gap,
            weld: None,
            seams: None,
            repair: false,
            outside: None,
        }
    }

    pub(crate) fn options(&self) -> AssembleOptions {
        let weld = match (self.seams, self.weld) {
            (Some(SeamsArg::Uv), _) => Weld::Texture,
            (None, Some(WeldArg::Auto) | None) => Weld::Auto,
            (None, Some(WeldArg::All)) => Weld::All,
            (None, Some(WeldArg::None)) => Weld::None,
        };
        let (gap, repair, outside) = (self.gap, self.repair, self.outside);
        AssembleOptions { gap, weld, repair, outside, ..AssembleOptions::default() }
    }

    /// Whether cuts are asked for.
    pub(crate) const fn has_seams(&self) -> bool {
        self.seams.is_some()
    }

    /// Reads a file as written, lengths in m, with its texture coordinates where these make seams.
    ///
    /// # Errors
    /// As [`read_draft_with`]; also if no sheet has texture coordinates to make seams of.
    pub(crate) fn read(&self, path: &Path, materials: bool) -> anyhow::Result<Draft> {
        let parts = ReadParts { texture: self.seams.is_some(), materials };
        let mut draft = read_draft_with(path, parts).map_err(Error::from)?;
        if self.seams.is_some() && draft.sheets.iter().all(|sheet| sheet.texture.is_none()) {
            let what = format!("{} has no texture coordinates on all corners of a sheet", path.display());
            return Err(advise(what, "leave out --seams uv; OBJ and glTF files may have a texture"));
        }
        draft.scale(self.unit.metres());
        Ok(draft)
    }
}

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Unit {
    /// Metres
    M,
    /// Millimetres
    Mm,
    /// Centimetres
    Cm,
    /// Inches
    In,
}

impl Unit {
    /// Its length in m.
    pub(crate) const fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Mm => 1e-3,
            Self::Cm => 1e-2,
            Self::In => 0.0254,
        }
    }
}

/// Which patches of a file to take.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Reading")]
pub(crate) struct PatchArgs {
    /// Take the patches of this name only, in which * and ? stand for any characters; may be given
    /// more than once [default: all patches]
    #[arg(long = "patch", value_name = "NAME", value_parser = pattern)]
    pub(crate) patches: Vec<Pattern>,
    /// Take the faces of a list only: a number on each line, counted from 0 through all triangles of
    /// the file
    #[arg(long, value_name = "FILE")]
    faces: Option<PathBuf>,
    /// Take the faces of this material of a glTF or OBJ file only, in which * and ? stand for any
    /// characters; may be given more than once
    #[arg(long = "material", value_name = "NAME", value_parser = pattern)]
    materials: Vec<Pattern>,
    /// Take the faces, or bare taxels, whose centre lies in this box only: two corners in m, in the
    /// world
    #[arg(long = "box", value_name = "X,Y,Z,X,Y,Z", value_parser = corners, allow_hyphen_values = true)]
    bounds: Option<[DVec3; 2]>,
}

impl PatchArgs {
    /// Whether faces are chosen by their material.
    pub(crate) const fn wants_materials(&self) -> bool {
        !self.materials.is_empty()
    }

    /// Keeps the faces that are chosen.
    ///
    /// # Errors
    /// If the list of faces cannot be read or does not fit, a material is not there, or nothing is
    /// left.
    pub(crate) fn keep_faces(&self, draft: &mut Draft, path: &Path) -> anyhow::Result<()> {
        let refuse = |what: String, help: &str| Err(advise(format!("{}: {what}", path.display()), help));
        if let Some(list) = &self.faces {
            let total: usize = draft.sheets.iter().map(|sheet| sheet.triangles.len()).sum();
            let mut chosen = vec![false; total];
            for face in read_faces(list).map_err(Error::from)? {
                let Some(chosen) = chosen.get_mut(face) else {
                    let what = format!("there is no face {face}, which {} lists", list.display());
                    return refuse(what, &format!("the file has {total} triangles, counted from 0"));
                };
                *chosen = true;
            }
            let mut chosen = chosen.into_iter();
            draft.retain(|sheet, _| !sheet.triangles.is_empty() && chosen.next().unwrap_or(false));
        }
        if self.wants_materials() {
            let is_chosen = |name: &String| self.materials.iter().any(|pattern| pattern.matches(name));
            if !draft.materials.iter().any(is_chosen) {
                let names = match draft.materials.as_slice() {
                    [] => "none".to_owned(),
                    some => some.iter().take(10).cloned().collect::<Vec<_>>().join(", "),
                };
                return refuse(
                    format!("no material has a name in --material; it has {names}"),
                    "give one of them; * stands for any characters",
                );
            }
            let chosen: Vec<bool> = draft.materials.iter().map(is_chosen).collect();
            draft.retain(|sheet, face| {
                let material = sheet.materials.as_ref().and_then(|all| all.get(face));
                material.is_some_and(|&m| chosen.get(m as usize).copied().unwrap_or(false))
            });
        }
        if let Some([low, high]) = self.bounds {
            let links = draft.links.clone();
            draft.retain(|sheet, k| {
                let pose = sheet.link.filter(|link| link.index() < links.len());
                let pose = pose.map_or(DAffine3::IDENTITY, |link| world_pose(&links, link));
                let at = |v: u32| sheet.positions.get(v as usize).copied().unwrap_or(DVec3::NAN);
                let centre = match sheet.triangles.get(k) {
                    Some(&[a, b, c]) => (at(a) + at(b) + at(c)) / 3.0,
                    None => sheet.positions[k],
                };
                let centre = pose.transform_point3(centre);
                centre.cmpge(low).all() && centre.cmple(high).all()
            });
        }
        draft.sheets.retain(|sheet| !sheet.positions.is_empty());
        if draft.sheets.is_empty()
            && (self.faces.is_some() || self.wants_materials() || self.bounds.is_some())
        {
            return refuse("no face is left".into(), "choose more with --faces, --material or --box");
        }
        Ok(())
    }
}

/// A direction: an axis, or three numbers.
fn direction(text: &str) -> Result<DVec3, String> {
    let axis = match text.trim_start_matches('+') {
        "x" => Some(DVec3::X),
        "-x" => Some(DVec3::NEG_X),
        "y" => Some(DVec3::Y),
        "-y" => Some(DVec3::NEG_Y),
        "z" => Some(DVec3::Z),
        "-z" => Some(DVec3::NEG_Z),
        _ => None,
    };
    let numbers: Vec<f64> = text.split(',').map_while(|word| word.trim().parse().ok()).collect();
    let given = <[f64; 3]>::try_from(numbers).ok().map(DVec3::from_array);
    let direction = axis.or(given).and_then(DVec3::try_normalize);
    direction.ok_or_else(|| "needed: x, -x, y, -y, z, -z, or three numbers X,Y,Z".to_owned())
}

/// Two corners of a box, in any order: the lower and the upper one.
fn corners(text: &str) -> Result<[DVec3; 2], String> {
    let numbers: Vec<f64> = text.split(',').map_while(|word| word.trim().parse().ok()).collect();
    match *numbers {
        [a, b, c, d, e, f] if numbers.iter().all(|x| x.is_finite()) && text.matches(',').count() == 5 => {
            let (p, q) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
            Ok([p.min(q), p.max(q)])
        }
        _ => Err("needed: six numbers, x,y,z of one corner and x,y,z of the opposite one, in m".to_owned()),
    }
}

pub(crate) fn pattern(text: &str) -> Result<Pattern, String> {
    Pattern::new(text).map_err(|e| format!("needed: a name, * and ? for any characters ({})", e.msg))
}

/// How to coarsen.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Pyramid")]
pub(crate) struct CoarsenArgs {
    /// Number of vertices of a level divided by that of the next coarser one [default: about 4, the
    /// value that keeps the fields even]
    #[arg(long, value_name = "R", value_parser = ratio)]
    ratio: Option<f64>,
    /// At most this many levels above level 0 [default: as many as --coarsest allows]
    #[arg(long, value_name = "N")]
    levels: Option<usize>,
    /// Stop at about this many vertices per patch
    #[arg(long, value_name = "N", default_value_t = CoarsenOptions::default().coarsest)]
    coarsest: usize,
    /// Fill holes of at most this many edges first, 0 for none; the outer boundary stays, but for a
    /// pin-hole of a closed body
    #[arg(long, value_name = "N", default_value_t = PIN_HOLE, value_parser = hole)]
    pub fill_holes: usize,
}

/// Where the skin is finer than elsewhere.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Pyramid")]
pub(crate) struct AcuityArgs {
    /// Where fields are finer and lengths on the map longer than elsewhere, as at fingertips: a table
    /// with the columns taxel_id,factor; taxels that it does not name have the factor 1
    #[arg(long, value_name = "FILE.csv")]
    acuity: Option<PathBuf>,
}

impl AcuityArgs {
    /// Reads the table, if one is named, into the taxels of a skin.
    pub(crate) fn apply(&self, skin: &mut Skin) -> Result<(), Error> {
        self.acuity.as_ref().map_or(Ok(()), |path| read_acuities(path, skin).map_err(Error::from))
    }
}

impl CoarsenArgs {
    pub(crate) fn options(&self) -> CoarsenOptions {
        CoarsenOptions { ratio: self.ratio, levels: self.levels, coarsest: self.coarsest }
    }
}

/// How to flatten.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Map")]
pub(crate) struct FlattenArgs {
    /// Method that computes the map
    #[arg(long, value_enum, default_value_t = MethodArg::Intrinsic)]
    method: MethodArg,
    /// What the intrinsic method minimises [default: sum]
    #[arg(long, value_enum)]
    energy: Option<EnergyArg>,
    /// Weight of the angle term [default: 1]
    #[arg(long, value_name = "W", value_parser = weight)]
    angle: Option<f64>,
    /// Weight of the area term [default: 1]
    #[arg(long, value_name = "W", value_parser = weight)]
    area: Option<f64>,
    /// Weight of the perimeter term [default: 0]
    #[arg(long, value_name = "W", value_parser = weight)]
    perimeter: Option<f64>,
    /// Magnification of dense skin: 0 true to the area, 1 equal map area per taxel [default: 0]
    #[arg(long, value_name = "GAMMA", value_parser = finite, allow_negative_numbers = true)]
    magnify: Option<f64>,
    /// What to do where the map of least distortion overlaps itself [default: prevent]
    #[arg(long, value_enum)]
    overlap: Option<OverlapArg>,
    /// The same as --overlap prevent
    #[arg(long, hide = true, conflicts_with = "overlap")]
    bijective: bool,
    /// Where to cut first: auto (what has no map otherwise, and where it makes the map much better),
    /// none, all (every boundary loop is joined), or a table of edges with the columns from,to (ids
    /// of taxels); nothing is cut within a table of --boundary
    #[arg(long, value_name = "auto|none|all|FILE.csv", default_value = "auto")]
    cut: String,
    /// Cut more, a plain disk too, until no triangle of the map is larger or smaller than on the skin
    /// by more than this factor; an error if no cut does that
    #[arg(long, value_name = "X", value_parser = area_ratio)]
    max_area_ratio: Option<f64>,
    /// Where the outer boundary lies: free; circle, rectangle or rectangle:W:H, as large as the skin;
    /// rectangle:W:H:A:B:C:D with its corners at these taxels, counter-clockwise from the lower left
    /// one; or a table with columns taxel_id,u,v (m), counter-clockwise [default: free]
    #[arg(long, value_name = "SHAPE|FILE.csv", value_parser = boundary)]
    boundary: Option<BoundaryArg>,
}

/// Where the boundary lies; taxels are looked up once the skin is read.
#[derive(Debug, Clone)]
enum BoundaryArg {
    Shape(Boundary),
    Corners([f64; 2], [TaxelId; 4]),
    Table(PathBuf),
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OverlapArg {
    /// Map it one to one, at more distortion
    Prevent,
    /// Keep it
    Allow,
}

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
    /// The options for a skin; those that name taxels need one with a single patch.
    ///
    /// # Errors
    /// As [`Self::options`], and if a taxel or a table that is named cannot be used.
    pub(crate) fn options_for(&self, skin: &Skin) -> anyhow::Result<FlattenOptions> {
        let mut options = self.options()?;
        let Some(boundary @ (BoundaryArg::Corners(..) | BoundaryArg::Table(_))) = &self.boundary else {
            return Ok(options);
        };
        let [patch] = skin.patches.as_slice() else {
            let found = skin.patches.len();
            return Err(advise(
                format!("the taxels of --boundary need a skin with one patch, not {found}"),
                "choose one with --patch NAME, or prescribe a shape: circle or rectangle",
            ));
        };
        let ids = &patch.taxels.ids;
        options.boundary = match boundary {
            BoundaryArg::Shape(shape) => shape.clone(),
            BoundaryArg::Corners(size, corners) => {
                Boundary::rectangle_through(ids, *size, *corners).map_err(Error::from)?
            }
            BoundaryArg::Table(path) => {
                let places = read_boundary(path).map_err(Error::from)?;
                Boundary::through(ids, places)
                    .map_err(Error::from)
                    .with_context(|| format!("cannot use {}", path.display()))?
            }
        };
        Ok(options)
    }

    /// The options but for a boundary that names taxels.
    ///
    /// # Errors
    /// If an option is given that has no effect with the others.
    pub(crate) fn options(&self) -> anyhow::Result<FlattenOptions> {
        let (angle, area) = (self.angle.unwrap_or(1.0), self.area.unwrap_or(1.0));
        let magnify = self.magnify.unwrap_or(0.0);
        let method = match (self.method, self.energy) {
            (MethodArg::Conformal, _) => {
                self.allow_only(&[], "--method conformal")?;
                Method::Conformal
            }
            (MethodArg::Linear, _) => {
                self.allow_only(&["--angle", "--area"], "--method linear")?;
                Method::Linear { angle, area }
            }
            (MethodArg::Intrinsic, Some(EnergyArg::SymmetricDirichlet)) => {
                self.allow_only(
                    &["--energy", "--magnify", "--overlap", "--bijective", "--boundary"],
                    "--energy symmetric-dirichlet",
                )?;
                Method::Intrinsic { energy: Energy::SymmetricDirichlet, magnify }
            }
            (MethodArg::Intrinsic, Some(EnergyArg::Sum) | None) => {
                let perimeter = self.perimeter.unwrap_or(0.0);
                Method::Intrinsic { energy: Energy::Sum { angle, area, perimeter }, magnify }
            }
        };
        let overlap = match self.overlap {
            Some(OverlapArg::Allow) => Overlap::Allow,
            Some(OverlapArg::Prevent) | None => Overlap::Prevent,
        };
        let boundary = match &self.boundary {
            Some(BoundaryArg::Shape(shape)) => shape.clone(),
            Some(BoundaryArg::Corners(..) | BoundaryArg::Table(_)) | None => Boundary::Free,
        };
        Ok(FlattenOptions { method, overlap, boundary })
    }

    /// Where to cut; reads the table if one is named.
    pub(crate) fn cut(&self) -> anyhow::Result<Cut> {
        let how = self.cut.as_str();
        let table = matches!(self.boundary, Some(BoundaryArg::Table(_)));
        match self.max_area_ratio {
            Some(ratio) if how == "auto" && !table => return Ok(Cut::AreaRatio(ratio)),
            Some(_) => {
                let with = if table { "a table of --boundary" } else { "--cut other than auto" };
                let why = format!("--max-area-ratio changes nothing with {with}");
                return Err(advise(why, "leave out one of the two"));
            }
            None => {}
        }
        if table {
            if how == "auto" || how == "none" {
                return Ok(Cut::None);
            }
            let why = "a table of --boundary has no places for the copies of taxels along a cut";
            return Err(advise(why, "use --cut none, or a circle or rectangle"));
        }
        Ok(match how {
            "auto" => Cut::Auto,
            "none" => Cut::None,
            "all" => Cut::All,
            file => Cut::Along(read_seams(Path::new(file)).map_err(Error::from)?),
        })
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
            ("--bijective", self.bijective),
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

/// The shape of the boundary: `rectangle:4:3` is a rectangle four wide and three high.
fn boundary(text: &str) -> Result<BoundaryArg, String> {
    let rectangle = |width, height| BoundaryArg::Shape(Boundary::Rectangle { width, height, corners: None });
    let side = |text: &str| number(text, "a width and a height above 0", |x| x > 0.0);
    let taxel = |text: &str| text.parse().map(TaxelId).map_err(|_| "needed: the id of a taxel".to_owned());
    match *text.split(':').collect::<Vec<_>>() {
        ["free"] => Ok(BoundaryArg::Shape(Boundary::Free)),
        ["circle"] => Ok(BoundaryArg::Shape(Boundary::Circle)),
        ["rectangle"] => Ok(rectangle(1.0, 1.0)),
        ["rectangle", width, height] => Ok(rectangle(side(width)?, side(height)?)),
        ["rectangle", width, height, a, b, c, d] => Ok(BoundaryArg::Corners(
            [side(width)?, side(height)?],
            [taxel(a)?, taxel(b)?, taxel(c)?, taxel(d)?],
        )),
        _ if Path::new(text).extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) => {
            Ok(BoundaryArg::Table(text.into()))
        }
        _ => Err("needed: free, circle, rectangle[:W:H[:A:B:C:D]] or a table FILE.csv".to_owned()),
    }
}

/// A number within a range that `wanted` describes.
fn number(text: &str, wanted: &str, ok: impl Fn(f64) -> bool) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && ok(x) => Ok(x),
        _ => Err(format!("needed: {wanted}")),
    }
}

/// Edges of a pin-hole at most: where a reader of scans dropped a sliver, not where a screw sits.
/// Three vertices of every loop stay on every level, so that many small holes stall a pyramid.
const PIN_HOLE: usize = 5;

/// Larger holes are intended boundaries, and filling one costs the cube of its number of edges.
const LARGEST_HOLE: usize = 200;

fn hole(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if n <= LARGEST_HOLE => Ok(n),
        _ => Err(format!("needed: a number of edges from 0 to {LARGEST_HOLE}")),
    }
}

fn ratio(text: &str) -> Result<f64, String> {
    number(text, "a number from 1.6 to 1000", |x| (1.6..=1000.0).contains(&x))
}

fn area_ratio(text: &str) -> Result<f64, String> {
    number(text, "a number above 1", |x| x > 1.0)
}

fn gap(text: &str) -> Result<f64, String> {
    number(text, "a number from 1 to 20", |x| (1.0..=20.0).contains(&x))
}

fn weight(text: &str) -> Result<f64, String> {
    number(text, "a number of at least 0", |x| x >= 0.0)
}

fn finite(text: &str) -> Result<f64, String> {
    number(text, "a finite number", |_| true)
}

pub(crate) fn length_mm(text: &str) -> Result<f64, String> {
    number(text, "a length in mm above 0", |x| x > 0.0)
}
