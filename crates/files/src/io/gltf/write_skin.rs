//! Writes skins as glTF, and the meshes of maps: positions, normals, triangles and what is known of
//! the taxels as attributes. All is rounded to `f32`; what that would break is refused.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::{io::Write, path::Path};

use glam::DVec3;
use gltf::json::accessor::Accessor;
use gltf::json::buffer::Target;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Index, Mesh, Node};

use crate::id::{IdVec, VertexId};
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{file_kind, unfit};
use crate::io::gltf::writer::{Form, PatchNode, SceneWriter, Stored};
use crate::io::gltf::{SheetExtras, UNKNOWN_VARIANCE};
use crate::mesh::TriMesh;
use crate::numeric::narrow;
use crate::skin::{
    Covariance, Joints, LinkId, Modalities, RegionName, Skin, TaxelId, Taxels, names_of, scaled_joints,
};

/// Writes a skin as one file, binary or, if it ends in `gltf`, text with the arrays in a data URI: a
/// node for each link, and under it one for each of its patches.
///
/// Tangents become `TANGENT` with `w` 1, ids `_TAXEL_ID` (VEC2 of u16: low, high), areas `_AREA` (m^2), densities `_DENSITY`
/// (1/m^2), weights `_WEIGHT`, acuities `_ACUITY`, presence `_PRESENT` (0 absent, 1 present, 2 thermal pad, 3 another
/// sensor), regions `_REGION` and what taxels sense `_MODALITY` (0 none, else counted from 1 in
/// `extras.dermatome.regions` and `.modalities` of the mesh). Covariances become `_SIGMA`
/// (square root of their trace, in m) and `_COVARIANCE_0` (xx, xy, xz) with `_COVARIANCE_1` (yy,
/// yz, zz), in m^2. A patch that follows several links has a skin of glTF, whose joints are their nodes. Everything
/// is rounded to `f32`.
pub(crate) fn write_skin(output: &mut dyn Write, path: &Path, skin: &Skin) -> Result<()> {
    if skin.patches.is_empty() {
        return Err(unfit(path, "the skin", "no patch", "at least one"));
    }
    let mut writer = SceneWriter::new(path);
    let names = Names::of(skin.patches.iter().map(|patch| &patch.taxels));
    let mut nodes = Vec::new();
    for patch in &skin.patches {
        let mut sheet = SheetWriter::new(&mut writer, format!("patch {:?}", patch.name), &patch.mesh)?;
        sheet.taxels(&patch.taxels, patch.mesh.positions.len(), &names, Codes::Whole)?;
        let mut mesh = mesh(patch.name.clone(), sheet.finish());
        let ([regions, modalities], counted) = (names.known_to(&patch.taxels), patch.taxels.are_counted);
        let extras = SheetExtras { regions, modalities, counted };
        if extras != SheetExtras::default() {
            mesh.extras = writer.extras(&extras)?;
        }
        let node = node(patch.name.clone(), writer.root.push(mesh));
        let (joints, binds) = (joints_of(&patch.taxels), patch.taxels.binds.clone());
        nodes.push(PatchNode { link: patch.link, node, joints, binds });
    }
    writer.add_scene(None, &skin.links, &skin.links.map(|_| true), nodes)?;
    writer.add_animations(&skin.animations)?;
    writer.finish(output, if file_kind(path) == "gltf" { Form::Text } else { Form::Glb })
}

/// The largest share of the mean edge by which rounding to `f32` may move a position without a word.
const SMALL_ROUNDING: f64 = 0.01;

/// How far the rounding of glTF moves a position of a mesh at most, in m, if that changes its shape: where it lies
/// far from the origin of its link, so that more than a hundredth of the mean edge is lost.
pub fn rounding_in_gltf(mesh: &TriMesh) -> Option<f64> {
    let moved = mesh.positions.iter().map(|p| p.distance(p.as_vec3().as_dvec3())).fold(0.0, f64::max);
    let edges = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let length: f64 = edges.map(|[a, b]| mesh.positions[a].distance(mesh.positions[b])).sum();
    (moved * 3.0 * mesh.triangles.len() as f64 > SMALL_ROUNDING * length).then_some(moved)
}

