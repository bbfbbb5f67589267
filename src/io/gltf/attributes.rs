//! The rules of glTF 2.0 for the vertex attributes of a primitive.

use std::collections::BTreeMap;

use gltf::json::{
    Mesh,
    accessor::{ComponentType, Type},
    mesh::{Primitive, Semantic},
    validation::Checked,
};
use serde::Deserialize;
use serde_json::Value;

use crate::io::{
    IoError,
    gltf::{
        accessor::{Accessor, kind_name},
        document::{DRACO, Document, Role, compression_remedy},
        guard::numbered,
    },
};

/// Largest deviation of a normal from unit length; the Khronos validator's, made for normals of
/// 8-bit integers.
const UNIT_NORMAL: f64 = 0.00674;

/// The checked attributes of a primitive, by name; all of one length.
pub(super) struct Attributes<'a> {
    /// What the primitive is called in errors.
    pub(super) element: String,
    pub(super) count: usize,
    by_name: BTreeMap<String, Accessor<'a>>,
}

impl<'a> Attributes<'a> {
    /// The accessor of an attribute, if the primitive has it and it is not all zeros by omission.
    pub(super) fn get(&self, name: &str) -> Option<&Accessor<'a>> {
        self.by_name.get(name)
    }

    /// An attribute through `read`, if [`Self::get`] finds it.
    pub(super) fn read<T>(
        &self,
        name: &str,
        read: impl FnOnce(&Accessor<'a>) -> Result<T, IoError>,
    ) -> Result<Option<T>, IoError> {
        self.get(name).map(read).transpose()
    }

    /// Checks the attributes of primitive `p` of `mesh`.
    pub(super) fn of(
        document: &'a Document,
        mesh: usize,
        p: usize,
        primitive: &'a Primitive,
    ) -> Result<Self, IoError> {
        let element = format!("mesh {mesh} primitive {p}");
        if !primitive.attributes.contains_key(&Checked::Valid(Semantic::Positions)) {
            let remedy = "give the vertices a POSITION";
            return Err(document.unsupported(element, "vertices without POSITION", remedy));
        }
        let mut by_name = BTreeMap::new();
        let mut first: Option<(String, usize)> = None;
        for (semantic, &index) in &primitive.attributes {
            // The crate strips the underscore of a name and puts it back here.
            let name = semantic.to_string();
            let asked_by = format!("{element} {name}");
            let accessor = document.accessor(index.value(), Role::Vertex, &asked_by)?;
            if let Err(needed) = check_format(&name, &accessor, document.is_quantized()) {
                let normalized = if accessor.json.normalized { ", normalized" } else { "" };
                let (kind, code) = (kind_name(accessor.kind), accessor.component.as_gl_enum());
                return Err(document.invalid(
                    asked_by,
                    format!("{kind} of componentType {code}{normalized}"),
                    needed,
                ));
            }
            let (other, count) = first.get_or_insert((name.clone(), accessor.count));
            if accessor.count != *count {
                let needed = format!("as many as {other}, {count}");
                return Err(document.invalid(asked_by, format!("{} rows", accessor.count), needed));
            }
            by_name.insert(name, accessor);
        }
        let count = first.map_or(0, |(_, count)| count);
        let attributes = Self { element, count, by_name };
        attributes.check_sets(document)?;
        let is_compressed = primitive.extensions.as_ref().is_some_and(|e| e.others.contains_key(DRACO));
        if is_compressed && attributes.by_name["POSITION"].base.is_none() {
            return Err(document.unsupported(
                attributes.element,
                DRACO,
                compression_remedy(DRACO).unwrap_or_default(),
            ));
        }
        attributes.check_targets(document, primitive)?;
        Ok(attributes)
    }

    /// Numbered attributes count from 0 without gaps, and every set of joints has its weights.
    fn check_sets(&self, document: &Document) -> Result<(), IoError> {
        let has = |name: String| self.by_name.contains_key(&name);
        for name in self.by_name.keys() {
            let Some((base, set)) = numbered(name) else { continue };
            if set > 0 && !has(format!("{base}_{}", set - 1)) {
                let needed = format!("{base}_{} before it", set - 1);
                return Err(document.invalid(&self.element, name, needed));
            }
            let partner = match base {
                "JOINTS" => format!("WEIGHTS_{set}"),
                "WEIGHTS" => format!("JOINTS_{set}"),
                _ => continue,
            };
            if !has(partner.clone()) {
                return Err(document.invalid(&self.element, name, format!("{partner} next to it")));
            }
        }
        Ok(())
    }

    /// Morph targets move attributes that exist. They are not read, but a broken one is not valid
    /// glTF.
    fn check_targets(&self, document: &'a Document, primitive: &Primitive) -> Result<(), IoError> {
        for (t, target) in primitive.targets.iter().flatten().enumerate() {
            let moved =
                [("POSITION", target.positions), ("NORMAL", target.normals), ("TANGENT", target.tangents)];
            for (name, index) in moved {
                let Some(index) = index else { continue };
                let asked_by = format!("{} target {t} {name}", self.element);
                let accessor = document.accessor(index.value(), Role::Vertex, &asked_by)?;
                if self.by_name.get(name).is_none_or(|base| base.count != accessor.count) {
                    let found = format!("{} rows", accessor.count);
                    let needed = format!("a base attribute of as many, {}", self.count);
                    return Err(document.invalid(asked_by, found, needed));
                }
                if name == "POSITION" {
                    declared_bounds(document, &accessor)?;
                }
            }
        }
        Ok(())
    }
}

