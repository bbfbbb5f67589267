//! Skins from glTF: one sheet for each node that carries a mesh of triangles.

use std::{collections::BTreeMap, path::Path};

use glam::{DMat3, DVec3};
use gltf::json::accessor::Type;

use crate::{
    io::{
        IoError,
        gltf::{
            accessor::Accessor,
            attributes::{Attributes, check_morphs, check_normals, declared_bounds},
            document::Document,
            extras::LevelExtras,
            nodes::{Placement, read_node_tree},
            triangles::{Mode, triangles},
        },
    },
    skin::{Covariance, Draft, Presence, Sheet, TaxelId},
};

/// Reads the default scene of a `.glb` or `.gltf` file: one sheet per node that carries a mesh of
/// triangles.
///
/// The primitives of a mesh become one sheet; points and lines are passed over. `_TAXEL_ID` may be
/// u8, u16, whole floats up to 2^24 or VEC2 of u16 (low, high); `_AREA` (m^2), `_DENSITY` (1/m^2)
/// and `_PRESENT` (0 absent, 1 present, 2 thermal pad) are scalars, and belong to every primitive
/// of a mesh or to none. Joints, weights, materials and morph targets are checked but not kept; a
/// `map.glb` reads as the skin it is a map of.
///
/// # Errors
/// If the file cannot be read, breaks a rule of glTF 2.0 in something that is used, or has no
/// triangles.
pub(crate) fn read_gltf(path: &Path) -> Result<Draft, IoError> {
    let document = Document::open(path)?;
    let tree = read_node_tree(&document)?;
    let mut draft = Draft { links: tree.links, ..Draft::default() };
    for placement in &tree.placements {
        draft.sheets.extend(read_sheet(&document, placement)?);
    }
    if draft.sheets.iter().all(|sheet| sheet.triangles.is_empty()) {
        let found = match (document.root.meshes.len(), tree.placements.len()) {
            (0, _) => "no mesh".into(),
            (meshes, 0) => format!("no node that carries one of the {meshes} meshes"),
            (_, carried) => format!("{carried} meshes without a triangle"),
        };
        return Err(document.invalid("the scene", found, "triangles that join the taxels"));
    }
    Ok(draft)
}

/// The sheet of one use of a mesh; `None` if it has no triangles but points and lines.
fn read_sheet(document: &Document, placement: &Placement) -> Result<Option<Sheet>, IoError> {
    let mesh = &document.root.meshes[placement.mesh];
    check_morphs(document, placement.mesh, mesh)?;
    let mut sheet = Sheet { link: Some(placement.link), ..Sheet::default() };
    sheet.name = match LevelExtras::of(mesh) {
        Some(Ok(extras)) => extras.patch,
        _ => placement.name.clone(),
    };
    // Where the vertices of each set of accessors start: primitives may differ in their triangles
    // alone.
    let mut starts = BTreeMap::new();
    for (p, primitive) in mesh.primitives.iter().enumerate() {
        let mode = Mode::of(primitive);
        if mode == Mode::Thin {
            continue;
        }
        let attributes = Attributes::of(document, placement.mesh, p, primitive)?;
        let start = match starts.get(&primitive.attributes) {
            Some(&start) => start,
            None => {
                let start = sheet.positions.len();
                append_vertices(document, &attributes, &mut sheet, starts.is_empty())?;
                starts.insert(&primitive.attributes, start);
                start
            }
        };
        let mut triangles = triangles(document, &attributes.element, primitive, mode, attributes.count)?;
        let Ok(shift) = u32::try_from(start) else {
            let found = "more than 2^32 vertices";
            return Err(document.invalid(&attributes.element, found, "fewer"));
        };
        if shift > 0 {
            triangles.iter_mut().flatten().for_each(|corner| *corner = corner.saturating_add(shift));
        }
        append(&mut sheet.triangles, triangles);
    }
    if starts.is_empty() {
        return Ok(None);
    }
    if let Some(stretch) = placement.stretch {
        bake(&mut sheet, stretch);
    }
    Ok(Some(sheet))
}

