//! Positions, ids and quantities of taxels.

use std::collections::{HashMap, HashSet};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::is_within_reach;
use crate::numeric::bits;
use crate::skin::check::FindingKind;
use crate::skin::check::finding::{Report, Subject};
use crate::skin::normals::is_unit;
use crate::skin::taxels::{is_positive, is_weight};
use crate::skin::{Presence, Sheet, TaxelId, in_tangent_plane};

/// Reports positions and corners that are not valid; returns which faces have neither.
pub(super) fn usable_faces(sheet: &Sheet, report: &mut Report<'_>) -> IdVec<FaceId, bool> {
    let finite: Vec<bool> = sheet.positions.iter().map(|p| is_within_reach(*p)).collect();
    let not_finite = (0..finite.len()).filter(|&v| !finite[v]).map(VertexId::new);
    report.add_vertices(FindingKind::NotFinite, not_finite);
    let vertices = sheet.positions.len();
    let is_outside = |&f: &usize| sheet.triangles[f].iter().any(|&v| v as usize >= vertices);
    let outside = (0..sheet.triangles.len()).filter(is_outside).map(FaceId::new);
    report.add_faces(FindingKind::CornerOutOfRange { vertices }, outside);
    let is_usable = |t: &[u32; 3]| t.iter().all(|&v| finite.get(v as usize).copied().unwrap_or(false));
    sheet.triangles.iter().map(is_usable).collect()
}

/// Reports taxels without a face and coincident taxels.
pub(super) fn check_places(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { sheet, surface, .. } = subject;
    let vertices = surface.place.len();
    let mut in_file = IdVec::<VertexId, bool>::filled(false, vertices);
    for &v in sheet.triangles.iter().flatten() {
        if (v as usize) < vertices {
            in_file[VertexId::from(v)] = true;
        }
    }
    let is_slot = |v: VertexId| sheet.presence.as_ref().is_some_and(|p| p[v.index()] != Presence::Present);
    let is_isolated = |v: VertexId| !in_file[v] && !is_slot(v);
    let isolated = in_file.ids().filter(|&v| is_isolated(v));
    report.add_vertices(FindingKind::IsolatedTaxel { of: vertices }, isolated);

    // Copies of one taxel along a split seam are valid; a second taxel at the same position is not.
    let mut first: HashMap<[u64; 3], VertexId> = HashMap::with_capacity(vertices);
    let mut again = Vec::new();
    for (v, p) in surface.mesh.positions.enumerate().take(vertices) {
        if !p.is_finite() || !(in_file[v] || is_isolated(v)) {
            continue;
        }
        let earlier = *first.entry(bits(p.to_array())).or_insert(v);
        let is_copy = surface.place[v] == surface.place[earlier] && in_file[v] && in_file[earlier];
        if earlier != v && !is_copy {
            again.push(v);
        }
    }
    report.add_vertices(FindingKind::DuplicatePosition { distance: 0.0 }, again);
}

/// Reports ids that more than one taxel has.
pub(super) fn check_ids(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { sheet, surface, .. } = subject;
    let Some(ids) = &sheet.ids else { return };
    let is_absent = |v: VertexId| sheet.presence.as_ref().is_some_and(|p| p[v.index()] == Presence::Absent);
    // The first vertex of each id. Copies of one vertex have one position and are one taxel.
    let mut owners: HashMap<TaxelId, (VertexId, usize)> = HashMap::with_capacity(ids.len());
    let taxels: Vec<(VertexId, TaxelId)> = surface
        .place
        .enumerate()
        .zip(ids)
        .filter(|&((v, &first), _)| v == first && !is_absent(v))
        .map(|((v, _), &id)| (v, id))
        .collect();
    for &(v, id) in &taxels {
        owners.entry(id).or_insert((v, 0)).1 += 1;
    }
    let shared = |id: TaxelId| owners.get(&id).map_or(0, |owner| owner.1) > 1;
    let (placeholders, repeated): (Vec<_>, Vec<_>) =
        taxels.iter().filter(|(_, id)| shared(*id)).partition(|(_, id)| TaxelId::PLACEHOLDERS.contains(id));
    report.add_vertices(FindingKind::PlaceholderId, placeholders.into_iter().map(|&(v, _)| v));
    let ids = repeated.iter().map(|(_, id)| id).collect::<HashSet<_>>().len();
    report.add_vertices(FindingKind::DuplicateId { ids }, repeated.into_iter().map(|&(v, _)| v));
}

/// Reports normals, areas and densities out of range, of taxels with a face.
pub(super) fn check_quantities(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { sheet, surface, .. } = subject;
    let mut used = IdVec::<VertexId, bool>::filled(false, surface.mesh.positions.len());
    surface.mesh.triangles.iter().flatten().for_each(|&v| used[v] = true);
    let of_skin: Vec<VertexId> = surface.taxel.ids().filter(|&v| used[surface.taxel[v]]).collect();
    let mut note = |kind, is_wrong: &dyn Fn(usize) -> bool| {
        report.add_vertices(kind, of_skin.iter().copied().filter(|&v| is_wrong(v.index())));
    };
    if let Some(normals) = &sheet.normals {
        note(FindingKind::NormalNotUnit, &|v| !is_unit(normals[v]));
    }
    if let Some(tangents) = &sheet.tangents {
        let is_along = |v: usize| {
            let normal = sheet.normals.as_ref().map(|normals| normals[v]).filter(|&n| is_unit(n));
            normal.is_some_and(|n| in_tangent_plane(tangents[v], n.normalize()).is_none())
        };
        note(FindingKind::UnusableTangent, &|v| !is_unit(tangents[v]) || is_along(v));
    }
    if let Some(areas) = &sheet.areas {
        note(FindingKind::AreaNotPositive, &|v| !is_positive(areas[v]));
    }
    if let Some(densities) = &sheet.densities {
        note(FindingKind::DensityNotPositive, &|v| !is_positive(densities[v]));
    }
    if let Some(weights) = &sheet.weights {
        note(FindingKind::WeightUnusable, &|v| !is_weight(weights[v]));
    }
}
