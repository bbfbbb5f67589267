//! How links move: tables of their poses, or animations of glTF files.

use std::{collections::HashSet, path::Path};

use glam::DAffine3;

use crate::{
    id::IdVec,
    io::{
        IoError,
        file::source::{Source, kind},
        gltf::read_animation,
        table::csv_table::Table,
    },
    skin::{LinkId, Motion, MotionFrame},
};

/// Columns of programs whose poses may be scaled.
const SCALES: [&str; 4] = ["scale", "sx", "sy", "sz"];
/// How far a scale may be from 1 by rounding.
const ROUNDED: f64 = 1e-6;

/// Reads how the links that `link_named` knows move.
///
/// A glTF file (`.glb`, `.gltf`) has animations: the one called `animation` is read, or its only one.
/// Nodes are found by their names; those that are not known are left out.
///
/// Any other file is a table of poses in the world: columns `link,x,y,z,qx,qy,qz,qw` and optionally
/// `time`, in any order, in m, s and unit quaternions, rows in any order. Without `time` a link has one
/// pose for all times.
///
/// # Errors
/// If the file cannot be read. Of an animation, if it is not there, breaks a rule of glTF 2.0, or
/// does more than move links rigidly. Of a table, if an animation is asked for, a column is
/// missing, a cell is not a finite number, a quaternion is not of unit length, a scale (`scale`, `sx`,
/// `sy` or `sz`) is not 1, or a link is unknown or comes twice at one time.
pub fn read_motion(
    path: &Path,
    animation: Option<&str>,
    link_named: &dyn Fn(&str) -> Option<LinkId>,
) -> Result<Motion, IoError> {
    if matches!(kind(path).as_str(), "glb" | "gltf") {
        return read_animation(path, animation, link_named);
    }
    let source = Source::open(path)?;
    if let Some(name) = animation {
        let needed = format!("a .glb or .gltf with the animation {name:?}");
        return Err(source.invalid("the file", "a table of poses", needed));
    }
    let table = Table::of(&source)?;
    let link = table.columns.need("link")?;
    let time = table.columns.find("time");
    let position = table.columns.need_vector(["x", "y", "z"])?;
    let rotation = table.columns.need_vector(["qx", "qy", "qz", "qw"])?;
    let scales: Vec<_> = SCALES.iter().filter_map(|name| table.columns.find(name)).collect();
    let mut keys = IdVec::<LinkId, Vec<(f64, DAffine3)>>::default();
    let mut seen = HashSet::new();
    table.each_row(&mut |row| {
        let pose = DAffine3::from_rotation_translation(row.rotation(rotation)?, row.vector(position)?);
        for &scale in &scales {
            if (row.number(scale)? - 1.0).abs() > ROUNDED {
                return Err(row.invalid(scale, "1: links are rigid; scale the skin when its map is built"));
            }
        }
        let at = time.map_or(Ok(0.0), |time| row.number(time))?;
        let found = link_named(row.text(link));
        let found = found.ok_or_else(|| row.invalid(link, "the name of a link of the map"))?;
        // Adding 0 makes -0 the same.
        if !seen.insert((found, (at + 0.0).to_bits())) {
            return Err(row.invalid(link, "each link once, or once at each time"));
        }
        while keys.len() <= found.index() {
            keys.push(Vec::new());
        }
        keys[found].push((at, pose));
        Ok(())
    })?;
    let mut motion = Motion::default();
    for (link, keys) in keys.enumerate().filter(|(_, keys)| !keys.is_empty()) {
        let invalid = |error| source.invalid(format!("{link}"), format!("{error}"), "rigid poses");
        motion.set(link, MotionFrame::World, keys).map_err(invalid)?;
    }
    Ok(motion)
}
