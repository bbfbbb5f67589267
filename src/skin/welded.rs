use std::collections::HashMap;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Edges, Halfedge, TriMesh},
    numeric::DisjointSets,
    skin::{Sheet, TaxelId},
};

/// The triangles of one sheet with the vertices welded that the file has split: what `assemble` repairs and `check`
/// judges.
///
/// Vertices keep the numbers of the file; of those that are one taxel, faces name the first.
#[derive(Debug)]
pub(super) struct Surface {
    /// Positions as in the file; corners welded.
    pub mesh: TriMesh,
    /// For every vertex of the file the first vertex that is the same taxel.
    pub taxel: IdVec<VertexId, VertexId>,
    /// What the file calls each face of `mesh`.
    pub file_faces: IdVec<FaceId, FaceId>,
    /// Faces of the file that are left out because they use a taxel twice.
    pub repeated: Vec<FaceId>,
}

impl Surface {
    /// Welds `sheet`, whose faces for which `usable` holds must have corners in range and finite.
    pub(super) fn new(sheet: &Sheet, usable: impl Fn(FaceId) -> bool) -> Self {
        let triangles: IdVec<FaceId, [VertexId; 3]> =
            sheet.triangles.iter().map(|t| t.map(VertexId::from)).collect();
        let mut mesh = TriMesh { positions: sheet.positions.clone().into(), triangles: IdVec::new() };
        let usable: Vec<FaceId> = triangles.ids().filter(|&f| usable(f)).collect();
        let taxel = weld(&mesh, sheet.ids.as_deref(), usable.iter().map(|&f| &triangles[f]));
        let (mut file_faces, mut repeated) = (IdVec::new(), Vec::new());
        for face in usable {
            let [a, b, c] = triangles[face].map(|v| taxel[v]);
            if a == b || b == c || c == a {
                repeated.push(face);
            } else {
                mesh.triangles.push([a, b, c]);
                file_faces.push(face);
            }
        }
        Self { mesh, taxel, file_faces, repeated }
    }

    /// Undoes each weld that made fans of faces touch in a point which are apart in the file, and returns the
    /// vertices where they touch in the file too.
    pub(super) fn part_fans(&mut self, sheet: &Sheet, edges: &Edges) -> Vec<VertexId> {
        let mut fans = Fans::new(&self.mesh, edges);
        let mut count = IdVec::<VertexId, u32>::filled(0, self.mesh.positions.len());
        for (face, t) in self.mesh.triangles.enumerate() {
            for (side, &v) in (0..).zip(t) {
                let corner = Halfedge { face, side };
                count[v] += u32::from(fans.of(corner) == corner);
            }
        }
        // Welded vertex, vertex of the file, fan: sorted, the fans of one vertex of the file stand side by side.
        let mut corners: Vec<(VertexId, VertexId, Halfedge)> = Vec::new();
        for (face, t) in self.mesh.triangles.enumerate() {
            let in_file = sheet.triangles[self.file_faces[face].index()].map(VertexId::from);
            for ((side, &v), at) in (0..).zip(t).zip(in_file) {
                if count[v] > 1 {
                    corners.push((v, at, fans.of(Halfedge { face, side })));
                }
            }
        }
        corners.sort_unstable();
        corners.dedup();
        let mut touching = Vec::new();
        for group in corners.chunk_by(|a, b| a.0 == b.0) {
            if group.windows(2).any(|pair| pair[0].1 == pair[1].1) {
                touching.push(group[0].0);
                continue;
            }
            let mut first_of_fan = HashMap::new();
            for &(_, in_file, fan) in group {
                self.taxel[in_file] = *first_of_fan.entry(fan).or_insert(in_file);
            }
        }
        if touching.is_empty() && !corners.is_empty() {
            for face in self.mesh.triangles.ids() {
                let in_file = sheet.triangles[self.file_faces[face].index()];
                self.mesh.triangles[face] = in_file.map(|v| self.taxel[VertexId::from(v)]);
            }
        }
        touching
    }
}

/// For every vertex the first one that is the same taxel.
///
/// Vertices are one taxel if their positions are exactly equal and so are their ids, or there are none. Ids alone
/// never weld: vendors repeat placeholders all over a skin. Vertices at one place with different ids are two taxels,
/// unless a face has both as corners: the edge between them has no length, and only one of them can stay.
fn weld<'a>(
    mesh: &TriMesh,
    ids: Option<&[TaxelId]>,
    triangles: impl Iterator<Item = &'a [VertexId; 3]>,
) -> IdVec<VertexId, VertexId> {
    let mut first = HashMap::with_capacity(mesh.positions.len());
    let mut taxel: IdVec<VertexId, VertexId> = mesh
        .positions
        .enumerate()
        .map(|(v, &p)| {
            // Adding zero makes -0 and 0 the same bits.
            let place = (p + 0.0).to_array().map(f64::to_bits);
            *first.entry((place, ids.map(|ids| ids[v.index()]))).or_insert(v)
        })
        .collect();
    let mut sets: Option<DisjointSets<VertexId>> = None;
    for t in triangles {
        for side in 0..3 {
            let (a, b) = (taxel[t[side]], taxel[t[(side + 1) % 3]]);
            if a != b && mesh.positions[a] == mesh.positions[b] {
                sets.get_or_insert_with(|| DisjointSets::new(taxel.len())).join(a, b);
            }
        }
    }
    if let Some(mut sets) = sets {
        taxel = taxel.map(|&v| sets.root(v));
    }
    taxel
}

/// Which corners of faces hang together around their vertex, across edges.
#[derive(Debug)]
struct Fans {
    /// A corner is told by the halfedge that leaves it.
    corners: DisjointSets<Halfedge>,
}

impl Fans {
    fn new(mesh: &TriMesh, edges: &Edges) -> Self {
        let mut corners = DisjointSets::<Halfedge>::new(3 * mesh.triangles.len());
        for uses in edges.iter() {
            let first = uses[0];
            for &other in &uses[1..] {
                let [a, b] = [first, first.next()];
                let [mut c, mut d] = [other, other.next()];
                if first.start(mesh) != other.start(mesh) {
                    (c, d) = (d, c);
                }
                corners.join(a, c);
                corners.join(b, d);
            }
        }
        Self { corners }
    }

    /// The fan of a corner, named by its first corner.
    fn of(&mut self, corner: Halfedge) -> Halfedge {
        self.corners.root(corner)
    }
}
