//! What a skin loses in a file that cannot keep all of it.

use std::path::Path;

use dermatome::{io::kind, skin::Skin};

use crate::Common;

/// Tells what a skin loses in the kind of file that a path names.
pub(crate) fn remark_lost(path: &Path, skin: &Skin, common: &Common) {
    for lost in lost(path, skin).into_iter().filter(|_| !common.quiet) {
        eprintln!("note: {}: {lost}; .glb keeps everything", path.display());
    }
}

/// What a skin loses there: its frames and names, and its covariances.
fn lost(path: &Path, skin: &Skin) -> Vec<&'static str> {
    let kind = kind(path);
    let covariances = matches!(kind.as_str(), "json" | "obj" | "ply" | "stl")
        && skin.patches.iter().any(|patch| patch.taxels.covariances.is_some());
    let covariances = covariances.then_some("how uncertain the taxels are is lost");
    lost_frames(&kind, skin).into_iter().chain(covariances).collect()
}

fn lost_frames(kind: &str, skin: &Skin) -> Option<&'static str> {
    let is_one_body = skin.patches.iter().all(|patch| patch.link == skin.patches[0.into()].link);
    let is_bare = skin.links.len() <= 1
        && skin.links.iter().all(|l| l.name.is_empty() && l.pose.abs_diff_eq(glam::DAffine3::IDENTITY, 0.0));
    match kind {
        "json" if !is_one_body => Some("robotskinlib has one link: positions are in the world"),
        "json" if skin.patches.len() > 1 => Some("robotskinlib has one patch: its pieces lose their names"),
        "obj" => Some("OBJ keeps no taxel ids and no link frames: positions are in the world"),
        "ply" if !is_bare || skin.patches.len() > 1 => {
            Some("PLY keeps no names and no link frames: positions are in the world")
        }
        "stl" => Some("STL keeps positions alone, in the world and rounded to f32"),
        "csv" if !is_bare => Some("tables keep no link frames: positions are in the world"),
        _ => None,
    }
}
