//! How links move: tables of their poses, or animations of glTF files.

use std::{
    collections::{BTreeSet, HashSet},
    path::Path,
};

use glam::DAffine3;

use crate::id::IdVec;
use crate::io::IoError;
use crate::io::file::{Source, file_kind};
use crate::io::gltf::read_animation;
use crate::io::table::{Table, each_row_of};
use crate::skin::{Link, LinkId, Motion, MotionFrame, link_names};

const COLUMNS: [&str; 13] =
    ["link", "time", "x", "y", "z", "qx", "qy", "qz", "qw", SCALES[0], SCALES[1], SCALES[2], SCALES[3]];
/// Columns of programs whose poses may be scaled.
const SCALES: [&str; 4] = ["scale", "sx", "sy", "sz"];
/// How far a scale may be from 1 by rounding.
const ROUNDED: f64 = 1e-6;

/// A file of how links move.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MotionFile {
    /// The poses of the links.
    pub motion: Motion,
    /// Names of what is not used: columns of a table; nodes that an animation moves and that are not
    /// links.
    pub unused: Vec<String>,
}

/// Reads how the `links` of a map move; they are found by their [names](link_names).
///
/// A glTF file (`.glb`, `.gltf`) has animations: the one called `animation` is read, or its only one.
/// Nodes with other names are left out; where they stand still between a link and its parent, the
/// link moves as in the file.
///
/// Any other file is a table of poses in the world: columns `link,x,y,z,qx,qy,qz,qw` and optionally
/// `time`, in any order, in m, s and unit quaternions. Without `time` a link has one
/// pose for all times. Times of a link may fall from row to row only to times that no other run of its rows covers: two recordings
/// whose clock began anew are not one motion.
///
/// # Errors
/// If the file cannot be read, or several links have a name that it uses. Of an animation, if it is not
/// there, breaks a rule of glTF 2.0, or does more than move links rigidly. Of a table, if an animation
/// is requested, a column is missing, there are no rows, a cell is not a finite number, a quaternion is
/// not of unit length, a scale (`scale`, `sx`, `sy` or `sz`) is not 1, a link is unknown or comes
/// twice at one time, or its times begin anew.
pub fn read_motion(
    path: &Path,
    animation: Option<&str>,
    links: &IdVec<LinkId, Link>,
) -> Result<MotionFile, IoError> {
    if matches!(file_kind(path).as_str(), "glb" | "gltf") {
        let (motion, unused) = read_animation(path, animation, links)?;
        return Ok(MotionFile { motion, unused });
    }
    let source = Source::open(path)?;
    if let Some(name) = animation {
        let needed = format!("a .glb or .gltf with the animation {name:?}");
        return Err(source.invalid("the file", "a table of poses", needed));
    }
    read_poses(&source, &link_names(links))
}

/// The names of the links of which a table has poses; none of a glTF file.
///
/// # Errors
/// If the file cannot be read, or the column `link` is missing.
pub fn read_link_names(path: &Path) -> Result<BTreeSet<String>, IoError> {
    let mut names = BTreeSet::new();
    if matches!(file_kind(path).as_str(), "glb" | "gltf") {
        return Ok(names);
    }
    each_row_of(path, ["link"], &mut |row, [link]| {
        names.insert(row.text(link).to_owned());
        Ok(())
    })?;
    Ok(names)
}

