//! The rules of glTF 2.0 for the vertex attributes of a primitive.

use std::collections::BTreeMap;

use crate::io::{
    IoError,
    gltf::{
        accessor::{Accessor, Component, Role},
        document::{DRACO, Document, compression_remedy},
        schema::{Mesh, Primitive},
    },
};

/// Largest deviation of a normal from unit length; the Khronos validator's, made for normals of 8-bit integers.
const UNIT_NORMAL: f64 = 0.00674;

/// The checked attributes of a primitive, by name; all of one length.
pub(super) struct Attributes<'a> {
    /// What the primitive is called in errors.
    pub(super) element: String,
    pub(super) count: usize,
    by_name: BTreeMap<&'a str, Accessor<'a>>,
}

impl<'a> Attributes<'a> {
    /// The accessor of an attribute, if the primitive has it and it is not all zeros by omission.
    pub(super) fn get(&self, name: &str) -> Option<&Accessor<'a>> {
        self.by_name.get(name)
    }

    /// Checks the attributes of primitive `p` of `mesh`.
    pub(super) fn of(
        document: &'a Document,
        mesh: usize,
        p: usize,
        primitive: &'a Primitive,
    ) -> Result<Self, IoError> {
        let element = format!("mesh {mesh} primitive {p}");
        if !primitive.attributes.contains_key("POSITION") {
            let remedy = "give the vertices a POSITION";
            return Err(document.unsupported(element, "vertices without POSITION", remedy));
        }
        let mut by_name = BTreeMap::new();
        let mut first: Option<(&str, usize)> = None;
        for (name, &index) in &primitive.attributes {
            let asked_by = format!("{element} {name}");
            let accessor = document.accessor(index, Role::Vertex, &asked_by)?;
            if let Err(needed) = format_of(name, &accessor, document.is_quantized()) {
                let json = accessor.json;
                let normalized = if json.normalized { ", normalized" } else { "" };
                let found = format!("{} of componentType {}{normalized}", json.kind, json.component_type);
                return Err(document.invalid(asked_by, found, needed));
            }
            let (other, count) = *first.get_or_insert((name, accessor.count));
            if accessor.count != count {
                let needed = format!("as many as {other}, {count}");
                return Err(document.invalid(asked_by, format!("{} rows", accessor.count), needed));
            }
            by_name.insert(name.as_str(), accessor);
        }
        let attributes = Self { element, count: first.map_or(0, |f| f.1), by_name };
        attributes.check_sets(document)?;
        if primitive.extensions.contains_key(DRACO) && attributes.by_name["POSITION"].base.is_none() {
            return Err(document.unsupported(
                attributes.element,
                DRACO,
                compression_remedy(DRACO).unwrap_or_default(),
            ));
        }
        if let Some(material) = primitive.material {
            document.get(&document.json.materials, material, "material", || attributes.element.clone())?;
        }
        attributes.check_targets(document, primitive)?;
        Ok(attributes)
    }

    /// Numbered attributes count from 0 without gaps, and every set of joints has its weights.
    fn check_sets(&self, document: &Document) -> Result<(), IoError> {
        let has = |name: String| self.by_name.contains_key(name.as_str());
        for name in self.by_name.keys() {
            let Some((base, set)) = numbered(name) else { continue };
            if set > 0 && !has(format!("{base}_{}", set - 1)) {
                let needed = format!("{base}_{} before it", set - 1);
                return Err(document.invalid(&self.element, *name, needed));
            }
            let partner = match base {
                "JOINTS" => format!("WEIGHTS_{set}"),
                "WEIGHTS" => format!("JOINTS_{set}"),
                _ => continue,
            };
            if !has(partner.clone()) {
                return Err(document.invalid(&self.element, *name, format!("{partner} beside it")));
            }
        }
        Ok(())
    }

    /// Morph targets move attributes that exist. They are not read, but a broken one is no glTF.
    fn check_targets(&self, document: &'a Document, primitive: &Primitive) -> Result<(), IoError> {
        for (t, target) in primitive.targets.iter().flatten().enumerate() {
            for (name, &index) in target {
                let asked_by = format!("{} target {t} {name}", self.element);
                let accessor = document.accessor(index, Role::Vertex, &asked_by)?;
                if !is_known(name) {
                    return Err(document.invalid(
                        asked_by,
                        "an unknown attribute",
                        "a name of glTF 2.0, or one with _",
                    ));
                }
                let base = self.by_name.get(name.as_str());
                if base.is_none_or(|b| b.count != accessor.count) {
                    let found = format!("{} rows", accessor.count);
                    return Err(document.invalid(
                        asked_by,
                        found,
                        format!("a base attribute of as many, {}", self.count),
                    ));
                }
                if name == "POSITION" {
                    declared_bounds(document, &accessor)?;
                }
            }
        }
        Ok(())
    }
}

