//! Which components of a sheet a file cuts open on purpose.
//!
//! *Heuristic*: an index buffer splits vertices where normals or texture coordinates jump, and a seam splits
//! them where a surface is cut to be flattened. A component counts as cut if its faces are one disk, with or
//! without holes, by the vertices of the file, but closed or with handles or more boundary loops when welded.
//! Exporters that split at sharp edges leave several pieces (a cube six), or slits that change no topology,
//! and both are welded.

use crate::id::{FaceId, VertexId};
use crate::mesh::{Edges, Halfedge, Topology, TriMesh};
use crate::numeric::{DisjointSets, Labels};
use crate::skin::weld::fans::{join, split_fans};

/// For every face whether its component stays cut as in the file; empty if none does.
///
/// `is_cut` is true for edges of two faces that share no edge in the file; `in_file` gives the vertex of the
/// file at which a halfedge starts.
pub(in crate::skin) fn kept_open(
    mesh: &TriMesh,
    edges: &Edges,
    is_cut: impl Fn(&[Halfedge]) -> bool,
    in_file: impl Fn(Halfedge) -> VertexId,
) -> Vec<bool> {
    if !edges.iter().any(&is_cut) {
        return Vec::new();
    }
    let mut welded = DisjointSets::<FaceId>::new(mesh.triangles.len());
    let mut pieces = DisjointSets::<FaceId>::new(mesh.triangles.len());
    for uses in edges.iter() {
        let cut = is_cut(uses);
        for other in &uses[1..] {
            welded.join(uses[0].face(), other.face());
            if !cut {
                pieces.join(uses[0].face(), other.face());
            }
        }
    }
    // For each component whether it is cut, still connected, and without edges of more than two faces.
    let components = welded.labels();
    let mut candidates = vec![false; components.count];
    for uses in edges.iter().filter(|uses| is_cut(uses)) {
        candidates[components.of[uses[0].face()]] = true;
    }
    for uses in edges.iter().filter(|uses| uses.len() > 2) {
        candidates[components.of[uses[0].face()]] = false;
    }
    for (face, &component) in components.of.enumerate() {
        candidates[component] &= pieces.root(face) == welded.root(face);
    }
    if candidates.iter().all(|&c| !c) {
        return Vec::new();
    }
    let closed = topologies(mesh, edges, &components, |_| true, &in_file);
    let open = topologies(mesh, edges, &components, |uses| !is_cut(uses), &in_file);
    let stays = |&component: &usize| {
        let (closed, open) = (closed[component], open[component]);
        let is_opened = closed.loops == 0 || closed.twice_handles() > 0 || open.loops < closed.loops;
        candidates[component] && open.is_disk() && is_opened
    };
    let kept: Vec<bool> = components.of.iter().map(stays).collect();
    if kept.iter().any(|&k| k) { kept } else { Vec::new() }
}

/// The topology of every component, with its faces joined across the edges for which `is_joined` holds.
fn topologies(
    mesh: &TriMesh,
    edges: &Edges,
    components: &Labels<FaceId>,
    is_joined: impl Fn(&[Halfedge]) -> bool,
    in_file: impl Fn(Halfedge) -> VertexId,
) -> Vec<Topology> {
    let mut fans = DisjointSets::<Halfedge>::new(4 * mesh.triangles.len());
    for uses in edges.iter().filter(|uses| is_joined(uses)) {
        uses[1..].iter().for_each(|&other| join(mesh, &mut fans, uses[0], other));
    }
    let split = split_fans(mesh, &mut fans, in_file);
    let mut triangles = mesh.triangles.clone();
    for (corner, name) in split.corners {
        triangles[corner.face()][corner.side()] = name;
    }
    let vertices = mesh.positions.len() + split.copied.len();
    Topology::of_components(&triangles, &Edges::new(&triangles, vertices), components, vertices)
}
