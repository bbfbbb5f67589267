//! Which patches, faces or taxels of a file to take.

use std::path::Path;

use dermatome::id::IdVec;
use dermatome::remesh::clip;
use dermatome::skin::{Draft, LinkId, Sheet, link_named, world_pose};
use glam::{DAffine3, DVec3};
use glob::Pattern;

use crate::console::errors::advise;
use crate::console::print::plain;
use crate::options::values::{direction, numbers};

/// Which patches of a file to take.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Reading")]
pub(crate) struct PatchArgs {
    /// Take the patches of this name only, in which * and ? stand for any characters; may be given
    /// more than once [default: all patches]
    #[arg(long = "patch", value_name = "NAME", value_parser = pattern)]
    pub(crate) patches: Vec<Pattern>,
    /// Take the faces of this material of a glTF or OBJ file only, in which * and ? stand for any
    /// characters; may be given more than once
    #[arg(long = "material", value_name = "NAME", value_parser = pattern, hide_short_help = true)]
    materials: Vec<Pattern>,
    /// Take the faces, or bare taxels, whose centre lies in this box only: two corners in m, in the
    /// world, or, as hand:X,..., in the frame of a link; with --spacing faces are cut along its sides
    #[arg(long = "box", value_name = "[LINK:]X,Y,Z,X,Y,Z", value_parser = corners, allow_hyphen_values = true)]
    bounds: Option<InFrame<[DVec3; 2]>>,
    /// Take only the faces, or bare taxels, whose normal is within some degrees of a direction (x, -x, y, -y, z, -z
    /// or three numbers), in the world or in the frame of a link; for example x,45deg [degrees: 60]
    #[arg(long, value_name = "[LINK:]DIR[,DEG]", value_parser = facing, allow_hyphen_values = true, hide_short_help = true)]
    facing: Option<InFrame<Facing>>,
}

/// A value in the frame of a link, or of the world.
#[derive(Debug, Clone)]
struct InFrame<T> {
    link: Option<String>,
    value: T,
}

/// A direction, and the largest angle from it, in rad.
#[derive(Debug, Clone, Copy)]
struct Facing {
    direction: DVec3,
    angle: f64,
}

impl<T> InFrame<T> {
    fn parse(text: &str, value: impl Fn(&str) -> Result<T, String>) -> Result<Self, String> {
        let (link, rest) =
            text.rsplit_once(':').map_or((None, text), |(link, rest)| (Some(link.into()), rest));
        Ok(Self { link, value: value(rest)? })
    }

    /// The poses of the links of a draft in this frame.
    fn poses(&self, draft: &Draft) -> anyhow::Result<IdVec<LinkId, DAffine3>> {
        let world: IdVec<LinkId, DAffine3> =
            draft.links.ids().map(|link| world_pose(&draft.links, link)).collect();
        let Some(name) = &self.link else { return Ok(world) };
        let own = link_named(&draft.links, name).map_err(|links| {
            let name = plain(name);
            if links == 0 {
                let what = format!("there is no link of the name {name} for --box or --facing");
                return advise(what, "`dermatome info` lists the links");
            }
            let what = format!(
                "--box or --facing in the frame of {name}, the name of {links} links; needed: the name of one link alone"
            );
            advise(what, "give the box or direction in the world, without the name of a link")
        })?;
        let from_world = world[own].inverse();
        Ok(world.iter().map(|pose| from_world * *pose).collect())
    }
}

impl PatchArgs {
    /// The patches whose name fits one of the patterns, or all without patterns.
    pub(crate) fn named(patches: &[Pattern]) -> Self {
        Self { patches: patches.to_vec(), ..Self::default() }
    }

    pub(crate) const fn wants_materials(&self) -> bool {
        !self.materials.is_empty()
    }

    /// Whether it takes some faces of a sheet and leaves out others.
    pub(crate) const fn takes_faces(&self) -> bool {
        self.wants_materials() || self.bounds.is_some() || self.facing.is_some()
    }

