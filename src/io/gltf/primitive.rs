//! A primitive: its vertex attributes, by the rules of glTF 2.0, and its triangles or points.
//!
//! A new attribute needs a line in [`check_format`], one where skins or maps are read, and one in
//! `SheetWriter`.

use std::collections::BTreeMap;

use glam::DVec3;
use gltf::{
    accessor::{DataType, Dimensions},
    json::{
        Mesh, Value,
        mesh::{Mode, Primitive, Semantic},
        validation::Checked,
    },
};
use serde::Deserialize;

use crate::io::{
    error::Result,
    gltf::{
        accessor::{Accessor, kind_name},
        document::{DRACO, Document, Role},
        guard::{is_needed, numbered},
    },
};

/// Largest deviation of normals and tangents from unit length: the Khronos validator's, for 8 bits.
const UNIT_NORMAL: f64 = 0.00674;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Points,
    Lines,
    Triangles,
}

impl Shape {
    pub(super) fn of(primitive: &Primitive) -> Self {
        use Mode::{Points, TriangleFan, TriangleStrip, Triangles};
        match primitive.mode {
            Checked::Valid(Points) => Self::Points,
            Checked::Valid(Triangles | TriangleStrip | TriangleFan) => Self::Triangles,
            _ => Self::Lines,
        }
    }
}

/// The checked attributes of a primitive, by name; all of one length.
pub(super) struct Attributes<'a> {
    pub(super) document: &'a Document,
    /// What the primitive is called in errors.
    pub(super) element: String,
    pub(super) count: usize,
    by_name: BTreeMap<String, Accessor<'a>>,
}

impl<'a> Attributes<'a> {
    /// Checks the attributes of primitive `p` of `mesh`.
    pub(super) fn of(document: &'a Document, mesh: usize, p: usize, primitive: &Primitive) -> Result<Self> {
        let element = format!("mesh {mesh} primitive {p}");
        if !primitive.attributes.contains_key(&Checked::Valid(Semantic::Positions)) {
            return Err(document.unsupported(element, "vertices without POSITION"));
        }
        let mut attributes = Self { document, element, count: 0, by_name: BTreeMap::new() };
        // The crate strips the underscore of a name and puts it back here. Positions come first: they
        // count the vertices.
        let named = primitive.attributes.iter().map(|(name, index)| (name.to_string(), index.value()));
        let (positions, others): (Vec<_>, Vec<_>) = named.partition(|(name, _)| name == "POSITION");
        for (name, index) in positions.into_iter().chain(others) {
            match attributes.checked(&name, index) {
                Ok(accessor) => {
                    if name == "POSITION" {
                        attributes.count = accessor.gltf.count();
                    }
                    attributes.by_name.insert(name, accessor);
                }
                Err(fault) if is_needed(&name) => return Err(fault),
                Err(fault) => document.notes.pass(fault)?,
            }
        }
        attributes.check_sets()?;
        let is_compressed = primitive.extensions.as_ref().is_some_and(|e| e.others.contains_key(DRACO));
        if is_compressed && attributes.by_name["POSITION"].gltf.view().is_none() {
            return Err(document.unsupported(attributes.element, DRACO));
        }
        if let Err(fault) = attributes.check_targets(primitive) {
            document.notes.pass(fault)?;
        }
        Ok(attributes)
    }