/// Morph targets of one mesh are as many in every primitive, and have no effect: their shapes are
/// not read.
pub(super) fn check_morphs(document: &Document, index: usize, mesh: &Mesh) -> Result<(), IoError> {
    let element = || format!("mesh {index}");
    let count = |p: &Primitive| p.targets.as_ref().map_or(0, Vec::len);
    let targets = mesh.primitives.first().map_or(0, count);
    if let Some(other) = mesh.primitives.iter().map(count).find(|&n| n != targets) {
        let found = format!("primitives of {targets} and of {other} morph targets");
        return Err(document.invalid(element(), found, "one number of targets"));
    }
    let Some(weights) = &mesh.weights else { return Ok(()) };
    if weights.len() != targets {
        let found = format!("{} weights for {targets} morph targets", weights.len());
        return Err(document.invalid(element(), found, "one weight per target"));
    }
    if weights.iter().any(|&w| w != 0.0) {
        return Err(document.unsupported(
            element(),
            "morph weights",
            "apply the morph targets, then export the file again",
        ));
    }
    Ok(())
}

/// The bounds a POSITION accessor must declare.
pub(super) fn declared_bounds(
    document: &Document,
    accessor: &Accessor<'_>,
) -> Result<[[f64; 3]; 2], IoError> {
    let bound = |values: &Option<Value>| values.as_ref().and_then(|v| <[f64; 3]>::deserialize(v).ok());
    match (bound(&accessor.json.min), bound(&accessor.json.max)) {
        (Some(min), Some(max)) => Ok([min, max]),
        _ => Err(document.invalid(accessor.name(), "POSITION without min and max", "both, of three numbers")),
    }
}

/// Checks unit length.
pub(super) fn check_normals(
    document: &Document,
    accessor: &Accessor<'_>,
    normals: &[glam::DVec3],
) -> Result<(), IoError> {
    match normals.iter().position(|n| (n.length() - 1.0).abs() > UNIT_NORMAL) {
        None => Ok(()),
        Some(row) => {
            let found = format!("normal {row} of length {}", normals[row].length());
            Err(document.invalid(accessor.name(), found, "unit normals, or no NORMAL at all"))
        }
    }
}

/// Whether an attribute has one of the formats that glTF 2.0 (or its quantization extension) gives
/// it; else which.
fn check_format(name: &str, accessor: &Accessor<'_>, quantized: bool) -> Result<(), &'static str> {
    use ComponentType::{F32, I8, I16, U8, U16, U32};
    use Type::{Vec2, Vec3, Vec4};
    let (kind, component, normalized) = (accessor.kind, accessor.component, accessor.json.normalized);
    let is_float = component == F32;
    let is_small = matches!(component, I8 | I16 | U8 | U16);
    let is_signed = matches!(component, I8 | I16) && normalized;
    let is_unsigned = matches!(component, U8 | U16);
    let is_fraction = is_unsigned && normalized;
    let base = numbered(name).map_or(name, |(base, _)| base);
    let (fits, needed) = match base {
        "POSITION" => (
            kind == Vec3 && (is_float || (quantized && is_small)),
            "VEC3 of floats (integers with KHR_mesh_quantization)",
        ),
        "NORMAL" => (kind == Vec3 && (is_float || (quantized && is_signed)), "VEC3 of floats"),
        "TANGENT" => (kind == Vec4 && (is_float || (quantized && is_signed)), "VEC4 of floats"),
        "TEXCOORD" => (
            kind == Vec2 && (is_float || is_fraction || (quantized && is_small)),
            "VEC2 of floats or normalized unsigned integers",
        ),
        "COLOR" => (
            matches!(kind, Vec3 | Vec4) && (is_float || is_fraction),
            "VEC3 or VEC4 of floats or normalized unsigned integers",
        ),
        "JOINTS" => (kind == Vec4 && is_unsigned && !normalized, "VEC4 of unsigned integers"),
        "WEIGHTS" => {
            (kind == Vec4 && (is_float || is_fraction), "VEC4 of floats or normalized unsigned integers")
        }
        _ => (
            component != U32,
            "no 32-bit integers in vertex attributes: u8, u16, floats, or VEC2 of u16 (low, high)",
        ),
    };
    if fits { Ok(()) } else { Err(needed) }
}
