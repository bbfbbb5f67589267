//! Named regions of a map from a table of taxels, or from polygons on the map.

use std::collections::HashSet;
use std::path::Path;

use glam::DVec2;
use serde::Deserialize;

use crate::io::IoError;
use crate::io::file::{Source, file_kind, invalid};
use crate::io::table::by_taxel::Homes;
use crate::io::table::each_row_of;
use crate::map::SkinMap;
use crate::skin::is_region_name;

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
    match &*file_kind(path) {
        "json" => read_polygons(path, map).map(|()| Vec::new()),
        "csv" => read_table(path, map),
        _ => Err(IoError::UnknownKind { path: path.into(), known: ".csv, .json" }),
    }
}

fn read_table(path: &Path, map: &mut SkinMap) -> Result<Vec<String>, IoError> {
    let homes = Homes::new(map.patches.enumerate().map(|(id, patch)| (id, &patch.taxels)));
    let mut seen = HashSet::new();
    let unused = each_row_of(path, ["taxel_id", "region"], &mut |row, [id, region]| {
        let taxel = homes.of(row, id, "the skin")?;
        if !seen.insert(taxel) {
            return Err(row.invalid(id, "an id that no earlier line names"));
        }
        map.set_regions([taxel], row.text(region)).map_err(|_| row.invalid(region, NAME_NEEDED))
    })?;
    match seen.is_empty() {
        true => Err(invalid(path, "table", "no row", "a row for each taxel of a region")),
        false => Ok(unused),
    }
}

fn read_polygons(path: &Path, map: &mut SkinMap) -> Result<(), IoError> {
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
    for (k, Polygon { patch, region, uv }) in polygons.into_iter().enumerate() {
        if !is_region_name(&region) {
            return Err(source.invalid(format!("polygon {k}"), format!("{region:?}"), NAME_NEEDED));
        }
        let uv: Vec<DVec2> = uv.into_iter().map(DVec2::from_array).collect();
        map.set_region_in(&patch, &region, &uv).map_err(|fault| {
            source.invalid(format!("polygon {k}"), fault.to_string(), "a region of this map")
        })?;
    }
    Ok(())
}
