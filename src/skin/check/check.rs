//! All checks of a draft, sheet by sheet.

use crate::{
    id::FaceId,
    numeric::order_by,
    skin::{
        AssembleOptions, Draft, Finding, FindingKind, RemarkKind, Sheet, assemble,
        check::{
            gaps,
            report::{Report, Subject},
            shape, taxels, topology,
        },
        link::before_parents,
        normals::mean_directions,
        remark::coincident,
        triangulate::UniquePoints,
        weld::{welded_mesh::WeldedMesh, winding::Winding},
    },
};

/// Everything that is wrong with a draft, by sheet and kind; empty for a healthy one.
///
/// Healthy is what [`crate::skin::assemble`] takes as it is, and a user means: sheets of one piece,
/// each with an outer boundary and any number of holes of five edges or more, wound outward, of
/// taxels that can be distinguished. Vertices that a file splits along seams of its normals or
/// textures are healthy too, and so are slots marked as absent that have no face. Holes of three or
/// four edges are findings: a taxel leaves a larger one, so a face is missing there. Takes time
/// near-linear in the size of the draft, and never panics.
///
/// Bare taxels are judged by what assembling them with `options` gives.
///
/// ```
/// use dermatome::{
///     mesh::shapes,
///     skin::{AssembleOptions, Draft, FindingKind, Sheet, check},
/// };
///
/// // A lattice without the two triangles at one of its edges.
/// let mesh = shapes::lattice(5, 5, 0.005);
/// let triangles = mesh.triangles.iter().filter(|t| !t.contains(&12.into()) || !t.contains(&13.into()));
/// let sheet = Sheet {
///     positions: mesh.positions.to_vec(),
///     triangles: triangles.map(|t| t.map(|v| v.raw())).collect(),
///     ..Sheet::default()
/// };
/// let draft = Draft { sheets: vec![sheet], ..Draft::default() };
/// let findings = check(&draft, &AssembleOptions::default());
/// assert_eq!((findings.len(), findings[0].kind), (1, FindingKind::PinHole));
/// ```
#[must_use]
pub fn check(draft: &Draft, options: &AssembleOptions) -> Vec<Finding> {
    let mut findings = Vec::new();
    let backward: Vec<u64> = before_parents(&draft.links).map(|link| u64::from(link.raw())).collect();
    if !backward.is_empty() {
        let message = format!("{} links come before their parents", backward.len());
        let patch = String::new();
        findings.push(Finding { kind: FindingKind::LinkOrder, patch, elements: backward, message });
    }
    for sheet in &draft.sheets {
        check_sheet(sheet, draft.links.len(), options, &mut findings);
    }
    if let Some(remark) = draft.doubtful_unit() {
        findings.push(Finding::of_sheet(FindingKind::DoubtfulUnit, &remark.patch, remark.kind.to_string()));
    }
    if draft.is_bare() {
        findings.retain(|f| f.kind != FindingKind::IsolatedTaxel);
        let taxels = draft.sheets.iter().filter(|sheet| !sheet.positions.is_empty());
        findings.splice(0..0, taxels.map(bare));
        check_bare(draft, options, &mut findings);
    } else if draft.sheets.iter().all(|sheet| sheet.triangles.is_empty()) {
        let message = "there is no triangle in it: a skin needs taxels joined by triangles".into();
        findings.push(Finding::of_sheet(FindingKind::NoTriangles, only_name(draft), message));
    }
    findings
}

fn bare(sheet: &Sheet) -> Finding {
    let message =
        "its taxels have no triangles; reading it as a skin joins them, and remarks say what was assumed";
    Finding::of_sheet(FindingKind::Bare, sheet.title(), message.into())
}

fn only_name(draft: &Draft) -> &str {
    match draft.sheets.as_slice() {
        [sheet] => sheet.title(),
        _ => "",
    }
}

/// Notes what becomes of bare taxels: why they cannot be joined, which are merged, into what
/// components they fall, and which are left out.
fn check_bare(draft: &Draft, options: &AssembleOptions, findings: &mut Vec<Finding>) {
    let assembled = match assemble(draft, options) {
        Ok(assembled) => assembled,
        Err(why) => {
            return findings.push(Finding::of_sheet(FindingKind::NoSkin, only_name(draft), why.to_string()));
        }
    };
    // Not only what lies exactly where another taxel lies is merged.
    findings.retain(|f| f.kind != FindingKind::DuplicatePosition);
    for sheet in &draft.sheets {
        let points = UniquePoints::new(sheet);
        if !points.merged.is_empty() {
            let elements = points.merged.iter().map(|v| u64::from(v.raw())).collect();
            let message = coincident(points.merged.len(), points.distance);
            let finding = Finding::of_sheet(FindingKind::DuplicatePosition, sheet.title(), message);
            findings.push(Finding { elements, ..finding });
        }
    }
    for remark in &assembled.remarks[draft.remarks.len()..] {
        if matches!(
            remark.kind,
            RemarkKind::Components { .. } | RemarkKind::LeftOut { .. } | RemarkKind::SheetLeftOut { .. }
        ) {
            let message = remark.kind.to_string();
            findings.push(Finding::of_sheet(FindingKind::BarePieces, &remark.patch, message));
        }
    }
}

fn check_sheet(sheet: &Sheet, links: usize, options: &AssembleOptions, findings: &mut Vec<Finding>) {
    let mut report = Report { patch: sheet.title(), findings: Vec::new() };
    if let Some(link) = sheet.link.filter(|l| l.index() >= links) {
        let message = format!("it is attached to link {link}, but there are {links} links");
        report.add_whole(FindingKind::UnknownLink, message);
    }
    if let Some((_, found)) = sheet.wrong_length() {
        let needed = sheet.positions.len();
        let message =
            format!("an array has {found} entries for {needed} vertices; nothing else was looked at");
        report.add_whole(FindingKind::ArrayLength, message);
    } else if sheet.is_too_large() {
        let message =
            "it has more vertices or faces than 32-bit numbers count; nothing else was looked at".into();
        report.add_whole(FindingKind::TooLarge, message);
    } else {
        check_surface(sheet, options, &mut report);
    }
    let found = report.findings;
    let order = order_by(found.len(), &|a, b| found[a].kind.cmp(&found[b].kind));
    findings.extend(order.into_iter().map(|k| found[k].clone()));
}

fn check_surface(sheet: &Sheet, options: &AssembleOptions, report: &mut Report<'_>) {
    let usable = taxels::usable_faces(sheet, report);
    let surface = WeldedMesh::new(sheet, options.welding(), |face: FaceId| usable[face]);
    let winding = Winding::new(&surface.mesh, &surface.edges);
    let normals = sheet.normals.as_deref().map(|n| mean_directions(n, &surface.taxel, &surface.copied));
    let subject = Subject { sheet, surface, winding, normals };
    let is_manifold = topology::check_manifold(&subject, report);
    topology::check_components(&subject, report);
    if is_manifold {
        topology::check_loops(&subject, report);
        gaps::check_gaps(&subject, report);
    }
    shape::check_faces(&subject, report);
    shape::check_winding(&subject, report);
    shape::check_normals(&subject, report);
    taxels::check_places(&subject, report);
    taxels::check_ids(&subject, report);
    taxels::check_quantities(&subject, report);
}