    /// Keeps the faces that are chosen; where the surface is meshed anew, its rim along a box is straight.
    /// Fails if a material is not there, or nothing is left.
    pub(crate) fn keep_faces(
        &self,
        draft: &mut Draft,
        is_meshed_anew: bool,
        path: &Path,
    ) -> anyhow::Result<()> {
        let refuse = |what: String, help: &str| Err(advise(format!("{}: {what}", path.display()), help));
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
        if let Some(bounds) = &self.bounds {
            let (poses, [low, high]) = (bounds.poses(draft)?, bounds.value);
            if is_meshed_anew {
                for sheet in &mut draft.sheets {
                    *sheet = clip(sheet, pose_of(sheet, &poses), bounds.value);
                }
            }
            draft.retain(|sheet, k| {
                if is_meshed_anew && !sheet.triangles.is_empty() {
                    return true;
                }
                let corners = corners_of(sheet, k);
                let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
                let centre = pose_of(sheet, &poses).transform_point3(centre);
                centre.cmpge(low).all() && centre.cmple(high).all()
            });
        }
        if let Some(facing) = &self.facing {
            let (poses, Facing { direction, angle }) = (facing.poses(draft)?, facing.value);
            draft.retain(|sheet, k| {
                let normal = match *corners_of(sheet, k) {
                    [a, b, c] => (b - a).cross(c - a),
                    _ => sheet.normals.as_ref().map_or(DVec3::ZERO, |normals| normals[k]),
                };
                let normal = pose_of(sheet, &poses).transform_vector3(normal);
                normal != DVec3::ZERO && normal.angle_between(direction) <= angle
            });
        }
        draft.sheets.retain(|sheet| !sheet.positions.is_empty());
        if draft.sheets.is_empty() && self.takes_faces() {
            return refuse("no face is left".into(), "choose more with --material, --box or --facing");
        }
        Ok(())
    }
}

/// The corners of a triangle of a sheet, or the position of a bare taxel.
fn corners_of(sheet: &Sheet, k: usize) -> Vec<DVec3> {
    let at = |v: u32| sheet.positions.get(v as usize).copied().unwrap_or(DVec3::NAN);
    sheet.triangles.get(k).map_or_else(|| vec![sheet.positions[k]], |t| t.map(at).to_vec())
}

fn pose_of(sheet: &Sheet, poses: &IdVec<LinkId, DAffine3>) -> DAffine3 {
    sheet.link.and_then(|link| poses.get(link)).copied().unwrap_or_default()
}

/// A direction and degrees, in a frame.
fn facing(text: &str) -> Result<InFrame<Facing>, String> {
    InFrame::parse(text, |text| {
        let (way, degrees) = match text.rsplit_once(',') {
            Some((way, angle)) if direction(text).is_err() => {
                (way, angle.trim().trim_end_matches("deg").trim_end().parse().unwrap_or(f64::NAN))
            }
            _ => (text, 60.0),
        };
        let direction = direction(way)?;
        if !(0.0..=180.0).contains(&degrees) {
            return Err("needed: degrees from 0 to 180, as in x,45deg".into());
        }
        Ok(Facing { direction, angle: degrees.to_radians() })
    })
}

/// Two corners of a box, in any order: the lower and the upper one.
fn corners(text: &str) -> Result<InFrame<[DVec3; 2]>, String> {
    InFrame::parse(text, box_corners)
}

fn box_corners(text: &str) -> Result<[DVec3; 2], String> {
    match numbers(text) {
        Some([a, b, c, d, e, f]) => {
            let (p, q) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
            Ok([p.min(q), p.max(q)])
        }
        _ => Err("needed: six numbers, x,y,z of one corner and x,y,z of the opposite one, in m".to_owned()),
    }
}

pub(crate) fn pattern(text: &str) -> Result<Pattern, String> {
    Pattern::new(text).map_err(|e| format!("needed: a name, * and ? for any characters ({})", e.msg))
}
