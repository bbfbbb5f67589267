//! Reads a map from glTF: the levels of each patch, with their maps and how they are joined.
//!
//! Only what cannot be turned into arrays is refused here; whether the arrays are a map is for
//! [`SkinMap::validate`] to decide.

use std::{collections::BTreeMap, path::Path};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::cut::{CutMesh, PlaceId};
use crate::flatten::Distortion;
use crate::id::{IdVec, VertexId};
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{Source, excerpt};
use crate::io::gltf::animation::read_animations;
use crate::io::gltf::body::read_extras;
use crate::io::gltf::document::Document;
use crate::io::gltf::joints::Binding;
use crate::io::gltf::nodes::read_node_tree;
use crate::io::gltf::primitive::{Attributes, Shape};
use crate::io::gltf::read_skin::{read_covariances, read_ids, read_names, read_presence};
use crate::io::gltf::rows::read_rows;
use crate::io::gltf::{FrameExtras, GENERATOR, LevelExtras, Notes, RowsExtras};
use crate::map::{ImageFrame, MapLevel, PatchMap, SkinMap};
use crate::mesh::TriMesh;
use crate::pyramid::{Level, LevelId};
use crate::skin::{LinkId, Presence, Taxels, in_tangent_plane};

/// Normals and tangents of `f32` are this near to unit length; those of 8-bit integers are not.
const ROUNDED: f64 = 1e-6;
/// How far texture coordinates may leave the unit square: by rounding, not in a wrapped texture.
const OUTSIDE: f64 = 1e-6;
/// Reads a map that [`crate::io::write_map`] wrote, or another program with the same names and
/// extras.
///
/// Rows of weights are scaled to sum 1 in `f64` again; taxels without `_PRESENT` are present, and
/// without `TANGENT` have no tangents; the distortion is measured anew.
///
/// # Errors
/// [`IoError::NoMap`] for a glTF file without a map, [`IoError::Rewritten`] for a map that another program
/// wrote anew and broke; if the file cannot be read, breaks a rule of glTF 2.0, or has a map that
/// [`SkinMap::validate`] refuses.
pub fn read_map(path: &Path) -> Result<SkinMap, IoError> {
    read(path, Source::open(path)?)
}

/// Reads a map from the content of a file.
///
/// # Errors
/// As [`read_map`].
pub fn map_from_bytes(bytes: Vec<u8>) -> Result<SkinMap, IoError> {
    let name = Path::new("map.glb");
    read(name, Source::from_bytes(name, bytes)?)
}

fn read(path: &Path, source: Source) -> Result<SkinMap> {
    let document = Document::new(source, Notes::new(true))?;
    let read = read_document(path, &document);
    let generator = document.root().asset.generator.as_deref().unwrap_or_default();
    if generator.is_empty() || generator.starts_with(GENERATOR) {
        return read;
    }
    let rewritten = |fault| IoError::Rewritten { path: path.into(), generator: excerpt(generator), fault };
    read.map_err(|fault| match fault {
        IoError::Invalid { element, found, needed, .. } => {
            rewritten(format!("{element}: found {found}; needed: {needed}"))
        }
        IoError::Map { source, .. } => rewritten(source.to_string()),
        other => other,
    })
}

fn read_document(path: &Path, document: &Document) -> Result<SkinMap> {
    let found = levels_by_patch(document)?;
    if !found.iter().flat_map(|patch| &patch.levels).any(|(_, extras)| extras.map.is_some()) {
        return Err(IoError::NoMap { path: path.into() });
    }
    let tree = read_node_tree(document)?;
    let mut links = BTreeMap::new();
    for placement in &tree.placements {
        if placement.stretch.is_some() {
            let (element, needed) =
                (format!("mesh {}", placement.mesh), "rigid nodes: map and skin are in metres");
            return Err(document.invalid(element, "a scaled or mirrored node", needed));
        }
        let binding = Binding::of(document, &tree, placement)?;
        links.insert(placement.mesh, (placement.link, binding));
    }
    let mut map =
        SkinMap { animations: read_animations(document, &tree).0, links: tree.links, ..SkinMap::default() };
    for patch in found {
        map.patches.push(read_patch(document, &links, patch)?);
    }
    (map.body, map.atlas) = read_extras(document)?;
    map.validate().map_err(|fault| IoError::Map { path: path.into(), source: Box::new(fault) })?;
    for patch in map.patches.iter_mut() {
        patch.levels.as_mut_slice().par_iter_mut().for_each(|map| {
            map.measure();
        });
    }
    Ok(map)
}

