//! Skins from glTF: one sheet for each node that carries a mesh of triangles.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec2};
use gltf::accessor::Dimensions;

use crate::io::error::Result;
use crate::io::file::Source;
use crate::io::gltf::accessor::Accessor;
use crate::io::gltf::animation::read_animations;
use crate::io::gltf::document::Document;
use crate::io::gltf::joints::Binding;
use crate::io::gltf::nodes::{Placement, read_node_tree};
use crate::io::gltf::primitive::{Attributes, Shape, check_morphs};
use crate::io::gltf::{LevelExtras, Notes, SheetExtras, UNKNOWN_VARIANCE};
use crate::io::{IoError, ReadParts};
use crate::skin::{Covariance, Draft, Joints, Presence, Remark, RemarkKind, Sheet, TaxelId};

/// Reads the default scene of a `.glb` or `.gltf` file: one sheet per node that carries a mesh of
/// triangles; in a scene without any triangle, one sheet of bare taxels per node that carries points.
///
/// The primitives of a mesh become one sheet; points next to triangles, and lines, are passed over. `_TAXEL_ID` may be
/// u8, u16, whole floats up to 2^24 or VEC2 of u16 (low, high); `_AREA` (m^2), `_DENSITY` (1/m^2), `_WEIGHT`,
/// `_ACUITY`, `_PRESENT` (0 absent, 1 present, 2 thermal pad, 3 another sensor), `_REGION` and `_MODALITY` (0 none, else
/// counted from 1 in `extras.dermatome.regions` and `.modalities` of the mesh) are scalars, and belong to every primitive
/// of a mesh or to none, as do the joints of a mesh that is skinned. Materials and morph targets are
/// not read; a `map.glb` reads as the skin it is a map of, without the faces that close pin-holes.
pub(crate) fn read_gltf(source: Source, parts: ReadParts) -> Result<Draft> {
    let stem = source.stem();
    let document = Document::new(source, Notes::new(false))?;
    let mut tree = read_node_tree(&document)?;
    let mut bindings = Vec::new();
    for placement in &tree.placements {
        bindings.push(Binding::of(&document, &tree, placement)?);
    }
    for (placement, binding) in tree.placements.iter().zip(&bindings) {
        if let Some(Binding { pose: Some(pose), .. }) = binding {
            tree.links[placement.link].pose = *pose;
        }
    }
    let (animations, others) = read_animations(&document, &tree);
    let left_out = |(name, reason): (String, IoError)| {
        let kind = RemarkKind::AnimationLeftOut { reason: reason.to_string() };
        Remark { patch: name, kind }
    };
    let remarks = others.into_iter().map(left_out).collect();
    let mut draft = Draft { links: tree.links, animations, remarks, ..Draft::default() };
    for shape in [Shape::Triangles, Shape::Points] {
        if draft.sheets.iter().all(|sheet| sheet.triangles.is_empty()) {
            draft.sheets.clear();
            for (placement, binding) in tree.placements.iter().zip(&bindings) {
                draft.sheets.extend(read_sheet(&document, placement, binding.as_ref(), (shape, parts))?);
            }
        }
    }
    draft.files = document.other_files();
    if draft.sheets.is_empty() {
        let found = match (document.root().meshes.len(), tree.placements.len()) {
            (0, _) => "no mesh".into(),
            (meshes, 0) => format!("no node that carries one of the {meshes} meshes"),
            (_, carried) => format!("{carried} meshes without a triangle or a point"),
        };
        return Err(document.invalid("the scene", found, "triangles that join the taxels, or points"));
    }
    let remark = |what| Remark { patch: stem.clone(), kind: RemarkKind::PassedOver { what } };
    draft.materials.clone_from(&document.materials);
    draft.remarks.extend(document.notes.texts().into_iter().map(remark));
    Ok(draft)
}

