//! One level of each patch of a map, as it is exported.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use glam::{DAffine3, DVec2, DVec3};

use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::unfit;
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::numeric::narrow;
use crate::pyramid::LevelId;
use crate::skin::{LinkId, PatchId, Presence, TaxelId, link_names, world_pose};

/// One level of a patch.
pub(super) struct ExportPart<'a> {
    pub(super) id: PatchId,
    pub(super) patch: &'a PatchMap,
    /// The name of its link, which no other link has.
    pub(super) link: String,
    /// The frame of its link in the world.
    pub(super) pose: DAffine3,
    pub(super) level: LevelId,
    pub(super) at: &'a MapLevel,
    tangents: &'a IdVec<VertexId, DVec3>,
}

/// A vertex of a part: a taxel, or the centre of a field.
pub(super) struct Vertex {
    pub(super) id: TaxelId,
    pub(super) presence: Presence,
    pub(super) position: DVec3,
    pub(super) normal: DVec3,
    pub(super) tangent: DVec3,
    /// Its position on the map (m); on a seam, that of its first place.
    pub(super) uv: DVec2,
    pub(super) area: f64,
}

impl ExportPart<'_> {
    /// Its vertices in the order of the level.
    pub(super) fn vertices(&self) -> impl ExactSizeIterator<Item = Vertex> {
        let (level, taxels) = (&self.at.level, &self.patch.taxels);
        level.origins.enumerate().map(move |(v, &taxel)| Vertex {
            id: taxels.ids[taxel],
            presence: taxels.presence[taxel],
            position: level.mesh.positions[v],
            normal: taxels.normals[taxel],
            tangent: self.tangents[taxel],
            uv: self.at.uv[PlaceId::first_of(v)],
            area: level.areas[v],
        })
    }

    /// The corners of its faces.
    pub(super) fn faces(&self) -> &IdVec<FaceId, [VertexId; 3]> {
        &self.at.level.mesh.triangles
    }
}

/// The parts of a valid map on one level, or of a patch without it on its coarsest; errors are about the file `path`.
pub(super) fn parts_of<'a>(path: &Path, map: &'a SkinMap, level: LevelId) -> Result<Vec<ExportPart<'a>>> {
    map.validate().map_err(|fault| IoError::Map { path: path.into(), source: Box::new(fault) })?;
    if map.patches.is_empty() {
        return Err(unfit(path, "the map", "no patch", "at least one"));
    }
    let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or_default();
    if level.index() >= levels {
        let found = format!("levels 0 to {}", levels - 1);
        return Err(unfit(path, "the map", found, format!("level {level}")));
    }
    let links = distinct(link_names(&map.links));
    let part = |(id, patch): (PatchId, &'a PatchMap)| {
        let name = format!("patch {:?}", patch.name);
        let level = patch.nearest_level(level);
        let at = &patch.levels[level];
        let tangents = patch.taxels.tangents.as_ref();
        let tangents = tangents.ok_or_else(|| unfit(path, &name, "no tangents", "a map with tangents"))?;
        let (link, pose) = (links[patch.link.index()].clone(), world_pose(&map.links, patch.link));
        Ok(ExportPart { id, patch, link, pose, level, at, tangents })
    };
    map.patches.enumerate().map(part).collect()
}

/// The parts of each link that has some.
pub(super) fn by_link<'p, 'a>(parts: &'p [ExportPart<'a>]) -> BTreeMap<LinkId, Vec<&'p ExportPart<'a>>> {
    let mut links: BTreeMap<LinkId, Vec<&ExportPart<'a>>> = BTreeMap::new();
    parts.iter().for_each(|part| links.entry(part.patch.link).or_default().push(part));
    links
}

/// The same names, but that one which came before gets a number.
pub(super) fn distinct(names: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut taken: HashSet<String> = HashSet::new();
    // How often each name came: many links may share one.
    let mut counts: HashMap<String, usize> = HashMap::new();
    let own = |name: String| {
        let count = counts.entry(name.clone()).or_default();
        let mut own = name.clone();
        while !taken.insert(own.clone()) {
            *count += 1;
            own = format!("{name}_{}", *count + 1);
        }
        own
    };
    names.into_iter().map(own).collect()
}

/// Coordinates as simulators store them.
pub(super) fn narrowed(v: DVec3) -> [f32; 3] {
    v.to_array().map(narrow)
}
