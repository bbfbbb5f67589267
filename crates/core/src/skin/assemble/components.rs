//! One sheet, welded, consistently wound and without faces of zero area, split into its components.

use std::collections::BTreeSet;

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, Part, TriMesh, separate, triangle_cross};
use crate::skin::assemble::zero_area::{Cleared, clear_zero_area};
use crate::skin::normals::mean_directions;
use crate::skin::remark::note;
use crate::skin::weld::WeldOptions;
use crate::skin::weld::welded_mesh::WeldedMesh;
use crate::skin::weld::winding::{Winding, one_sided_strip};
use crate::skin::{RemarkKind, Sheet, SkinError};

/// One sheet, ready to be split into patches.
pub(super) struct Components<'a> {
    pub sheet: &'a Sheet,
    /// For each vertex its vertex in the file.
    pub in_file: IdVec<VertexId, VertexId>,
    /// Unit normals of the taxels, zero where there is none; `None` without normals.
    pub normals: Option<IdVec<VertexId, DVec3>>,
    /// Unit tangents, zero where there is none; `None` without tangents.
    pub tangents: Option<IdVec<VertexId, DVec3>>,
    /// The component of each face; `None` for a face that was dropped.
    pub component: IdVec<FaceId, Option<usize>>,
    pub count: usize,
    /// Whether each face is wound against the file.
    pub turned: IdVec<FaceId, bool>,
    /// The number of each face in the file.
    pub file_faces: IdVec<FaceId, FaceId>,
    /// Faces of the file that were dropped, since an earlier one has the same corners.
    pub duplicates: Vec<FaceId>,
    /// For every vertex of the file the first one with its position and id.
    pub place: IdVec<VertexId, VertexId>,
    mesh: TriMesh,
}

/// A future patch: its taxels, numbered as in the sheet, and its faces.
#[derive(Debug)]
pub(super) struct Component {
    /// As [`Components::component`] counts it.
    pub number: usize,
    pub vertices: IdVec<VertexId, VertexId>,
    pub mesh: TriMesh,
    /// How many of its faces are wound against the file.
    pub turned: usize,
}

impl<'a> Components<'a> {
    /// Welds and winds a valid sheet.
    pub(super) fn new(
        sheet: &'a Sheet,
        welding: WeldOptions,
        remarks: &mut Vec<RemarkKind>,
    ) -> Result<Self, SkinError> {
        let patch = || sheet.title().to_owned();
        let surface = WeldedMesh::new(sheet, welding, |_| true);
        let crowded = surface.crowded();
        if !crowded.is_empty() {
            return Err(SkinError::NonManifoldEdges { patch: patch(), edges: crowded });
        }
        let again = repeated_faces(&surface);
        if !again.is_empty() {
            return Err(SkinError::DuplicateFaces { patch: patch(), faces: again });
        }
        let winding = Winding::new(&surface.mesh, &surface.edges);
        if let Some(&edge) = winding.conflicting_edges.first() {
            let strip = one_sided_strip(&surface.mesh, &surface.edges, edge);
            let faces = strip.into_iter().map(|face| surface.file_faces[face]).collect();
            let edge = edge.map(|v| surface.in_file(v));
            return Err(SkinError::NotOrientable { patch: patch(), edge, faces });
        }
        report_splits(&surface, remarks);
        let in_file = surface.mesh.positions.ids().map(|v| surface.in_file(v)).collect();
        let WeldedMesh { mut mesh, taxel, copied, file_faces, repeated, duplicates, place, .. } = surface;
        for (face, t) in mesh.triangles.iter_mut().enumerate() {
            if winding.reversed[FaceId::new(face)] {
                t.swap(1, 2);
            }
        }
        let mut cleared = clear_zero_area(&mut mesh);
        let area = |face: FaceId| triangle_cross(mesh.corners(face)).length();
        let flat: f64 = cleared.kept.iter().map(|&face| area(face)).sum();
        if 2.0 * flat > mesh.triangles.ids().map(area).sum::<f64>() {
            let (faces, of) = (cleared.kept.len(), mesh.triangles.len());
            return Err(SkinError::Needles { patch: patch(), faces, of });
        }
        let mut component: IdVec<FaceId, Option<usize>> = winding.components.of.map(|&c| Some(c));
        cleared.drop_flat_pieces(&mesh, &component);
        for &face in &cleared.dropped {
            component[face] = None;
        }
        report_faces(repeated, &cleared, &file_faces, remarks);
        let normals = sheet.normals.as_deref().map(|n| mean_directions(n, &taxel, &copied));
        let tangents = sheet.tangents.as_deref().map(|t| mean_directions(t, &taxel, &copied));
        let (turned, count) = (winding.reversed, winding.components.count);
        let this = Self {
            sheet,
            in_file,
            normals,
            tangents,
            component,
            count,
            turned,
            file_faces,
            duplicates,
            place,
            mesh,
        };
        this.report_taxels(&taxel, remarks);
        Ok(this)
    }

