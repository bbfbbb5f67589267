//! Which side of a component is outside, and the normals that its taxels get.

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    mesh::{Edges, TriMesh},
    skin::{
        OutsideFrom, RemarkKind, assemble::components::Component, normals::NormalQuality,
        normals::surface_normals,
    },
};

/// Turns all faces over if the component is inside out, and reports how many faces then differ from
/// the file.
///
/// The outside is where reliable normals point, else the outside of a closed surface, else where
/// most faces of the file have it.
pub(super) fn turn_outward(
    component: &mut Component,
    quality: Option<NormalQuality>,
    remarks: &mut Vec<RemarkKind>,
) {
    let of = component.mesh.triangles.len();
    let (inside_out, outside) = match quality {
        Some(NormalQuality::Outward) => (false, OutsideFrom::Normals),
        Some(NormalQuality::Inward) => (true, OutsideFrom::Normals),
        _ => match enclosed_volume(&component.mesh) {
            Some(volume) => (volume < 0.0, OutsideFrom::ClosedSurface),
            None => (2 * component.turned > of, OutsideFrom::MostFaces),
        },
    };
    if inside_out {
        component.mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        component.turned = of - component.turned;
    }
    if component.turned > 0 {
        remarks.push(RemarkKind::Turned { faces: component.turned, of, outside });
    }
}

/// The given normals where they are reliable, else those of the faces.
pub(super) fn choose_normals(
    mesh: &TriMesh,
    given: Option<(IdVec<VertexId, DVec3>, NormalQuality)>,
    remarks: &mut Vec<RemarkKind>,
) -> IdVec<VertexId, DVec3> {
    let mut normals = surface_normals(mesh);
    let Some((given, quality)) = given else { return normals };
    if let NormalQuality::Unreliable(reason) = quality {
        remarks.push(RemarkKind::NormalsIgnored { reason });
        return normals;
    }
    let mut taxels = 0;
    for (normal, &n) in normals.iter_mut().zip(&given) {
        if n.dot(*normal) > 0.0 {
            *normal = n;
        } else {
            taxels += 1;
        }
    }
    if taxels > 0 {
        remarks.push(RemarkKind::NormalsReplaced { taxels });
    }
    normals
}

/// Volume inside a closed component, in m^3, negative if it is inside out; `None` for one with a
/// boundary.
fn enclosed_volume(mesh: &TriMesh) -> Option<f64> {
    if Edges::new(&mesh.triangles, mesh.positions.len()).iter().any(|uses| uses.len() == 1) {
        return None;
    }
    let origin = mesh.positions.iter().next().copied()?;
    let volume = |face| {
        let [a, b, c] = mesh.corners(face).map(|p| p - origin);
        a.dot(b.cross(c)) / 6.0
    };
    Some(mesh.triangles.ids().map(volume).sum())
}