/// The sheet of one use of a mesh, of its primitives of this shape; `None` if it has none.
fn read_sheet(
    document: &Document,
    placement: &Placement,
    binding: Option<&Binding>,
    (shape, parts): (Shape, ReadParts),
) -> Result<Option<Sheet>> {
    let mesh = &document.root().meshes[placement.mesh];
    check_morphs(document, placement, mesh)?;
    let mut sheet = Sheet { link: Some(placement.link), ..Sheet::default() };
    let level = LevelExtras::of(mesh).and_then(Result::ok);
    let filled = level.as_ref().map_or(0, |extras| extras.filled);
    sheet.name = level.map_or_else(|| placement.name.clone(), |extras| extras.patch);
    // Where the vertices of each set of accessors start: primitives may share them all.
    let mut starts = BTreeMap::new();
    let mut points = BTreeSet::new();
    let mut texture: Option<Vec<DVec2>> = None;
    let extras = SheetExtras::of(mesh).unwrap_or_default();
    sheet.are_counted = extras.counted;
    for (p, primitive) in mesh.primitives.iter().enumerate().filter(|(_, p)| Shape::of(p) == shape) {
        let attributes = Attributes::of(document, placement.mesh, p, primitive)?;
        let start = match starts.get(&primitive.attributes) {
            Some(&start) => start,
            None => {
                let start = sheet.positions.len();
                append_vertices(&attributes, binding, &mut sheet, (starts.is_empty(), &extras))?;
                if parts.texture {
                    let part = attributes.read("TEXCOORD_0", |a| a.reals(DVec2::from_array))?;
                    if join(&mut texture, part, starts.is_empty()).is_err() {
                        texture = None;
                    }
                }
                starts.insert(&primitive.attributes, start);
                start
            }
        };
        let Ok(shift) = u32::try_from(start) else {
            return Err(document.invalid(&attributes.element, "more than 2^32 vertices", "fewer"));
        };
        if shape == Shape::Points {
            points.extend(attributes.points(primitive)?.into_iter().map(|vertex| start + vertex as usize));
            continue;
        }
        let mut triangles = attributes.triangles(primitive)?;
        if shift > 0 {
            triangles.iter_mut().flatten().for_each(|corner| *corner = corner.saturating_add(shift));
        }
        let material = primitive.material.and_then(|m| u32::try_from(m.value()).ok()).unwrap_or(u32::MAX);
        if parts.materials {
            let all = sheet.materials.get_or_insert_default();
            all.resize(all.len() + triangles.len(), material);
        }
        append(&mut sheet.triangles, triangles);
    }
    if starts.is_empty() {
        return Ok(None);
    }
    if let Some(of_skin) = sheet.triangles.len().checked_sub(filled).filter(|faces| *faces > 0) {
        // The last faces of a map close pin-holes: they are no skin.
        sheet.triangles.truncate(of_skin);
        sheet.materials.iter_mut().for_each(|all| all.truncate(of_skin));
    }
    if shape == Shape::Points && points.len() < sheet.positions.len() {
        sheet = sheet.select(&points.into_iter().collect::<Vec<_>>());
    }
    sheet.follow_modalities();
    if let Some(stretch) = placement.stretch {
        sheet.positions.iter_mut().for_each(|p| *p = stretch * *p);
        bake(&mut sheet, |_| stretch);
    }
    let moved = |joints: &Vec<Joints>| joints.iter().map(|row| binding?.moved(row)).collect();
    if sheet.joints.is_some() {
        sheet.binds = binding.map(|binding| binding.binds.clone()).unwrap_or_default();
    }
    if let Some(moves) = sheet.joints.as_ref().and_then::<Vec<DAffine3>, _>(moved) {
        sheet.positions.iter_mut().zip(&moves).for_each(|(p, pose)| *p = pose.transform_point3(*p));
        bake(&mut sheet, |v| moves[v].matrix3);
    }
    let at = |v: u32| texture.as_ref().and_then(|all| all.get(v as usize).copied());
    let corners = |&[a, b, c]: &[u32; 3]| Some([at(a)?, at(b)?, at(c)?]);
    if parts.texture {
        sheet.texture = sheet.triangles.iter().map(corners).collect();
    }
    Ok(Some(sheet))
}