fn read_poses(source: &Source, names: &IdVec<LinkId, String>) -> Result<MotionFile, IoError> {
    let table = Table::of(source)?;
    let unused = table.columns.unused(&COLUMNS);
    let link = table.columns.need("link")?;
    let time = table.columns.find_time()?;
    let position = table.columns.need_vector(["x", "y", "z"])?;
    let rotation = table.columns.need_vector(["qx", "qy", "qz", "qw"])?;
    let scales: Vec<_> = SCALES.iter().filter_map(|name| table.columns.find(name)).collect();
    let mut keys = IdVec::<LinkId, Vec<(f64, DAffine3)>>::default();
    let mut lines = IdVec::<LinkId, Vec<(f64, usize)>>::default();
    let mut seen = HashSet::new();
    table.each_row(&mut |row| {
        let pose = DAffine3::from_rotation_translation(row.rotation(rotation)?, row.vector(position)?);
        for &scale in &scales {
            if (row.number(scale)? - 1.0).abs() > ROUNDED {
                return Err(row.invalid(scale, "1: links are rigid; scale the skin when its map is built"));
            }
        }
        let at = time.map_or(Ok(0.0), |time| row.time(time))?;
        let name = row.text(link);
        let found = match names.ids().filter(|&link| names[link] == name).collect::<Vec<_>>()[..] {
            [] => return Err(row.invalid(link, "the name of a link of the map")),
            [found] => found,
            ref several => {
                let needed = format!("a name of one link: {} links of the map have it", several.len());
                return Err(row.invalid(link, needed));
            }
        };
        // Adding 0 makes -0 the same.
        if !seen.insert((found, (at + 0.0).to_bits())) {
            return Err(row.invalid(link, "each link once, or once at each time"));
        }
        while keys.len() <= found.index() {
            keys.push(Vec::new());
        }
        keys[found].push((at, pose));
        while lines.len() <= found.index() {
            lines.push(Vec::new());
        }
        lines[found].push((at, row.at.line));
        Ok(())
    })?;
    if keys.is_empty() {
        return Err(source.invalid(
            "the table",
            "no row below the names of its columns",
            "the pose of a link",
        ));
    }
    if let Some(line) = lines.iter().filter_map(|lines| begins_anew(lines)).min() {
        return Err(source.invalid((line, ""), BEGINS_ANEW, ONE_CLOCK));
    }
    let mut motion = Motion::default();
    for (link, keys) in keys.enumerate().filter(|(_, keys)| !keys.is_empty()) {
        let invalid = |error| source.invalid(format!("{link}"), format!("{error}"), "rigid poses");
        motion.set(link, MotionFrame::World, keys).map_err(invalid)?;
    }
    Ok(MotionFile { motion, unused })
}

/// What is said of rows whose times [begin anew](begins_anew).
pub(super) const BEGINS_ANEW: &str = "a time before that of the row above, among times of other rows";
pub(super) const ONE_CLOCK: &str = "the times of one run of the clock";

/// The line at which times begin anew: they fall, and what follows is among times of rows elsewhere. Rows are times in s and lines.
pub(super) fn begins_anew(rows: &[(f64, usize)]) -> Option<usize> {
    let mut runs: Vec<&[(f64, usize)]> = rows.chunk_by(|a, b| a.0 <= b.0).collect();
    runs.sort_by(|a, b| a[0].0.total_cmp(&b[0].0));
    let overlap = |pair: &[&[(f64, usize)]]| {
        let is_over = pair[0].last().is_some_and(|last| pair[1][0].0 < last.0);
        is_over.then(|| pair[0][0].1.max(pair[1][0].1))
    };
    runs.windows(2).filter_map(overlap).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows may stand in another order; two runs of one clock may not.
    #[test]
    fn times_that_begin_anew_are_found() {
        let found = |times: &[f64]| begins_anew(&times.iter().copied().zip(2..).collect::<Vec<_>>());
        for times in [
            &[0.0, 1.0, 2.0][..],
            &[2.0, 0.0],
            &[2.0, 1.0, 0.0],
            &[3.0, 4.0, 0.0, 1.0],
            &[0.0, 1.0, 1.0],
            &[],
        ] {
            assert_eq!(found(times), None, "{times:?}");
        }
        assert_eq!(found(&[0.0, 1.0, 2.0, 0.0, 1.0]), Some(5));
        assert_eq!(found(&[0.0, 1.0, 2.0, 0.5, 1.5]), Some(5));
    }
}