    /// The accessor of one attribute, of the right format and length.
    fn checked(&self, name: &str, index: usize) -> Result<Accessor<'a>> {
        let document = self.document;
        let asked_by = format!("{} {name}", self.element);
        let accessor = document.accessor(index, Role::Vertex, &asked_by)?;
        let gltf = &accessor.gltf;
        if let Err(needed) = check_format(name, gltf, document.is_quantized) {
            let normalized = if gltf.normalized() { ", normalized" } else { "" };
            let (kind, code) = (kind_name(gltf.dimensions()), gltf.data_type().as_gl_enum());
            let found = format!("{kind} of componentType {code}{normalized}");
            return Err(document.invalid(asked_by, found, needed));
        }
        if name != "POSITION" && gltf.count() != self.count {
            let needed = format!("as many as POSITION, {}", self.count);
            return Err(document.invalid(asked_by, format!("{} rows", gltf.count()), needed));
        }
        Ok(accessor)
    }

    pub(super) fn get(&self, name: &str) -> Option<&Accessor<'a>> {
        self.by_name.get(name)
    }

    pub(super) fn need(&self, name: &str) -> Result<&Accessor<'a>> {
        let missing = || self.document.invalid(&self.element, format!("no {name}"), name);
        self.get(name).ok_or_else(missing)
    }

    pub(super) fn read<T>(
        &self,
        name: &str,
        read: impl FnOnce(&Accessor<'a>) -> Result<T>,
    ) -> Result<Option<T>> {
        self.get(name).map(read).transpose()
    }

    /// One number per vertex, if the primitive has such an attribute.
    pub(super) fn scalars(&self, name: &str) -> Result<Option<Vec<f64>>> {
        self.read(name, |accessor| accessor.reals(|[x]| x))
    }

    /// Positions in metres, checked against the declared bounds.
    pub(super) fn positions(&self) -> Result<Vec<DVec3>> {
        let accessor = self.need("POSITION")?;
        let positions = accessor.reals(DVec3::from_array)?;
        let declared = match declared_bounds(accessor) {
            Ok(declared) => declared,
            Err(fault) => return self.document.notes.pass(fault).map(|()| positions),
        };
        // Bounds are of the numbers as they are stored, here not normalized; zeros have none.
        if accessor.gltf.normalized() || accessor.is_blank() {
            return Ok(positions);
        }
        let bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (lo, hi) = positions.iter().fold(bounds, |(lo, hi), &p| (lo.min(p), hi.max(p)));
        let [min, max] = declared;
        // Both are f32 by nature: a decimal of few digits stands for the nearest one.
        if (min.as_vec3(), max.as_vec3()) != (lo.as_vec3(), hi.as_vec3()) {
            let needed = format!("the bounds of the positions, {lo} and {hi}");
            self.document.notes.pass(accessor.invalid(format!("min {min} and max {max}"), needed))?;
        }
        Ok(positions)
    }

    /// Unit normals; `None` without them, or where they are zeros by omission.
    pub(super) fn normals(&self) -> Result<Option<Vec<DVec3>>> {
        let Some(accessor) = self.get("NORMAL").filter(|a| !a.is_blank()) else { return Ok(None) };
        let mut normals = match accessor.reals(DVec3::from_array) {
            Ok(normals) => normals,
            Err(fault) => return self.document.notes.pass(fault).map(|()| None),
        };
        if let Some(row) = normals.iter().position(|n| (n.length() - 1.0).abs() > UNIT_NORMAL) {
            let found = format!("normal {row} of length {}", normals[row].length());
            self.document.notes.pass(accessor.invalid(found, "unit normals, or no NORMAL at all"))?;
            normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
        }
        Ok(Some(normals))
    }

    /// Unit tangents; `None` without them or without normals (glTF has tangents ignored then), or
    /// where they are zeros by omission. The sign that makes a bitangent of a tangent is checked
    /// and dropped: the second tangent of a taxel is `n x t`, whatever texture the file was made
    /// for.
    pub(super) fn tangents(&self) -> Result<Option<Vec<DVec3>>> {
        let Some(accessor) = self.get("TANGENT").filter(|a| !a.is_blank()) else { return Ok(None) };
        let rows = match accessor.reals(|[x, y, z, w]: [f64; 4]| (DVec3::new(x, y, z), w)) {
            Ok(rows) => rows,
            Err(fault) => return self.document.notes.pass(fault).map(|()| None),
        };
        let is_wrong = |(t, w): &(DVec3, f64)| (t.length() - 1.0).abs() > UNIT_NORMAL || w.abs() != 1.0;
        if let Some(row) = rows.iter().position(is_wrong) {
            let (t, w) = rows[row];
            let found = format!("tangent {row} of length {} with w = {w}", t.length());
            let needed = "unit tangents with w = 1 or -1, or no TANGENT at all";
            self.document.notes.pass(accessor.invalid(found, needed))?;
        }
        let has_normals = self.get("NORMAL").is_some_and(|a| !a.is_blank());
        let unit = |t: DVec3| {
            if (t.length() - 1.0).abs() > UNIT_NORMAL { t.normalize_or_zero() } else { t }
        };
        Ok(has_normals.then(|| rows.into_iter().map(|(t, _)| unit(t)).collect()))
    }

    /// Numbered attributes count from 0 without gaps, and every set of joints has its weights.
    fn check_sets(&self) -> Result<()> {
        for name in self.by_name.keys() {
            let Some((base, set)) = numbered(name) else { continue };
            let before = set.checked_sub(1).map(|before| format!("{base}_{before}"));
            let partner = match base {
                "JOINTS" => Some(format!("WEIGHTS_{set}")),
                "WEIGHTS" => Some(format!("JOINTS_{set}")),
                _ => None,
            };
            for other in before.into_iter().chain(partner) {
                if !self.by_name.contains_key(&other) {
                    let fault = self.document.invalid(&self.element, name, format!("{other} next to it"));
                    self.document.notes.pass(fault)?;
                }
            }
        }
        Ok(())
    }

    /// Morph targets move attributes that exist; they are not read, but have to be valid.
    fn check_targets(&self, primitive: &Primitive) -> Result<()> {
        for (t, target) in primitive.targets.iter().flatten().enumerate() {
            let moved =
                [("POSITION", target.positions), ("NORMAL", target.normals), ("TANGENT", target.tangents)];
            for (name, index) in moved {
                let Some(index) = index else { continue };
                let asked_by = format!("{} target {t} {name}", self.element);
                let accessor = self.document.accessor(index.value(), Role::Vertex, &asked_by)?;
                if self.get(name).is_none_or(|base| base.gltf.count() != accessor.gltf.count()) {
                    let found = format!("{} rows", accessor.gltf.count());
                    let needed = format!("a base attribute of as many, {}", self.count);
                    return Err(self.document.invalid(asked_by, found, needed));
                }
                if name == "POSITION" {
                    declared_bounds(&accessor)?;
                }
            }
        }
        Ok(())
    }
}

