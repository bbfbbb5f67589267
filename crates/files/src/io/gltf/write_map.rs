//! Writes maps and pyramids as glTF.
//!
//! Triangles of a map stay upright when positions are rounded to f32: a needle may be thinner than the
//! spacing of f32 numbers. *Heuristic*: a corner of a triangle that rounding turned over moves by a few
//! units of rounding, to the nearest position at which all triangles around it are upright. A thin plate of CAD
//! with 3548 faces whose needles have aspects up to 2e7 could not be written for such a triangle, and can.

use std::{borrow::Cow, io::Write, path::Path};

use glam::{DVec2, DVec3};
use gltf::json::material::{PbrMetallicRoughness, StrengthFactor};
use gltf::json::{Index, Material, Mesh};

use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{OutPath, replace_file, unfit};
use crate::io::gltf::body::write_extras;
use crate::io::gltf::rows::add_rows;
use crate::io::gltf::write_skin::{Codes, Names, SheetWriter, joints_of, mesh, node};
use crate::io::gltf::writer::{Form, PatchNode, SceneWriter};
use crate::io::gltf::{FrameExtras, LevelExtras};
use crate::map::{MapError, MapLevel, OnPatch, SkinMap};
use crate::mesh::{FlatTriangle, TriMesh, VertexCorners};
use crate::numeric::{hash, narrow};
use crate::parallel::{par_collect, par_map};
use crate::pyramid::{Level, LevelId, Pyramid, PyramidError};
use crate::skin::{Link, LinkId, Motion, Skin, Taxels};

/// Writes `map.glb`: one mesh and node per patch and level, named `PATCH/L0`, `PATCH/L1`, ...; one
/// scene per level.
///
/// A scene shows the links that carry a patch of its level (scene 0, the default, shows all links)
/// and under them the patches. `TEXCOORD_0` is the map position in the unit square of the level's
/// image, `TANGENT` with `w` 1 the tangents of the taxels that the vertices are, `_AREA` the receptive
/// area (m^2). Level 0 has what a skin has: `_TAXEL_ID` (f32, or where an id is 2^24 or larger VEC2 of u16:
/// low, high), `_PRESENT` (f32), and `_DENSITY`, `_WEIGHT`, `_ACUITY`, `_REGION`, `_MODALITY` (f32), `_SIGMA` and `_COVARIANCE_0/1`
/// where they are known. A patch that follows several links has a skin of glTF on each level, whose joints are the
/// nodes of the links; its nodes are roots, as glTF requires, and `extras.dermatome` of each is
/// `{"link": N}`, the node of its own link. The mesh's `extras.dermatome` has the names of patch and level, the
/// rectangle of the map, and the accessors of the prolongations and, from level 1 on, of the
/// vertices of level 0 that its vertices are. Where a map is cut, the mesh has the vertices of the
/// seam once for each of their places, and `unsplit` is the accessor of the vertex of the level that
/// each of them is. Everything but the rectangle is rounded to `f32`. Where patches are joined, the `extras.dermatome.body`
/// of the document has the accessor `links`: rows of patch, vertex, patch and vertex, patches in the
/// order of their meshes; and where there are several patches `levels`, each with accessors `origins` (patch, vertex), `area` (m^2) and `up`: the
/// fields of the level before in terms of its own. A map on that of another skin has `extras.dermatome.atlas` of the
/// document: the `name` and the `hash` ([`map_hash`](crate::io::map_hash)) of the other map, and whether it is
/// `mirrored`; and `atlas` of each level 0 is its [`OnPatch`].
///
/// # Errors
/// If [`SkinMap::validate`] refuses the map or it has no patch, if rounding would turn a triangle
/// of the map over or a texture coordinate leaves the unit square, or if the file cannot be
/// written. Errors name patch, level and face or vertex.
pub fn write_map(path: impl Into<OutPath>, map: &SkinMap) -> Result<(), IoError> {
    let path = &path.into();
    replace_file(path, |file| write(file, path, map))
}

/// The content of a file that [`write_map`] writes.
///
/// # Errors
/// As [`write_map`].
pub fn map_to_bytes(map: &SkinMap) -> Result<Vec<u8>, IoError> {
    let mut bytes = Vec::new();
    write(&mut bytes, Path::new("map.glb"), map)?;
    Ok(bytes)
}

