//! The direction of growing `u` on the skin: what taxels without tangents get from their map.

use glam::{DVec2, DVec3};

use crate::{
    id::{IdVec, VertexId},
    mesh::TriMesh,
    skin::{Taxels, tangents_along},
};

/// Gives taxels that have no tangents those of the map `uv` of their mesh (m).
pub(super) fn fill_tangents(taxels: &mut Taxels, mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) {
    if taxels.tangents.is_none() {
        let (tangents, _) = tangents_along(mesh, &taxels.normals, &directions_of_u(mesh, uv));
        taxels.tangents = Some(tangents);
    }
}

/// At each vertex the sum over its faces of area times gradient of `u`, twice, in m^2: zero where
/// the gradients cancel or the faces have no area.
fn directions_of_u(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> IdVec<VertexId, DVec3> {
    let mut sums = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, mesh.positions.len());
    for (face, &[a, b, c]) in mesh.triangles.enumerate() {
        let [x, y, z] = mesh.corners(face);
        let normal = mesh.face_cross(face).normalize_or_zero();
        // The gradient of a hat function is the opposite side, turned by a right angle inwards.
        let side = (uv[b].x - uv[a].x) * (x - z) + (uv[c].x - uv[a].x) * (y - x);
        let gradient = normal.cross(side);
        [a, b, c].iter().for_each(|&v| sums[v] += gradient);
    }
    sums
}
