//! Which patches, faces or taxels of a file to take.

use std::path::{Path, PathBuf};

use dermatome::Error;
use dermatome::io::read_faces;
use dermatome::skin::{Draft, world_pose};
use glam::{DAffine3, DVec3};
use glob::Pattern;

use crate::console::errors::advise;

/// Which patches of a file to take.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Reading")]
pub(crate) struct PatchArgs {
    /// Take the patches of this name only, in which * and ? stand for any characters; may be given
    /// more than once [default: all patches]
    #[arg(long = "patch", value_name = "NAME", value_parser = pattern)]
    pub(crate) patches: Vec<Pattern>,
    /// Keep only the faces listed in FILE: a number on each line, counted from 0 through all triangles
    /// of the mesh
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
    /// The patches whose name fits one of the patterns, or all without patterns.
    pub(crate) fn named(patches: &[Pattern]) -> Self {
        Self { patches: patches.to_vec(), ..Self::default() }
    }

    pub(crate) const fn wants_materials(&self) -> bool {
        !self.materials.is_empty()
    }

    /// Keeps the faces that are chosen.
    /// Fails if the list of faces cannot be read or does not fit, a material is not there, or nothing is
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
