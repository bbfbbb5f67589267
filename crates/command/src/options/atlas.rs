//! The map of another skin that a map is drawn on.

use std::path::Path;
use std::sync::Arc;

use dermatome::Error;
use dermatome::cut::Cut;
use dermatome::io::{NotInSkin, map_hash, read_landmarks_with, read_map};
use dermatome::map::SkinMap;
use dermatome::pipeline::{BuildOptions, Built};
use dermatome::registration::{Landmarks, Onto, Registered, carried_seams};
use dermatome::run::Run;
use dermatome::skin::{Skin, Taxels};

use crate::console::errors::advise;
use crate::console::notes::{note, note_unused};
use crate::console::print::plain_sentence;
use crate::options::Common;
use crate::options::paths::{InPath, LandmarkSource, landmark_source};

/// The map of another skin that a map is drawn on.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct AtlasArgs {
    /// Draw the map on that of another skin (docs/atlas.md)
    #[arg(long, help_heading = "Map", value_name = "MAP", requires = "landmarks")]
    atlas: Option<InPath>,
    /// Places of both: taxel_id,atlas_taxel_id, or those of regions
    #[arg(long, value_name = "L.csv|regions", value_parser = landmark_source, requires = "atlas", help_heading = "Map")]
    landmarks: Option<LandmarkSource>,
    /// The skin is that of the other hand: draw it on the mirror image of the atlas
    #[arg(long, requires = "atlas", help_heading = "Map", hide_short_help = true)]
    mirror: bool,
}

/// A map that others are drawn on, with its name.
pub(crate) struct AtlasMap {
    name: String,
    map: SkinMap,
    hash: u64,
}

impl AtlasArgs {
    /// Reads the map of the other skin, if one is asked for.
    pub(crate) fn read(&self) -> Result<Option<AtlasMap>, Error> {
        let Some(path) = &self.atlas else { return Ok(None) };
        let map = read_map(path)?;
        Ok(Some(AtlasMap { name: atlas_name(path), hash: map_hash(&map)?, map }))
    }

    /// The seams of the atlas on the closed patches of a skin: how to cut it, unless that is given.
    pub(crate) fn seams(
        &self,
        atlas: &AtlasMap,
        skin: &Skin,
        others: &NotInSkin,
        common: &Common,
    ) -> anyhow::Result<Option<Cut>> {
        let common = Common { quiet: true, ..common.clone() };
        let own = skin.patches.iter().map(|patch| (&*patch.name, &patch.taxels));
        let Some(landmarks) = self.landmarks(own, atlas, others, &common)? else { return Ok(None) };
        let seams = carried_seams(skin, &self.onto(atlas, &landmarks)).map_err(Error::from)?;
        Ok(seams.iter().any(|edges| !edges.is_empty()).then_some(Cut::Edges(seams)))
    }

    /// What is the same on the atlas and on a skin with these patches.
    fn landmarks<'a>(
        &self,
        own: impl IntoIterator<Item = (&'a str, &'a Taxels)>,
        atlas: &AtlasMap,
        others: &NotInSkin,
        common: &Common,
    ) -> anyhow::Result<Option<Landmarks>> {
        Ok(match &self.landmarks {
            Some(LandmarkSource::File(path)) => {
                let (rows, unused) =
                    read_landmarks_with(path, own, &atlas.map, others).map_err(Error::from)?;
                note_unused(path, &unused, common);
                Some(Landmarks::Taxels(rows))
            }
            Some(LandmarkSource::Regions) => Some(Landmarks::Regions),
            None => None,
        })
    }

    /// Draws a map that was built on that of the other skin.
    pub(crate) fn apply(
        &self,
        atlas: &AtlasMap,
        built: &mut Built,
        skin: &Skin,
        options: &BuildOptions,
        others: &NotInSkin,
        common: &Common,
    ) -> anyhow::Result<()> {
        let map = Arc::clone(&built.map);
        let own = map.patches.iter().map(|patch| (&*patch.name, &patch.taxels));
        let Some(landmarks) = self.landmarks(own, atlas, others, common)? else { return Ok(()) };
        if landmarks == Landmarks::Regions {
            for (map, whose) in [(&*map, "the skin"), (&atlas.map, "the atlas")] {
                if map.regions().names.is_empty() {
                    let what = format!("--landmarks regions, but {whose} has no named region");
                    return Err(advise(what, "name them with --regions, or give a table of landmarks"));
                }
            }
        }
        let run = Run::default().counting(&common.steps);
        note_registered(&built.register(skin, options, &self.onto(atlas, &landmarks), run)?, common);
        Ok(())
    }

    fn onto<'a>(&self, atlas: &'a AtlasMap, landmarks: &'a Landmarks) -> Onto<'a> {
        let AtlasMap { name, map, hash } = atlas;
        Onto { atlas: map, name, hash: *hash, landmarks, is_mirrored: self.mirror }
    }
}

/// The name of a map for people: that of its file, or of the folder of a `map.glb`.
fn atlas_name(path: &Path) -> String {
    let folder = path.parent().filter(|_| path.file_stem().is_some_and(|stem| stem == "map"));
    let named = folder.and_then(Path::file_name).or(path.file_stem());
    named.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

fn note_registered(registered: &Registered, common: &Common) {
    registered.remarks().iter().for_each(|remark| note!(common, "{}", plain_sentence(remark)));
    registered.patches.iter().for_each(|patch| note!(common, "{}", plain_sentence(&patch.to_string())));
}
