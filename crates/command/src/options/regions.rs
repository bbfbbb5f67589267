//! Names of regions of the skin.

use std::path::{Path, PathBuf};

use dermatome::Error;
use dermatome::io::{file_kind, read_regions};
use dermatome::map::SkinMap;

use crate::console::notes::note_columns;
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

    /// Names the regions of a map.
    pub(crate) fn apply(&self, map: &mut SkinMap, common: &Common) -> Result<(), Error> {
        for source in &self.sources {
            match source {
                RegionSource::Link => map.set_regions_by_link()?,
                RegionSource::File(path) => note_columns(path, &read_regions(path, map)?, common),
            }
        }
        Ok(())
    }
}
