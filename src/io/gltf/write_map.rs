use std::{borrow::Cow, collections::BTreeSet, path::Path};

use glam::{DVec2, DVec3};
use gltf::json::{Index, Mesh};

use crate::{
    id::{IdVec, VertexId},
    io::{
        IoError,
        file::source::unfit as refuse,
        gltf::{
            extras::{FrameExtras, LevelExtras, RowsExtras},
            write_links::add_scene,
            write_skin::{SheetWriter, mesh, node},
            writer::{Form, SceneWriter, extras, narrow},
        },
    },
    map::{MapFrame, MapLevel, SkinMap},
    mesh::{FlatTriangle, TriMesh},
    pyramid::{Level, LevelId, Prolongation, Pyramid},
    skin::{Link, LinkId, Patch, Skin, TaxelId},
};

/// Largest deviation of a row of weights from sum 1.
const SUM: f64 = 1e-6;

/// Writes `map.glb`: one mesh and node per patch and level, named `PATCH/L0`, `PATCH/L1`, ...; one scene per level.
///
/// A scene shows the links that carry a patch of its level (scene 0, the default, shows all links) and under them the
/// patches. `TEXCOORD_0` is the map position in the unit square of the level's image, `_AREA` the receptive area
/// (m^2), `_TAXEL_ID` the vendor id (level 0 only; VEC2 of u16: low, high), beside it `_SIGMA` and
/// `_COVARIANCE_0/1` where covariances are known, as in a skin. The mesh's `extras.dermatome` holds the names
/// of patch and level, the rectangle of the map, and the accessors of the prolongations. Everything but the rectangle is
/// rounded to `f32`.
///
/// # Errors
/// If the map breaks one of its promises, if rounding would turn a triangle of the map over or a texture coordinate
/// leaves the unit square, or if the file cannot be written. Errors name patch, level and face or vertex.
pub fn write_map(path: &Path, map: &SkinMap) -> Result<(), IoError> {
    let patches: Vec<_> = map
        .patches
        .iter()
        .map(|patch| PatchView {
            name: &patch.name,
            link: patch.link,
            ids: &patch.ids,
            covariances: patch.covariances.as_ref(),
            levels: patch.levels.iter().map(LevelView::of_map).collect(),
        })
        .collect();
    write_levels(path, &map.links, &patches)
}

/// Writes pyramids alone: as [`write_map`], without maps.
///
/// # Errors
/// If there is not one pyramid per patch, a pyramid does not fit its patch, or the file cannot be written.
pub fn write_pyramids(path: &Path, skin: &Skin, pyramids: &[Pyramid]) -> Result<(), IoError> {
    if pyramids.len() != skin.patches.len() {
        let needed = format!("{}, one per patch", skin.patches.len());
        return Err(refuse(path, "the skin", format!("{} pyramids", pyramids.len()), needed));
    }
    let patches: Vec<_> = skin
        .patches
        .iter()
        .zip(pyramids)
        .map(|(patch, pyramid)| PatchView {
            name: &patch.name,
            link: patch.link,
            ids: &patch.taxels.ids,
            covariances: patch.taxels.covariances.as_ref(),
            levels: pyramid.levels.iter().map(|level| LevelView::of_pyramid(patch, level)).collect(),
        })
        .collect();
    write_levels(path, &skin.links, &patches)
}

/// What is written of a patch.
struct PatchView<'a> {
    name: &'a str,
    link: LinkId,
    ids: &'a IdVec<VertexId, TaxelId>,
    covariances: Option<&'a IdVec<VertexId, [f64; 6]>>,
    levels: IdVec<LevelId, LevelView<'a>>,
}

/// What is written of a level.
struct LevelView<'a> {
    mesh: &'a TriMesh,
    normals: Cow<'a, IdVec<VertexId, DVec3>>,
    areas: &'a IdVec<VertexId, f64>,
    map: Option<(&'a IdVec<VertexId, DVec2>, &'a MapFrame)>,
    up: Option<&'a Prolongation>,
    direct: Option<&'a Prolongation>,
}

impl<'a> LevelView<'a> {
    fn of_map(level: &'a MapLevel) -> Self {
        Self {
            mesh: &level.mesh,
            normals: Cow::Borrowed(&level.normals),
            areas: &level.areas,
            map: Some((&level.uv, &level.frame)),
            up: level.up.as_ref(),
            direct: level.direct.as_ref(),
        }
    }

    fn of_pyramid(patch: &Patch, level: &'a Level) -> Self {
        let zero = DVec3::ZERO;
        Self {
            mesh: &level.mesh,
            normals: Cow::Owned(
                level.origins.map(|&taxel| *patch.taxels.normals.get(taxel).unwrap_or(&zero)),
            ),
            areas: &level.areas,
            map: None,
            up: level.up.as_ref(),
            direct: level.direct.as_ref(),
        }
    }
}