impl Attributes<'_> {
    /// The triangles of the primitive, counter-clockwise. Corners that do not fill a triangle at the
    /// end are left out, as every viewer does; so are triangles of a strip or fan that only turn a
    /// corner.
    pub(super) fn triangles(&self, primitive: &Primitive) -> Result<Vec<[u32; 3]>> {
        let corners = self.points(primitive)?;
        let is_list = primitive.mode == Checked::Valid(Mode::Triangles);
        self.document.reserve(&self.element, corners.len(), if is_list { 4 } else { 12 })?;
        let is_proper = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        Ok(match primitive.mode {
            _ if is_list => corners.as_chunks::<3>().0.to_vec(),
            Checked::Valid(Mode::TriangleStrip) => {
                let turned = |(i, w): (usize, &[u32])| {
                    if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] }
                };
                corners.windows(3).enumerate().map(turned).filter(is_proper).collect()
            }
            _ => {
                let hub = corners.first().copied().unwrap_or_default();
                corners.windows(2).skip(1).map(|w| [hub, w[0], w[1]]).filter(is_proper).collect()
            }
        })
    }

    /// The vertices that a primitive shows, which exist: those of its indices, else all. The largest
    /// number of a type would restart a strip, which glTF forbids.
    pub(super) fn points(&self, primitive: &Primitive) -> Result<Vec<u32>> {
        let Some(index) = primitive.indices else {
            self.document.reserve(&self.element, self.count, 4)?;
            return Ok((0..u32::try_from(self.count).unwrap_or(u32::MAX)).collect());
        };
        let asked_by = format!("{} indices", self.element);
        let accessor = self.document.accessor(index.value(), Role::Index, &asked_by)?;
        let corners = accessor.integers::<1>()?.into_flattened();
        let restart = u32::MAX >> (32 - 8 * accessor.gltf.size().min(4));
        let largest = corners.iter().copied().max().unwrap_or_default();
        if largest != restart && (largest as usize) < self.count {
            return Ok(corners);
        }
        let at = corners.iter().position(|&c| c == largest).unwrap_or_default();
        let needed = if largest as usize >= self.count {
            format!("less than {}, the number of vertices", self.count)
        } else {
            "no primitive restart: a wider type of index".into()
        };
        Err(accessor.invalid(format!("index {largest} at place {at}"), needed))
    }
}

