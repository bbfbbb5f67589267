use std::{collections::BTreeMap, path::Path};

use glam::DVec2;

use crate::{
    flatten::distortion,
    id::{IdVec, VertexId},
    io::{
        IoError,
        file::source::kind,
        gltf::{
            attributes::Attributes,
            document::{Document, Role},
            extras::{FrameExtras, LevelExtras, RowsExtras},
            nodes::read_node_tree,
            read_skin::{read_covariances, read_ids, read_normals, read_positions},
            triangles::{Mode, triangles},
        },
    },
    map::{MapFrame, MapLevel, PatchMap, SkinMap},
    mesh::TriMesh,
    pyramid::{LevelId, Prolongation},
    skin::{LinkId, TaxelId},
};

/// Largest deviation of a row of weights from sum 1: other programs may have written it.
const SUM: f64 = 1e-5;
/// How far a texture coordinate may lie outside the unit square: rounding, but not a wrapped texture.
const OUTSIDE: f64 = 1e-6;
/// Metres per pixel of a map that does not tell its pixels.
const PIXEL: f64 = 1e-3;

/// Reads a map that [`crate::io::write_map`] wrote, or another program with the same names and extras.
///
/// Rows of weights are scaled to sum 1 in `f64` again; the centre of a field is the taxel whose `direct` weight in it
/// is 1; the distortion is measured anew.
///
/// # Errors
/// If the file cannot be read, breaks a rule of glTF 2.0, is no map, or is a map with an array that does not fit.
pub fn read_map(path: &Path) -> Result<SkinMap, IoError> {
    read_levels(&Document::open(path)?)
}

/// As [`read_map`]; `None` for a file of another kind, and for a glTF file without a map.
///
/// # Errors
/// As [`read_map`], for a file that says it is a map.
pub fn read_map_if_any(path: &Path) -> Result<Option<SkinMap>, IoError> {
    if !matches!(kind(path).as_str(), "glb" | "gltf") {
        return Ok(None);
    }
    let document = Document::open(path)?;
    let is_map = |extras: Result<LevelExtras, _>| extras.is_ok_and(|extras| extras.map.is_some());
    let has_map = document.root.meshes.iter().filter_map(LevelExtras::of).any(is_map);
    if has_map { read_levels(&document).map(Some) } else { Ok(None) }
}

fn read_levels(document: &Document) -> Result<SkinMap, IoError> {
    let found = levels_by_patch(document)?;
    let tree = read_node_tree(document)?;
    let mut links = BTreeMap::new();
    for placement in &tree.placements {
        if placement.stretch.is_some() {
            let element = format!("mesh {}", placement.mesh);
            return Err(document.invalid(
                element,
                "a scaled or mirrored node",
                "rigid nodes: map and skin are in metres",
            ));
        }
        links.insert(placement.mesh, placement.link);
    }
    let mut map = SkinMap { links: tree.links, ..SkinMap::default() };
    for patch in found {
        map.patches.push(read_patch(document, &links, patch)?);
    }
    Ok(map)
}

/// The meshes of one patch, finest first.
struct PatchFound {
    name: String,
    levels: Vec<(usize, LevelExtras)>,
}

/// Finds the levels of every patch, in the order of their finest meshes.
fn levels_by_patch(document: &Document) -> Result<Vec<PatchFound>, IoError> {
    let mut patches: Vec<PatchFound> = Vec::new();
    let mut by_name: BTreeMap<String, usize> = BTreeMap::new();
    for (mesh, json) in document.root.meshes.iter().enumerate() {
        let extras = match LevelExtras::of(json) {
            None => continue,
            Some(Ok(extras)) => extras,
            Some(Err(e)) => {
                let needed = "patch, level, map, up and direct";
                return Err(document.invalid(format!("mesh {mesh} extras.dermatome"), e.to_string(), needed));
            }
        };
        let at = *by_name.entry(extras.patch.clone()).or_insert_with(|| {
            patches.push(PatchFound { name: extras.patch.clone(), levels: Vec::new() });
            patches.len() - 1
        });
        patches[at].levels.push((mesh, extras));
    }
    if patches.is_empty() {
        let needed = "a map, as dermatome writes it";
        return Err(document.invalid("the file", "no mesh with extras.dermatome", needed));
    }
    for patch in &mut patches {
        patch.levels.sort_by_key(|(_, extras)| extras.level);
        if let Some(level) = (0..patch.levels.len()).find(|&k| patch.levels[k].1.level != k) {
            let numbers: Vec<_> = patch.levels.iter().map(|(_, extras)| extras.level).collect();
            let needed = format!("each level once, from 0 on: {level} is not");
            return Err(document.invalid(
                format!("patch {:?}", patch.name),
                format!("the levels {numbers:?}"),
                needed,
            ));
        }
    }
    Ok(patches)
}