/// The meshes of one patch, finest first.
struct PatchFound {
    name: String,
    levels: Vec<(usize, LevelExtras)>,
}

/// Finds the levels of every patch, in the order of their finest meshes.
fn levels_by_patch(document: &Document) -> Result<Vec<PatchFound>> {
    let mut patches: Vec<PatchFound> = Vec::new();
    let mut by_name: BTreeMap<String, usize> = BTreeMap::new();
    for (mesh, json) in document.root().meshes.iter().enumerate() {
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
    for patch in &mut patches {
        patch.levels.sort_by_key(|(_, extras)| extras.level);
        let numbers: Vec<_> = patch.levels.iter().map(|(_, extras)| extras.level).collect();
        if numbers.iter().enumerate().any(|(k, &number)| number != k) {
            let (element, found) = (format!("patch {:?}", patch.name), format!("the levels {numbers:?}"));
            return Err(document.invalid(element, found, "each level once, from 0 on"));
        }
    }
    Ok(patches)
}

fn read_patch(
    document: &Document,
    links: &BTreeMap<usize, (LinkId, Option<Binding>)>,
    patch: PatchFound,
) -> Result<PatchMap> {
    let Some((link, binding)) = patch.levels.first().and_then(|(mesh, _)| links.get(mesh)) else {
        let (found, needed) = ("no node in the default scene", "a node that carries its level 0");
        return Err(document.invalid(format!("patch {:?}", patch.name), found, needed));
    };
    let mut taxels = Taxels::default();
    let mut levels = IdVec::<LevelId, MapLevel>::default();
    for (mesh, extras) in &patch.levels {
        levels.push(read_level(document, (*mesh, extras), binding.as_ref(), &mut taxels)?);
    }
    let sizes: Vec<_> = levels.iter().map(|map| map.level.mesh.positions.len()).collect();
    for (number, (_, extras)) in levels.ids().zip(&patch.levels) {
        let name = |what| format!("{}/L{number} {what}", patch.name);
        let rows = |what, given: Option<RowsExtras>, coarse: usize| {
            given.map(|given| read_rows(document, &name(what), given, coarse)).transpose()
        };
        let coarser = sizes.get(number.index() + 1).copied().unwrap_or_default();
        let from_coarser = rows("up", extras.up, coarser)?;
        let to_finest = rows("direct", extras.direct, sizes[number.index()])?;
        let origins = match extras.origins {
            Some(accessor) => {
                let origins = document.accessor(accessor, &name("origins"))?.integers::<1>()?;
                origins.into_iter().map(|[v]| VertexId::from(v)).collect()
            }
            None if number.index() == 0 => levels[number].level.mesh.positions.ids().collect(),
            None => {
                let needed = "the accessor of the level-0 vertex that each vertex is";
                return Err(document.invalid(name("origins"), "none", needed));
            }
        };
        check_places(document, &name("origins"), &levels, number, &origins)?;
        let level = &mut levels[number].level;
        (level.from_coarser, level.to_finest, level.origins) = (from_coarser, to_finest, origins);
    }
    let filled = patch.levels.first().map_or(0, |(_, extras)| extras.filled);
    let atlas = patch.levels.into_iter().next().and_then(|(_, extras)| extras.atlas);
    Ok(PatchMap { name: patch.name, link: *link, filled, taxels, levels, atlas })
}

/// The mesh and the map of one level, not yet measured nor joined; level 0 fills in the taxels.
fn read_level(
    document: &Document,
    (index, extras): (usize, &LevelExtras),
    binding: Option<&Binding>,
    taxels: &mut Taxels,
) -> Result<MapLevel> {
    let name = format!("{}/L{}", extras.patch, extras.level);
    let [primitive] = document.root().meshes[index].primitives.as_slice() else {
        return Err(document.invalid(name, "several primitives or none", "one"));
    };
    if Shape::of(primitive) != Shape::Triangles {
        return Err(document.invalid(name, "points or lines", "triangles"));
    }
    let attributes = Attributes::of(document, index, 0, primitive)?;
    let mesh = TriMesh::from_arrays(attributes.positions()?, &attributes.triangles(primitive)?);
    if mesh.triangles.is_empty() {
        return Err(document.invalid(name, "no triangles", "at least one"));
    }
    let areas: IdVec<_, _> = attributes.need("_AREA")?.reals(|[area]| area)?.into();
    let no_map = || document.invalid(&name, "a level without a map", "a map, as on other levels");
    let frame = read_frame(extras.map.as_ref().ok_or_else(no_map)?);
    let uv = read_uv(&attributes, &frame)?;
    if extras.level == 0 {
        let missing = || document.invalid(&name, "no NORMAL", "NORMAL");
        let normals: IdVec<VertexId, DVec3> =
            attributes.normals()?.ok_or_else(missing)?.into_iter().map(unit).collect();
        let tangents = attributes.tangents()?;
        let tangents =
            tangents.map(|all| all.into_iter().zip(&normals).map(|(t, &n)| tangent(t, n)).collect());
        let presence = attributes.read("_PRESENT", read_presence)?;
        let names = |attribute, names: &[String]| {
            attributes.read(attribute, |accessor| read_names(accessor, attribute, names))
        };
        let regions = names("_REGION", &extras.regions)?;
        let modalities = names("_MODALITY", &extras.modalities)?;
        let joints = binding.map_or(Ok(None), |binding| binding.joints(&attributes))?;
        *taxels = Taxels {
            binds: binding.map(|binding| binding.binds.clone()).unwrap_or_default(),
            are_counted: extras.counted,
            ids: read_ids(attributes.need("_TAXEL_ID")?)?.into(),
            normals,
            tangents,
            areas: areas.clone(),
            densities: attributes.scalars("_DENSITY")?.map(IdVec::from),
            weights: attributes.scalars("_WEIGHT")?.map(IdVec::from),
            acuities: attributes.scalars("_ACUITY")?.map(IdVec::from),
            presence: presence.map_or_else(|| areas.map(|_| Presence::Present), IdVec::from),
            covariances: read_covariances(&attributes)?.map(IdVec::from),
            joints: joints.map(IdVec::from),
            regions: regions.map(IdVec::from),
            modalities: modalities.map(IdVec::from),
        };
    }
    let whole = MapLevel {
        level: Level { mesh, areas, ..Level::default() },
        cut: None,
        uv,
        frame,
        distortion: Distortion::default(),
        convergence: None,
    };
    match extras.unsplit {
        None => Ok(whole),
        Some(accessor) => {
            let name = format!("{name} unsplit");
            let unsplit = document.accessor(accessor, &name)?.integers::<1>()?;
            let unsplit = unsplit.into_iter().map(|[v]| VertexId::from(v)).collect();
            let places = Places::new(document, &name, unsplit, whole.uv.len())?;
            if extras.level == 0 {
                *taxels = taxels.select(&places.first);
            }
            Ok(places.glue(whole))
        }
    }
}

/// Which vertices of a mesh that is cut open are copies of the same vertex.
struct Places {
    /// A vertex of the mesh for each vertex of the level.
    first: IdVec<VertexId, VertexId>,
    /// The place on the map that each vertex of the mesh is: those of `first` come first.
    place: IdVec<VertexId, PlaceId>,
    /// The vertex of the level that each place is.
    unsplit: IdVec<PlaceId, VertexId>,
}

impl Places {
    fn new(
        document: &Document,
        name: &str,
        given: IdVec<VertexId, VertexId>,
        vertices: usize,
    ) -> Result<Self, IoError> {
        if given.len() != vertices {
            let needed = format!("{vertices}, one per vertex");
            return Err(document.invalid(name, format!("{} entries", given.len()), needed));
        }
        let count = given.iter().map(|v| v.index() + 1).max().unwrap_or(0).min(vertices + 1);
        let mut first = IdVec::<VertexId, Option<VertexId>>::filled(None, count);
        for (at, &v) in given.enumerate() {
            if v.index() < count {
                first[v].get_or_insert(at);
            }
        }
        if let Some(missing) = first.iter().position(Option::is_none) {
            return Err(document.invalid(name, format!("no vertex {missing}"), "every vertex of the level"));
        }
        let first: IdVec<VertexId, VertexId> = first.into_iter().flatten().collect();
        let mut place = given.map(|&v| PlaceId::first_of(v));
        let mut unsplit: IdVec<PlaceId, VertexId> = first.ids().collect();
        for (at, &v) in given.enumerate() {
            if first[v] != at {
                place[at] = unsplit.push(v);
            }
        }
        Ok(Self { first, place, unsplit })
    }

    /// The level of a mesh that is cut open.
    fn glue(self, opened: MapLevel) -> MapLevel {
        let Self { first, place, unsplit } = self;
        let Level { mesh, areas, .. } = opened.level;
        let triangles: IdVec<_, _> = mesh.triangles.map(|t| t.map(|v| place[v]));
        let whole = TriMesh {
            positions: first.map(|&v| mesh.positions[v]),
            triangles: triangles.map(|t| t.map(|v| unsplit[v])),
        };
        let mut uv = opened.uv.clone();
        place.iter().zip(&opened.uv).for_each(|(&at, &position)| uv[at] = position);
        MapLevel {
            level: Level { mesh: whole, areas: first.map(|&v| areas[v]), ..Level::default() },
            cut: Some(CutMesh { triangles, unsplit }),
            uv,
            ..opened
        }
    }
}

/// A normal of unit length: glTF allows normals of 8-bit integers, which are not.
fn unit(normal: DVec3) -> DVec3 {
    if (normal.length() - 1.0).abs() > ROUNDED { normal.normalize_or_zero() } else { normal }
}

/// A unit tangent perpendicular to the normal. One along the normal stays as it is, to be refused.
fn tangent(tangent: DVec3, normal: DVec3) -> DVec3 {
    let is_off = (tangent.length() - 1.0).abs() > ROUNDED || tangent.dot(normal).abs() > ROUNDED;
    if is_off { in_tangent_plane(tangent, normal).unwrap_or(tangent) } else { tangent }
}

/// Map positions, in m.
fn read_uv(attributes: &Attributes<'_>, frame: &ImageFrame) -> Result<IdVec<PlaceId, DVec2>> {
    let accessor = attributes.need("TEXCOORD_0")?;
    let texture = accessor.reals(DVec2::from_array)?;
    let outside = |t: &DVec2| t.min_element() < -OUTSIDE || t.max_element() > 1.0 + OUTSIDE;
    if let Some(v) = texture.iter().position(outside) {
        let found = format!("TEXCOORD_0 {} of vertex {v}", texture[v]);
        return Err(accessor.invalid(found, "a position in the unit square"));
    }
    Ok(texture.into_iter().map(|t| frame.map_position(t)).collect())
}

fn read_frame(extras: &FrameExtras) -> ImageFrame {
    let (origin, size) = (DVec2::from_array(extras.origin), DVec2::from_array(extras.size));
    ImageFrame { origin, size, size_px: extras.pixels }
}

/// Refuses a vertex that is not where its taxel is: levels are nested, and both are rounded alike. (Whether
/// the taxels exist is for [`SkinMap::validate`] to decide.)
fn check_places(
    document: &Document,
    name: &str,
    levels: &IdVec<LevelId, MapLevel>,
    number: LevelId,
    origins: &IdVec<VertexId, VertexId>,
) -> Result<(), IoError> {
    let finest = &levels[LevelId::new(0)].level.mesh.positions;
    let here = &levels[number].level.mesh.positions;
    let is_off = |(v, at): (VertexId, &DVec3)| {
        origins.get(v).and_then(|&taxel| finest.get(taxel)).is_some_and(|taxel| taxel != at)
    };
    match here.enumerate().find(|&place| is_off(place)) {
        None => Ok(()),
        Some((v, at)) => {
            let found = format!("vertex {v} at {at}");
            Err(document.invalid(name, found, format!("the position of its taxel, {}", finest[origins[v]])))
        }
    }
}