/// Morph targets are as many in every primitive, and have no effect: their shapes are not read.
pub(super) fn check_morphs(document: &Document, index: usize, mesh: &Mesh) -> Result<()> {
    document.notes.check(document, "meshes", index)?;
    let pass = |found: String, needed: &str| {
        document.notes.pass(document.invalid(format!("mesh {index}"), found, needed))
    };
    let count = |p: &Primitive| p.targets.as_ref().map_or(0, Vec::len);
    let targets = mesh.primitives.first().map_or(0, count);
    if let Some(other) = mesh.primitives.iter().map(count).find(|&n| n != targets) {
        let found = format!("primitives of {targets} and of {other} morph targets");
        pass(found, "one number of targets")?;
    }
    let Some(weights) = &mesh.weights else { return Ok(()) };
    if weights.len() != targets {
        let found = format!("{} weights for {targets} morph targets", weights.len());
        pass(found, "one weight per target")?;
    }
    if targets > 0 && weights.iter().any(|&w| w != 0.0) {
        return Err(document.unsupported(format!("mesh {index}"), "morph weights"));
    }
    Ok(())
}

fn declared_bounds(accessor: &Accessor<'_>) -> Result<[DVec3; 2]> {
    let bound = |values: Option<Value>| <[f64; 3]>::deserialize(values?).ok().map(DVec3::from_array);
    match (bound(accessor.gltf.min()), bound(accessor.gltf.max())) {
        (Some(min), Some(max)) => Ok([min, max]),
        _ => Err(accessor.invalid("POSITION without min and max", "both, of three numbers")),
    }
}

/// Checks for a format that glTF 2.0, or its quantization extension, gives an attribute.
fn check_format(name: &str, accessor: &gltf::Accessor<'_>, quantized: bool) -> Result<(), &'static str> {
    use DataType::{F32, I8, I16, U8, U16, U32};
    use Dimensions::{Vec2, Vec3, Vec4};
    let (kind, component, normalized) = (accessor.dimensions(), accessor.data_type(), accessor.normalized());
    let is_float = component == F32;
    let is_small = quantized && component != U32;
    let is_signed = quantized && matches!(component, I8 | I16) && normalized;
    let is_unsigned = matches!(component, U8 | U16);
    let is_fraction = is_float || is_unsigned && normalized;
    let (kinds, fits, needed): (&[_], _, _) = match numbered(name).map_or(name, |(base, _)| base) {
        "POSITION" => (&[Vec3], is_float || is_small, "VEC3 of floats (integers with KHR_mesh_quantization)"),
        "NORMAL" => (&[Vec3], is_float || is_signed, "VEC3 of floats"),
        "TANGENT" => (&[Vec4], is_float || is_signed, "VEC4 of floats"),
        "TEXCOORD" => (&[Vec2], is_fraction || is_small, "VEC2 of floats or normalized unsigned integers"),
        "COLOR" => (&[Vec3, Vec4], is_fraction, "VEC3 or VEC4 of floats or normalized unsigned integers"),
        "JOINTS" => (&[Vec4], is_unsigned && !normalized, "VEC4 of unsigned integers"),
        "WEIGHTS" => (&[Vec4], is_fraction, "VEC4 of floats or normalized unsigned integers"),
        _ => {
            let needed =
                "no 32-bit integers in vertex attributes: u8, u16, floats, or VEC2 of u16 (low, high)";
            return if component == U32 { Err(needed) } else { Ok(()) };
        }
    };
    if fits && kinds.contains(&kind) { Ok(()) } else { Err(needed) }
}