fn write(output: &mut dyn Write, path: &Path, map: &SkinMap) -> Result<()> {
    map.validate().map_err(|fault| IoError::Map { path: path.into(), source: Box::new(fault) })?;
    let patches: Vec<_> = map
        .patches
        .iter()
        .map(|patch| {
            let levels = patch.levels.iter().map(|map| (&map.level, Some(map))).collect();
            PatchLevels {
                name: &patch.name,
                atlas: patch.atlas.as_ref(),
                link: patch.link,
                filled: patch.filled,
                taxels: &patch.taxels,
                levels,
            }
        })
        .collect();
    write_levels(output, path, (&map.links, &map.animations, Some(map)), &patches)
}

/// A hash of the map of level 0 as a file stores it: names of patches, ids and places of taxels. A map has the same one
/// in memory and read from its file.
///
/// # Errors
/// [`MapError::Rounded`], if a file cannot store the map.
pub fn map_hash(map: &SkinMap) -> Result<u64, MapError> {
    let mut of = 0;
    let mut add = |word: u64| of = hash(of ^ word);
    for patch in &map.patches {
        patch.name.bytes().for_each(|byte| add(u64::from(byte)));
        patch.taxels.ids.iter().for_each(|id| add(u64::from(id.0)));
        let Some(finest) = patch.levels.first() else { continue };
        let texture = texture_coordinates(finest, &finest.opened());
        let texture = texture.map_err(|(found, needed)| MapError::Rounded { found, needed })?;
        let frame = [finest.frame.origin, finest.frame.size];
        frame.iter().for_each(|corner| corner.to_array().iter().for_each(|x| add(x.to_bits())));
        texture.into_iter().flatten().for_each(|x| add(u64::from(x.to_bits())));
    }
    Ok(of)
}

/// Whether two maps lie on one plane: one is drawn on the other, both are drawn on a third, or they are the same.
///
/// # Errors
/// As [`map_hash`].
pub fn share_plane(a: &SkinMap, b: &SkinMap) -> Result<bool, MapError> {
    let plane = |map: &SkinMap| map.atlas.as_ref().map_or_else(|| map_hash(map), |on| Ok(on.hash));
    Ok(plane(a)? == plane(b)?)
}

/// Writes pyramids alone: as [`write_map`], without maps.
///
/// # Errors
/// If the skin or a pyramid breaks a rule, there is not one pyramid per patch, a pyramid does not
/// fit its patch, or the file cannot be written.
pub fn write_pyramids(path: impl Into<OutPath>, skin: &Skin, pyramids: &[Pyramid]) -> Result<(), IoError> {
    let path = &path.into();
    if pyramids.len() != skin.patches.len() {
        let (element, found) =
            (format!("{} patches", skin.patches.len()), format!("{} pyramids", pyramids.len()));
        return Err(unfit(path, element, found, "one per patch"));
    }
    skin.validate().map_err(|e| unfit(path, "the skin", e.to_string(), "a valid skin"))?;
    let mut patches = Vec::new();
    for (patch, pyramid) in skin.patches.iter().zip(pyramids) {
        let broken = |e: PyramidError| {
            unfit(path, format!("patch {:?}", patch.name), e.to_string(), "a valid pyramid of this skin")
        };
        pyramid.validate().map_err(broken)?;
        let levels = pyramid.levels.iter().map(|level| (level, None)).collect();
        patches.push(PatchLevels {
            name: &patch.name,
            atlas: None,
            link: patch.link,
            filled: patch.filled,
            taxels: &patch.taxels,
            levels,
        });
    }
    replace_file(path, |file| write_levels(file, path, (&skin.links, &skin.animations, None), &patches))
}

/// A patch with its levels, and their maps if there are any; all valid.
struct PatchLevels<'a> {
    name: &'a str,
    atlas: Option<&'a OnPatch>,
    link: LinkId,
    filled: usize,
    taxels: &'a Taxels,
    levels: IdVec<LevelId, (&'a Level, Option<&'a MapLevel>)>,
}

