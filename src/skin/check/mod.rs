//! Everything that is wrong with a draft, found without changing it.

mod finding;
mod gaps;
mod shape;
mod taxels;
mod topology;

pub use finding::{Element, Finding, FindingKind};

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::Edges,
    skin::{
        Draft, MeshOptions, Remark, RemarkKind, Sheet, assemble, check::topology::Topology, mesh_bare,
        names::sheet_name, normals::taxel_normals, triangulate::Places, unit_check::doubtful_unit,
        welded::Surface, winding::Winding,
    },
};

/// Everything that is wrong with a draft, by sheet and kind; empty for a healthy one.
///
/// Healthy is what [`crate::skin::assemble`] takes as it is, and a user means: sheets of one piece, each with an
/// outer boundary and any number of holes of five edges or more, wound outward, of taxels that can be told
/// apart. Vertices that a file splits along seams of its normals or textures are healthy too, and so are slots marked as
/// absent that have no face. Holes of three or four edges are findings: a taxel leaves a larger one, so a face
/// is missing there. Takes time near-linear in the size of the draft, and never panics.
#[must_use]
pub fn check(draft: &Draft) -> Vec<Finding> {
    check_with(draft, &MeshOptions::default())
}

/// [`check`], with bare taxels joined as `options` say.
#[must_use]
pub fn check_with(draft: &Draft, options: &MeshOptions) -> Vec<Finding> {
    let mut findings = Vec::new();
    let backward = draft.links.enumerate().filter(|(link, l)| l.parent.is_some_and(|p| p >= *link));
    let backward: Vec<u64> = backward.map(|(link, _)| u64::from(link.raw())).collect();
    if !backward.is_empty() {
        let message = format!("{} links come before their parents", backward.len());
        let patch = String::new();
        findings.push(Finding { kind: FindingKind::LinkOrder, patch, elements: backward, message });
    }
    for sheet in &draft.sheets {
        check_sheet(sheet, draft.links.len(), &mut findings);
    }
    if let Some((sheet, message)) = doubtful_unit(&draft.sheets) {
        findings.push(Finding::of_sheet(FindingKind::DoubtfulUnit, sheet, message));
    }
    if draft.is_bare() {
        findings.retain(|f| f.kind != FindingKind::IsolatedTaxel);
        let taxels = draft.sheets.iter().filter(|sheet| !sheet.positions.is_empty());
        findings.splice(0..0, taxels.map(bare));
        check_meshing(draft, options, &mut findings);
    } else if draft.sheets.iter().all(|sheet| sheet.triangles.is_empty()) {
        let message = "there is no triangle in it: a skin needs taxels joined by triangles".into();
        findings.push(Finding::of_sheet(FindingKind::NoTriangles, only_name(draft), message));
    }
    findings
}

fn bare(sheet: &Sheet) -> Finding {
    let message =
        "its taxels have no triangles; reading it as a skin joins them, and `convert` tells what was assumed";
    Finding::of_sheet(FindingKind::Bare, sheet_name(sheet), message.into())
}

/// Name of the sheet that a finding about the whole draft concerns; empty if there are several.
fn only_name(draft: &Draft) -> &str {
    match draft.sheets.as_slice() {
        [sheet] => sheet_name(sheet),
        _ => "",
    }
}

/// Notes what becomes of bare taxels: why they cannot be meshed, which are merged, into what pieces they fall, and which are left
/// out.
fn check_meshing(draft: &Draft, options: &MeshOptions, findings: &mut Vec<Finding>) {
    let assembled = mesh_bare(draft, options).and_then(|meshed| assemble(&meshed));
    if assembled.is_ok() {
        // Not only what lies exactly where another taxel lies is merged.
        findings.retain(|f| f.kind != FindingKind::DuplicatePosition);
        for sheet in &draft.sheets {
            let places = Places::new(sheet);
            if !places.merged.is_empty() {
                let elements = places.merged.iter().map(|&k| k as u64).collect();
                let message = places.told_merged();
                let finding = Finding::of_sheet(FindingKind::DuplicatePosition, sheet_name(sheet), message);
                findings.push(Finding { elements, ..finding });
            }
        }
    }
    let mut note = |kind, patch: &str, message| findings.push(Finding::of_sheet(kind, patch, message));
    match assembled {
        Err(why) => note(FindingKind::NoSkin, only_name(draft), why.to_string()),
        Ok(assembled) => {
            let of_kind = |r: &&Remark| matches!(r.kind, RemarkKind::Components | RemarkKind::LeftOut);
            for remark in assembled.remarks[draft.remarks.len()..].iter().filter(of_kind) {
                note(FindingKind::BarePieces, &remark.patch, remark.message.clone());
            }
        }
    }
}