fn write_levels(path: &Path, links: &IdVec<LinkId, Link>, patches: &[PatchView<'_>]) -> Result<(), IoError> {
    check_names(path, patches)?;
    let mut writer = SceneWriter::new();
    let deepest = patches.iter().map(|patch| patch.levels.len()).max().unwrap_or_default();
    for level in (0..deepest).map(LevelId::new) {
        let mut wanted = links.map(|_| level.index() == 0);
        let mut nodes = Vec::new();
        for patch in patches.iter().filter(|patch| level.index() < patch.levels.len()) {
            let mesh = add_level(path, &mut writer, patch, level)?;
            nodes.push((patch.link, node(level_name(patch, level), mesh)));
            let mut link = Some(patch.link);
            // A parent comes before its child, so this ends.
            while let Some(at) = link.filter(|at| wanted.get(*at) == Some(&false)) {
                wanted[at] = true;
                link = links[at].parent;
            }
        }
        let name = Some(format!("level {level}"));
        add_scene(path, &mut writer, name, links, &wanted, nodes)?;
    }
    writer.root.scene = Some(Index::new(0));
    writer.finish(path, Form::Glb)
}

/// `PATCH/L0`.
fn level_name(patch: &PatchView<'_>, level: LevelId) -> String {
    format!("{}/{level:?}", patch.name)
}

fn check_names(path: &Path, patches: &[PatchView<'_>]) -> Result<(), IoError> {
    if patches.is_empty() {
        return Err(refuse(path, "the map", "no patch", "at least one"));
    }
    let mut names = BTreeSet::new();
    for patch in patches {
        let element = || format!("patch {:?}", patch.name);
        if !names.insert(patch.name) {
            return Err(refuse(path, element(), "two patches of this name", "a name of its own"));
        }
        let Some(finest) = patch.levels.get(LevelId::new(0)) else {
            return Err(refuse(path, element(), "no level", "at least level 0"));
        };
        if patch.ids.len() != finest.mesh.positions.len() {
            let needed = format!("{}, one per taxel", finest.mesh.positions.len());
            return Err(refuse(path, element(), format!("{} ids", patch.ids.len()), needed));
        }
    }
    Ok(())
}

fn add_level(
    path: &Path,
    writer: &mut SceneWriter,
    patch: &PatchView<'_>,
    number: LevelId,
) -> Result<Index<Mesh>, IoError> {
    let name = level_name(patch, number);
    let level = &patch.levels[number];
    let mut sheet = SheetWriter::new(path, name.clone(), writer, level.mesh)?;
    sheet.normals(&level.normals)?;
    if let Some((uv, frame)) = level.map {
        let texture = texture_coordinates(path, &name, uv, frame, level.mesh.positions.len())?;
        check_faces(path, &name, level.mesh, (uv, frame), &texture)?;
        sheet.insert("TEXCOORD_0", |writer| writer.attribute(texture.into_iter()));
    }
    sheet.positive("_AREA", level.areas)?;
    if number.index() == 0 {
        sheet.ids(patch.ids);
        if let Some(covariances) = patch.covariances {
            sheet.covariances(covariances)?;
        }
    }
    let primitive = sheet.finish();

    let count = |k: usize| patch.levels.get(LevelId::new(k)).map(|l| l.mesh.positions.len());
    let rows = RowsWriter { path, name: &name };
    let coarser = count(number.index() + 1);
    let up = rows.add(writer, "up", level.up, level.mesh.positions.len(), coarser)?;
    let here = (number.index() > 0).then_some(level.mesh.positions.len());
    let direct = rows.add(writer, "direct", level.direct, patch.ids.len(), here)?;
    let map = level.map.map(|(_, frame)| FrameExtras {
        origin: frame.origin.to_array(),
        size: frame.size.to_array(),
        pixels: Some(frame.size_px),
    });
    let content = LevelExtras { patch: patch.name.to_owned(), level: number.index(), map, up, direct };
    let mut mesh = mesh(name, primitive);
    mesh.extras = extras(path, &content)?;
    Ok(writer.root.push(mesh))
}

/// Map positions in the unit square of the image, as they are written.
fn texture_coordinates(
    path: &Path,
    name: &str,
    uv: &IdVec<VertexId, DVec2>,
    frame: &MapFrame,
    count: usize,
) -> Result<Vec<[f32; 2]>, IoError> {
    if uv.len() != count {
        let found = format!("{} map positions", uv.len());
        return Err(refuse(path, name, found, format!("{count}, one per vertex")));
    }
    if !(frame.origin.is_finite() && frame.size.is_finite() && frame.size.cmpgt(DVec2::ZERO).all()) {
        let found = format!("a map rectangle of {} m at {}", frame.size, frame.origin);
        return Err(refuse(path, name, found, "a finite rectangle with an area"));
    }
    let inside = |t: &[f32; 2]| t.iter().all(|x| (0.0..=1.0).contains(x));
    let texture: Vec<_> = uv.iter().map(|&at| frame.to_texture(at).to_array().map(narrow)).collect();
    match texture.iter().position(|t| !inside(t)) {
        None => Ok(texture),
        Some(v) => {
            let found = format!("vertex {v} at {} on the map", uv[VertexId::new(v)]);
            let needed = format!("a place in the rectangle of {} m at {}", frame.size, frame.origin);
            Err(refuse(path, name, found, needed))
        }
    }
}

/// Rounding neither turns a triangle of the map over nor takes the area of one on the skin.
///
/// A triangle that the map itself turns over, as a linear map may, is written as it is.
fn check_faces(
    path: &Path,
    name: &str,
    mesh: &TriMesh,
    (uv, frame): (&IdVec<VertexId, DVec2>, &MapFrame),
    texture: &[[f32; 2]],
) -> Result<(), IoError> {
    for (face, corners) in mesh.triangles.enumerate() {
        let [a, b, c] =
            corners.map(|v| frame.from_texture(DVec2::from_array(texture[v.index()].map(f64::from))));
        let exact = corners.map(|v| uv[v]);
        let flat = FlatTriangle::new(corners.map(|v| mesh.positions[v].as_vec3().as_dvec3()));
        let unfit = |found: String, needed: &str, remedy| {
            let (path, element, needed) = (path.to_owned(), name.to_owned(), needed.to_owned());
            Err(IoError::Unfit { path, element, found, needed, remedy })
        };
        // As readers will compute it; a triangle without area on the skin has none.
        let shape = (flat.area() > 0.0).then(|| flat.jacobian([a, b, c]).determinant());
        if shape.is_none() && mesh.face_area(face) > 0.0 {
            let found = format!("face {face} without area after rounding its positions to f32");
            let remedy = "move the link's frame near the patch: f32 keeps seven digits";
            return unfit(found, "an area above 0", remedy);
        }
        let area = (b - a).perp_dot(c - a) / 2.0;
        let is_upright = (exact[1] - exact[0]).perp_dot(exact[2] - exact[0]) > 0.0;
        if is_upright && !(area > 0.0 && shape.is_none_or(|d| d > 0.0)) {
            let found = format!("face {face} with the map area {area:e} m^2 after rounding to f32");
            let remedy =
                "choose a pixel size with which the image is not much larger than the map, or remesh slivers";
            return unfit(found, "a positive area", remedy);
        }
    }
    Ok(())
}

/// Writes prolongations for the level called `name`.
struct RowsWriter<'a> {
    path: &'a Path,
    name: &'a str,
}

impl RowsWriter<'_> {
    /// A prolongation of `rows` rows into `coarse` vertices; `coarse` is `None` where there must be none.
    fn add(
        &self,
        writer: &mut SceneWriter,
        what: &'static str,
        prolongation: Option<&Prolongation>,
        rows: usize,
        coarse: Option<usize>,
    ) -> Result<Option<RowsExtras>, IoError> {
        let refuse = |found: String, needed: String| {
            Err(refuse(self.path, format!("{} {what}", self.name), found, needed))
        };
        let (p, coarse) = match (prolongation, coarse) {
            (None, None) => return Ok(None),
            (Some(p), Some(coarse)) => (p, coarse),
            (Some(_), None) => return refuse("a prolongation".into(), "none at this level".into()),
            (None, Some(_)) => return refuse("no prolongation".into(), "one at this level".into()),
        };
        if (p.indices.len(), p.weights.len(), p.coarse_len) != (rows, rows, coarse) {
            let found =
                format!("{} x {} ({} rows of weights)", p.indices.len(), p.coarse_len, p.weights.len());
            return refuse(found, format!("{rows} x {coarse}"));
        }
        for ((row, indices), weights) in p.indices.enumerate().zip(&p.weights) {
            if let Some(v) = indices.iter().find(|v| v.index() >= coarse) {
                return refuse(format!("row {row} names vertex {v}"), format!("one of {coarse}"));
            }
            let sum: f64 = weights.iter().sum();
            if !(weights.iter().all(|&w| w >= 0.0) && (sum - 1.0).abs() <= SUM) {
                return refuse(
                    format!("row {row} with the weights {weights:?}"),
                    "no negative ones, sum 1".into(),
                );
            }
        }
        let indices = writer.plain(p.indices.iter().map(|row| row.map(VertexId::raw)));
        let weights = writer.plain(p.weights.iter().map(|row| row.map(narrow)));
        Ok(Some(RowsExtras { indices: indices.value(), weights: weights.value() }))
    }
}