fn write_levels(
    output: &mut dyn Write,
    path: &Path,
    (links, animations, map): (&IdVec<LinkId, Link>, &[Motion], Option<&SkinMap>),
    patches: &[PatchLevels<'_>],
) -> Result<()> {
    if patches.is_empty() {
        return Err(unfit(path, "the map", "no patch", "at least one"));
    }
    let mut writer = SceneWriter::new(path);
    let deepest = patches.iter().map(|patch| patch.levels.len()).max().unwrap_or_default();
    let names = Names::of(patches.iter().map(|patch| patch.taxels));
    for level in (0..deepest).map(LevelId::new) {
        let mut wanted = links.map(|_| level.index() == 0);
        let mut nodes = Vec::new();
        for patch in patches.iter().filter(|patch| level.index() < patch.levels.len()) {
            let mesh = add_level(&mut writer, patch, level, &names)?;
            let joints = joints_of(patch.taxels);
            for first in joints.iter().copied().chain([patch.link]) {
                let mut link = Some(first);
                // A parent comes before its child, so this ends.
                while let Some(at) = link.filter(|at| wanted.get(*at) == Some(&false)) {
                    wanted[at] = true;
                    link = links[at].parent;
                }
            }
            let (node, binds) = (node(level_name(patch, level), mesh), patch.taxels.binds.clone());
            nodes.push(PatchNode { link: patch.link, node, joints, binds });
        }
        let name = Some(format!("level {level}"));
        writer.add_scene(name, links, &wanted, nodes)?;
    }
    writer.add_animations(animations)?;
    if let Some(map) = map {
        write_extras(&mut writer, map)?;
    }
    writer.finish(output, Form::Glb)
}

/// `PATCH/L0`.
fn level_name(patch: &PatchLevels<'_>, level: LevelId) -> String {
    format!("{}/L{level}", patch.name)
}

fn add_level(
    writer: &mut SceneWriter<'_>,
    patch: &PatchLevels<'_>,
    number: LevelId,
    names: &Names,
) -> Result<Index<Mesh>> {
    let name = level_name(patch, number);
    let (level, map) = patch.levels[number];
    let opened = map.map_or(Cow::Borrowed(&level.mesh), MapLevel::opened);
    let unsplit = map.and_then(MapLevel::unsplit);
    let mut sheet = SheetWriter::new(writer, name.clone(), &opened)?;
    if number.index() == 0 {
        let count = opened.positions.len();
        match unsplit {
            None => sheet.taxels(patch.taxels, count, names, Codes::Real)?,
            Some(at) => {
                let opened = patch.taxels.select(at);
                sheet.taxels(&opened, count, names, Codes::Real)?;
            }
        }
    } else {
        let taxel_of: IdVec<VertexId, VertexId> = match unsplit {
            None => level.origins.clone(),
            Some(at) => at.map(|&v| level.origins[v]).reindexed(),
        };
        let of_level = |of_taxels: &IdVec<VertexId, DVec3>| taxel_of.map(|&taxel| of_taxels[taxel]);
        let tangents = patch.taxels.tangents.as_ref().map(of_level);
        sheet.frames(&of_level(&patch.taxels.normals), tangents.as_ref());
        let areas = unsplit.map(|at| at.iter().map(|&v| level.areas[v]).collect());
        sheet.positive("_AREA", areas.as_ref().unwrap_or(&level.areas))?;
        if let Some(joints) = &patch.taxels.joints {
            let rows = taxel_of.map(|&taxel| joints[taxel]);
            sheet.joints(&joints_of(patch.taxels), rows.as_slice())?;
        }
    }
    if let Some(map) = map {
        let texture =
            texture_coordinates(map, &opened).map_err(|(found, needed)| sheet.unfit(found, &needed))?;
        sheet.insert("TEXCOORD_0", texture.into_iter());
    }
    let mut primitive = sheet.finish();
    if map.is_some() {
        primitive.material = Some(plain(writer));
    }

    let [regions, modalities] =
        if number.index() == 0 { names.known_to(patch.taxels) } else { Default::default() };
    let content = LevelExtras {
        patch: patch.name.to_owned(),
        level: number.index(),
        filled: if number.index() == 0 { patch.filled } else { 0 },
        map: map.map(|map| FrameExtras {
            origin: map.frame.origin.to_array(),
            size: map.frame.size.to_array(),
            pixels: map.frame.size_px,
        }),
        up: level.from_coarser.as_ref().map(|rows| add_rows(writer, rows)),
        direct: level.to_finest.as_ref().map(|rows| add_rows(writer, rows)),
        origins: (number.index() > 0)
            .then(|| writer.array(None, level.origins.iter().map(|v| [v.raw()])).value()),
        unsplit: unsplit.map(|at| writer.array(None, at.iter().map(|v| [v.raw()])).value()),
        regions,
        modalities,
        counted: number.index() == 0 && patch.taxels.are_counted,
        atlas: patch.atlas.filter(|_| number.index() == 0).cloned(),
    };
    let mut mesh = mesh(name, primitive);
    mesh.extras = writer.extras(&content)?;
    Ok(writer.root.push(mesh))
}

/// The one material of a document: some programs read texture coordinates only of a mesh that has one.
fn plain(writer: &mut SceneWriter<'_>) -> Index<Material> {
    if writer.root.materials.is_empty() {
        let look =
            PbrMetallicRoughness { metallic_factor: StrengthFactor(0.0), ..PbrMetallicRoughness::default() };
        writer.root.push(Material {
            name: Some("skin".into()),
            pbr_metallic_roughness: look,
            double_sided: true,
            ..Material::default()
        });
    }
    Index::new(0)
}

/// The mesh of a level, cut open, and its map (m), as a map file stores them; refuses one that loses a
/// triangle there.
pub(crate) fn as_in_map_file(map: &MapLevel) -> Result<(TriMesh, IdVec<VertexId, DVec2>), MapError> {
    let mut mesh = map.opened().into_owned();
    let texture = texture_coordinates(map, &mesh);
    let texture = texture.map_err(|(found, needed)| MapError::Rounded { found, needed })?;
    mesh.positions.iter_mut().for_each(|p| *p = p.as_vec3().as_dvec3());
    Ok((mesh, texture.into_iter().map(|at| on_map(map, at)).collect()))
}

/// The map position (m) of a texture coordinate.
fn on_map(map: &MapLevel, texture: [f32; 2]) -> DVec2 {
    map.frame.map_position(DVec2::from_array(texture.map(f64::from)))
}

/// Map positions in the unit square of the image, as they are written; else what rounding breaks,
/// and what is needed instead. It neither turns a triangle of the map over nor takes the area of one
/// on the skin. Needles that rounding would turn over stay upright by a few units of it.
///
/// A triangle that the map itself turns over, as a linear map may, is written as it is.
fn texture_coordinates(map: &MapLevel, mesh: &TriMesh) -> Result<Vec<[f32; 2]>, (String, String)> {
    let MapLevel { uv, frame, .. } = map;
    let mut texture: Vec<_> = par_map(uv.as_slice(), |&at| frame.to_texture(at).to_array().map(narrow));
    let is_upright = |face: FaceId| {
        let [a, b, c] = map.uv_of(face);
        (b - a).perp_dot(c - a) > 0.0
    };
    let rounded =
        |face: FaceId, texture: &[[f32; 2]]| mesh.triangles[face].map(|v| on_map(map, texture[v.index()]));
    let area = |[a, b, c]: [DVec2; 3]| (b - a).perp_dot(c - a) / 2.0;
    let on_skin = |face: FaceId| {
        FlatTriangle::new(mesh.triangles[face].map(|v| mesh.positions[v].as_vec3().as_dvec3()))
    };
    // The area is NaN where the first edge has no length.
    let has_area = |flat: &FlatTriangle| flat.area() > 0.0;
    // As readers will compute it; a triangle without area on the skin keeps its shape.
    let keeps_shape = |flat: FlatTriangle, on_map: [DVec2; 3]| {
        !has_area(&flat) || flat.jacobian(on_map).determinant() > 0.0
    };
    let stays = |face: FaceId, texture: &[[f32; 2]]| {
        !is_upright(face) || {
            let on_map = rounded(face, texture);
            area(on_map) > 0.0 && keeps_shape(on_skin(face), on_map)
        }
    };
    let flipped = keep_upright(&mut texture, mesh, &stays);
    if let Some(v) = texture.iter().position(|t| !t.iter().all(|x| (0.0..=1.0).contains(x))) {
        let needed = format!("a position in the rectangle of {} m at {}", frame.size, frame.origin);
        return Err((format!("vertex {v} at {} on the map", uv[PlaceId::new(v)]), needed));
    }
    let collapsed = faces_that(mesh, |face| !has_area(&on_skin(face)) && mesh.face_area(face) > 0.0);
    if let Some(face) = collapsed.first() {
        let needed = "an area above 0: f32 keeps seven digits, so the link's frame must be near";
        let found = format!("face {face} without area after rounding its positions to f32");
        return Err((found, needed.into()));
    }
    if let Some(&face) = flipped.first() {
        let area = area(rounded(face, &texture));
        let found = format!("face {face} with the map area {area:e} m^2 after rounding to f32");
        let needed = "a positive area: no sliver, and an image not much larger than the map";
        return Err((found, needed.into()));
    }
    Ok(texture)
}

/// The faces for which `is_so`, in their order.
fn faces_that(mesh: &TriMesh, is_so: impl Fn(FaceId) -> bool + Sync) -> Vec<FaceId> {
    par_collect(mesh.triangles.len(), |range, out| {
        out.extend(range.map(FaceId::new).filter(|&face| is_so(face)));
    })
}

/// Spacing of f32 numbers just below 1.
const UNIT: f32 = f32::EPSILON / 2.0;

/// Units that a corner moves, at most, in both directions.
const REACH: i16 = 6;

/// Times that each triangle is tried: the neighbour of one may prevent a move.
const PASSES: usize = 4;

/// Moves corners of triangles that are not `upright` as little as it takes, where that helps; returns the
/// triangles that are not so after it, in their order.
pub(super) fn keep_upright(
    texture: &mut [[f32; 2]],
    mesh: &TriMesh,
    upright: &(dyn Fn(FaceId, &[[f32; 2]]) -> bool + Sync),
) -> Vec<FaceId> {
    let all_flipped = |texture: &[[f32; 2]]| faces_that(mesh, |face| !upright(face, texture));
    let mut flipped = all_flipped(texture);
    if flipped.is_empty() {
        return flipped;
    }
    let corners = VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len());
    let all = || (-REACH..=REACH).flat_map(|i| (-REACH..=REACH).map(move |j| [i, j]));
    let at_square = |square: i16| all().filter(move |[i, j]| i * i + j * j == square);
    let offsets: Vec<[i16; 2]> = (0..=2 * REACH * REACH).flat_map(at_square).collect();
    for _ in 0..PASSES {
        for &face in &flipped {
            for v in mesh.triangles[face] {
                let around: Vec<FaceId> = corners.of(v).iter().map(|corner| corner.face()).collect();
                move_corner(texture, v, &offsets, &|texture| {
                    around.iter().filter(|&&face| !upright(face, texture)).count()
                });
            }
        }
        flipped.retain(|&face| !upright(face, texture));
    }
    all_flipped(texture)
}