/// One sheet with all that the parts of the check need to know of it.
struct Subject<'a> {
    sheet: &'a Sheet,
    surface: Surface,
    edges: Edges,
    winding: Winding,
    /// Believable parts of the taxels' normals; `None` without normals.
    normals: Option<IdVec<VertexId, glam::DVec3>>,
}

/// The findings of one sheet; of each kind one.
struct Report<'a> {
    patch: &'a str,
    findings: Vec<Finding>,
}

impl Report<'_> {
    /// Notes a finding, unless it has no elements.
    fn add(&mut self, kind: FindingKind, elements: Vec<u64>, message: impl FnOnce(usize) -> String) {
        let per_item = if kind.element() == Element::Edge { 2 } else { 1 };
        if !elements.is_empty() {
            let message = message(elements.len() / per_item);
            self.findings.push(Finding { kind, patch: self.patch.to_owned(), elements, message });
        }
    }

    /// Notes a finding about the whole sheet.
    fn add_whole(&mut self, kind: FindingKind, message: String) {
        self.findings.push(Finding::of_sheet(kind, self.patch, message));
    }
}

fn check_sheet(sheet: &Sheet, links: usize, findings: &mut Vec<Finding>) {
    let mut report = Report { patch: sheet_name(sheet), findings: Vec::new() };
    if let Some(link) = sheet.link.filter(|l| l.index() >= links) {
        let message = format!("it hangs on link {link}, but there are {links} links");
        report.add_whole(FindingKind::UnknownLink, message);
    }
    if let Some((_, found)) = sheet.wrong_length() {
        let needed = sheet.positions.len();
        let message =
            format!("an array has {found} entries for {needed} vertices; nothing else was looked at");
        report.add_whole(FindingKind::ArrayLength, message);
    } else if sheet.positions.len() >= u32::MAX as usize || sheet.triangles.len() >= (u32::MAX / 3) as usize {
        let message =
            "it has more vertices or faces than 32-bit numbers count; nothing else was looked at".into();
        report.add_whole(FindingKind::TooLarge, message);
    } else {
        check_surface(sheet, &mut report);
    }
    report.findings.sort_by_key(|f| f.kind);
    findings.append(&mut report.findings);
}

fn check_surface(sheet: &Sheet, report: &mut Report<'_>) {
    let usable = taxels::usable_faces(sheet, report);
    let mut surface = Surface::new(sheet, |face: FaceId| usable[face]);
    let edges = Edges::new(&surface.mesh.triangles, surface.mesh.positions.len());
    let touching = surface.part_fans(sheet, &edges);
    let winding = Winding::new(&surface.mesh, &edges);
    let normals = sheet.normals.as_deref().map(|n| taxel_normals(n, &surface.taxel));
    let subject = Subject { sheet, surface, edges, winding, normals };
    let is_manifold = topology::check_manifold(&subject, &touching, report);
    topology::check_components(&subject, report);
    if is_manifold {
        let topology = Topology::new(&subject);
        topology.check(&subject, report);
        gaps::check_gaps(&subject, report);
    }
    shape::check_faces(&subject, report);
    shape::check_winding(&subject, report);
    shape::check_normals(&subject, report);
    taxels::check_places(&subject, report);
    taxels::check_ids(&subject, report);
    taxels::check_quantities(&subject, report);
}

/// Elements as a finding lists them.
fn numbers<T: Copy + Into<u64>>(elements: impl IntoIterator<Item = T>) -> Vec<u64> {
    elements.into_iter().map(Into::into).collect()
}