/// Moves `part` to the end of `whole`, without a copy where there is nothing yet.
fn append<T>(whole: &mut Vec<T>, mut part: Vec<T>) {
    if whole.is_empty() { *whole = part } else { whole.append(&mut part) }
}

/// Appends the vertices of a primitive.
fn append_vertices(
    document: &Document,
    attributes: &Attributes<'_>,
    sheet: &mut Sheet,
    first: bool,
) -> Result<(), IoError> {
    append(&mut sheet.positions, read_positions(document, attributes)?);
    let element = &attributes.element;
    let join = Join { document, element, first };

    let ids = attributes.read("_TAXEL_ID", |a| read_ids(document, a))?;
    join.all_or_none("_TAXEL_ID", &mut sheet.ids, ids)?;
    let presence = attributes.read("_PRESENT", |a| read_presence(document, a))?;
    join.all_or_none("_PRESENT", &mut sheet.presence, presence)?;
    let scalars = |name| attributes.read(name, |a| document.gather_scalars(a));
    join.all_or_none("_AREA", &mut sheet.areas, scalars("_AREA")?)?;
    join.all_or_none("_DENSITY", &mut sheet.densities, scalars("_DENSITY")?)?;
    join.all_or_none("_COVARIANCE_0", &mut sheet.covariances, read_covariances(document, attributes)?)?;

    // A primitive without normals is flat by the rules of glTF: its triangles know better than a
    // placeholder.
    let normals = read_normals(document, attributes)?;
    sheet.normals = match (sheet.normals.take(), normals) {
        (None, normals) if first => normals,
        (Some(mut all), Some(normals)) => {
            append(&mut all, normals);
            Some(all)
        }
        _ => None,
    };
    Ok(())
}

/// How the vertices of one primitive join those before it.
struct Join<'a> {
    document: &'a Document,
    element: &'a str,
    first: bool,
}

impl Join<'_> {
    /// Appends an attribute that either all primitives of a mesh have or none.
    fn all_or_none<T>(
        &self,
        name: &str,
        all: &mut Option<Vec<T>>,
        part: Option<Vec<T>>,
    ) -> Result<(), IoError> {
        match (all.as_mut(), part) {
            (Some(all), Some(part)) => append(all, part),
            (None, part) if self.first => *all = part,
            (None, None) => {}
            (before, _) => {
                let found =
                    if before.is_some() { "missing here" } else { "missing in the primitives before" };
                let needed = "the attribute in every primitive of the mesh, or in none";
                return Err(self.document.invalid(format!("{} {name}", self.element), found, needed));
            }
        }
        Ok(())
    }
}

/// Positions in metres, checked against the declared bounds.
pub(super) fn read_positions(
    document: &Document,
    attributes: &Attributes<'_>,
) -> Result<Vec<DVec3>, IoError> {
    let missing = || document.invalid(&attributes.element, "no POSITION", "POSITION");
    let accessor = attributes.get("POSITION").ok_or_else(missing)?;
    let [min, max] = declared_bounds(document, accessor)?.map(DVec3::from_array);
    let positions = document.gather(accessor, DVec3::from_array)?;
    // The bounds are those of the stored numbers, so normalized integers would have to be undone;
    // zeros have none.
    if accessor.json.normalized || accessor.is_blank() {
        return Ok(positions);
    }
    let (lo, hi) =
        positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    // Both are f32 by nature: a decimal of few digits stands for the nearest one.
    if (min.as_vec3(), max.as_vec3()) != (lo.as_vec3(), hi.as_vec3()) {
        let found = format!("min {min} and max {max}");
        let needed = format!("the bounds of the positions, {lo} and {hi}");
        return Err(document.invalid(accessor.name(), found, needed));
    }
    Ok(positions)
}