/// Moves a corner by the first of the `offsets` that leaves the fewest triangles `flipped`.
fn move_corner(
    texture: &mut [[f32; 2]],
    corner: VertexId,
    offsets: &[[i16; 2]],
    flipped: &dyn Fn(&[[f32; 2]]) -> usize,
) {
    let at = texture[corner.index()];
    let (mut best, mut least) = (at, flipped(texture));
    for [i, j] in offsets {
        if least == 0 {
            break;
        }
        let moved = [at[0] + f32::from(*i) * UNIT, at[1] + f32::from(*j) * UNIT];
        if moved.iter().all(|x| (0.0..=1.0).contains(x)) {
            texture[corner.index()] = moved;
            let count = flipped(texture);
            if count < least {
                (best, least) = (moved, count);
            }
        }
    }
    texture[corner.index()] = best;
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;

    /// The tip of a needle lies below its base by less than the spacing of f32 numbers.
    #[test]
    fn a_needle_that_rounding_turned_over_stands_up() {
        let mut texture = [[0.1, 0.5], [0.9, 0.9], [0.5, 0.7 - UNIT], [0.2, 0.95], [0.8, 0.1]];
        let faces = [[0, 1, 2], [2, 1, 3], [0, 2, 3], [0, 4, 1]];
        let mesh = TriMesh::from_arrays(vec![DVec3::ZERO; 5], &faces);
        let upright = |face: FaceId, texture: &[[f32; 2]]| {
            let [a, b, c] =
                mesh.triangles[face].map(|v| DVec2::from_array(texture[v.index()].map(f64::from)));
            (b - a).perp_dot(c - a) > 0.0
        };
        let flipped = |texture: &[[f32; 2]]| mesh.triangles.ids().find(|&face| !upright(face, texture));
        let before = texture;
        assert_eq!(flipped(&texture), Some(FaceId::new(0)));
        keep_upright(&mut texture, &mesh, &upright);
        assert_eq!(flipped(&texture), None, "{texture:?}");
        let moved = texture.iter().flatten().zip(before.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(moved.fold(0.0, f32::max) <= 2.0 * UNIT, "{texture:?}");
    }
}