    /// Reports which taxels have no face, and how many vertices were welded.
    fn report_taxels(&self, taxel: &IdVec<VertexId, VertexId>, remarks: &mut Vec<RemarkKind>) {
        let mut used = IdVec::<VertexId, bool>::filled(false, self.mesh.positions.len());
        for (face, t) in self.mesh.triangles.enumerate() {
            if self.component[face].is_some() {
                t.iter().for_each(|&v| used[v] = true);
            }
        }
        let mut merged = 0_usize;
        let mut left_out = Vec::new();
        for (v, &first) in taxel.enumerate() {
            if used[first] {
                merged += usize::from(first != v);
            } else {
                left_out.push(v);
            }
        }
        if merged > 0 {
            let taxels = used.iter().take(taxel.len()).filter(|&&u| u).count();
            remarks.push(RemarkKind::Welded { vertices: taxels + merged, taxels });
        }
        note(remarks, left_out, |vertices| RemarkKind::LeftOut { vertices });
    }

    /// The taxels and faces of each component that has any, in the order of the file.
    pub(super) fn split(&self) -> Vec<Component> {
        let mut turned = vec![0; self.count];
        for (component, is_turned) in self.component.iter().zip(&self.turned) {
            if let Some(component) = *component {
                turned[component] += usize::from(*is_turned);
            }
        }
        let parts = separate(&self.mesh, &self.component, self.count).into_iter().zip(turned);
        let components = parts.enumerate().map(|(number, (Part { vertices, mesh }, turned))| Component {
            number,
            vertices,
            mesh,
            turned,
        });
        components.filter(|component| !component.vertices.is_empty()).collect()
    }
}

/// The faces of the file with the same corners as an earlier one; no edge has more than two faces.
fn repeated_faces(surface: &WeldedMesh) -> Vec<FaceId> {
    let apex = |h: Halfedge| h.previous().start(&surface.mesh);
    let again = surface.edges.iter().filter_map(|uses| match uses[..] {
        [a, b] if apex(a) == apex(b) => Some(surface.file_faces[a.face().max(b.face())]),
        _ => None,
    });
    let again: BTreeSet<FaceId> = again.collect();
    again.into_iter().collect()
}

/// Reports what was cut, dropped or split to make a manifold.
fn report_splits(surface: &WeldedMesh, remarks: &mut Vec<RemarkKind>) {
    if surface.cut > 0 {
        remarks.push(RemarkKind::CutKept { edges: surface.cut });
    }
    note(remarks, surface.duplicates.clone(), |faces| RemarkKind::DuplicatesDropped { faces });
    note(remarks, surface.split_edges.clone(), |edges| RemarkKind::EdgesParted { edges });
    note(remarks, surface.divided.clone(), |edges| RemarkKind::EdgesDivided { edges });
    note(remarks, surface.one_sided.clone(), |edges| RemarkKind::OneSidedCut { edges });
    note(remarks, surface.touching.clone(), |vertices| RemarkKind::FansSplit { vertices });
}

fn report_faces(
    repeated: Vec<FaceId>,
    cleared: &Cleared,
    file_faces: &IdVec<FaceId, FaceId>,
    remarks: &mut Vec<RemarkKind>,
) {
    let in_file = |faces: &[FaceId]| faces.iter().map(|&f| file_faces[f]).collect();
    note(remarks, repeated, |faces| RemarkKind::RepeatedCorner { faces });
    note(remarks, in_file(&cleared.dropped), |faces| RemarkKind::ZeroAreaDropped { faces });
    note(remarks, in_file(&cleared.flipped), |faces| RemarkKind::ZeroAreaFlipped { faces });
    note(remarks, in_file(&cleared.kept), |faces| RemarkKind::ZeroAreaKept { faces });
}
