//! What answers need of a map: its index, and the names and levels of its patches.

use std::path::Path;

use dermatome::Error;
use dermatome::body::Body;
use dermatome::contact::{Cell, LiveTaxels};
use dermatome::id::IdVec;
use dermatome::io::{MotionFile, read_motion};
use dermatome::map::{FieldRegions, SkinMap};
use dermatome::pyramid::LevelId;
use dermatome::skin::{LinkId, Motion, PatchId, link_names, world_pose};
use glam::DAffine3;
use glob::Pattern;

use crate::console::errors::advise;
use crate::console::notes::{first_names, note, note_columns};
use crate::console::print::plain;
use crate::files::input::{is_gltf, read_map_first, select_patches};
use crate::lookup::fields::Fields;
use crate::options::{Common, JointsArg, LevelArg, RegionsArgs};

pub(super) struct Robot {
    pub(super) map: SkinMap,
    pub(super) links: IdVec<LinkId, String>,
    pub(super) patches: IdVec<PatchId, String>,
    pub(super) live: LiveTaxels,
    pub(super) carries: IdVec<LinkId, bool>,
    /// Whether it carries one in the file, chosen or not.
    pub(super) has_skin: IdVec<LinkId, bool>,
    pub(super) levels: Vec<LevelId>,
    /// The chosen levels without a mesh.
    pub(super) fields: Vec<Fields>,
    regions: FieldRegions,
}

fn carries(map: &SkinMap) -> IdVec<LinkId, bool> {
    map.links.ids().map(|id| map.patches.iter().any(|patch| patch.link == id)).collect()
}

impl Robot {
    /// Reads a map, and chooses among its patches and levels; none: all.
    pub(super) fn read(
        path: &Path,
        patches: &[Pattern],
        chosen: &[LevelArg],
        regions: &RegionsArgs,
        common: &Common,
    ) -> anyhow::Result<Self> {
        let mut map = read_map_first(path)?;
        regions.apply(&mut map, common)?;
        let has_skin = carries(&map);
        let (of_patches, named) = LevelArg::sort(chosen, Some(&map))?;
        let mut fields = Vec::new();
        if !named.is_empty() {
            let names = map.patches.iter().map(|patch| patch.name.clone()).collect();
            let names = select_patches(path, names, patches, |name: &String| name)?;
            let is_chosen = |id| names.contains(&map.patches[id].name);
            fields = named.into_iter().map(|level| Fields::new(&map, level, is_chosen)).collect();
        }
        let all = map.patches.into_iter().collect();
        // What joins patches numbers all of them.
        map.body = Body::default();
        map.patches = select_patches(path, all, patches, |patch| &patch.name)?.into();
        let most = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0);
        if let Some(level) = of_patches.iter().find(|level| level.index() >= most) {
            let last = most.saturating_sub(1);
            let what = format!("the map has no level {level}; its levels are 0 to {last}");
            return Err(advise(what, "leave out --level to get all of them"));
        }
        for patch in &map.patches {
            let levels = patch.levels.len();
            if of_patches.iter().any(|level| level.index() >= levels) {
                let what = format!("{} has {levels} levels", plain(&patch.name));
                note!(common, "{what}; contacts on it get the row of the last one for levels above");
            }
        }
        let levels = (0..most).map(LevelId::new).filter(|k| chosen.is_empty() || of_patches.contains(k));
        Ok(Self {
            carries: carries(&map),
            has_skin,
            links: link_names(&map.links),
            patches: map.patches.map(|patch| patch.name.clone()),
            live: LiveTaxels::new(&map),
            levels: levels.collect(),
            fields,
            regions: FieldRegions::new(&map),
            map,
        })
    }

    /// The levels of which a patch gives rows: for those that it does not reach up to its coarsest, each once.
    pub(super) fn levels_of(&self, patch: PatchId) -> impl Iterator<Item = LevelId> + use<'_> {
        let (patch, mut last) = (&self.map.patches[patch], None);
        let levels = self.levels.iter().map(|&level| patch.nearest_level(level));
        levels.filter(move |&level| last.replace(level) != Some(level))
    }

    /// The name of the region of a field.
    pub(super) fn region(&self, patch: PatchId, cell: &Cell) -> Option<&str> {
        self.regions.name(patch, cell.level, cell.field)
    }

    /// How the links move: the poses of a table, or an animation of a glTF file, by default of the
    /// map.
    pub(super) fn motion(
        &self,
        map: &Path,
        pose: Option<&Path>,
        animation: Option<&str>,
        common: &Common,
    ) -> anyhow::Result<Option<Motion>> {
        let own = self.map.animations.iter().find(|own| Some(own.name.as_str()) == animation);
        let (path, read) = match (pose, own) {
            (None, None) if animation.is_none() => return Ok(None),
            (None, Some(own)) => (map, MotionFile { motion: own.clone(), unused: Vec::new() }),
            (Some(path), _) if animation.is_some() && !is_gltf(path) => {
                let what = format!("{} has no animation", path.display());
                return Err(advise(what, "give --pose a .glb or .gltf, or leave out --animation"));
            }
            (path, _) => {
                let path = path.unwrap_or(map);
                (path, read_motion(path, animation, &self.map.links).map_err(Error::from)?)
            }
        };
        note_unused(path, &read, common);
        Ok(Some(read.motion))
    }

    /// How the links move where the joints of a robot have some values; none: 0.
    pub(super) fn joint_motion(
        &self,
        path: &Path,
        joints: Option<&JointsArg>,
        common: &Common,
    ) -> anyhow::Result<Motion> {
        let motion = JointsArg::motion(joints, path, &self.map.links, common)?;
        if motion.times().is_none() {
            note!(common, "{}: no link of the map has the name of one of its links", path.display());
        }
        Ok(motion)
    }

    /// Whether a link is a frame of its own: it has skin, or another pose than the world.
    pub(super) fn is_apart(&self, link: LinkId) -> bool {
        self.has_skin[link] || world_pose(&self.map.links, link) != DAffine3::IDENTITY
    }

    /// The link that carries all patches, if one does.
    pub(super) fn only_link(&self) -> Option<LinkId> {
        let mut links = self.map.patches.iter().map(|patch| patch.link);
        let first = links.next()?;
        links.all(|link| link == first).then_some(first)
    }
}

/// Says what of a file changes no pose.
fn note_unused(path: &Path, read: &MotionFile, common: &Common) {
    let name = path.display();
    if !is_gltf(path) {
        note_columns(path, &read.unused, common);
    } else if !read.unused.is_empty() {
        let nodes = first_names(&read.unused);
        note!(common, "{name}: the map has no link for the animated {nodes}");
    }
    if read.motion.times().is_none() {
        note!(common, "{name}: the animation moves no link of the map");
    }
}
