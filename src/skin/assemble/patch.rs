//! A component becomes a patch: outward, filled, and with everything the file says about its
//! taxels.

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    mesh::{FillHoles, TriMesh, fill_holes},
    skin::{
        LinkId, Patch, Presence, RemarkKind, Sheet, SkinError, TaxelError, TaxelId, Taxels,
        assemble::{
            components::{Component, Components},
            outward::{choose_normals, turn_outward},
        },
        normals::NormalConsensus,
        tangents_along,
        taxels::{is_positive, is_weight},
    },
};

/// Turns `component` outward, fills the `holes` that are wanted and gives its
/// taxels what the file says about them.
///
/// Holes are filled before normals and areas are computed, since these come from the faces.
pub(super) fn patch_of(
    components: &Components<'_>,
    mut component: Component,
    (name, link): (String, LinkId),
    holes: FillHoles,
    next_id: &mut u32,
    remarks: &mut Vec<RemarkKind>,
) -> Result<Patch, SkinError> {
    let sheet = components.sheet;
    let normals = components.normals.as_ref().map(|normals| {
        let given: IdVec<VertexId, DVec3> = component.vertices.iter().map(|&v| normals[v]).collect();
        let quality = NormalConsensus::of(&component.mesh, &given).quality();
        (given, quality)
    });
    turn_outward(&mut component, normals.as_ref().map(|n| n.1), remarks);
    let Component { vertices, mut mesh, .. } = component;
    let own = mesh.triangles.len();
    if holes != FillHoles::None {
        let filled = fill_holes(&mut mesh, holes);
        let count = filled.map_err(|source| SkinError::Mesh { patch: name.clone(), source })?.len();
        if count > 0 {
            remarks.push(RemarkKind::HolesFilled { holes: count, max_edges: holes.most_edges() });
        }
    }
    let normals = choose_normals(&mesh, normals, remarks);
    let given = components.tangents.as_ref().map(|all| vertices.iter().map(|&v| all[v]).collect());
    let tangents = given.and_then(|given| choose_tangents(&mesh, &normals, &given, remarks));
    let vertices: Vec<VertexId> = vertices.iter().map(|&v| components.in_file[v]).collect();
    let areas = areas(sheet, &vertices, &mesh, remarks);
    let ids = match &sheet.ids {
        Some(ids) => vertices.iter().map(|v| ids[v.index()]).collect(),
        None => vertices.iter().map(|_| count_on(next_id)).collect(),
    };
    let presence = match &sheet.presence {
        Some(presence) => vertices.iter().map(|v| presence[v.index()]).collect(),
        None => IdVec::filled(Presence::Present, vertices.len()),
    };
    let demands = densities_and_weights(sheet, &vertices);
    let [densities, weights] = demands.map_err(|source| SkinError::Taxels { patch: name.clone(), source })?;
    let covariances = sheet.covariances.as_ref().map(|c| vertices.iter().map(|v| c[v.index()]).collect());
    let joints = sheet.joints.as_ref().map(|all| vertices.iter().map(|v| all[v.index()]).collect());
    let acuities = None;
    let taxels =
        Taxels { ids, normals, tangents, areas, densities, weights, acuities, presence, covariances, joints };
    let filled = mesh.triangles.len() - own;
    Ok(Patch { name, link, mesh, filled, taxels })
}

/// The tangents of the file in the tangent planes of the normals chosen; `None` where most of them
/// say nothing.
fn choose_tangents(
    mesh: &TriMesh,
    normals: &IdVec<VertexId, DVec3>,
    given: &IdVec<VertexId, DVec3>,
    remarks: &mut Vec<RemarkKind>,
) -> Option<IdVec<VertexId, DVec3>> {
    let (tangents, replaced) = tangents_along(mesh, normals, given);
    if 2 * replaced > given.len() {
        remarks.push(RemarkKind::TangentsIgnored {});
        return None;
    }
    if replaced > 0 {
        remarks.push(RemarkKind::TangentsReplaced { taxels: replaced });
    }
    Some(tangents)
}

/// The densities and the weights of the file, if it has them; errors count its vertices.
fn densities_and_weights(
    sheet: &Sheet,
    vertices: &[VertexId],
) -> Result<[Option<IdVec<VertexId, f64>>; 2], TaxelError> {
    let first = |values: &Option<Vec<f64>>, is_good: fn(f64) -> bool| {
        let mut all = values.iter().flat_map(|all| vertices.iter().map(|&v| (v, all[v.index()])));
        all.find(|x| !is_good(x.1))
    };
    if let Some((vertex, found)) = first(&sheet.densities, is_positive) {
        return Err(TaxelError::Density { vertex, found });
    }
    if let Some((vertex, found)) = first(&sheet.weights, is_weight) {
        return Err(TaxelError::Weight { vertex, found });
    }
    let of = |values: &Option<Vec<f64>>| {
        values.as_ref().map(|all| vertices.iter().map(|v| all[v.index()]).collect())
    };
    Ok([of(&sheet.densities), of(&sheet.weights)])
}

/// The areas of the file where they are positive, else those of the faces.
fn areas(
    sheet: &Sheet,
    vertices: &[VertexId],
    mesh: &TriMesh,
    remarks: &mut Vec<RemarkKind>,
) -> IdVec<VertexId, f64> {
    let mut areas = mesh.positive_vertex_areas();
    let Some(given) = &sheet.areas else { return areas };
    let mut replaced = Vec::new();
    for (area, &v) in areas.iter_mut().zip(vertices) {
        let found = given[v.index()];
        if is_positive(found) {
            *area = found;
        } else {
            replaced.push(v);
        }
    }
    if !replaced.is_empty() {
        remarks.push(RemarkKind::AreasReplaced { vertices: replaced });
    }
    areas
}

fn count_on(next_id: &mut u32) -> TaxelId {
    let id = TaxelId(*next_id);
    *next_id = next_id.wrapping_add(1);
    id
}