/// The links that taxels follow, each once, rising; none if they only follow that of their patch.
pub(super) fn joints_of(taxels: &Taxels) -> Vec<LinkId> {
    let rows = taxels.joints.iter().flatten().flatten();
    let mut links: Vec<_> = rows.filter(|joint| joint.1 > 0.0).map(|joint| joint.0).collect();
    links.sort_unstable();
    links.dedup();
    links
}

pub(super) fn node(name: String, mesh: Index<Mesh>) -> Node {
    Node { name: Some(name), mesh: Some(mesh), ..Node::default() }
}

pub(super) fn mesh(name: String, primitive: Primitive) -> Mesh {
    Mesh { extensions: None, extras: None, name: Some(name), primitives: vec![primitive], weights: None }
}

/// Ids below this are exact in 32-bit floats.
const EXACT_IDS: u32 = 1 << 24;

/// How ids and presence are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codes {
    /// As integers: ids as VEC2 of u16.
    Whole,
    /// As 32-bit floats, which programs for meshes keep as attributes; larger ids as integers.
    Real,
}

/// The names that taxels of all patches have, which files count from 1 on.
pub(super) struct Names {
    regions: Vec<RegionName>,
    modalities: Vec<Modalities>,
}

impl Names {
    pub(super) fn of<'a>(patches: impl Iterator<Item = &'a Taxels> + Clone) -> Self {
        let regions = names_of(patches.clone().map(|taxels| &taxels.regions));
        Self { regions, modalities: names_of(patches.map(|taxels| &taxels.modalities)) }
    }

    /// The regions and modalities to list where these taxels have any.
    pub(super) fn known_to(&self, taxels: &Taxels) -> [Vec<String>; 2] {
        let list = |is_known: bool, names: &[Arc<str>]| {
            names.iter().filter(|_| is_known).map(ToString::to_string).collect()
        };
        let Self { regions, modalities } = self;
        [list(taxels.regions.is_some(), regions), list(taxels.modalities.is_some(), modalities)]
    }
}

/// Writes the arrays of one mesh, each checked for what `f32` and glTF cannot express.
pub(super) struct SheetWriter<'a, 'p> {
    writer: &'a mut SceneWriter<'p>,
    /// What it is called in errors.
    name: String,
    attributes: BTreeMap<Checked<Semantic>, Index<Accessor>>,
    corners: Index<Accessor>,
}