/// Moves `part` to the end of `whole`, without a copy where there is nothing yet.
fn append<T>(whole: &mut Vec<T>, mut part: Vec<T>) {
    if whole.is_empty() { *whole = part } else { whole.append(&mut part) }
}

fn append_vertices(
    attributes: &Attributes<'_>,
    binding: Option<&Binding>,
    sheet: &mut Sheet,
    (first, extras): (bool, &SheetExtras),
) -> Result<()> {
    append(&mut sheet.positions, attributes.positions()?);
    let all_or_none = |name: &str, joined: Result<(), &str>| {
        let needed = "the attribute in every primitive of the mesh, or in none";
        let element = format!("{} {name}", attributes.element);
        joined.map_err(|found| attributes.document.invalid(element, found, needed))
    };
    let (ids, presence) =
        (attributes.read("_TAXEL_ID", read_ids)?, attributes.read("_PRESENT", read_presence)?);
    all_or_none("_TAXEL_ID", join(&mut sheet.ids, ids, first))?;
    all_or_none("_PRESENT", join(&mut sheet.presence, presence, first))?;
    for (name, all, names) in [
        ("_REGION", &mut sheet.regions, &extras.regions),
        ("_MODALITY", &mut sheet.modalities, &extras.modalities),
    ] {
        let part = attributes.read(name, |accessor| read_names(accessor, name, names))?;
        all_or_none(name, join(all, part, first))?;
    }
    all_or_none("_AREA", join(&mut sheet.areas, attributes.scalars("_AREA")?, first))?;
    all_or_none("_DENSITY", join(&mut sheet.densities, attributes.scalars("_DENSITY")?, first))?;
    all_or_none("_WEIGHT", join(&mut sheet.weights, attributes.scalars("_WEIGHT")?, first))?;
    all_or_none("_ACUITY", join(&mut sheet.acuities, attributes.scalars("_ACUITY")?, first))?;
    all_or_none("_COVARIANCE_0", join(&mut sheet.covariances, read_covariances(attributes)?, first))?;
    let joints = binding.map_or(Ok(None), |binding| binding.joints(attributes))?;
    all_or_none("JOINTS_0", join(&mut sheet.joints, joints, first))?;

    // A primitive without normals is flat by the rules of glTF: its triangles define it better than normals of vertices.
    for (all, part) in
        [(&mut sheet.normals, attributes.normals()?), (&mut sheet.tangents, attributes.tangents()?)]
    {
        if join(all, part, first).is_err() {
            *all = None;
        }
    }
    Ok(())
}

/// Appends an attribute that all primitives of a mesh have or none; else the error names one that lacks it.
fn join<T>(all: &mut Option<Vec<T>>, part: Option<Vec<T>>, first: bool) -> Result<(), &'static str> {
    match (all.as_mut(), part) {
        (Some(all), Some(part)) => append(all, part),
        (None, part) if first || part.is_none() => *all = part,
        (Some(_), None) => return Err("missing here"),
        (None, _) => return Err("missing in the primitives before"),
    }
    Ok(())
}

/// Covariances of positions, `xx xy xz yy yz zz` in m^2, if both halves are there; [`UNKNOWN_VARIANCE`] is none.
pub(super) fn read_covariances(attributes: &Attributes<'_>) -> Result<Option<Vec<Option<Covariance>>>> {
    let half = |name| attributes.read(name, |accessor| accessor.reals(|row: [f64; 3]| row));
    let join = |([xx, xy, xz], [yy, yz, zz]): ([f64; 3], [f64; 3])| {
        let is_known = [xx, yy, zz] != [f64::from(UNKNOWN_VARIANCE); 3];
        is_known.then_some(Covariance { xx, xy, xz, yy, yz, zz })
    };
    let halves = half("_COVARIANCE_0")?.zip(half("_COVARIANCE_1")?);
    Ok(halves.map(|(first, second)| first.into_iter().zip(second).map(join).collect()))
}

