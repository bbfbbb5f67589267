//! Holes that were filled: what fills them is no skin, so that the mesh with taxels fills them again, without any.
//!
//! The skin around them is meshed anew with its holes open. A rim of the new mesh is that of a filled hole if it is
//! nearer to the rims of these than to the others. Vertices on straight rims are in line: faces lower than [`LOWEST`]
//! are taken only where there is no other triangulation.

use std::borrow::Cow;

use glam::DVec3;

use crate::id::VertexId;
use crate::mesh::{MeshError, TriMesh, boundary_loops, fill_loops};
use crate::remesh::surface::Surface;
use crate::skin::Patch;

/// Faces in a hole are at least this high where that is possible, over the spacing.
const LOWEST: f64 = 0.03;

/// A hole with more taxels around stays open: time grows with the cube of their number, 1000 take some seconds.
const MOST_TAXELS: usize = 1000;

/// What fills the holes of a mesh again.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Filled {
    /// How many of the last faces fill holes.
    pub(super) faces: usize,
    /// How many holes are too large to be filled.
    pub(super) open: usize,
}

/// The mesh of a patch with its filled holes open.
pub(super) fn opened(patch: &Patch) -> Cow<'_, TriMesh> {
    let own = own_faces(patch);
    if own == patch.mesh.triangles.len() {
        return Cow::Borrowed(&patch.mesh);
    }
    let faces = patch.mesh.triangles.iter().take(own).copied();
    Cow::Owned(TriMesh { positions: patch.mesh.positions.clone(), triangles: faces.collect() })
}

/// How many faces, the first ones, are skin: all, if none is.
fn own_faces(patch: &Patch) -> usize {
    let all = patch.mesh.triangles.len();
    if patch.filled < all { all - patch.filled } else { all }
}

/// Fills the filled holes of a patch again in the new mesh that covers it.
pub(super) fn fill_again(mesh: &mut TriMesh, patch: &Patch, spacing: f64) -> Result<Filled, MeshError> {
    let own = own_faces(patch);
    if own == patch.mesh.triangles.len() {
        return Ok(Filled::default());
    }
    let [of_filled, of_others] =
        rims(patch, own).map(|rims| Surface::of_segments(&patch.mesh.positions, &rims));
    let distance = |to: &Option<Surface>, at: DVec3| {
        let nearest = to.as_ref().and_then(|rims| rims.nearest(at, DVec3::ZERO, None));
        nearest.map_or(f64::INFINITY, |nearest| nearest.point.distance(at))
    };
    let is_filled = |walk: &Vec<VertexId>| {
        let at = walk.iter().map(|&v| mesh.positions[v]);
        let nearer = at.filter(|&at| distance(&of_filled, at) < distance(&of_others, at));
        2 * nearer.count() > walk.len()
    };
    let holes: Vec<Vec<VertexId>> = boundary_loops(mesh).into_iter().filter(is_filled).collect();
    let (large, small): (Vec<_>, Vec<_>) = holes.into_iter().partition(|walk| walk.len() > MOST_TAXELS);
    let [known, wanted] = [mesh.triangles.len(), small.len()];
    let filled = fill_loops(mesh, small, LOWEST * spacing)?;
    let faces = mesh.triangles.len() - known;
    Ok(Filled { faces, open: large.len() + wanted - filled })
}

/// The edges of the rims of filled holes, and those of the others.
fn rims(patch: &Patch, own: usize) -> [Vec<[VertexId; 2]>; 2] {
    let sides = |t: &[VertexId; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let sorted = |faces: &mut dyn Iterator<Item = &[VertexId; 3]>| {
        let mut all: Vec<[VertexId; 2]> = faces.flat_map(sides).collect();
        all.sort_unstable();
        all
    };
    let of_skin = sorted(&mut patch.mesh.triangles.iter().take(own));
    let of_holes = sorted(&mut patch.mesh.triangles.iter().skip(own));
    let has_twin = |all: &[[VertexId; 2]], [a, b]: [VertexId; 2]| all.binary_search(&[b, a]).is_ok();
    let rim = of_skin.iter().copied().filter(|&edge| !has_twin(&of_skin, edge));
    let (filled, others) = rim.partition(|&edge| has_twin(&of_holes, edge));
    [filled, others]
}
