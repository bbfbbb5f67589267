//! A forearm covered with rigid modules of ten taxels, as CySkin and the skin of the iCub are made
//! of.

use std::collections::HashMap;

use dermatome::{
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
    skin::Skin,
};
use glam::{DVec2, DVec3};

use crate::grid::snapped;

/// Distance of the taxels within a module, in m.
const SPACING: f64 = 0.0065;
/// Distance between facing rows of two modules, in m.
const GAP: f64 = 0.007;
/// Radius of the arm at the elbow and at the wrist, in m.
const RADII: [f64; 2] = [0.044, 0.037];
/// Radius of the arc that the axis of the arm follows, in m.
const BEND: f64 = 0.7;
/// Rows of modules along the arm.
const ROWS: i32 = 8;
/// Modules in each row: about 300 degrees around.
const MODULES: i32 = 13;

/// Modules that are not there: room for a connector, and one that failed.
const MISSING: [Tile; 4] = [tile(2, 5), tile(2, 6), tile(2, 7), tile(5, 3)];

/// Corners of modules with a bolt between: the gap there stays open.
const BOLTS: [Corner; 5] = [corner(2, 1), corner(1, 4), corner(4, 4), corner(2, 6), corner(-1, 7)];

/// A triangle of the tiling, pointing to the wrist if row and column are both even or both odd.
type Tile = (i32, i32);
/// A vertex of the tiling in lattice coordinates.
type Corner = (i32, i32);

const fn tile(row: i32, column: i32) -> Tile {
    (row, column)
}

const fn corner(a: i32, b: i32) -> Corner {
    (a, b)
}

/// The three corners of a tile, counter-clockwise seen from outside.
fn corners_of((row, column): Tile) -> [Corner; 3] {
    // Lattice point (a, b) lies a + b/2 sides around and b rows along.
    let left = (column - row).div_euclid(2);
    if (row + column) % 2 == 0 {
        [(left, row), (left + 1, row), (left, row + 1)]
    } else {
        [(left + 1, row), (left + 1, row + 1), (left, row + 1)]
    }
}

/// Side of the tiles, in m: the module and half a gap on every side.
fn side() -> f64 {
    3.0 * SPACING + 3.0_f64.sqrt() * GAP
}

/// Where a corner of the tiling lies on the unrolled arm, in m: around, along.
fn unrolled((a, b): Corner) -> DVec2 {
    let (a, b) = (f64::from(a), f64::from(b));
    side() * DVec2::new(a + 0.5 * b, 0.75_f64.sqrt() * b)
}

/// About 1000 taxels on about 100 flat modules around 300 degrees of a bent, tapered forearm. Holes
/// are left by two groups of missing modules and by bolts.
pub fn forearm() -> Skin {
    let tiles = (0..ROWS).flat_map(|row| (0..MODULES).map(move |column| (row, column)));
    let modules: Vec<Module> = tiles.filter(|t| !MISSING.contains(t)).map(Module::new).collect();
    let mut mesh = TriMesh::default();
    let mut first = HashMap::new();
    for module in &modules {
        first.insert(module.tile, mesh.positions.len());
        module.taxels.iter().for_each(|&p| {
            mesh.positions.push(p);
        });
        let start = first[&module.tile];
        for t in module_triangles() {
            mesh.triangles.push(t.map(|k| VertexId::new(start + k)));
        }
    }
    join_sides(&modules, &first, &mut mesh.triangles);
    close_corners(&modules, &first, &mut mesh.triangles);
    let mut skin = Skin::from_mesh("forearm", snapped(mesh));
    for patch in skin.patches.iter_mut() {
        // A module is rigid and flat: all its taxels look the same way.
        for module in 0..modules.len() {
            let at = |k: usize| patch.mesh.positions[VertexId::new(10 * module + k)];
            let normal = (at(3) - at(0)).cross(at(9) - at(0)).normalize();
            (0..10).for_each(|k| patch.taxels.normals[VertexId::new(10 * module + k)] = normal);
        }
    }
    skin
}

/// Ten taxels in rows of 4, 3, 2 and 1.
struct Module {
    tile: Tile,
    /// Positions, in m, in the order of [`place`].
    taxels: Vec<DVec3>,
}

/// The place of taxel `k` of row `r` among the ten of a module.
const fn place(r: usize, k: usize) -> usize {
    [0, 4, 7, 9][r] + k
}

/// The four taxels along side `s` of a module, counter-clockwise.
const fn along_side(s: usize) -> [usize; 4] {
    match s {
        0 => [place(0, 0), place(0, 1), place(0, 2), place(0, 3)],
        1 => [place(0, 3), place(1, 2), place(2, 1), place(3, 0)],
        _ => [place(3, 0), place(2, 0), place(1, 0), place(0, 0)],
    }
}

/// The nine triangles within a module.
fn module_triangles() -> Vec<[usize; 3]> {
    let mut triangles = Vec::new();
    for r in 0..3 {
        for k in 0..3 - r {
            triangles.push([place(r, k), place(r, k + 1), place(r + 1, k)]);
            if k + 1 < 3 - r {
                triangles.push([place(r, k + 1), place(r + 1, k + 1), place(r + 1, k)]);
            }
        }
    }
    triangles
}

impl Module {
    /// Lays the module on the arm, in the plane that touches it under the module's middle.
    fn new(tile: Tile) -> Self {
        let corners = corners_of(tile).map(unrolled);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let [right, up, _, origin] = frame(middle);
        let shrink = 3.0 * SPACING / side();
        let [a, b, c] = corners.map(|p| shrink * (p - middle));
        let mut taxels = Vec::new();
        for r in 0..4_u32 {
            for k in 0..4 - r {
                let (along_ab, along_ac) = (f64::from(k) / 3.0, f64::from(r) / 3.0);
                let at = a + along_ab * (b - a) + along_ac * (c - a);
                taxels.push(origin + at.x * right + at.y * up);
            }
        }
        Self { tile, taxels }
    }
}

