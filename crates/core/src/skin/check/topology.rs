//! Manifoldness, components, boundary loops and handles.

use crate::id::{FaceId, VertexId};
use crate::mesh::{FillHoles, Halfedge, Part, Topology, TriMesh, fillings, loops_of, separate};
use crate::skin::check::finding::{Report, Subject};
use crate::skin::check::{Elements, FindingKind};

/// Reports edges, vertices and strips because of which the sheet is not an oriented manifold; returns whether
/// every edge has at most two faces.
pub(super) fn check_manifold(subject: &Subject<'_>, report: &mut Report<'_>) -> bool {
    let Subject { surface, winding, .. } = subject;
    let in_file = |ends: [VertexId; 2]| ends.map(|v| surface.in_file(v));
    let crowded = surface.crowded();
    let is_sheet = crowded.is_empty();
    let most = surface.edges.iter().map(|uses| uses.len()).max().unwrap_or(0);
    report.add(FindingKind::NonManifoldEdge { most }, Elements::Edges(crowded));
    report.add_vertices(FindingKind::NonManifoldVertex, surface.touching.iter().copied());
    let conflicts = winding.conflicting_edges.iter().copied().map(in_file).collect();
    report.add(FindingKind::NotOrientable, Elements::Edges(conflicts));
    is_sheet
}

pub(super) fn check_components(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { surface, winding, .. } = subject;
    if winding.components.count > 1 {
        let mut sizes = vec![0_usize; winding.components.count];
        winding.components.of.iter().for_each(|&c| sizes[c] += 1);
        let (least, most) =
            (sizes.iter().min().copied().unwrap_or(0), sizes.iter().max().copied().unwrap_or(0));
        let firsts = winding.components.firsts().into_iter().map(|f| surface.file_faces[f]);
        report.add_faces(FindingKind::SeveralComponents { least, most }, firsts);
    }
}

/// Reports pin-holes, closed pieces and handles of a manifold sheet.
pub(super) fn check_loops(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { surface, winding, .. } = subject;
    let TriMesh { positions, triangles } = &surface.mesh;
    let pieces = Topology::of_components(triangles, &surface.edges, &winding.components, positions.len());
    let firsts: Vec<FaceId> =
        winding.components.firsts().into_iter().map(|face| surface.file_faces[face]).collect();
    let those = |is_one: &dyn Fn(&Topology) -> bool| -> Vec<FaceId> {
        pieces.iter().zip(&firsts).filter(|(piece, _)| is_one(piece)).map(|(_, &first)| first).collect()
    };
    let is_orientable = winding.conflicting_edges.is_empty();
    if is_orientable {
        let holes = pin_holes(subject);
        let vertices = holes.iter().flatten().map(|&v| surface.in_file(v));
        report.add_vertices(FindingKind::PinHole { holes: holes.len() }, vertices);
    }
    report.add_faces(FindingKind::ClosedPatch, those(&|piece| piece.loops == 0));
    if is_orientable {
        let handles = |piece: &Topology| usize::try_from(piece.twice_handles() / 2).unwrap_or(0);
        let kind = FindingKind::Handle { handles: pieces.iter().map(handles).sum() };
        report.add_faces(kind, those(&|piece| handles(piece) > 0));
    }
}

/// The pin-holes of an orientable manifold sheet.
fn pin_holes(subject: &Subject<'_>) -> Vec<Vec<VertexId>> {
    let Subject { surface, winding, .. } = subject;
    let along = |uses: &[Halfedge]| {
        let &[h] = uses else { return None };
        let [a, b] = [h.start(&surface.mesh), h.end(&surface.mesh)];
        Some(if winding.reversed[h.face()] { [b, a] } else { [a, b] })
    };
    let mut edges: Vec<[VertexId; 2]> = surface.edges.iter().filter_map(along).collect();
    edges.sort_unstable();
    if loops_of(&edges).iter().all(|walk| walk.len() > FillHoles::PinHoles.most_edges()) {
        return Vec::new();
    }
    let mut wound = surface.mesh.clone();
    for (t, _) in wound.triangles.iter_mut().zip(&winding.reversed).filter(|(_, reversed)| **reversed) {
        t.swap(1, 2);
    }
    let pieces = separate(&wound, &winding.components.of.map(|&c| Some(c)), winding.components.count);
    let mut holes = Vec::new();
    for Part { vertices, mesh } in &pieces {
        // Corners that rounding made coincident can leave a piece that is not a manifold.
        for filling in fillings(mesh, FillHoles::PinHoles).unwrap_or_default() {
            holes.push(filling.hole.into_iter().map(|v| vertices[v]).collect());
        }
    }
    holes
}
