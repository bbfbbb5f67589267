//! Simulated touches: what truly happens in a recording.

use std::path::Path;

use crate::{
    io::{
        IoError,
        table::csv_table::{decimals, write_table},
    },
    signal::Touch,
    skin::Skin,
};

/// Writes what truly happens in a simulated recording: a row for each frame in which something is
/// touched.
///
/// `frame,time,press,patch,link,x,y,z,force,taxels,sphere_x,sphere_y,sphere_z`: `x,y,z` the centre
/// of pressure and `sphere_*` the centre of the sphere in the frame of the link, in m; `force` of
/// the whole contact, in N; `taxels` the number of working taxels that feel it.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
///
/// # Panics
/// If a touch names a patch that `skin` does not have.
pub fn write_touches(path: &Path, skin: &Skin, touches: &[Touch]) -> Result<(), IoError> {
    const HEADER: [&str; 13] = [
        "frame", "time", "press", "patch", "link", "x", "y", "z", "force", "taxels", "sphere_x", "sphere_y",
        "sphere_z",
    ];
    let mut rows = touches.iter().map(|touch| {
        let patch = &skin.patches[touch.patch];
        let link = skin.links[patch.link].name.clone();
        let mut row = vec![touch.frame.to_string()];
        row.extend(decimals([touch.time]));
        row.extend([touch.press.to_string(), patch.name.clone(), link]);
        row.extend(decimals(touch.centre.to_array().into_iter().chain([touch.force])));
        row.push(touch.taxels.to_string());
        row.extend(decimals(touch.sphere.to_array()));
        Ok(row)
    });
    write_table(path, &HEADER, &mut rows)
}
