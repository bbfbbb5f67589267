//! Rounding that makes positions the same on every machine.

use dermatome::mesh::TriMesh;
use glam::DVec3;

/// Positions are multiples of this, in m, as near as `f32` comes: far above what sines and cosines
/// differ by between machines, far below the spacing of taxels.
pub const STEP: f64 = 1e-7;

/// The multiple of [`STEP`] nearest to `p`, as a file in `f32` keeps it.
pub fn snap(p: DVec3) -> DVec3 {
    ((p / STEP).round() * STEP).as_vec3().as_dvec3()
}

/// The same mesh with its positions on the grid.
pub fn snapped(mut mesh: TriMesh) -> TriMesh {
    mesh.positions.iter_mut().for_each(|p| *p = snap(*p));
    mesh
}
