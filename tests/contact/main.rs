//! Laws of the module `contact`: answers are those of brute force, for any shape and pose, on every level,
//! and in every frame without an allocation.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod blend;
#[cfg(feature = "cli")]
#[path = "../common/mod.rs"]
mod common;
mod exact;
#[cfg(feature = "cli")]
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../gltf_files/mod.rs"]
mod gltf_files;
#[cfg(feature = "cli")]
mod joints;
mod levels;
mod queries;
mod steady;

use dermatome::{
    contact::IndexOptions,
    map::SkinMap,
    mesh::TriMesh,
    pyramid::LevelId,
    skin::{Link, LinkId, Motion, MotionFrame, Patch, PatchId, Skin},
};
use glam::{DAffine3, DQuat, DVec3};
use proptest::{prelude::*, test_runner::RngSeed};

const FIELDS: IndexOptions = IndexOptions { levels: false, fields: true };
const LEVELS: IndexOptions = IndexOptions { levels: true, fields: false };
const BOTH: IndexOptions = IndexOptions { levels: true, fields: true };

/// The same cases in every run; a failing one becomes a test of its own.
fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(6),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// A pose turned by anything and moved by up to `reach` along each axis, in m.
fn any_pose(reach: f64) -> impl Strategy<Value = DAffine3> {
    (prop::array::uniform3(-3.0_f64..3.0), prop::array::uniform3(-reach..reach)).prop_map(|(turn, place)| {
        DAffine3::from_rotation_translation(DQuat::from_scaled_axis(turn.into()), place.into())
    })
}

/// A motion that has links at these poses in the world, at any time.
fn posed(poses: impl IntoIterator<Item = (LinkId, DAffine3)>) -> Motion {
    let mut motion = Motion::default();
    for (link, pose) in poses {
        motion.set(link, MotionFrame::World, &[(0.0, pose)]).unwrap();
    }
    motion
}

/// A skin of these patches, each on a link of its own.
fn skin_of(patches: impl IntoIterator<Item = (TriMesh, DAffine3)>) -> Skin {
    let mut skin = Skin::default();
    for (k, (mesh, pose)) in patches.into_iter().enumerate() {
        let link = skin.links.push(Link { name: format!("link {k}"), parent: None, pose });
        skin.patches.push(Patch::from_mesh(format!("patch {k}"), link, mesh));
    }
    skin
}

/// The finest level of a patch.
fn finest(map: &SkinMap, patch: usize) -> &TriMesh {
    &map.patches[PatchId::new(patch)].levels[LevelId::new(0)].level.mesh
}

// ---- brute force, written independently ----

/// Distance of a point from a mesh, by every triangle.
fn distance_to(mesh: &TriMesh, q: DVec3) -> f64 {
    mesh.triangles.ids().map(|f| distance_to_triangle(q, mesh.corners(f))).fold(f64::INFINITY, f64::min)
}

/// Distance of a point from a triangle, which may have no area.
fn distance_to_triangle(q: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let sides =
        distance_to_segment(q, a, b).min(distance_to_segment(q, b, c)).min(distance_to_segment(q, c, a));
    let cross = (b - a).cross(c - a);
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    if cross.length() < 1e-9 * longest {
        return sides; // a segment: its normal is noise
    }
    let normal = cross.normalize();
    let over = [(a, b), (b, c), (c, a)].iter().all(|&(s, e)| normal.dot((e - s).cross(q - s)) > 0.0);
    if over { (q - a).dot(normal).abs().min(sides) } else { sides }
}

fn distance_to_segment(q: DVec3, a: DVec3, b: DVec3) -> f64 {
    let ab = b - a;
    let t = if ab == DVec3::ZERO { 0.0 } else { ((q - a).dot(ab) / ab.length_squared()).clamp(0.0, 1.0) };
    q.distance(a + ab * t)
}