fn read_patch(
    document: &Document,
    links: &BTreeMap<usize, LinkId>,
    patch: PatchFound,
) -> Result<PatchMap, IoError> {
    let Some(&link) = patch.levels.first().and_then(|(mesh, _)| links.get(mesh)) else {
        let needed = "a node that carries its level 0";
        return Err(document.invalid(
            format!("patch {:?}", patch.name),
            "no node in the default scene",
            needed,
        ));
    };
    let mut taxels = Taxels::default();
    let mut levels = IdVec::<LevelId, MapLevel>::new();
    // Prolongations need the sizes of other levels.
    let mut rows: Vec<[Option<RowsExtras>; 2]> = Vec::new();
    for (mesh, extras) in &patch.levels {
        let (level, taxels_here) = read_level(document, *mesh, extras)?;
        if let Some(taxels_here) = taxels_here {
            taxels = taxels_here;
        }
        levels.push(level);
        rows.push([extras.up, extras.direct]);
    }
    let sizes: Vec<_> = levels.iter().map(|level| level.mesh.positions.len()).collect();
    for (number, [up, direct]) in levels.ids().zip(rows) {
        let k = number.index();
        let name = format!("{}/{number:?}", patch.name);
        let row = |what: &str, rows, coarse, given| {
            read_rows(document, &format!("{name} {what}"), given, rows, coarse)
        };
        levels[number].up = row("up", sizes[k], sizes.get(k + 1).copied(), up)?;
        levels[number].direct = row("direct", sizes[0], (k > 0).then_some(sizes[k]), direct)?;
        levels[number].origins = origins(document, &name, &levels, number)?;
    }
    let Taxels { ids, covariances } = taxels;
    Ok(PatchMap { name: patch.name, link, ids, covariances, levels })
}

/// What only the vertices of level 0 have.
#[derive(Default)]
struct Taxels {
    ids: IdVec<VertexId, TaxelId>,
    covariances: Option<IdVec<VertexId, [f64; 6]>>,
}

/// The mesh and the map of one level; the prolongations and origins stay empty.
fn read_level(
    document: &Document,
    index: usize,
    extras: &LevelExtras,
) -> Result<(MapLevel, Option<Taxels>), IoError> {
    let name = format!("{}/L{}", extras.patch, extras.level);
    let [primitive] = document.root.meshes[index].primitives.as_slice() else {
        return Err(document.invalid(name, "several primitives or none", "one"));
    };
    let mode = Mode::of(primitive);
    if mode == Mode::Thin {
        return Err(document.invalid(name, "points or lines", "triangles"));
    }
    let attributes = Attributes::of(document, index, 0, primitive)?;
    let missing = |what: &str| document.invalid(&name, format!("no {what}"), what);
    let positions = read_positions(document, &attributes)?;
    let corners = triangles(document, &name, primitive, mode, positions.len())?;
    let mesh = TriMesh::from_arrays(positions, &corners);
    mesh.validate().map_err(|e| document.invalid(&name, e.to_string(), "a mesh"))?;
    let normals = read_normals(document, &attributes)?.ok_or_else(|| missing("NORMAL"))?;
    let areas = attributes.get("_AREA").ok_or_else(|| missing("_AREA"))?;
    let areas = document.gather(areas, |[x]: [f64; 1]| x)?;
    if let Some(v) = areas.iter().position(|&a| a <= 0.0) {
        return Err(document.invalid(
            name,
            format!("area {} m^2 of vertex {v}", areas[v]),
            "a positive area",
        ));
    }
    let map = extras
        .map
        .as_ref()
        .ok_or_else(|| document.invalid(&name, "a pyramid without a map", "a map, as dermatome writes it"))?;
    let frame = read_frame(document, &name, map)?;
    let uv = read_uv(document, &name, &attributes, &frame)?;
    let taxels = match (extras.level, attributes.get("_TAXEL_ID")) {
        (0, None) => return Err(missing("_TAXEL_ID")),
        (0, Some(ids)) => Some(Taxels {
            ids: read_ids(document, ids)?.into(),
            covariances: read_covariances(document, &attributes)?.map(IdVec::from),
        }),
        _ => None,
    };
    let distortion = distortion(&mesh, &uv);
    let level = MapLevel {
        mesh,
        normals: normals.into(),
        areas: areas.into(),
        origins: IdVec::new(),
        uv,
        frame,
        up: None,
        direct: None,
        distortion,
    };
    Ok((level, taxels))
}