/// Unit normals; `None` without them, or where they are zeros by omission.
pub(super) fn read_normals(
    document: &Document,
    attributes: &Attributes<'_>,
) -> Result<Option<Vec<DVec3>>, IoError> {
    let Some(accessor) = attributes.get("NORMAL").filter(|a| !a.is_blank()) else { return Ok(None) };
    let normals = document.gather(accessor, DVec3::from_array)?;
    check_normals(document, accessor, &normals)?;
    Ok(Some(normals))
}

/// Covariances of positions, `xx xy xz yy yz zz` in m^2, if both halves are there.
pub(super) fn read_covariances(
    document: &Document,
    attributes: &Attributes<'_>,
) -> Result<Option<Vec<Covariance>>, IoError> {
    let half = |name| attributes.read(name, |a| document.gather(a, |row: [f64; 3]| row));
    let join = |([xx, xy, xz], [yy, yz, zz]): ([f64; 3], [f64; 3])| Covariance { xx, xy, xz, yy, yz, zz };
    let halves = half("_COVARIANCE_0")?.zip(half("_COVARIANCE_1")?);
    Ok(halves.map(|(first, second)| first.into_iter().zip(second).map(join).collect()))
}

/// Vendor ids: whole scalars, or low and high halves.
pub(super) fn read_ids(document: &Document, accessor: &Accessor<'_>) -> Result<Vec<TaxelId>, IoError> {
    /// The first whole number that `f32` cannot tell from its successor.
    const EXACT: f64 = 16_777_216.0;
    if accessor.kind == Type::Vec2 {
        let halves = document.gather_uint::<2>(accessor)?;
        return match halves.iter().position(|half| half.iter().any(|&h| h > 0xFFFF)) {
            None => Ok(halves.into_iter().map(|[low, high]| TaxelId(low | high << 16)).collect()),
            Some(row) => Err(document.invalid(
                accessor.name(),
                format!("{:?} in row {row}", halves[row]),
                "16 bits each",
            )),
        };
    }
    let raw = document.gather_scalars(accessor)?;
    let odd = |&x: &f64| x.fract() != 0.0 || !(0.0..=EXACT).contains(&x) || accessor.json.normalized;
    if let Some(row) = raw.iter().position(odd) {
        let found = format!("taxel id {} in row {row}", raw[row]);
        return Err(document.invalid(
            accessor.name(),
            found,
            "whole numbers from 0 to 2^24, or VEC2 of u16 (low, high)",
        ));
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole and at most 2^24, as just checked"
    )]
    let ids = raw.into_iter().map(|x| TaxelId(x as u32)).collect();
    Ok(ids)
}

/// What each slot holds.
pub(super) fn read_presence(document: &Document, accessor: &Accessor<'_>) -> Result<Vec<Presence>, IoError> {
    let raw = document.gather_scalars(accessor)?;
    let refuse = |row: usize, x: f64| {
        let found = format!("_PRESENT {x} in row {row}");
        document.invalid(accessor.name(), found, "0 (absent), 1 (present) or 2 (thermal pad)")
    };
    raw.into_iter().enumerate().map(|(row, x)| Presence::from_code(x).ok_or_else(|| refuse(row, x))).collect()
}

/// Applies the part of a node's transform that a link's rigid frame cannot hold. Areas and
/// densities are in metres already and stay.
fn bake(sheet: &mut Sheet, stretch: DMat3) {
    for p in &mut sheet.positions {
        *p = stretch * *p;
    }
    let of_normals = stretch.inverse().transpose();
    for n in sheet.normals.iter_mut().flatten() {
        *n = (of_normals * *n).normalize_or_zero();
    }
    for c in sheet.covariances.iter_mut().flatten() {
        // The lower triangle: rounding makes it differ from the upper one in the last bits.
        let stretched = stretch * c.to_matrix() * stretch.transpose();
        *c = Covariance::from_matrix(&stretched.transpose());
    }
    if stretch.determinant() < 0.0 {
        sheet.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
}