impl<'a, 'p> SheetWriter<'a, 'p> {
    pub(super) fn new(writer: &'a mut SceneWriter<'p>, name: String, mesh: &TriMesh) -> Result<Self> {
        mesh.validate()
            .map_err(|e| unfit(writer.path, &name, e.to_string(), "a mesh of finite triangles"))?;
        if mesh.triangles.is_empty() {
            return Err(unfit(writer.path, name, "no triangles", "at least one"));
        }
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.to_array().map(narrow)).collect();
        if let Some(v) = positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            let found = format!("vertex {v} at {}", mesh.positions[VertexId::new(v)]);
            return Err(unfit(writer.path, name, found, "a position within the range of f32"));
        }
        let position = writer.positions(&positions);
        let corners = mesh.triangles.as_slice().as_flattened().iter().map(|v| [v.raw()]);
        let corners = writer.array(Some(Target::ElementArrayBuffer), corners);
        let mut attributes = BTreeMap::new();
        attributes.insert(Checked::Valid(Semantic::Positions), position);
        Ok(Self { writer, name, attributes, corners })
    }

    /// Adds an attribute; `name` with its underscore, or one of glTF's own.
    pub(super) fn insert<S: Stored, const N: usize>(
        &mut self,
        name: &str,
        rows: impl ExactSizeIterator<Item = [S; N]>,
    ) {
        let semantic = match name {
            "NORMAL" => Semantic::Normals,
            "TANGENT" => Semantic::Tangents,
            "TEXCOORD_0" => Semantic::TexCoords(0),
            "JOINTS_0" => Semantic::Joints(0),
            "WEIGHTS_0" => Semantic::Weights(0),
            _ => Semantic::Extras(name.trim_start_matches('_').into()),
        };
        let rows = self.writer.array(Some(Target::ArrayBuffer), rows);
        self.attributes.insert(Checked::Valid(semantic), rows);
    }

    /// Adds what is known of taxels, their regions and modalities as numbers in lists of all `names`.
    pub(super) fn taxels(
        &mut self,
        taxels: &Taxels,
        vertices: usize,
        names: &Names,
        codes: Codes,
    ) -> Result<()> {
        taxels.validate(vertices).map_err(|e| self.unfit(e.to_string(), "one valid taxel per vertex"))?;
        self.frames(&taxels.normals, taxels.tangents.as_ref());
        let are_exact = taxels.ids.iter().all(|id| id.0 < EXACT_IDS);
        if codes == Codes::Real && are_exact {
            self.insert("_TAXEL_ID", taxels.ids.iter().map(|id| [narrow(id.0.into())]));
        } else {
            // Low half first.
            let halves = |id: &TaxelId| {
                let [a, b, c, d] = id.0.to_le_bytes();
                [u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])]
            };
            self.insert("_TAXEL_ID", taxels.ids.iter().map(halves));
        }
        self.positive("_AREA", &taxels.areas)?;
        if let Some(densities) = &taxels.densities {
            self.positive("_DENSITY", densities)?;
        }
        if let Some(weights) = &taxels.weights {
            self.scalars(("_WEIGHT", "an f32 of at least 0"), weights, |x| x >= 0.0)?;
        }
        if let Some(acuities) = &taxels.acuities {
            self.positive("_ACUITY", acuities)?;
        }
        match codes {
            Codes::Whole => self.insert("_PRESENT", taxels.presence.iter().map(|&p| [p.code()])),
            Codes::Real => self.insert("_PRESENT", taxels.presence.iter().map(|&p| [f32::from(p.code())])),
        }
        if let Some(of_taxels) = &taxels.regions {
            self.names("_REGION", of_taxels, &names.regions, codes)?;
        }
        if let Some(of_taxels) = &taxels.modalities {
            self.names("_MODALITY", of_taxels, &names.modalities, codes)?;
        }
        if let Some(joints) = &taxels.joints {
            self.joints(&joints_of(taxels), joints.as_slice())?;
        }
        taxels.covariances.as_ref().map_or(Ok(()), |covariances| self.covariances(covariances))
    }

    /// The numbers of the names of taxels, from 1 on; 0 for none.
    fn names(
        &mut self,
        attribute: &str,
        of_taxels: &IdVec<VertexId, Option<Arc<str>>>,
        names: &[Arc<str>],
        codes: Codes,
    ) -> Result<()> {
        if names.len() > usize::from(u16::MAX) {
            return Err(self.unfit(format!("{attribute} with {} names", names.len()), "less than 2^16"));
        }
        let numbers: HashMap<&Arc<str>, u16> = names.iter().zip(1..).collect();
        let number =
            |name: &Option<Arc<str>>| name.as_ref().and_then(|name| numbers.get(name)).map_or(0, |n| *n);
        match codes {
            Codes::Whole => self.insert(attribute, of_taxels.iter().map(|name| [number(name)])),
            Codes::Real => self.insert(attribute, of_taxels.iter().map(|name| [f32::from(number(name))])),
        }
        Ok(())
    }

    /// The links that vertices follow, by their numbers among `links`, all of them rising; what has no
    /// weight is 0.
    pub(super) fn joints(&mut self, links: &[LinkId], rows: &[Joints]) -> Result<()> {
        if links.len() > usize::from(u16::MAX) {
            return Err(self.unfit(format!("{} joints", links.len()), "less than 2^16"));
        }
        let rows: Vec<_> = rows.iter().map(|row| scaled_joints(row).unwrap_or(*row)).collect();
        let number = |(link, weight): (LinkId, f64)| {
            let number = links.binary_search(&link).ok().filter(|_| weight > 0.0);
            number.and_then(|number| u16::try_from(number).ok()).unwrap_or_default()
        };
        self.insert("JOINTS_0", rows.iter().map(|row| row.map(number)));
        self.insert("WEIGHTS_0", rows.iter().map(|row| row.map(|joint| narrow(joint.1))));
        Ok(())
    }

    /// Unit normals and tangents; `n x t` is the bitangent, so `w` is 1.
    pub(super) fn frames(
        &mut self,
        normals: &IdVec<VertexId, DVec3>,
        tangents: Option<&IdVec<VertexId, DVec3>>,
    ) {
        self.insert("NORMAL", normals.iter().map(|n| n.to_array().map(narrow)));
        if let Some(tangents) = tangents {
            self.insert("TANGENT", tangents.iter().map(|t| t.extend(1.0).to_array().map(narrow)));
        }
    }

    pub(super) fn positive(&mut self, name: &str, values: &IdVec<VertexId, f64>) -> Result<()> {
        self.scalars((name, "a positive f32"), values, |x| x > 0.0)
    }

    fn scalars(
        &mut self,
        (name, needed): (&str, &str),
        values: &IdVec<VertexId, f64>,
        is_good: fn(f32) -> bool,
    ) -> Result<()> {
        let fits = |x: f64| is_good(narrow(x)) && narrow(x).is_finite();
        if let Some((v, x)) = values.enumerate().find(|(_, x)| !fits(**x)) {
            return Err(self.unfit(format!("{name} {x} of vertex {v}"), needed));
        }
        self.insert(name, values.iter().map(|&x| [narrow(x)]));
        Ok(())
    }

    /// Covariances of positions, and the standard deviation that stands for each; [`UNKNOWN_VARIANCE`] where unknown.
    fn covariances(&mut self, covariances: &IdVec<VertexId, Option<Covariance>>) -> Result<()> {
        let known = || covariances.enumerate().filter_map(|(v, c)| Some((v, (*c)?)));
        let fits = |c: Covariance| <[f64; 6]>::from(c).iter().all(|x| narrow(*x).is_finite());
        if let Some((v, c)) = known().find(|(_, c)| !fits(*c)) {
            return Err(self.unfit(format!("covariance {c:?} of vertex {v}"), "finite f32"));
        }
        let none = f64::from(UNKNOWN_VARIANCE);
        let unknown = Covariance { xx: none, yy: none, zz: none, ..Covariance::default() };
        let sigma = |c: &Option<Covariance>| [c.map_or(UNKNOWN_VARIANCE, |c| narrow(c.sigma()))];
        let all = || covariances.iter().map(|c| c.unwrap_or(unknown));
        self.insert("_SIGMA", covariances.iter().map(sigma));
        self.insert("_COVARIANCE_0", all().map(|c| [c.xx, c.xy, c.xz].map(narrow)));
        self.insert("_COVARIANCE_1", all().map(|c| [c.yy, c.yz, c.zz].map(narrow)));
        Ok(())
    }

    pub(super) fn unfit(&self, found: String, needed: &str) -> IoError {
        unfit(self.writer.path, &self.name, found, needed)
    }

    pub(super) fn finish(self) -> Primitive {
        Primitive {
            attributes: self.attributes,
            extensions: None,
            extras: None,
            indices: Some(self.corners),
            material: None,
            mode: Checked::Valid(Mode::Triangles),
            targets: None,
        }
    }
}
