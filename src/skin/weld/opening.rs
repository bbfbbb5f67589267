//! Which components of a sheet a file cuts open on purpose.
//!
//! *Heuristic*: an index buffer splits vertices where normals or texture coordinates jump, and a
//! seam splits them where a surface is cut to be flattened. A component is taken as cut if its
//! faces are one disk, with holes or without, by the vertices of the file, while welded it is
//! closed, has handles or more boundary loops. Exporters that split at sharp edges leave several
//! pieces (a cube six), or slits that change no topology, and both are welded.

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Edges, Halfedge, TriMesh},
    numeric::DisjointSets,
    skin::weld::fans::{join, split_fans},
};

/// For every face whether its component stays cut as in the file; empty if none does.
///
/// `is_cut` tells the edges of two faces that share no edge in the file, `in_file` the vertex of the
/// file that a halfedge starts from.
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
    let mut has_cut = vec![false; mesh.triangles.len()];
    let mut is_crowded = vec![false; mesh.triangles.len()];
    for uses in edges.iter() {
        let cut = is_cut(uses);
        for other in &uses[1..] {
            welded.join(uses[0].face(), other.face());
            if !cut {
                pieces.join(uses[0].face(), other.face());
            }
        }
        has_cut[uses[0].face().index()] |= cut;
        is_crowded[uses[0].face().index()] |= uses.len() > 2;
    }
    // Of the root of each component: whether it is cut, and still one piece.
    let mut candidates = IdVec::<FaceId, bool>::filled(false, mesh.triangles.len());
    for face in mesh.triangles.ids().filter(|face| has_cut[face.index()]) {
        candidates[welded.root(face)] = true;
    }
    for face in mesh.triangles.ids() {
        let root = welded.root(face);
        if pieces.root(face) != root || is_crowded[face.index()] {
            candidates[root] = false;
        }
    }
    if candidates.iter().all(|&c| !c) {
        return Vec::new();
    }
    let component = mesh.triangles.ids().map(|face| welded.root(face)).collect::<IdVec<FaceId, _>>();
    let closed = Topology::of(mesh, edges, &component, |_| true, &in_file);
    let open = Topology::of(mesh, edges, &component, |uses| !is_cut(uses), &in_file);
    let stays = |root: FaceId| {
        let (closed, open) = (closed[root], open[root]);
        let is_opened = closed.loops == 0 || closed.handles() > 0 || open.loops < closed.loops;
        candidates[root] && open.handles() == 0 && open.loops > 0 && is_opened
    };
    let kept: Vec<bool> = component.iter().map(|&root| stays(root)).collect();
    if kept.iter().any(|&k| k) { kept } else { Vec::new() }
}

/// The Euler characteristic and the number of boundary loops of a component.
#[derive(Debug, Clone, Copy, Default)]
struct Topology {
    euler: i64,
    loops: i64,
}

impl Topology {
    /// Of every component, at its root, with the faces joined across the edges for which `is_joined`
    /// holds.
    fn of(
        mesh: &TriMesh,
        edges: &Edges,
        component: &IdVec<FaceId, FaceId>,
        is_joined: impl Fn(&[Halfedge]) -> bool,
        in_file: impl Fn(Halfedge) -> VertexId,
    ) -> IdVec<FaceId, Self> {
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
        let mut topology = IdVec::<FaceId, Self>::filled(Self::default(), triangles.len());
        let mut seen = IdVec::<VertexId, bool>::filled(false, vertices);
        for (face, t) in triangles.enumerate() {
            let new: i64 = t.iter().map(|&v| i64::from(!std::mem::replace(&mut seen[v], true))).sum();
            topology[component[face]].euler += new + 1;
        }
        // The loops are the sets of vertices along boundary edges.
        let mut rims = DisjointSets::<VertexId>::new(vertices);
        let mut boundary = Vec::new();
        let ends = |h: Halfedge| [triangles[h.face()][h.side()], triangles[h.face()][h.next().side()]];
        for uses in Edges::new(&triangles, vertices).iter() {
            let root = component[uses[0].face()];
            topology[root].euler -= 1;
            if let &[h] = uses {
                let [a, b] = ends(h);
                rims.join(a, b);
                boundary.push((a, root));
            }
        }
        let mut counted = IdVec::<VertexId, bool>::filled(false, vertices);
        for (v, root) in boundary {
            let rim = rims.root(v);
            topology[root].loops += i64::from(!std::mem::replace(&mut counted[rim], true));
        }
        topology
    }

    /// Twice the number of handles, by Euler's formula; a one-sided component has an odd number.
    const fn handles(self) -> i64 {
        2 - self.loops - self.euler
    }
}
