//! Manifoldness, components, boundary loops and handles.

use crate::{
    id::{IdVec, VertexId},
    numeric::{DisjointSets, order_by},
    skin::check::{
        FindingKind,
        report::{Report, Subject, numbers},
    },
};

/// A hole of at most this many edges is not a missing taxel: that would leave at least five.
const PIN_HOLE_EDGES: usize = 4;

/// Notes edges, vertices and strips that make the sheet no oriented manifold; says whether loops
/// can be counted.
pub(super) fn check_manifold(subject: &Subject<'_>, report: &mut Report<'_>) -> bool {
    let Subject { surface, winding, .. } = subject;
    let (mesh, edges) = (&surface.mesh, &surface.edges);
    let ends = |ends: [VertexId; 2]| ends.map(|v| u64::from(surface.in_file(v).raw()));
    let mut crowded = Vec::new();
    let mut most = 0;
    for uses in edges.iter().filter(|uses| uses.len() > 2) {
        crowded.extend(ends([uses[0].start(mesh), uses[0].end(mesh)]));
        most = most.max(uses.len());
    }
    let is_manifold = crowded.is_empty();
    report.add(FindingKind::NonManifoldEdge, crowded, |n| {
        format!(
            "{n} edges (pairs of vertices) have more than two faces, one has {most}; a sheet has one or two"
        )
    });
    report.add(FindingKind::NonManifoldVertex, numbers(surface.touching.iter().map(|v| v.raw())), |n| {
        format!("at {n} vertices several fans of faces touch in a point; the faces around a taxel must form one fan")
    });
    let conflicting_edges = winding.conflicting_edges.iter().copied().flat_map(ends).collect();
    report.add(FindingKind::NotOrientable, conflicting_edges, |n| {
        format!("a piece has one side only: at {n} edges (pairs of vertices) its faces cannot be wound the same way")
    });
    is_manifold
}

pub(super) fn check_components(subject: &Subject<'_>, report: &mut Report<'_>) {
    let Subject { surface, winding, .. } = subject;
    if winding.components > 1 {
        let mut sizes = vec![0_usize; winding.components];
        winding.component.iter().for_each(|&c| sizes[c] += 1);
        let (least, most) = (sizes.iter().min().unwrap_or(&0), sizes.iter().max().unwrap_or(&0));
        let firsts = first_faces(subject).into_iter().map(|f| surface.file_faces[f].raw());
        report.add(FindingKind::SeveralComponents, numbers(firsts), |n| {
            format!(
                "it falls into {n} pieces of {least} to {most} faces that share no edge; \
                 listed is the first face of each"
            )
        });
    }
}

fn first_faces(subject: &Subject<'_>) -> Vec<crate::id::FaceId> {
    let mut firsts = Vec::with_capacity(subject.winding.components);
    for (face, &piece) in subject.winding.component.enumerate() {
        if piece == firsts.len() {
            firsts.push(face);
        }
    }
    firsts
}

/// One boundary loop.
#[derive(Debug, Clone)]
struct Loop {
    piece: usize,
    vertices: Vec<VertexId>,
    /// In m.
    length: f64,
}

/// The boundary loops of a manifold sheet, by their smallest vertices.
fn boundary_loops(subject: &Subject<'_>) -> Vec<Loop> {
    let Subject { surface, winding, .. } = subject;
    let (mesh, edges) = (&surface.mesh, &surface.edges);
    let mut sets = DisjointSets::<VertexId>::new(mesh.positions.len());
    let mut boundary = Vec::new();
    for h in edges.iter().filter(|uses| uses.len() == 1).map(|uses| uses[0]) {
        let (a, b, piece) = (h.start(mesh), h.end(mesh), winding.component[h.face()]);
        sets.join(a, b);
        boundary.push((a, mesh.positions[a].distance(mesh.positions[b]), piece));
        boundary.push((b, 0.0, piece));
    }
    let order = order_by(boundary.len(), &|a, b| boundary[a].0.cmp(&boundary[b].0));
    let mut place = IdVec::<VertexId, usize>::filled(usize::MAX, mesh.positions.len());
    let mut loops: Vec<Loop> = Vec::new();
    for (v, length, piece) in order.into_iter().map(|k| boundary[k]) {
        let at = &mut place[sets.root(v)];
        if *at == usize::MAX {
            *at = loops.len();
            loops.push(Loop { piece, vertices: Vec::new(), length: 0.0 });
        }
        let this = &mut loops[*at];
        this.length += length;
        if this.vertices.last() != Some(&v) {
            this.vertices.push(v);
        }
    }
    loops
}

/// Vertices minus edges plus faces of each piece.
fn euler_characteristics(subject: &Subject<'_>) -> Vec<i64> {
    let Subject { surface, winding, .. } = subject;
    let edges = &surface.edges;
    let mut euler = vec![0_i64; winding.components];
    let mut seen = IdVec::<VertexId, bool>::filled(false, surface.mesh.positions.len());
    for (face, t) in surface.mesh.triangles.enumerate() {
        let new: i64 = t.iter().map(|&v| i64::from(!std::mem::replace(&mut seen[v], true))).sum();
        euler[winding.component[face]] += new + 1;
    }
    edges.iter().for_each(|uses| euler[winding.component[uses[0].face()]] -= 1);
    euler
}

/// Notes pin-holes, closed pieces and handles of a manifold sheet.
pub(super) fn check_loops(subject: &Subject<'_>, report: &mut Report<'_>) {
    let (pieces, loops) = (subject.winding.components, boundary_loops(subject));
    let mut count = vec![0_i64; pieces];
    let mut longest: Vec<Option<&Loop>> = vec![None; pieces];
    for this in &loops {
        count[this.piece] += 1;
        if longest[this.piece].is_none_or(|l| this.length > l.length) {
            longest[this.piece] = Some(this);
        }
    }
    let is_outer = |l: &Loop| longest[l.piece].is_some_and(|outer| std::ptr::eq(outer, l));
    let holes: Vec<&Loop> =
        loops.iter().filter(|l| l.vertices.len() <= PIN_HOLE_EDGES && !is_outer(l)).collect();
    let vertices = holes.iter().flat_map(|l| l.vertices.iter().map(|&v| subject.surface.in_file(v).raw()));
    report.add(FindingKind::PinHole, numbers(vertices), |_| {
        let count = holes.len();
        format!("{count} holes have three or four edges: faces are missing there; listed are their vertices")
    });
    let firsts = first_faces(subject);
    let file_face = |piece: usize| subject.surface.file_faces[firsts[piece]].raw();
    let closed = (0..pieces).filter(|&p| count[p] == 0).map(file_face);
    report.add(FindingKind::ClosedPatch, numbers(closed), |n| {
        format!("{n} pieces have no boundary: their map is cut open along a seam; listed is the first face of each")
    });
    if subject.winding.conflicting_edges.is_empty() {
        let euler = euler_characteristics(subject);
        // Euler's formula for an orientable surface: V - E + F = 2 - 2 handles - loops.
        let handles = |p: usize| (2 - count[p] - euler[p]) / 2;
        let with_handles = (0..pieces).filter(|&p| handles(p) > 0);
        let total: i64 = (0..pieces).map(handles).sum();
        report.add(FindingKind::Handle, numbers(with_handles.map(file_face)), |n| {
            format!(
                "{n} pieces have {total} handles, like that of a cup: their map is cut open along a seam; \
                 listed is the first face of each"
            )
        });
    }
}
