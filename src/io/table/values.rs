//! Tables of values on taxels and receptive fields.

use std::{io::Write, path::Path};

use csv::Writer;

use crate::{
    io::{IoError, file::cannot_write, table::csv_table::table_write_error},
    map::SkinMap,
    pyramid::LevelId,
    signal::{Channel, LevelFrame},
    skin::PatchId,
};

/// Writes the values of some levels: `patch,level,vertex,taxel_id`, then a column for each channel,
/// as `force[N]` where its unit is known.
///
/// A row for each vertex: on level 0 a taxel, above it a field, whose `taxel_id` is that of its
/// centre. Cells without a value are empty. Decimals are the shortest that read back as the same
/// `f64`. Errors call the output `path`.
///
/// # Errors
/// [`IoError::Write`].
///
/// # Panics
/// If the frame or a level is not one of `map`.
pub fn write_values(
    path: &Path,
    output: impl Write,
    map: &SkinMap,
    (frame, channels): (&LevelFrame, &[Channel]),
    levels: &[(PatchId, LevelId)],
) -> Result<(), IoError> {
    let fail = |e| table_write_error(path, e);
    let mut table = Writer::from_writer(output);
    let names = channels.iter().map(|Channel { name, unit, .. }| match unit.as_str() {
        "" => name.clone(),
        unit => format!("{name}[{unit}]"),
    });
    let first = ["patch", "level", "vertex", "taxel_id"].map(str::to_owned);
    table.write_record(first.into_iter().chain(names)).map_err(fail)?;
    for &(id, level) in levels {
        let patch = &map.patches[id];
        for (vertex, &taxel) in patch.levels[level].level.origins.enumerate() {
            let place = [level.to_string(), vertex.to_string(), patch.taxels.ids[taxel].to_string()];
            let cell = |values: f64| if values.is_nan() { String::new() } else { values.to_string() };
            let values = frame.values[id].iter().map(|channel| cell(channel[level][vertex]));
            let row = [patch.name.clone()].into_iter().chain(place).chain(values);
            table.write_record(row).map_err(fail)?;
        }
    }
    table.flush().map_err(cannot_write(path))
}
