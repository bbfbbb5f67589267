//! How to read a skin.

use std::path::Path;

use clap::ValueEnum;
use dermatome::Error;
use dermatome::io::{ReadParts, file_kind, read_draft_with};
use dermatome::skin::{AssembleOptions, Draft, Patch, Skin, Weld, link_names};
use glam::DVec3;
use glob::Pattern;

use crate::console::errors::advise;
use crate::console::print::plain;
use crate::options::values::{direction, number};
use crate::options::{Choice, RobotArgs, length, one_of, pattern};

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
    #[arg(long, value_parser = one_of(&WELDS), value_name = "WHICH", conflicts_with = "seams", hide_short_help = true)]
    weld: Option<Weld>,
    /// Cut along the seams of the texture of a glTF or OBJ file: where texture coordinates jump
    #[arg(long, value_parser = one_of(&SEAMS), value_name = "uv", hide_short_help = true)]
    seams: Option<Weld>,
    /// Drop faces with the same corners as an earlier one, split edges with more than two faces into
    /// sheets, and cut surfaces with one side only open;
    /// each is listed [default for .stl, .dae, .3mf, .urdf and .xml]
    #[arg(long)]
    repair: bool,
    /// Direction of the outside of taxels without triangles in the world, if the file has no normals: x, -x,
    /// y, -y, z, -z, or three numbers X,Y,Z
    #[arg(long, value_name = "DIR", value_parser = direction, allow_hyphen_values = true, hide_short_help = true)]
    outside: Option<DVec3>,
    /// Keep what of each link can be seen from outside, and so be touched; faces that are partly seen are divided
    #[arg(long)]
    pub(crate) outer: bool,
    /// Mesh the surface anew with taxels this far apart, as 5mm: for CAD, whose triangles are no taxels. By the
    /// names of links, in which * and ? stand for any characters, as '*hand=2mm,*arm=1cm,5mm': the first that
    /// fits counts, and a length alone is that of all others
    #[arg(long, value_name = "LENGTH|NAME=LENGTH,...", value_parser = spacing)]
    pub(crate) spacing: Option<Spacing>,
    #[command(flatten)]
    pub(crate) robot: RobotArgs,
}

const WELDS: [Choice<Weld>; 3] = [
    (
        "auto",
        Weld::Auto,
        "Those split for normals or texture coordinates; a cut that opens a surface into a disk stays",
    ),
    ("all", Weld::All, "All of them: cuts close"),
    (
        "none",
        Weld::None,
        "None: the mesh is taken as its indices join it (the corners of an .stl are always welded)",
    ),
];

const SEAMS: [Choice<Weld>; 1] = [("uv", Weld::Texture, "Seams of the texture")];

impl ReadArgs {
    /// Refuses the options that say how a skin is made of a file, where files are taken as they are written.
    pub(crate) fn allow_as_written(&self, why: &str) -> anyhow::Result<()> {
        let given = [
            ("--gap", self.gap != AssembleOptions::default().gap),
            ("--weld", self.weld.is_some()),
            ("--seams", self.seams.is_some()),
            ("--repair", self.repair),
            ("--outside", self.outside.is_some()),
            ("--outer", self.outer),
            ("--spacing", self.spacing.is_some()),
        ];
        match given.into_iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((name, _)) => Err(advise(format!("{name} changes nothing: {why}"), "leave it out")),
        }
    }

    /// The options for a file. Those of CAD programs need repair more often than not (57 % of 110 robot
    /// parts), and their formats do not store which faces are one sheet.
    pub(crate) fn options(&self, paths: &[impl AsRef<Path>]) -> AssembleOptions {
        let weld = self.seams.or(self.weld).unwrap_or_default();
        let is_cad =
            |path: &Path| matches!(file_kind(path).as_str(), "stl" | "dae" | "3mf" | "urdf" | "xml" | "mjcf");
        let is_cad = paths.iter().any(|path| is_cad(path.as_ref()));
        let (gap, repair, outside) = (self.gap, self.repair || is_cad, self.outside);
        AssembleOptions { gap, weld, repair, outside, ..AssembleOptions::default() }
    }

    pub(crate) const fn has_seams(&self) -> bool {
        self.seams.is_some()
    }

    /// Reads a file as written, lengths in m, with its texture coordinates where these make seams.
    pub(crate) fn read(&self, path: &Path, materials: bool) -> anyhow::Result<Draft> {
        let parts = ReadParts { texture: self.seams.is_some(), materials };
        let mut draft = if RobotArgs::describes(path) {
            self.robot.read_draft(path)?
        } else {
            self.robot.refuse_unused(path)?;
            read_draft_with(path, parts).map_err(Error::from)?
        };
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
    /// Decimetres
    Dm,
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
            Self::Dm => 0.1,
            Self::In => 0.0254,
        }
    }
}
/// How far apart the taxels of links must be, in m.
#[derive(Debug, Clone)]
pub(crate) struct Spacing {
    of_links: Vec<(Pattern, f64)>,
    others: Option<f64>,
}

impl Spacing {
    /// The spacing on each patch of a skin.
    ///
    /// # Errors
    /// If a pattern fits no link, or a patch is on a link that fits none and there is no other length.
    pub(crate) fn of_patches(&self, skin: &Skin) -> anyhow::Result<Vec<f64>> {
        let links = link_names(&skin.links);
        let fits = |pattern: &Pattern| links.iter().any(|name| pattern.matches(name));
        if let Some((none, _)) = self.of_links.iter().find(|(pattern, _)| !fits(pattern)) {
            let what = format!("there is no link of the name {none} in --spacing");
            return Err(advise(what, "`dermatome info` lists the links; * stands for any characters"));
        }
        let of_patch = |patch: &Patch| {
            let name = &links[patch.link];
            let own = self.of_links.iter().find(|(pattern, _)| pattern.matches(name));
            own.map(|(_, spacing)| *spacing).or(self.others).ok_or_else(|| {
                let what = format!("no name in --spacing is that of the link {}", plain(name));
                advise(what, "end it with a length for all others, as in hand=2mm,5mm")
            })
        };
        skin.patches.iter().map(of_patch).collect()
    }
}

/// A parser of [`Spacing`].
fn spacing(text: &str) -> Result<Spacing, String> {
    let mut spacing = Spacing { of_links: Vec::new(), others: None };
    for part in text.split(',') {
        let (name, value) = part.rsplit_once('=').map_or((None, part), |(name, value)| (Some(name), value));
        let value = length(value.trim()).ok().filter(|x| *x > 0.0 && x.is_finite());
        let value = value.ok_or("needed: lengths above 0, as in 5mm, or hand=2mm,5mm")?;
        match name {
            Some(name) => spacing.of_links.push((pattern(name.trim())?, value)),
            None if spacing.others.replace(value).is_some() => {
                return Err("needed: one length without a name, as in hand=2mm,5mm".into());
            }
            None => {}
        }
    }
    Ok(spacing)
}

fn gap(text: &str) -> Result<f64, String> {
    number(text, "a number from 1 to 20", |x| (1.0..=20.0).contains(&x))
}
