//! Makes a patch of a component: turned outward, filled, and with the data of the file on its taxels, whose
//! normals are chosen here.

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::{Edges, FillHoles, TriMesh, fill_holes, surface_normals};
use crate::skin::assemble::components::{Component, Components};
use crate::skin::normals::{NormalConsensus, NormalQuality};
use crate::skin::patch::check_joints;
use crate::skin::remark::note;
use crate::skin::taxels::is_positive;
use crate::skin::{OutsideFrom, Patch, Presence, RemarkKind, SkinError, TaxelId, Taxels, tangents_along};

/// Turns `component` outward, fills the requested `holes` and adds the data of the file on its taxels. The
/// patch has the name and link of its sheet; its taxels may follow only links below `links`.
///
/// Holes are filled before normals and areas are computed, since these come from the faces.
pub(super) fn patch_of(
    components: &Components<'_>,
    mut component: Component,
    links: usize,
    holes: FillHoles,
    next_id: &mut u32,
    remarks: &mut Vec<RemarkKind>,
) -> Result<Patch, SkinError> {
    let name = components.sheet.title().to_owned();
    let normals = given_normals(components, &component);
    turn_outward(&mut component, normals.as_ref().map(|n| n.1), remarks);
    let Component { vertices, mut mesh, .. } = component;
    let own = mesh.triangles.len();
    if holes != FillHoles::None {
        let filled = fill_holes(&mut mesh, holes);
        let count = filled.map_err(|source| SkinError::Mesh { patch: name.clone(), source })?;
        if count > 0 {
            remarks.push(RemarkKind::HolesFilled { holes: count, max_edges: holes.most_edges() });
        }
    }
    let normals = choose_normals(&mesh, normals, remarks);
    let given = components.tangents.as_ref().map(|all| vertices.map(|&v| all[v]));
    let tangents = given.and_then(|given| choose_tangents(&mesh, &normals, &given, remarks));
    let in_file = vertices.map(|&v| components.in_file[v]);
    let numbers = match &components.sheet.numbers {
        Some(all) => in_file.map(|v| VertexId::from(all[v.index()])),
        None => in_file.clone(),
    };
    let file = components.sheet.select(&in_file.iter().map(|v| v.index()).collect::<Vec<_>>());
    let taxels = Taxels {
        binds: file.binds,
        are_counted: file.are_counted || file.ids.is_none(),
        ids: file.ids.unwrap_or_else(|| in_file.iter().map(|_| count_on(next_id)).collect()).into(),
        normals,
        tangents,
        areas: areas(file.areas.as_deref(), &numbers, &mesh, remarks),
        densities: file.densities.map(IdVec::from),
        weights: file.weights.map(IdVec::from),
        acuities: file.acuities.map(IdVec::from),
        presence: file.presence.unwrap_or_else(|| vec![Presence::Present; in_file.len()]).into(),
        covariances: file.covariances.map(IdVec::from),
        joints: file.joints.map(IdVec::from),
        regions: file.regions.map(IdVec::from),
        modalities: file.modalities.map(IdVec::from),
    };
    let filled = mesh.triangles.len() - own;
    let patch = Patch { name, link: components.sheet.link.unwrap_or_default(), mesh, filled, taxels };
    let valid = patch.validate().and_then(|()| check_joints(&patch.name, &patch.taxels, links));
    valid.map_err(|error| match error {
        SkinError::Taxels { patch, source } => {
            SkinError::Taxels { patch, source: source.renumbered(|v| numbers[v]) }
        }
        other => other,
    })?;
    Ok(patch)
}

/// The normals of the file on the taxels of a component, and how reliable they are.
pub(super) fn given_normals(
    components: &Components<'_>,
    component: &Component,
) -> Option<(IdVec<VertexId, DVec3>, NormalQuality)> {
    components.normals.as_ref().map(|normals| {
        let given = component.vertices.map(|&v| normals[v]);
        let quality = NormalConsensus::of(&component.mesh, &given).quality();
        (given, quality)
    })
}

/// The tangents of the file in the tangent planes of the chosen normals; `None` if most of them are unusable.
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

/// The areas of the file where they are positive, else those of the faces.
fn areas(
    given: Option<&[f64]>,
    numbers: &IdVec<VertexId, VertexId>,
    mesh: &TriMesh,
    remarks: &mut Vec<RemarkKind>,
) -> IdVec<VertexId, f64> {
    let mut areas = mesh.vertex_areas();
    let Some(given) = given else { return areas };
    let mut replaced = Vec::new();
    for ((area, &found), &v) in areas.iter_mut().zip(given).zip(numbers) {
        if is_positive(found) {
            *area = found;
        } else {
            replaced.push(v);
        }
    }
    note(remarks, replaced, |vertices| RemarkKind::AreasReplaced { vertices });
    areas
}

fn count_on(next_id: &mut u32) -> TaxelId {
    let id = TaxelId(*next_id);
    *next_id = next_id.wrapping_add(1);
    id
}

/// Turns all faces over if the component is inside out, and reports how many faces then differ from
/// the file. Whether it was inside out.
///
/// The outside is where reliable normals point, else the outside of a closed surface, else that of most faces
/// of the file.
pub(super) fn turn_outward(
    component: &mut Component,
    quality: Option<NormalQuality>,
    remarks: &mut Vec<RemarkKind>,
) -> bool {
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
    inside_out
}

/// The given normals where they are reliable, else those of the faces.
fn choose_normals(
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
    let is_closed = Edges::new(&mesh.triangles, mesh.positions.len()).iter().all(|uses| uses.len() > 1);
    is_closed.then(|| mesh.enclosed_volume())
}
