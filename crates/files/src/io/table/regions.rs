//! Named regions of a map from a table of taxels, or from polygons on the map.

use std::collections::HashSet;
use std::path::Path;

use glam::DVec2;
use serde::Deserialize;

use crate::id::VertexId;
use crate::io::IoError;
use crate::io::file::{Source, file_kind, invalid};
use crate::io::table::by_taxel::{Homes, NotInSkin, Unused};
use crate::io::table::each_row_of;
use crate::map::SkinMap;
use crate::skin::{PatchId, Skin, is_region_name};

/// What can be the name of a region.
pub(in crate::io) const NAME_NEEDED: &str = "the name of a region, of 1 to 100 printable characters";

/// The longest file of polygons, in bytes.
const LONGEST: usize = 1 << 24;

/// A region of a file of polygons.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Polygon {
    patch: String,
    region: String,
    uv: Vec<[f64; 2]>,
}

/// Reads named regions into a map: a `.csv` with columns `taxel_id,region`, or a `.json` with polygons on the map of
/// level 0, `[{"patch": "palm", "region": "thumb", "uv": [[u, v], ...]}, ...]`, in m. Later ones win, also over those
/// that the map has. Returns the names of columns that are not used.
///
/// # Errors
/// If the file cannot be read, lacks a column or key, names an id twice, or an id, patch or place that is not one of
/// this map, or as [`SkinMap::set_region_in`].
pub fn read_regions(path: &Path, map: &mut SkinMap) -> Result<Vec<String>, IoError> {
    read_regions_with(path, map, &NotInSkin::default()).map(|unused| unused.columns)
}

/// As [`read_regions`]; rows and polygons of what the file of the skin has and the map has not are counted, and not used.
///
/// # Errors
/// As [`read_regions`].
pub fn read_regions_with(path: &Path, map: &mut SkinMap, others: &NotInSkin) -> Result<Unused, IoError> {
    match &*file_kind(path) {
        "json" => {
            let mut rows = 0;
            for (k, Polygon { patch, region, uv }) in polygons(path)?.into_iter().enumerate() {
                if others.patches.contains(&patch) && map.patches.iter().all(|of| of.name != patch) {
                    rows += 1;
                    continue;
                }
                let uv: Vec<DVec2> = uv.into_iter().map(DVec2::from_array).collect();
                map.set_region_in(&patch, &region, &uv).map_err(|fault| {
                    invalid(path, format!("polygon {k}"), fault.to_string(), "a region of this map")
                })?;
            }
            Ok(Unused { columns: Vec::new(), rows })
        }
        "csv" => {
            let homes = Homes::new(map.patches.enumerate().map(|(id, patch)| (id, &patch.taxels)));
            let (rows, unused) = table(path, &homes, others)?;
            for (taxel, region) in rows {
                map.set_regions([taxel], &region)
                    .map_err(|fault| invalid(path, "region", fault.to_string(), NAME_NEEDED))?;
            }
            Ok(unused)
        }
        _ => Err(IoError::UnknownKind { path: path.into(), known: ".csv, .json" }),
    }
}

/// Checks before a map is built of a skin what [`read_regions_with`] can refuse without the map: all but the corners of
/// polygons.
///
/// # Errors
/// As [`read_regions`].
pub fn check_regions(path: &Path, skin: &Skin, others: &NotInSkin) -> Result<(), IoError> {
    match &*file_kind(path) {
        "json" => {
            let known: HashSet<&str> = skin.patches.iter().map(|patch| &*patch.name).collect();
            let is_unknown = |polygon: &Polygon| {
                !known.contains(&*polygon.patch) && !others.patches.contains(&polygon.patch)
            };
            match polygons(path)?.iter().enumerate().find(|(_, polygon)| is_unknown(polygon)) {
                Some((k, polygon)) => {
                    let found = format!("patch {:?}", polygon.patch);
                    let first: Vec<&str> = skin.patches.iter().take(10).map(|patch| &*patch.name).collect();
                    Err(invalid(path, format!("polygon {k}"), found, format!("one of {}", first.join(", "))))
                }
                None => Ok(()),
            }
        }
        _ => {
            let homes = Homes::new(skin.patches.enumerate().map(|(id, patch)| (id, &patch.taxels)));
            table(path, &homes, others).map(drop)
        }
    }
}

/// The taxels of a table of regions with their names, and what is not used.
type Rows = (Vec<((PatchId, VertexId), String)>, Unused);

fn table(path: &Path, homes: &Homes, others: &NotInSkin) -> Result<Rows, IoError> {
    let (mut all, mut seen, mut rows) = (Vec::new(), HashSet::new(), 0);
    let columns = each_row_of(path, ["taxel_id", "region"], &mut |row, [id, region]| {
        if !is_region_name(row.text(region)) {
            return Err(row.invalid(region, NAME_NEEDED));
        }
        let Some(taxel) = homes.of_or_other(row, id, "the skin", others)? else {
            rows += 1;
            return Ok(());
        };
        if !seen.insert(taxel) {
            return Err(row.invalid(id, "an id that no earlier line names"));
        }
        all.push((taxel, row.text(region).to_owned()));
        Ok(())
    })?;
    match all.is_empty() && rows == 0 {
        true => Err(invalid(path, "table", "no row", "a row for each taxel of a region")),
        false => Ok((all, Unused { columns, rows })),
    }
}

fn polygons(path: &Path) -> Result<Vec<Polygon>, IoError> {
    let source = Source::open(path)?;
    if source.bytes().len() > LONGEST {
        let found = format!("{} bytes", source.bytes().len());
        return Err(source.invalid("file", found, format!("polygons in at most {LONGEST} bytes")));
    }
    let needed = r#"JSON: [{"patch": NAME, "region": NAME, "uv": [[u, v], ...]}, ...]"#;
    let polygons: Vec<Polygon> =
        serde_json::from_slice(source.bytes()).map_err(|e| source.invalid("file", e.to_string(), needed))?;
    if polygons.is_empty() {
        return Err(source.invalid("file", "no polygon", needed));
    }
    match polygons.iter().enumerate().find(|(_, polygon)| !is_region_name(&polygon.region)) {
        Some((k, Polygon { region, .. })) => {
            Err(source.invalid(format!("polygon {k}"), format!("{region:?}"), NAME_NEEDED))
        }
        None => Ok(polygons),
    }
}
