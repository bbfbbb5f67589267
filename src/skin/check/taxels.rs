//! Positions, ids and quantities of taxels.

use std::collections::{HashMap, HashSet};

use crate::{
    id::{FaceId, IdVec, VertexId},
    skin::{
        Presence, Sheet, TaxelId,
        check::{
            FindingKind,
            report::{Report, Subject, numbers},
        },
        in_tangent_plane,
        normals::is_unit,
        taxels::{is_positive, is_weight},
    },
};

/// Notes positions and corners that are not valid; says which faces have neither.
pub(super) fn usable_faces(sheet: &Sheet, report: &mut Report<'_>) -> IdVec<FaceId, bool> {
    let finite: Vec<bool> = sheet.positions.iter().map(|p| p.is_finite()).collect();
    let not_finite = (0_u64..).zip(&finite).filter(|&(_, &ok)| !ok).map(|(v, _)| v);
    report.add(FindingKind::NotFinite, not_finite.collect(), |n| {
        format!("{n} vertices have a coordinate that is NaN or infinite")
    });
    let vertices = sheet.positions.len();
    let out_of_range = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= vertices);
    let outside = (0_u64..).zip(&sheet.triangles).filter(|(_, t)| out_of_range(t)).map(|(face, _)| face);
    report.add(FindingKind::CornerOutOfRange, outside.collect(), |n| {
        format!("{n} faces name vertices that do not exist; there are {vertices}")
    });
    let is_usable = |t: &[u32; 3]| t.iter().all(|&v| finite.get(v as usize).copied().unwrap_or(false));
    sheet.triangles.iter().map(is_usable).collect()
}

/// Notes taxels without a face and taxels at the same place.
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
    let isolated = in_file.ids().filter(|&v| is_isolated(v)).map(VertexId::raw);
    report.add(FindingKind::IsolatedTaxel, numbers(isolated), |n| {
        format!("{n} of {vertices} taxels belong to no face")
    });

    // Copies that are one taxel of a split seam are healthy; a second taxel at the same place is
    // not.
    let mut first: HashMap<[u64; 3], VertexId> = HashMap::with_capacity(vertices);
    let mut again = Vec::new();
    for (v, p) in surface.mesh.positions.enumerate().take(vertices) {
        if !p.is_finite() || !(in_file[v] || is_isolated(v)) {
            continue;
        }
        let earlier = *first.entry((*p + 0.0).to_array().map(f64::to_bits)).or_insert(v);
        let is_copy = surface.place[v] == surface.place[earlier] && in_file[v] && in_file[earlier];
        if earlier != v && !is_copy {
            again.push(v.raw());
        }
    }
    report.add(FindingKind::DuplicatePosition, numbers(again), |n| {
        format!("{n} taxels lie exactly where an earlier taxel lies")
    });
}

/// Notes ids that more than one taxel has.
pub(super) fn check_ids(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { sheet, surface, .. } = subject;
    let Some(ids) = &sheet.ids else { return };
    let is_absent = |v: VertexId| sheet.presence.as_ref().is_some_and(|p| p[v.index()] == Presence::Absent);
    // Where each id is for the first time. Copies of one vertex have one place and are one taxel.
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
    report.add(FindingKind::PlaceholderId, numbers(placeholders.iter().map(|(v, _)| v.raw())), |n| {
        format!("{n} taxels have a placeholder id: 0 or {}", u32::MAX)
    });
    let different = repeated.iter().map(|(_, id)| id).collect::<HashSet<_>>().len();
    report.add(FindingKind::DuplicateId, numbers(repeated.iter().map(|(v, _)| v.raw())), |n| {
        format!("{n} taxels share {different} ids: readings cannot tell them apart")
    });
}

/// Notes normals, areas and densities of taxels with a face that are out of range.
pub(super) fn check_quantities(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { sheet, surface, .. } = subject;
    let mut used = IdVec::<VertexId, bool>::filled(false, surface.mesh.positions.len());
    surface.mesh.triangles.iter().flatten().for_each(|&v| used[v] = true);
    let of_skin: Vec<u32> =
        surface.taxel.ids().filter(|&v| used[surface.taxel[v]]).map(VertexId::raw).collect();
    let mut note = |kind, is_wrong: &dyn Fn(usize) -> bool, what: &str| {
        let wrong = of_skin.iter().copied().filter(|&v| is_wrong(v as usize));
        report.add(kind, numbers(wrong), |n| format!("{n} {what}"));
    };
    if let Some(normals) = &sheet.normals {
        let is_wrong = |v: usize| !is_unit(normals[v]);
        note(FindingKind::NormalNotUnit, &is_wrong, "vertices have a normal that is not a unit vector");
    }
    if let Some(tangents) = &sheet.tangents {
        let is_along = |v: usize| {
            let normal = sheet.normals.as_ref().map(|normals| normals[v]).filter(|&n| is_unit(n));
            normal.is_some_and(|n| in_tangent_plane(tangents[v], n.normalize()).is_none())
        };
        let is_wrong = |v: usize| !is_unit(tangents[v]) || is_along(v);
        let what = "vertices have a tangent that is not a unit vector or is parallel to the normal";
        note(FindingKind::UnusableTangent, &is_wrong, what);
    }
    if let Some(areas) = &sheet.areas {
        let is_wrong = |v: usize| !is_positive(areas[v]);
        note(FindingKind::AreaNotPositive, &is_wrong, "vertices have a receptive area that is not positive");
    }
    if let Some(densities) = &sheet.densities {
        let is_wrong = |v: usize| !is_positive(densities[v]);
        note(FindingKind::DensityNotPositive, &is_wrong, "vertices have a density that is not positive");
    }
    if let Some(weights) = &sheet.weights {
        let is_wrong = |v: usize| !is_weight(weights[v]);
        note(
            FindingKind::WeightUnusable,
            &is_wrong,
            "vertices have a weight that is negative or not a number",
        );
        let is_zero = |v: usize| weights[v] == 0.0;
        if (0..weights.len()).all(is_zero) {
            note(FindingKind::WeightUnusable, &is_zero, "vertices have the weight 0: all of them");
        }
    }
}
