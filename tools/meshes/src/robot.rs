//! A robot of three links that wears five patches.

use dermatome::{
    id::IdVec,
    mesh::{TriMesh, shapes},
    skin::{Link, LinkId, Patch, Skin, TaxelId},
};
use glam::{DAffine3, DMat3, DVec3};

use crate::grid::snapped;

/// Shoulder, upper arm and forearm, each turned against the one before; two patches on each of the
/// arms.
pub fn robot() -> Skin {
    let mut skin = Skin::default();
    let mut link = |name: &str, parent: Option<LinkId>, pose: DAffine3| {
        skin.links.push(Link { name: name.into(), parent, pose })
    };
    let shoulder = link("shoulder", None, DAffine3::from_translation(DVec3::new(0.0, 0.25, 1.2)));
    let upper_arm = link("upper_arm", Some(shoulder), hinge(DVec3::new(0.0, 0.02, -0.09)));
    let forearm = link("forearm", Some(upper_arm), hinge(DVec3::new(0.0, 0.0, -0.28)));
    let patches = [
        ("shoulder", shoulder, shapes::cap(700, 0.08, 1.2)),
        ("upper_arm_front", upper_arm, sector(24, 20, 0.05, [0.0, 0.45])),
        ("upper_arm_back", upper_arm, sector(24, 20, 0.05, [0.5, 0.95])),
        ("forearm_cuff", forearm, shapes::tube(40, 12, 0.042, 0.07)),
        ("forearm_pad", forearm, pad(18, 14, 0.005)),
    ];
    // Ids count through the whole robot, with room for each patch to grow, as they do where hubs
    // number their taxels.
    for ((name, link, mesh), hub) in patches.into_iter().zip(1..) {
        let mut patch = Patch::from_mesh(name, link, snapped(mesh));
        patch.taxels.ids = patch.taxels.ids.map(|id| TaxelId(1000 * hub + id.0));
        skin.patches.push(patch);
    }
    skin
}

/// Turned about the y axis by the angle of the triangle 3-4-5, whose sine and cosine are exact
/// decimals.
fn hinge(place: DVec3) -> DAffine3 {
    let turn = DMat3::from_cols(DVec3::new(0.8, 0.0, -0.6), DVec3::Y, DVec3::new(0.6, 0.0, 0.8));
    DAffine3::from_mat3_translation(turn, place)
}

/// Part of a tube around the z axis that hangs down from the origin; `turns` are the shares of a
/// full turn where it starts and ends.
fn sector(columns: u32, rows: u32, radius: f64, turns: [f64; 2]) -> TriMesh {
    let width = std::f64::consts::TAU * radius * (turns[1] - turns[0]);
    let step = width / f64::from(columns);
    shapes::sheet(columns, rows, |i, j| {
        let along = (f64::from(i) + 0.5 * f64::from(j % 2)) / (f64::from(columns) - 0.5);
        let turn = std::f64::consts::TAU * (turns[0] + along * (turns[1] - turns[0]));
        let (sin, cos) = turn.sin_cos();
        let height = 0.75_f64.sqrt() * step * (f64::from(j) - f64::from(rows)) - 0.01;
        DVec3::new(radius * cos, radius * sin, height)
    })
}

/// A gently domed pad below the cuff, with a round hole.
fn pad(columns: u32, rows: u32, spacing: f64) -> TriMesh {
    let flat = shapes::lattice(columns, rows, spacing);
    let middle = flat.positions.iter().sum::<DVec3>() / f64::from(columns * rows);
    let is_hole = |p: DVec3| p.distance(middle) < 1.8 * spacing;
    let mut domed = TriMesh::default();
    let mut number = IdVec::<dermatome::id::VertexId, _>::from(vec![None; flat.positions.len()]);
    for (v, &p) in flat.positions.enumerate() {
        if !is_hole(p) {
            let q = p - middle;
            number[v] = Some(domed.positions.push(DVec3::new(q.x, q.y, -1.5 * q.length_squared() - 0.08)));
        }
    }
    for t in &flat.triangles {
        if let [Some(a), Some(b), Some(c)] = t.map(|v| number[v]) {
            domed.triangles.push([a, b, c]);
        }
    }
    domed
}
