//! Reading a skin as every subcommand does: draft, assembly, remarks.

use std::fs::{DirEntry, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use anyhow::Context;
use dermatome::Error;
use dermatome::body::{Body, Gap, gap_links};
use dermatome::io::{IoError, NotInSkin, ReadingsLayout, ReadingsReader, read_map};
use dermatome::map::SkinMap;
use dermatome::mesh::FillHoles;
use dermatome::remesh::{Remeshed, keep_outer, remesh_skin};
use dermatome::run::Run;
use dermatome::skin::{AssembleOptions, Draft, Oriented, Remark, RemarkKind, Skin, assemble, orient};
use glob::Pattern;
use serde_json::{Value, json};

use crate::console::errors::advise;
use crate::console::notes::{first_names, note, note_remarks};
use crate::files::outputs;
use crate::options::{Common, InPath, PatchArgs, ReadArgs, RobotArgs, Spacing, Unit};

/// Reads and assembles a skin, bare taxels too; prints on standard error what had to be changed.
pub(crate) fn read_skin(
    path: &Path,
    read: &ReadArgs,
    chosen: &PatchArgs,
    options: &AssembleOptions,
    common: &Common,
) -> anyhow::Result<Skin> {
    Ok(read_good_patches(&[path.to_owned()], read, chosen, options, common)?.skin)
}

/// A skin that was read, and what of its files is not in it.
pub(crate) struct ReadSkin {
    pub(crate) skin: Skin,
    /// How many patches are not valid and were left out, if that is asked for.
    pub(crate) left_out: usize,
    /// The taxels and patches that the files have and the skin has not.
    pub(crate) others: NotInSkin,
}

/// The skin of a map, or of a file that [`read_skin`] reads.
pub(crate) fn read_any_skin(path: &InPath, read: &ReadArgs, common: &Common) -> anyhow::Result<Skin> {
    match read_map_if_any(path)? {
        Some(map) => Ok(map.skin()),
        None => read_skin(path, read, &PatchArgs::default(), &read.options(&[path]), common),
    }
}

/// An input and its name in errors; `-`: standard input.
pub(crate) fn open_input(path: &Path) -> anyhow::Result<(&Path, Box<dyn Read + Send>)> {
    if outputs::is_stream(path) {
        return Ok((Path::new("standard input"), Box::new(io::stdin())));
    }
    let fail = |source| Error::from(IoError::Read { path: path.to_owned(), source });
    Ok((path, Box::new(File::open(path).map_err(fail)?)))
}

/// Kinds of files with triangles: those that are taken of a folder.
const MESHES: [&str; 9] = ["glb", "gltf", "json", "obj", "off", "ply", "stl", "dae", "3mf"];

/// The files of a skin: those that are named, and the meshes of the folders that are named, by name.
pub(crate) fn skin_files(named: &[InPath]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in named {
        if !path.is_dir() {
            files.push(path.into());
            continue;
        }
        let fail = |source| Error::from(IoError::Read { path: path.into(), source });
        let all = path.read_dir().and_then(Iterator::collect::<io::Result<Vec<_>>>).map_err(fail)?;
        let mut meshes: Vec<_> = all.iter().map(DirEntry::path).collect();
        meshes.retain(|file| file.is_file() && MESHES.contains(&&*outputs::kind(file)));
        meshes.sort();
        if meshes.is_empty() {
            let kinds = MESHES.join(", ");
            return Err(advise(
                format!("the folder {} has no file with triangles: {kinds}", path.display()),
                "name the files of the skin, or a folder that has them",
            ));
        }
        files.append(&mut meshes);
    }
    Ok(files)
}

/// The same of several files, one skin.
pub(crate) fn read_good_patches(
    paths: &[PathBuf],
    read: &ReadArgs,
    chosen: &PatchArgs,
    options: &AssembleOptions,
    common: &Common,
) -> anyhow::Result<ReadSkin> {
    let path = &*names(paths);
    let mut drafts = paths.iter().map(|path| read_draft_of(path, read, chosen.wants_materials()));
    let mut draft = drafts.next().transpose()?.unwrap_or_default();
    drafts.try_for_each(|other| other.map(|other| draft.append(other)))?;
    outputs::add_inputs(&draft.files, &common.outputs);
    let mut others = NotInSkin {
        taxels: draft.sheets.iter().flat_map(|sheet| sheet.ids.iter().flatten().copied()).collect(),
        patches: draft.sheets.iter().map(|sheet| sheet.title().to_owned()).collect(),
    };
    let are_chosen = read.outer || chosen.takes_faces();
    let oriented = if are_chosen { orient(&mut draft, options) } else { Oriented::default() };
    // What hides others may be among the faces that are not taken.
    if read.outer {
        keep_outer(&mut draft).notes().iter().for_each(|what| note!(common, "{what}"));
        if draft.sheets.is_empty() {
            return Err(advise(
                format!("{}: no face can be seen from outside", path.display()),
                "leave out --outer",
            ));
        }
    }
    chosen.keep_faces(&mut draft, read.spacing.is_some(), path)?;
    // Patches that are not taken may be faulty. A piece of a sheet has a name of its own once it is
    // assembled.
    let sheets = select(&mut draft.sheets, &chosen.patches, |sheet| &sheet.name);
    draft.remarks.append(&mut oriented.remarks(&draft));
    let mut assembled = assemble(&draft, options)
        .map_err(Error::from)
        .with_context(|| format!("the skin in {} cannot be used", path.display()))?;
    note_remarks(&assembled.remarks, common);
    let is_large = |r: &Remark| matches!(r.kind, RemarkKind::DoubtfulUnit { extent } if extent > 1.0);
    if read.unit == Unit::M && assembled.remarks.iter().any(is_large) {
        if paths.iter().any(|path| RobotArgs::describes(path)) {
            note!(common, "scale=\"0.001 0.001 0.001\" in its <mesh> reads a mesh in millimetres");
        } else {
            note!(common, "--unit mm reads a file in millimetres");
        }
    }
    if assembled.remarks.iter().any(|r| matches!(r.kind, RemarkKind::CutKept { .. })) && !read.has_seams() {
        note!(common, "the mesh is cut open along a line; --weld all joins it");
    }
    let is_guessed = |remark: &Remark| {
        matches!(remark.kind, RemarkKind::OutsideFromCentre { .. } | RemarkKind::OutsideFromAxis { .. })
    };
    if assembled.remarks.iter().any(is_guessed) {
        note!(common, "--outside DIR says where the outside is");
    }
    let has = |is_kind: fn(&RemarkKind) -> bool| assembled.remarks.iter().any(|r| is_kind(&r.kind));
    if has(|kind| matches!(kind, RemarkKind::Triangulated { .. }))
        && has(|kind| matches!(kind, RemarkKind::Components { .. }))
    {
        note!(common, "a larger --gap joins pieces");
    }
    let named: Vec<String> = assembled.skin.patches.iter().map(|patch| patch.name.clone()).collect();
    if !sheets {
        let patches = assembled.skin.patches.into_iter().collect();
        assembled.skin.patches = select_patches(path, patches, &chosen.patches, |patch| &patch.name)?.into();
    }
    if chosen.patches.is_empty() {
        let robot = match paths {
            [robot] if RobotArgs::describes(robot) => Some(&**robot),
            _ => None,
        };
        let skin = &mut assembled.skin;
        let spacings = read.spacing.as_ref().map(|spacing| spacing.of_patches(skin)).transpose()?;
        read.robot.drop_crumbs(robot, skin, spacings.as_deref(), common)?;
    }
    if let Some(spacing) = &read.spacing {
        if options.fill_holes == FillHoles::PinHoles {
            // Faces that are missing in the surface; taxels lie on them as on the others.
            assembled.skin.patches.iter_mut().for_each(|patch| patch.filled = 0);
        }
        assembled.skin = mesh_anew(&assembled.skin, spacing, common)?;
    }
    others.patches.extend(named);
    if read.spacing.is_some() {
        // Ids are those of new taxels.
        others.taxels.clear();
    }
    for patch in &assembled.skin.patches {
        others.patches.remove(&patch.name);
        patch.taxels.ids.iter().for_each(|id| _ = others.taxels.remove(id));
    }
    let is_left_out = |remark: &&Remark| matches!(remark.kind, RemarkKind::PatchLeftOut { .. });
    let left_out = assembled.remarks.iter().filter(is_left_out).count();
    Ok(ReadSkin { skin: assembled.skin, left_out, others })
}

/// Meshes a skin anew with taxels this far apart.
fn mesh_anew(skin: &Skin, spacing: &Spacing, common: &Common) -> anyhow::Result<Skin> {
    let spacings = spacing.of_patches(skin)?;
    let Remeshed { skin, left_out, mut shrunk, unfilled } =
        remesh_skin(skin, &spacings, Run::default()).map_err(Error::from)?;
    if skin.patches.is_empty() {
        let least = spacings.iter().copied().fold(f64::INFINITY, f64::min);
        return Err(advise(
            format!(
                "every patch is smaller than the hexagon around one taxel: they would be {least} m apart"
            ),
            "give a smaller --spacing, with its unit, as 8mm",
        ));
    }
    if !left_out.is_empty() {
        let count = left_out.len();
        note!(
            common,
            "{count} patches are smaller than the hexagon around one taxel, and left out: {}",
            first_names(&left_out)
        );
    }
    shrunk.sort_by(|a, b| b.1.total_cmp(&a.1));
    if let Some(&(_, farthest)) = shrunk.first() {
        let names: Vec<String> = shrunk.into_iter().map(|(name, _)| name).collect();
        note!(
            common,
            "parts thinner than the taxels are apart have none at their ends, up to {:.1} mm of them: {}; a smaller \
             --spacing covers them",
            1e3 * farthest,
            first_names(&names)
        );
    }
    if !unfilled.is_empty() {
        let count: usize = unfilled.iter().map(|(_, count)| count).sum();
        let names: Vec<String> = unfilled.into_iter().map(|(name, _)| name).collect();
        let holes = if count == 1 { "1 hole stays".to_owned() } else { format!("{count} holes stay") };
        note!(common, "{holes} open, with too many taxels around: {}", first_names(&names));
    }
    let taxels: usize = skin.patches.iter().map(|patch| patch.mesh.positions.len()).sum();
    let [least, most] =
        [f64::min, f64::max].map(|of| (1e6 * spacings.iter().copied().fold(spacings[0], of)).round() / 1e3);
    let apart = if least < most { format!("{least} to {most}") } else { format!("{least}") };
    note!(common, "meshed anew with {taxels} taxels, {apart} mm apart; their ids count from 1");
    Ok(skin)
}

pub(crate) fn names(paths: &[impl AsRef<Path>]) -> PathBuf {
    let names: Vec<String> = paths.iter().map(|path| path.as_ref().display().to_string()).collect();
    names.join(", ").into()
}

/// More names than this are not listed.
const MOST_NAMES: usize = 10;

/// The patches of a file whose name fits one of the patterns, or all of them without patterns.
/// Fails if one of the patterns fits no name.
pub(crate) fn select_patches<T>(
    path: &Path,
    mut patches: Vec<T>,
    patterns: &[Pattern],
    name: impl Fn(&T) -> &str,
) -> anyhow::Result<Vec<T>> {
    if !select(&mut patches, patterns, &name) {
        let names: Vec<&str> = patches.iter().take(MOST_NAMES).map(name).collect();
        let what =
            format!("{} has no patch of a name in --patch; it has {}", path.display(), names.join(", "));
        return Err(advise(what, "give one of them; * stands for any characters"));
    }
    Ok(patches)
}

/// Keeps the items whose name fits one of the patterns, or all items without patterns. If one of the
/// patterns fits no name, all items are kept, and the answer is false.
fn select<T>(items: &mut Vec<T>, patterns: &[Pattern], name: impl Fn(&T) -> &str) -> bool {
    let fits = patterns.iter().all(|pattern| items.iter().any(|item| pattern.matches(name(item))));
    if fits && !patterns.is_empty() {
        items.retain(|item| patterns.iter().any(|pattern| pattern.matches(name(item))));
    }
    fits
}

/// The map of a file. Where maps are needed they come first, so that a file of another kind is often another one.
pub(crate) fn read_map_first(path: &Path) -> anyhow::Result<SkinMap> {
    if !is_gltf(path) && path.exists() {
        let help = if path.is_dir() {
            "name the map.glb in it"
        } else {
            "the map comes first: a .glb of `dermatome build`"
        };
        return Err(advise(format!("{} is not a map", path.display()), help));
    }
    Ok(read_map(path).map_err(Error::from)?)
}

pub(crate) fn is_gltf(path: &Path) -> bool {
    matches!(outputs::kind(path).as_str(), "glb" | "gltf")
}

/// Reads a file as written; another file of ours is named by what it has.
pub(crate) fn read_draft_of(path: &Path, read: &ReadArgs, materials: bool) -> anyhow::Result<Draft> {
    read.read(path, materials).map_err(|error| {
        let (what, help) = match outputs::kind(path).as_str() {
            _ if !matches!(
                error.downcast_ref(),
                Some(Error::Io(IoError::Invalid { .. } | IoError::UnknownKind { .. }))
            ) =>
            {
                return error;
            }
            "exr" => ("has images", "the skin of a map is in its map.glb"),
            "g2o" => ("has observations of taxels", "`dermatome calibrate` makes a skin of them"),
            "npz" | "npy" | "csv" | "txt" | "log"
                if ReadingsReader::open(path, ReadingsLayout::default()).is_ok() =>
            {
                (
                    "is a recording of readings",
                    "`dermatome render MAP.glb READINGS -o OUT` reads it, on the map of its skin",
                )
            }
            _ => return error,
        };
        advise(format!("{} {what}, not a skin", path.display()), help)
    })
}

/// The gaps of a skin with the names of their patches: those that a map has links over, its lengths in `unit`, or `build`
/// would find.
pub(crate) fn gaps_of(map: Option<&SkinMap>, skin: &Skin, unit: Unit) -> Vec<([String; 2], Gap)> {
    let in_metres = |gap: Gap| Gap { width: gap.width.map(|width| unit.metres() * width), ..gap };
    let gaps = match map {
        Some(map) => map.gaps().into_iter().map(in_metres).collect(),
        None => Body { links: gap_links(skin, None), ..Body::default() }.gaps(skin),
    };
    let named = |gap: Gap| (gap.patches.map(|patch| skin.patches[patch].name.clone()), gap);
    gaps.into_iter().map(named).collect()
}

/// Gaps as JSON.
pub(crate) fn gaps_as_json(gaps: &[([String; 2], Gap)]) -> Value {
    let object = |(patches, gap): &([String; 2], Gap)| json!({ "patches": patches, "links": gap.links, "width_mm": gap.width.map(|width| 1e3 * width) });
    gaps.iter().map(object).collect()
}

/// The map of a file, if it has one; otherwise it may be a skin.
pub(crate) fn read_map_if_any(path: &Path) -> Result<Option<SkinMap>, Error> {
    if !is_gltf(path) {
        return Ok(None);
    }
    match read_map(path) {
        Ok(map) => Ok(Some(map)),
        Err(IoError::NoMap { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}