/// Morph targets of one mesh are as many in every primitive, and have no effect: their shapes are not read.
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
    let bound = |values: &Option<Vec<f64>>| values.as_deref().and_then(|v| <[f64; 3]>::try_from(v).ok());
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

/// Splits `JOINTS_0`; the number is written without leading zeros.
fn numbered(name: &str) -> Option<(&str, u32)> {
    let (base, digits) = name.rsplit_once('_')?;
    let known = ["TEXCOORD", "COLOR", "JOINTS", "WEIGHTS"].contains(&base);
    let set = digits.parse::<u32>().ok().filter(|n| n.to_string() == digits)?;
    known.then_some((base, set))
}

fn is_known(name: &str) -> bool {
    matches!(name, "POSITION" | "NORMAL" | "TANGENT") || name.starts_with('_') || numbered(name).is_some()
}

/// Whether an attribute has one of the formats glTF 2.0 (or its quantization extension) gives it; else which.
fn format_of(name: &str, accessor: &Accessor<'_>, quantized: bool) -> Result<(), &'static str> {
    use Component::{F32, I8, I16, U8, U16, U32};
    let (kind, component) = (accessor.json.kind.as_str(), accessor.component);
    let normalized = accessor.json.normalized;
    let small = matches!(component, I8 | U8 | I16 | U16);
    let signed = matches!(component, I8 | I16) && normalized;
    let unsigned = matches!(component, U8 | U16);
    let (base, _) = numbered(name).unwrap_or((name, 0));
    let (fits, needed) = match base {
        "POSITION" => {
            let integer = quantized && small;
            (
                kind == "VEC3" && (component == F32 || integer),
                "VEC3 of floats (integers with KHR_mesh_quantization)",
            )
        }
        "NORMAL" => {
            let integer = quantized && signed;
            (kind == "VEC3" && (component == F32 || integer), "VEC3 of floats")
        }
        "TANGENT" => (kind == "VEC4" && (component == F32 || (quantized && signed)), "VEC4 of floats"),
        "TEXCOORD" => {
            let integer = (unsigned && normalized) || (quantized && small);
            (
                kind == "VEC2" && (component == F32 || integer),
                "VEC2 of floats or normalized unsigned integers",
            )
        }
        "COLOR" => {
            let integer = unsigned && normalized;
            let vector = matches!(kind, "VEC3" | "VEC4");
            (
                vector && (component == F32 || integer),
                "VEC3 or VEC4 of floats or normalized unsigned integers",
            )
        }
        "JOINTS" => (kind == "VEC4" && unsigned && !normalized, "VEC4 of unsigned integers"),
        "WEIGHTS" => {
            let integer = unsigned && normalized;
            (
                kind == "VEC4" && (component == F32 || integer),
                "VEC4 of floats or normalized unsigned integers",
            )
        }
        _ if name.starts_with('_') => (
            component != U32,
            "no 32-bit integers in vertex attributes: u8, u16, floats, or VEC2 of u16 (low, high)",
        ),
        _ => (false, "a name of glTF 2.0, or one that starts with _"),
    };
    if fits { Ok(()) } else { Err(needed) }
}
