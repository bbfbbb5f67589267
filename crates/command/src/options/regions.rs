//! Names of regions of the skin.

use std::path::{Path, PathBuf};

use dermatome::Error;
use dermatome::io::{NotInSkin, check_regions, file_kind, read_regions_with};
use dermatome::map::SkinMap;
use dermatome::skin::Skin;

use crate::console::notes::note_unused;
use crate::options::Common;

/// Names of regions of the skin.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct RegionsArgs {
    /// Name regions of the skin: `link` for the names of the links, a table with columns taxel_id,region, or polygons
    /// on the maps, .json (docs/files.md); may be given more than once, and later ones win
    #[arg(long = "regions", value_name = "R.csv|P.json|link", value_parser = region_source)]
    sources: Vec<RegionSource>,
}

/// Where the names of regions come from.
#[derive(Debug, Clone)]
pub(crate) enum RegionSource {
    Link,
    File(PathBuf),
}

fn region_source(text: &str) -> Result<RegionSource, String> {
    match text {
        "link" => Ok(RegionSource::Link),
        file if ["csv", "json"].contains(&&*file_kind(Path::new(file))) => {
            Ok(RegionSource::File(file.into()))
        }
        _ => Err("needed: link, or a file that ends in .csv or .json".into()),
    }
}

impl RegionsArgs {
    pub(crate) fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    /// Refuses before any work tables that cannot be used on the map of a skin.
    pub(crate) fn check(&self, skin: &Skin, others: &NotInSkin) -> Result<(), Error> {
        let files = self.sources.iter().filter_map(|source| match source {
            RegionSource::Link => None,
            RegionSource::File(path) => Some(path),
        });
        Ok(files.into_iter().try_for_each(|path| check_regions(path, skin, others))?)
    }

    /// Names the regions of a map.
    pub(crate) fn apply(&self, map: &mut SkinMap, common: &Common) -> Result<(), Error> {
        self.apply_with(map, &NotInSkin::default(), common)
    }

    /// As [`Self::apply`], of a map that has not all that its file has.
    pub(crate) fn apply_with(
        &self,
        map: &mut SkinMap,
        others: &NotInSkin,
        common: &Common,
    ) -> Result<(), Error> {
        for source in &self.sources {
            match source {
                RegionSource::Link => map.set_regions_by_link()?,
                RegionSource::File(path) => note_unused(path, &read_regions_with(path, map, others)?, common),
            }
        }
        Ok(())
    }
}
