//! Ugly skins: the shapes that rooms meet in the field, which squares are not.

use dermatome::id::{FaceId, VertexId};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::skin::{Link, LinkId, Patch, Presence, Skin, TaxelId, Taxels};
use glam::{DAffine3, DVec3};

use crate::altered;

/// A lattice with three holes of different size.
fn holed() -> TriMesh {
    let mesh = shapes::lattice(24, 12, 0.004);
    let centre = |face: FaceId| mesh.corners(face).iter().sum::<DVec3>() / 3.0;
    let holes = [(0.02, 0.02, 0.009), (0.05, 0.025, 0.006), (0.075, 0.015, 0.005)];
    let is_hole = |face| holes.iter().any(|&(x, y, r)| centre(face).truncate().distance((x, y).into()) < r);
    altered::without(&mesh, is_hole)
}

/// A sheet whose middle columns are a micrometre apart: faces of an aspect of 5000.
fn needles() -> TriMesh {
    shapes::sheet(9, 9, |i, j| {
        let x = f64::from(i) * 0.005;
        let x = if i > 4 { x - 0.005 + 1e-6 } else { x };
        DVec3::new(x, f64::from(j) * 0.005, 0.002 * (30.0 * x).sin())
    })
}

/// The shapes, each with its name.
pub(crate) fn meshes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("closed", shapes::ball(5, 0.02)),
        ("handle", shapes::torus(28, 14, 0.03, 0.012)),
        ("sleeve", shapes::tube(16, 12, 0.02, 0.06)),
        ("holed", holed()),
        ("needles", needles()),
        ("thimble", shapes::cap(400, 0.01, 2.6)),
        ("three faces", shapes::fan(3)),
        ("star", shapes::fan(30)),
    ]
}

/// All shapes as patches of one robot: two links, each turned and the second on the first, one taxel in seven
/// absent, a thermal pad, and one whole side of a patch without a working taxel. Ids are unique.
pub(crate) fn skin() -> Skin {
    let turned = |angle: f64, at: DVec3| {
        DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, angle) * DAffine3::from_translation(at)
    };
    let base = Link { name: "base".into(), parent: None, pose: turned(0.7, DVec3::X) };
    let tip = Link { name: "tip \"<2>\"".into(), parent: Some(LinkId::new(0)), pose: turned(2.0, DVec3::Y) };
    let mut skin = Skin { links: vec![base, tip].into(), ..Skin::default() };
    let mut id = 10;
    for (k, (name, mut mesh)) in meshes().into_iter().enumerate() {
        // Apart, so that a contact is near one patch alone.
        mesh.positions.iter_mut().for_each(|p| *p += k as f64 * DVec3::new(0.0, 0.0, 3.0));
        let mut taxels = Taxels::from(&mesh);
        let half = mesh.positions.len() / 2;
        for v in (0..mesh.positions.len()).map(VertexId::new) {
            taxels.ids[v] = TaxelId(id);
            id += 1;
            let is_dead = v.index() % 7 == 3 || name == "holed" && v.index() < half;
            taxels.presence[v] = if is_dead { Presence::Absent } else { Presence::Present };
        }
        taxels.presence[VertexId::new(0)] = Presence::ThermalPad;
        let patch = Patch { taxels, ..Patch::from_mesh(name, LinkId::new(k % 2), mesh) };
        skin.patches.push(patch);
    }
    skin
}

/// The map of [`skin`].
pub(crate) fn map() -> SkinMap {
    build(&skin(), &BuildOptions::default()).unwrap()
}
