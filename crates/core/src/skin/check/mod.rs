//! Checking: everything that is wrong with a draft, found without changing it.

mod finding;
mod gaps;
mod modules;
mod shape;
mod taxels;
mod topology;

use crate::id::FaceId;
use crate::mesh::too_many;
use crate::skin::check::finding::{Report, Subject};
use crate::skin::link::before_parents;
use crate::skin::normals::mean_directions;
use crate::skin::triangulate::UniquePoints;
use crate::skin::weld::welded_mesh::WeldedMesh;
use crate::skin::weld::winding::Winding;
use crate::skin::{AssembleOptions, Draft, Remark, RemarkKind, Sheet, assemble};

pub use finding::{Elements, Finding, FindingKind, Severity};

/// Everything that is wrong with a draft: sheet by sheet, errors first; empty if nothing is.
///
/// A sheet has no findings if [`crate::skin::assemble`] takes it unchanged and it is probably what was meant:
/// one piece with an outer boundary and any number of holes other than pin-holes, wound outward, of taxels
/// that can be distinguished. Vertices that a file splits along seams of its normals or textures are fine
/// too, and so are slots marked as absent that have no face.
///
/// With an error among the findings ([`Severity::Error`]), and only then, the draft is refused by
/// [`crate::skin::assemble`] with the same `options`; with [`AssembleOptions::keep_going`] the sheets of the
/// errors may be left out instead. Errors that no other kind describes are [`FindingKind::NoSkin`]. Takes
/// time near-linear in the size of the draft, and never panics.
///
/// Bare taxels are joined with `options` first, and the result is checked.
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
///     positions: mesh.positions.as_slice().to_vec(),
///     triangles: triangles.map(|t| t.map(|v| v.raw())).collect(),
///     ..Sheet::default()
/// };
/// let draft = Draft { sheets: vec![sheet], ..Draft::default() };
/// let findings = check(&draft, &AssembleOptions::default());
/// assert_eq!((findings.len(), &findings[0].kind), (1, &FindingKind::PinHole { holes: 1 }));
/// ```
pub fn check(draft: &Draft, options: &AssembleOptions) -> Vec<Finding> {
    let mut whole = Report::new(only_name(draft));
    let backward: Vec<_> = before_parents(&draft.links).collect();
    if !backward.is_empty() {
        whole.add(FindingKind::LinkOrder, Elements::Links(backward));
    }
    let of_sheet = |sheet: &Sheet| check_sheet(sheet, draft.links.len(), options);
    let mut findings: Vec<Finding> = draft.sheets.iter().flat_map(of_sheet).collect();
    if let Some((sheet, extent)) = draft.doubtful_unit() {
        findings.push(Finding::whole(sheet.title(), FindingKind::DoubtfulUnit { extent }));
    }
    if draft.is_bare() {
        check_bare(draft, options, &mut findings, &mut whole);
    } else if draft.sheets.iter().all(|sheet| sheet.triangles.is_empty()) {
        whole.add(FindingKind::NoTriangles, Elements::Whole);
    }
    whole.findings.append(&mut findings);
    let is_error = |found: &Finding| found.severity() == Severity::Error;
    if !draft.is_bare()
        && !whole.findings.iter().any(is_error)
        && let Err(reason) = assemble(draft, options)
    {
        whole.findings.push(Finding::whole("", FindingKind::NoSkin { reason }));
    }
    whole.findings
}

fn only_name(draft: &Draft) -> &str {
    match draft.sheets.as_slice() {
        [sheet] => sheet.title(),
        _ => "",
    }
}

/// Reports how bare taxels are joined: why they cannot be, which are merged, what components they make, and
/// which are left out.
fn check_bare(draft: &Draft, options: &AssembleOptions, findings: &mut Vec<Finding>, whole: &mut Report<'_>) {
    // Assembling reports which taxels are left out, and also merges taxels that are only nearly coincident.
    let is_isolated = |kind: &FindingKind| matches!(kind, FindingKind::IsolatedTaxel { .. });
    let is_duplicate = |kind: &FindingKind| matches!(kind, FindingKind::DuplicatePosition { .. });
    findings.retain(|f| !is_isolated(&f.kind));
    let taxels = draft.sheets.iter().filter(|sheet| !sheet.positions.is_empty());
    whole.findings.extend(taxels.map(|sheet| Finding::whole(sheet.title(), FindingKind::Bare)));
    let assembled = match assemble(draft, options) {
        Ok(assembled) => assembled,
        Err(reason) => return whole.add(FindingKind::NoSkin { reason }, Elements::Whole),
    };
    findings.retain(|f| !is_duplicate(&f.kind));
    for sheet in &draft.sheets {
        let points = UniquePoints::new(sheet);
        let mut report = Report::new(sheet.title());
        let kind = FindingKind::DuplicatePosition { distance: points.distance };
        report.add(kind, Elements::Vertices(points.merged));
        findings.append(&mut report.findings);
    }
    for Remark { patch, kind } in &assembled.remarks[draft.remarks.len()..] {
        let mut report = Report::new(patch);
        match kind.clone() {
            RemarkKind::Components { patches } => {
                report.add(FindingKind::BarePieces { patches }, Elements::Whole);
            }
            RemarkKind::LeftOut { vertices } => {
                report.add(FindingKind::BareLeftOut, Elements::Vertices(vertices));
            }
            RemarkKind::SheetLeftOut { reason, .. } => {
                report.add(FindingKind::BareSheetLeftOut { reason }, Elements::Whole);
            }
            _ => {}
        }
        findings.append(&mut report.findings);
    }
}

fn check_sheet(sheet: &Sheet, links: usize, options: &AssembleOptions) -> Vec<Finding> {
    let mut report = Report::new(sheet.title());
    if let Some(link) = sheet.link.filter(|l| l.index() >= links) {
        report.add(FindingKind::UnknownLink { link, links }, Elements::Whole);
    }
    if let Some((what, found)) = sheet.wrong_length() {
        let needed = sheet.positions.len();
        report.add(FindingKind::ArrayLength { what, found, needed }, Elements::Whole);
    } else if too_many(sheet.positions.len(), sheet.triangles.len()).is_some() {
        report.add(FindingKind::TooLarge, Elements::Whole);
    } else {
        check_surface(sheet, options, &mut report);
        modules::check_congruent(sheet, &mut report);
    }
    report.findings.sort_by_key(Finding::severity);
    report.findings
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