/// Directions around and along the arm and outwards, and the point of the arm, at a place on the
/// unrolled arm.
fn frame(at: DVec2) -> [DVec3; 4] {
    let length = f64::from(ROWS) * side() * 0.75_f64.sqrt();
    let share = at.y / length;
    let taper = (RADII[1] - RADII[0]) / length;
    let radius = RADII[0] + share * (RADII[1] - RADII[0]);
    let mean_radius = 0.5 * (RADII[0] + RADII[1]);
    let (sin_bend, cos_bend) = (at.y / BEND).sin_cos();
    let axis = DVec3::new(sin_bend, 0.0, cos_bend);
    let inner = DVec3::new(cos_bend, 0.0, -sin_bend);
    let centre = BEND * DVec3::new(1.0 - cos_bend, 0.0, sin_bend);
    let (sin, cos) = (at.x / mean_radius).sin_cos();
    let radial = cos * inner + sin * DVec3::Y;
    let around = cos * DVec3::Y - sin * inner;
    let outward = (radial - taper * axis).normalize();
    [around, outward.cross(around), outward, centre + radius * radial]
}

/// Meshes the gap between every two modules that share a side of the tiling.
fn join_sides(
    modules: &[Module],
    first: &HashMap<Tile, usize>,
    triangles: &mut IdVec<FaceId, [VertexId; 3]>,
) {
    let mut sides: HashMap<[Corner; 2], (Tile, usize)> = HashMap::new();
    for module in modules {
        let corners = corners_of(module.tile);
        for s in 0..3 {
            let (from, to) = (corners[s], corners[(s + 1) % 3]);
            if let Some(&(other, t)) = sides.get(&[to, from]) {
                let near = along_side(s).map(|k| VertexId::new(first[&module.tile] + k));
                let mut far = along_side(t).map(|k| VertexId::new(first[&other] + k));
                // Seen from outside, the other row runs the other way.
                far.reverse();
                for k in 0..3 {
                    triangles.push([near[k + 1], near[k], far[k]]);
                    triangles.push([near[k + 1], far[k], far[k + 1]]);
                }
            }
            sides.insert([from, to], (module.tile, s));
        }
    }
}

/// Meshes the hexagon between six modules that meet in a corner, unless there is a bolt.
fn close_corners(
    modules: &[Module],
    first: &HashMap<Tile, usize>,
    triangles: &mut IdVec<FaceId, [VertexId; 3]>,
) {
    // By corner: the taxel of each module there, and the direction in which the module lies.
    let mut meeting: HashMap<Corner, Vec<(usize, VertexId)>> = HashMap::new();
    let mut order = Vec::new();
    for module in modules {
        let corners = corners_of(module.tile);
        let middle = corners.map(unrolled).iter().sum::<DVec2>() / 3.0;
        for (s, corner) in corners.into_iter().enumerate() {
            let taxel = VertexId::new(first[&module.tile] + along_side(s)[0]);
            let here = meeting.entry(corner).or_default();
            if here.is_empty() {
                order.push(corner);
            }
            here.push((sextant(middle - unrolled(corner)), taxel));
        }
    }
    for corner in order {
        let mut ring = meeting[&corner].clone();
        if ring.len() == 6 && !BOLTS.contains(&corner) {
            ring.sort_unstable();
            let [a, b, c, d, e, f] = std::array::from_fn(|i| ring[i].1);
            for t in [[a, b, c], [c, d, e], [e, f, a], [a, c, e]] {
                triangles.push(t);
            }
        }
    }
}

/// Which sixth of the circle a direction lies in, counter-clockwise from the right.
fn sextant(direction: DVec2) -> usize {
    let steep = direction.y.abs() > 3.0_f64.sqrt() * direction.x.abs();
    match (direction.y > 0.0, direction.x > 0.0, steep) {
        (true, _, true) => 1,
        (false, _, true) => 4,
        (true, true, false) => 0,
        (true, false, false) => 2,
        (false, false, false) => 3,
        (false, true, false) => 5,
    }
}

#[cfg(test)]
mod tests {
    use dermatome::mesh::Adjacency;

    use super::*;

    #[test]
    fn modules_are_flat_and_keep_their_size() {
        let skin = forearm();
        let patch = skin.patches.iter().next().unwrap();
        for module in 0..patch.taxels.ids.len() / 10 {
            let at = |k: usize| patch.mesh.positions[VertexId::new(10 * module + k)];
            let normal = patch.taxels.normals[VertexId::new(10 * module)];
            for k in 0..10 {
                let height = (at(k) - at(0)).dot(normal);
                assert!(height.abs() < 2e-7, "taxel {k} of module {module} lies {height} m off its plane");
            }
            for (p, q) in [(0, 3), (3, 9), (9, 0)] {
                assert!((at(p).distance(at(q)) - 3.0 * SPACING).abs() < 4e-7, "side of module {module}");
            }
        }
    }

    #[test]
    fn missing_modules_and_bolts_are_holes() {
        let skin = forearm();
        let adjacency = Adjacency::new(&skin.patches.iter().next().unwrap().mesh).unwrap();
        let mut loops: Vec<usize> = adjacency.boundary_loops().iter().map(Vec::len).collect();
        loops.sort_unstable();
        assert_eq!(
            loops.len(),
            1 + 2 + BOLTS.len(),
            "outer boundary, two groups of modules, bolts: {loops:?}"
        );
        assert_eq!(loops[..BOLTS.len()], [6; BOLTS.len()], "a bolt is a hole of six edges");
    }
}