/// Vendor ids: whole scalars, or low and high halves.
pub(super) fn read_ids(accessor: &Accessor<'_>) -> Result<Vec<TaxelId>> {
    /// The first whole number that is the same `f32` as its successor.
    const EXACT: f64 = 16_777_216.0;
    if accessor.gltf.dimensions() == Dimensions::Vec2 {
        let halves = accessor.integers::<2>()?;
        return match halves.iter().position(|half| half.iter().any(|&h| h > 0xFFFF)) {
            None => Ok(halves.into_iter().map(|[low, high]| TaxelId(low | high << 16)).collect()),
            Some(row) => Err(accessor.invalid(format!("{:?} in row {row}", halves[row]), "16 bits each")),
        };
    }
    let raw = accessor.reals(|[x]| x)?;
    let odd = |&x: &f64| x.fract() != 0.0 || !(0.0..=EXACT).contains(&x) || accessor.gltf.normalized();
    if let Some(row) = raw.iter().position(odd) {
        let needed = "whole numbers from 0 to 2^24, or VEC2 of u16 (low, high)";
        return Err(accessor.invalid(format!("taxel id {} in row {row}", raw[row]), needed));
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole and at most 2^24, as just checked"
    )]
    let ids = raw.into_iter().map(|x| TaxelId(x as u32)).collect();
    Ok(ids)
}

pub(super) fn read_presence(accessor: &Accessor<'_>) -> Result<Vec<Presence>> {
    let refuse = |row: usize, x: f64| {
        let found = format!("_PRESENT {x} in row {row}");
        accessor.invalid(found, "0 (absent), 1 (present), 2 (thermal pad) or 3 (another sensor)")
    };
    let presence = |(row, x): (usize, f64)| Presence::from_code(x).ok_or_else(|| refuse(row, x));
    accessor.reals(|[x]| x)?.into_iter().enumerate().map(presence).collect()
}

/// The names of taxels, by their numbers among `names` from 1 on; 0 is none.
pub(super) fn read_names(
    accessor: &Accessor<'_>,
    attribute: &str,
    names: &[String],
) -> Result<Vec<Option<Arc<str>>>> {
    let names: Vec<Arc<str>> = names.iter().map(|name| name.as_str().into()).collect();
    let region = |(row, x): (usize, f64)| {
        if x.fract() != 0.0 || !(0.0..=names.len() as f64).contains(&x) {
            let list = if attribute == "_REGION" { "regions" } else { "modalities" };
            let needed = format!("0 to {}: extras.dermatome.{list} of the mesh lists them", names.len());
            return Err(accessor.invalid(format!("{attribute} {x} in row {row}"), needed));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole and at most the number of names, as just checked"
        )]
        let number = x as usize;
        Ok(number.checked_sub(1).and_then(|k| names.get(k)).cloned())
    };
    accessor.reals(|[x]| x)?.into_iter().enumerate().map(region).collect()
}

/// Applies the linear part at each vertex that a link's rigid frame cannot express to all but the
/// positions. Areas and densities are in metres already and stay.
fn bake(sheet: &mut Sheet, linear: impl Fn(usize) -> DMat3) {
    for (v, n) in sheet.normals.iter_mut().flatten().enumerate() {
        *n = (linear(v).inverse().transpose() * *n).normalize_or_zero();
    }
    // Directions in the skin move with it. A mirror leaves them where they belong; `n x t` is then
    // the opposite of its image, so that frames stay right-handed.
    for (v, t) in sheet.tangents.iter_mut().flatten().enumerate() {
        *t = (linear(v) * *t).normalize_or_zero();
    }
    for (v, c) in sheet.covariances.iter_mut().flatten().enumerate() {
        let Some(c) = c else { continue };
        // The lower triangle: rounding makes it differ from the upper one in the last bits.
        let stretched = linear(v) * DMat3::from(*c) * linear(v).transpose();
        *c = stretched.transpose().into();
    }
    for t in &mut sheet.triangles {
        if linear(t[0] as usize).determinant() < 0.0 {
            t.swap(1, 2);
        }
    }
}
