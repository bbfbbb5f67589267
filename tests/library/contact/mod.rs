//! Laws of the module `contact`: answers are those of brute force, for any shape and pose, on every level,
//! and in every frame without an allocation.

mod blend;
mod exact;
mod joints;
mod queries;
mod reactive;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../../../crates/bvh/src/soup.rs"]
mod soup;
mod steady;

use dermatome::contact::IndexOptions;
use dermatome::map::SkinMap;
use dermatome::mesh::TriMesh;
use dermatome::pyramid::LevelId;
use dermatome::skin::{Link, LinkId, Motion, MotionFrame, Patch, PatchId, Skin};
use glam::{DAffine3, DQuat, DVec3};
use proptest::prelude::*;

const FIELDS: IndexOptions = IndexOptions { reactive: false, fields: true };
const REACTIVE: IndexOptions = IndexOptions { reactive: true, fields: false };
const BOTH: IndexOptions = IndexOptions { reactive: true, fields: true };

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

/// Distance of a point from a mesh, by every triangle.
fn distance_to(mesh: &TriMesh, q: DVec3) -> f64 {
    mesh.triangles.ids().map(|f| soup::distance(q, mesh.corners(f))).fold(f64::INFINITY, f64::min)
}
