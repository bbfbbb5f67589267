//! The triangles of one sheet with split vertices welded: what assembling repairs and checking
//! judges.
//!
//! Welding is exact: no tolerance merges vertices that a file keeps apart. It is undone where it
//! would only make fans of faces touch in a point.

use std::collections::HashMap;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Edges, Halfedge, TriMesh},
    numeric::DisjointSets,
    skin::{Sheet, TaxelId},
};

/// The triangles of one sheet after welding.
///
/// Vertices keep the numbers of the file; of those that are one taxel, faces use the first.
#[derive(Debug)]
pub(super) struct WeldedMesh {
    /// Positions as in the file; corners welded.
    pub mesh: TriMesh,
    /// For every vertex of the file the first vertex that is the same taxel.
    pub taxel: IdVec<VertexId, VertexId>,
    /// The number of each face of `mesh` in the file.
    pub file_faces: IdVec<FaceId, FaceId>,
    /// Faces of the file that are left out because they use a taxel twice.
    pub repeated: Vec<FaceId>,
}

impl WeldedMesh {
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

    /// Undoes every weld that made fans of faces touch in a point which are apart in the file.
    ///
    /// Returns the vertices where fans touch in the file too; if there are any, nothing is changed.
    pub(super) fn split_touching_fans(&mut self, sheet: &Sheet, edges: &Edges) -> Vec<VertexId> {
        let mut touching = Vec::new();
        let mut splits = Vec::new();
        for corners in self.corners_of_touching_fans(sheet, edges).chunk_by(|a, b| a.welded == b.welded) {
            match split(corners) {
                Some(vertices) => splits.extend(vertices),
                None => touching.push(corners[0].welded),
            }
        }
        if touching.is_empty() && !splits.is_empty() {
            for [in_file, first] in splits {
                self.taxel[in_file] = first;
            }
            for face in self.mesh.triangles.ids() {
                let in_file = sheet.triangles[self.file_faces[face].index()];
                self.mesh.triangles[face] = in_file.map(|v| self.taxel[VertexId::from(v)]);
            }
        }
        touching
    }

    /// The corners at vertices with several fans, vertex by vertex, each once for every fan.
    fn corners_of_touching_fans(&self, sheet: &Sheet, edges: &Edges) -> Vec<FanCorner> {
        let mut fans = fans(&self.mesh, edges);
        let mut fans_of_vertex = IdVec::<VertexId, u32>::filled(0, self.mesh.positions.len());
        let corners_of = |face| [0, 1, 2].map(|side| Halfedge::new(face, side));
        for (face, t) in self.mesh.triangles.enumerate() {
            for (corner, &v) in corners_of(face).into_iter().zip(t) {
                fans_of_vertex[v] += u32::from(fans.root(corner) == corner);
            }
        }
        let mut corners = Vec::new();
        for (face, t) in self.mesh.triangles.enumerate() {
            let in_file = sheet.triangles[self.file_faces[face].index()].map(VertexId::from);
            for ((corner, &welded), in_file) in corners_of(face).into_iter().zip(t).zip(in_file) {
                if fans_of_vertex[welded] > 1 {
                    corners.push(FanCorner { welded, in_file, fan: fans.root(corner) });
                }
            }
        }
        corners.sort_unstable();
        corners.dedup();
        corners
    }
}

/// A vertex of the file in a fan of faces around a welded vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct FanCorner {
    welded: VertexId,
    in_file: VertexId,
    /// The first corner of the fan.
    fan: Halfedge,
}

/// For every vertex of the file around one welded vertex the first one of its fan; `None` if two
/// fans have a vertex of the file in common. `corners` are sorted.
fn split(corners: &[FanCorner]) -> Option<Vec<[VertexId; 2]>> {
    if corners.windows(2).any(|pair| pair[0].in_file == pair[1].in_file) {
        return None;
    }
    let mut first_of_fan = HashMap::new();
    let first = |c: &FanCorner| [c.in_file, *first_of_fan.entry(c.fan).or_insert(c.in_file)];
    Some(corners.iter().map(first).collect())
}

/// For every vertex the first one that is the same taxel.
///
/// Vertices are one taxel if their positions are exactly equal and so are their ids, or there are
/// no ids. Ids alone never weld: vendors repeat placeholders all over a skin. Vertices at one place
/// with different ids are two taxels, unless a face has both as corners: the edge between them has
/// no length, and only one of them can stay.
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

/// The fans of faces: sets of corners that are joined across edges. A corner is named by the
/// halfedge that leaves it.
fn fans(mesh: &TriMesh, edges: &Edges) -> DisjointSets<Halfedge> {
    let mut corners = DisjointSets::<Halfedge>::new(4 * mesh.triangles.len());
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
    corners
}
