//! What every part of the check works on: one sheet, and the findings about it.

use glam::DVec3;

use crate::{
    id::{FaceId, IdVec, VertexId},
    skin::{
        Sheet,
        check::{Elements, Finding, FindingKind},
        weld::{welded_mesh::WeldedMesh, winding::Winding},
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
    patch: &'a str,
    pub findings: Vec<Finding>,
}

impl<'a> Report<'a> {
    pub(super) fn new(patch: &'a str) -> Self {
        Self { patch, findings: Vec::new() }
    }

    /// Adds a finding, unless it is about a list of elements that is empty.
    pub(super) fn add(&mut self, kind: FindingKind, elements: Elements) {
        if elements == Elements::Whole || !elements.is_empty() {
            self.findings.push(Finding { patch: self.patch.to_owned(), kind, elements });
        }
    }

    pub(super) fn add_vertices(&mut self, kind: FindingKind, vertices: impl IntoIterator<Item = VertexId>) {
        self.add(kind, Elements::Vertices(vertices.into_iter().collect()));
    }

    pub(super) fn add_faces(&mut self, kind: FindingKind, faces: impl IntoIterator<Item = FaceId>) {
        self.add(kind, Elements::Faces(faces.into_iter().collect()));
    }
}