/// Map positions, in m.
fn read_uv(
    document: &Document,
    name: &str,
    attributes: &Attributes<'_>,
    frame: &MapFrame,
) -> Result<IdVec<VertexId, DVec2>, IoError> {
    let missing = || document.invalid(name, "no TEXCOORD_0", "TEXCOORD_0");
    let texture = attributes.get("TEXCOORD_0").ok_or_else(missing)?;
    let texture = document.gather(texture, DVec2::from_array)?;
    let outside = |t: &DVec2| t.min_element() < -OUTSIDE || t.max_element() > 1.0 + OUTSIDE;
    if let Some(v) = texture.iter().position(outside) {
        let found = format!("TEXCOORD_0 {} of vertex {v}", texture[v]);
        return Err(document.invalid(name, found, "a place in the unit square"));
    }
    Ok(texture.into_iter().map(|t| frame.from_texture(t)).collect())
}

fn read_frame(document: &Document, name: &str, extras: &FrameExtras) -> Result<MapFrame, IoError> {
    let (origin, size) = (DVec2::from_array(extras.origin), DVec2::from_array(extras.size));
    if !(origin.is_finite() && size.is_finite() && size.cmpgt(DVec2::ZERO).all()) {
        let found = format!("a map rectangle of {size} m at {origin}");
        return Err(document.invalid(name, found, "a finite rectangle with an area"));
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "`as` saturates; the rasteriser refuses images that large"
    )]
    let pixels = |length: f64| (length / PIXEL).round().max(1.0) as u32;
    let size_px = extras.pixels.unwrap_or([pixels(size.x), pixels(size.y)]);
    if size_px.contains(&0) {
        return Err(document.invalid(name, format!("an image of {size_px:?} pixels"), "at least one pixel"));
    }
    Ok(MapFrame { origin, size, size_px })
}

/// Reads a prolongation of `rows` rows into `coarse` vertices; `coarse` is `None` where there must be none.
fn read_rows(
    document: &Document,
    name: &str,
    given: Option<RowsExtras>,
    rows: usize,
    coarse: Option<usize>,
) -> Result<Option<Prolongation>, IoError> {
    let (given, coarse) = match (given, coarse) {
        (None, None) => return Ok(None),
        (Some(given), Some(coarse)) => (given, coarse),
        (Some(_), None) => return Err(document.invalid(name, "a prolongation", "none at this level")),
        (None, Some(_)) => return Err(document.invalid(name, "no prolongation", "one at this level")),
    };
    let accessor = |number: usize| document.accessor(number, Role::Plain, name);
    let indices = accessor(given.indices)?;
    let weights = accessor(given.weights)?;
    if (indices.count, weights.count) != (rows, rows) {
        let found = format!("{} rows of indices and {} of weights", indices.count, weights.count);
        return Err(document.invalid(name, found, format!("{rows} of both")));
    }
    let indices = document.gather_uint::<3>(&indices)?;
    if let Some(row) = indices.iter().position(|row| row.iter().any(|&i| i as usize >= coarse)) {
        let found = format!("row {row} names the vertices {:?}", indices[row]);
        return Err(document.invalid(name, found, format!("vertices below {coarse}")));
    }
    let weights = document.gather(&weights, |row: [f64; 3]| row)?;
    let sum = |row: &[f64; 3]| row.iter().sum::<f64>();
    let odd = |row: &[f64; 3]| row.iter().any(|&w| w < 0.0) || (sum(row) - 1.0).abs() > SUM;
    if let Some(row) = weights.iter().position(odd) {
        let found = format!("row {row} with the weights {:?}", weights[row]);
        return Err(document.invalid(name, found, "no negative weights, sum 1"));
    }
    Ok(Some(Prolongation {
        indices: indices.into_iter().map(|row| row.map(VertexId::from)).collect(),
        weights: weights.into_iter().map(|row| row.map(|w| w / sum(&row))).collect(),
        coarse_len: coarse,
    }))
}

/// The level-0 vertex that each field's centre is: the row of `direct` with weight 1 there. If several have it, because
/// of rounding or of taxels at one place, the one at the centre's position; if several still, the first.
fn origins(
    document: &Document,
    name: &str,
    levels: &IdVec<LevelId, MapLevel>,
    number: LevelId,
) -> Result<IdVec<VertexId, VertexId>, IoError> {
    let level = &levels[number];
    let finest = &levels[LevelId::new(0)].mesh.positions;
    let Some(direct) = &level.direct else { return Ok(finest.ids().collect()) };
    let mut found = IdVec::<VertexId, Option<VertexId>>::filled(None, level.mesh.positions.len());
    for ((taxel, fields), weights) in direct.indices.enumerate().zip(&direct.weights) {
        for (&field, _) in fields.iter().zip(weights).filter(|(_, w)| **w == 1.0) {
            let here = |v: VertexId| finest[v] == level.mesh.positions[field];
            if found[field].is_none_or(|before| here(taxel) && !here(before)) {
                found[field] = Some(taxel);
            }
        }
    }
    match found.iter().position(Option::is_none) {
        None => Ok(found.into_iter().flatten().collect()),
        Some(field) => {
            let needed = "a row of direct with weight 1: its centre is a taxel";
            Err(document.invalid(name, format!("no centre of field {field}"), needed))
        }
    }
}
