//! What every part of the check works on: one sheet, and the findings about it.

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    skin::{
        Sheet,
        check::finding::{Finding, FindingKind},
        welded::WeldedMesh,
        winding::Winding,
    },
};

/// One sheet with everything that the parts of the check need to know about it.
pub(super) struct Subject<'a> {
    pub sheet: &'a Sheet,
    pub surface: WeldedMesh,
    pub winding: Winding,
    /// Unit normals of the taxels, zero where there is none; `None` without normals.
    pub normals: Option<IdVec<VertexId, DVec3>>,
}

/// The findings of one sheet, at most one of each kind.
pub(super) struct Report<'a> {
    pub patch: &'a str,
    pub findings: Vec<Finding>,
}

impl Report<'_> {
    /// Adds a finding, unless it has no elements; `message` takes their number.
    pub(super) fn add(
        &mut self,
        kind: FindingKind,
        elements: Vec<u64>,
        message: impl FnOnce(usize) -> String,
    ) {
        let per_item = if kind.elements() == "edges" { 2 } else { 1 };
        if !elements.is_empty() {
            let message = message(elements.len() / per_item);
            self.findings.push(Finding { kind, patch: self.patch.to_owned(), elements, message });
        }
    }

    pub(super) fn add_whole(&mut self, kind: FindingKind, message: String) {
        self.findings.push(Finding::of_sheet(kind, self.patch, message));
    }
}

/// Elements as a finding lists them.
pub(super) fn numbers<T: Copy + Into<u64>>(elements: impl IntoIterator<Item = T>) -> Vec<u64> {
    elements.into_iter().map(Into::into).collect()
}
