//! A sleeve over an elbow that is bent: its joints stand elsewhere than when it was bound to them.

use dermatome::{
    mesh::shapes,
    skin::{Joints, Link, Patch, Skin},
};
use glam::{DAffine3, DMat3, DVec3};
use serde_json::{Value, json};

use crate::grid::snapped;

/// Height of the elbow above the upper end of the arm, in m.
const ELBOW: f64 = 0.15;

/// The straight sleeve, which follows the upper arm and, beyond the elbow, the lower one.
pub fn sleeve() -> Skin {
    let mut skin = Skin::default();
    let mut link = |name: &str, parent, pose| skin.links.push(Link { name: name.into(), parent, pose });
    let turn = DMat3::from_cols(DVec3::new(0.8, 0.6, 0.0), DVec3::new(-0.6, 0.8, 0.0), DVec3::Z);
    let base = link("base", None, DAffine3::IDENTITY);
    let upper = link("upper", Some(base), DAffine3::from_mat3_translation(turn, DVec3::new(0.1, 0.0, 0.5)));
    let lower = link("lower", Some(upper), DAffine3::from_translation(DVec3::Z * ELBOW));
    let mut sleeve = Patch::from_mesh("sleeve", upper, snapped(shapes::tube(20, 22, 0.04, 2.0 * ELBOW)));
    let joints = sleeve.mesh.positions.map(|p| -> Joints {
        let share = ((p.z - ELBOW) / 0.06 + 0.5).clamp(0.0, 1.0);
        [(upper, 1.0 - share), (lower, share), (upper, 0.0), (upper, 0.0)]
    });
    sleeve.taxels.joints = Some(joints);
    skin.patches.push(sleeve);
    skin
}

/// Bends the elbow of a GLB file of the straight sleeve.
pub fn bent(glb: &[u8]) -> Option<Vec<u8>> {
    let length = usize::try_from(u32::from_le_bytes(*glb.get(12..16)?.as_array()?)).ok()?;
    let (text, rest) = glb.get(20..)?.split_at_checked(length)?;
    let mut document: Value = serde_json::from_slice(text).ok()?;
    for node in document["nodes"].as_array_mut()?.iter_mut().filter(|node| node["name"] == "lower") {
        node["rotation"] = json!([0.0, 0.28, 0.0, 0.96]);
    }
    let mut text = serde_json::to_vec(&document).ok()?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| u32::try_from(n).map(u32::to_le_bytes).ok();
    let total = word(20 + text.len() + rest.len())?;
    Some([&glb[..8], &total, &word(text.len())?, b"JSON", &text, rest].concat())
}
