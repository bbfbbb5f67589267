//! A primitive: its vertex attributes, by the rules of glTF 2.0, and its triangles or points.
//!
//! A new attribute needs its name in [`OF_TAXELS`], a line where skins or maps are read, and one in
//! `SheetWriter`.

use std::collections::BTreeMap;

use glam::DVec3;
use gltf::json::Mesh;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use crate::io::Feature;
use crate::io::error::Result;
use crate::io::gltf::accessor::Accessor;
use crate::io::gltf::document::{DRACO, Document};
use crate::io::gltf::nodes::Placement;

/// Largest deviation of normals and tangents from unit length: the Khronos validator's, for 8 bits.
const UNIT_NORMAL: f64 = 0.00674;

/// What is needed of a skin in addition to positions, where it is there.
const OF_TAXELS: [&str; 10] = [
    "_TAXEL_ID",
    "_AREA",
    "_DENSITY",
    "_WEIGHT",
    "_ACUITY",
    "_PRESENT",
    "_REGION",
    "_MODALITY",
    "_COVARIANCE_0",
    "_COVARIANCE_1",
];

/// What is read too, and left out with a note where it is wrong: it is looks, or is computed without.
const OPTIONAL: [&str; 6] = ["NORMAL", "TANGENT", "TEXCOORD_0", "JOINTS_0", "JOINTS_1", "WEIGHTS_0"];

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
            let is_needed = name == "POSITION" || OF_TAXELS.contains(&name.as_str());
            if !is_needed && !OPTIONAL.contains(&name.as_str()) {
                continue;
            }
            match attributes.checked(&name, index) {
                Ok(accessor) => {
                    if name == "POSITION" {
                        attributes.count = accessor.gltf.count();
                    }
                    attributes.by_name.insert(name, accessor);
                }
                Err(fault) if is_needed => return Err(fault),
                Err(fault) => document.notes.pass(fault)?,
            }
        }
        let is_compressed = primitive.extensions.as_ref().is_some_and(|e| e.others.contains_key(DRACO));
        if is_compressed && attributes.by_name["POSITION"].gltf.view().is_none() {
            return Err(document.unsupported(attributes.element, Feature::Extension(DRACO.into())));
        }
        Ok(attributes)
    }

    /// The accessor of one attribute, of the right length.
    fn checked(&self, name: &str, index: usize) -> Result<Accessor<'a>> {
        let document = self.document;
        let asked_by = format!("{} {name}", self.element);
        let accessor = document.accessor(index, &asked_by)?;
        let gltf = &accessor.gltf;
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

    pub(super) fn positions(&self) -> Result<Vec<DVec3>> {
        self.need("POSITION")?.reals(DVec3::from_array)
    }

    /// Unit normals; `None` without them, or where they are zeros by omission.
    pub(super) fn normals(&self) -> Result<Option<Vec<DVec3>>> {
        let Some(accessor) = self.get("NORMAL").filter(|a| !a.is_blank()) else { return Ok(None) };
        let mut normals = match accessor.reals(DVec3::from_array) {
            Ok(normals) => normals,
            Err(fault) => return self.document.notes.pass(fault).map(|()| None),
        };
        self.normalise(accessor, &mut normals, "normal")?;
        Ok(Some(normals))
    }

    /// Unit tangents; `None` without them or without normals (glTF has tangents ignored then), or
    /// where they are zeros by omission. The sign that makes a bitangent of a tangent is dropped: the
    /// second tangent of a taxel is `n x t`, whatever texture the file was made for.
    pub(super) fn tangents(&self) -> Result<Option<Vec<DVec3>>> {
        let Some(accessor) = self.get("TANGENT").filter(|a| !a.is_blank()) else { return Ok(None) };
        let mut tangents = match accessor.reals(|[x, y, z, _]: [f64; 4]| DVec3::new(x, y, z)) {
            Ok(tangents) => tangents,
            Err(fault) => return self.document.notes.pass(fault).map(|()| None),
        };
        self.normalise(accessor, &mut tangents, "tangent")?;
        Ok(self.get("NORMAL").is_some_and(|a| !a.is_blank()).then_some(tangents))
    }

    /// Gives vectors unit length, with a note if one has another.
    fn normalise(&self, accessor: &Accessor<'_>, vectors: &mut [DVec3], name: &str) -> Result<()> {
        let is_off = |v: &DVec3| (v.length() - 1.0).abs() > UNIT_NORMAL;
        if let Some(row) = vectors.iter().position(is_off) {
            let found = format!("{name} {row} of length {}", vectors[row].length());
            self.document.notes.pass(accessor.invalid(found, format!("unit {name}s, or none at all")))?;
            vectors.iter_mut().for_each(|v| *v = v.normalize_or_zero());
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
        let accessor = self.document.accessor(index.value(), &asked_by)?;
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
        Err(accessor.invalid(format!("index {largest} at row {at}"), needed))
    }
}

/// Refuses morph targets that have an effect: their shapes are not read.
pub(super) fn check_morphs(document: &Document, placement: &Placement, mesh: &Mesh) -> Result<()> {
    let has_targets = mesh.primitives.iter().any(|p| p.targets.as_ref().is_some_and(|t| !t.is_empty()));
    if has_targets && placement.is_morphed {
        return Err(document.unsupported(format!("mesh {}", placement.mesh), "morph weights"));
    }
    Ok(())
}
