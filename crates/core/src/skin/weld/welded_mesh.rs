//! The triangles of one sheet with split vertices welded, for assembling and checking.
//!
//! Welding is exact: no tolerance merges different positions. It is undone where it
//! would make sheets touch along an edge or fans of faces touch in a point, and where the file cuts
//! a surface open (`opening`). Faces are then joined across edges (`joined_faces`), and every fan of
//! faces gets a vertex of its own.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use rayon::prelude::*;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Edges, Halfedge, TriMesh, parts};
use crate::numeric::{DisjointSets, bits};
use crate::parallel::par_ids;
use crate::skin::weld::fans::split_fans;
use crate::skin::weld::joined_faces::{JoinedFaces, fans};
use crate::skin::weld::{Weld, WeldOptions};
use crate::skin::{Sheet, TaxelId};

/// The triangles of one sheet after welding.
///
/// Vertices keep the numbers of the file, copies follow after them; faces use one vertex for each taxel.
#[derive(Debug)]
pub(in crate::skin) struct WeldedMesh {
    /// Positions as in the file, then those of the copies; corners welded.
    pub mesh: TriMesh,
    /// The halfedges along each edge of `mesh`.
    pub edges: Edges,
    /// For every vertex of the file the first one with its position and id.
    pub place: IdVec<VertexId, VertexId>,
    /// For every vertex of the file the vertex that faces use for it.
    pub taxel: IdVec<VertexId, VertexId>,
    /// For each copy its vertex in the file.
    pub copied: Vec<VertexId>,
    /// The number of each face of `mesh` in the file.
    pub file_faces: IdVec<FaceId, FaceId>,
    /// Faces of the file that are left out because they use a taxel twice.
    pub repeated: Vec<FaceId>,
    /// Faces of the file that were dropped, since an earlier one has the same corners.
    pub duplicates: Vec<FaceId>,
    /// Vertices of the file around which several fans of faces touched.
    pub touching: Vec<VertexId>,
    /// Edges of more than two faces that were split into sheets, by vertices of the file.
    pub split_edges: Vec<[VertexId; 2]>,
    /// Edges that got a vertex in the middle, since their sheets are connected around both ends; by vertices of the file.
    pub divided: Vec<[VertexId; 2]>,
    /// Edges along which one-sided surfaces were cut open, by vertices of the file.
    pub one_sided: Vec<[VertexId; 2]>,
    /// How many edges stay cut open as in the file.
    pub cut: usize,
}

impl WeldedMesh {
    /// Welds `sheet`, whose faces for which `usable` holds must have corners in range and finite. On request, no edge has more
    /// than two faces afterwards.
    pub(in crate::skin) fn new(sheet: &Sheet, options: WeldOptions, usable: impl Fn(FaceId) -> bool) -> Self {
        let triangles: IdVec<FaceId, [VertexId; 3]> =
            sheet.triangles.iter().map(|t| t.map(VertexId::from)).collect();
        let mut mesh = TriMesh { positions: sheet.positions.clone().into(), triangles: IdVec::default() };
        let usable: Vec<FaceId> = triangles.ids().filter(|&f| usable(f)).collect();
        let place = weld(&mesh, sheet.ids.as_deref(), usable.iter().map(|&f| &triangles[f]));
        let (mut file_faces, mut repeated) = (IdVec::default(), Vec::new());
        for face in usable {
            let [a, b, c] = triangles[face].map(|v| place[v]);
            if a == b || b == c || c == a {
                repeated.push(face);
            } else {
                mesh.triangles.push([a, b, c]);
                file_faces.push(face);
            }
        }
        let duplicates =
            if options.repair { drop_duplicates(&mut mesh, &mut file_faces) } else { Vec::new() };
        let edges = Edges::new(&mesh.triangles, mesh.positions.len());
        let mut this = Self {
            taxel: place.clone(),
            mesh,
            edges,
            place,
            copied: Vec::new(),
            file_faces,
            repeated,
            duplicates,
            touching: Vec::new(),
            split_edges: Vec::new(),
            divided: Vec::new(),
            one_sided: Vec::new(),
            cut: 0,
        };
        this.split(sheet, options);
        this
    }

    /// Gives every fan of faces a vertex of its own.
    fn split(&mut self, sheet: &Sheet, options: WeldOptions) {
        let joined = JoinedFaces::new(sheet, &self.mesh, &self.edges, &self.file_faces, options);
        let mut fans = fans(&self.mesh, &self.edges, &joined);
        let split = split_fans(&self.mesh, &mut fans, |h| joined.in_file(h));
        self.split_edges = joined.split_edges(&self.edges);
        self.one_sided = joined.one_sided();
        self.cut = joined.cut_edges(&self.edges);
        let sheets = if options.repair { joined.sheets_at_edges(&self.edges) } else { Vec::new() };
        if split.corners.is_empty() && sheets.is_empty() {
            return;
        }
        for (v, name) in split.names {
            self.taxel[v] = name;
        }
        for &v in &split.copied {
            self.mesh.positions.push(self.mesh.positions[v]);
        }
        for (corner, name) in split.corners {
            self.mesh.triangles[corner.face()][corner.side()] = name;
        }
        self.copied = split.copied;
        // A seam of the texture splits vertices on purpose.
        if options.weld != Weld::Texture {
            self.touching = split.touching;
        }
        self.divide(&sheets);
        self.edges = Edges::new(&self.mesh.triangles, self.mesh.positions.len());
    }

    /// The edges of more than two faces, by their vertices in the file.
    pub(in crate::skin) fn crowded(&self) -> Vec<[VertexId; 2]> {
        let ends = |h: Halfedge| [h.start(&self.mesh), h.end(&self.mesh)].map(|v| self.in_file(v));
        self.edges.iter().filter(|uses| uses.len() > 2).map(|uses| ends(uses[0])).collect()
    }

    /// Gives every sheet at an edge an edge of its own: where several still have both vertices, all but the first get a
    /// vertex in the middle.
    fn divide(&mut self, edges: &[Vec<Vec<Halfedge>>]) {
        let mut middles: BTreeMap<FaceId, [Option<VertexId>; 3]> = BTreeMap::new();
        for sheets in edges {
            let mut taken = BTreeSet::new();
            for sheet in sheets {
                let [a, b] = [sheet[0].start(&self.mesh), sheet[0].end(&self.mesh)];
                if taken.insert([a.min(b), a.max(b)]) {
                    continue;
                }
                let middle = self.mesh.positions[a].midpoint(self.mesh.positions[b]);
                let middle = self.mesh.positions.push(middle);
                let ends = [a, b].map(|v| self.in_file(v));
                self.divided.push(ends);
                self.copied.push(ends[0].min(ends[1]));
                for h in sheet {
                    middles.entry(h.face()).or_default()[h.side()] = Some(middle);
                }
            }
        }
        if middles.is_empty() {
            return;
        }
        let (mut triangles, mut file_faces) = (IdVec::default(), IdVec::default());
        for (face, t) in self.mesh.triangles.enumerate() {
            let cut = middles.get(&face).copied().unwrap_or_default();
            for part in parts(cut.map(|middle| middle.is_some())) {
                let corner = |k: usize| if k < 3 { t[k] } else { cut[k - 3].unwrap_or(t[k - 3]) };
                triangles.push(part.map(corner));
                file_faces.push(self.file_faces[face]);
            }
        }
        (self.mesh.triangles, self.file_faces) = (triangles, file_faces);
    }

    /// The vertex of the file for a vertex.
    pub(in crate::skin) fn in_file(&self, v: VertexId) -> VertexId {
        v.index().checked_sub(self.taxel.len()).map_or(v, |copy| self.copied[copy])
    }

    /// The first vertex with the position and id of a vertex.
    pub(in crate::skin) fn place_of(&self, v: VertexId) -> VertexId {
        self.place[self.in_file(v)]
    }
}

/// Faces with the same three corners as an earlier one.
pub(in crate::skin) fn duplicate_faces(mesh: &TriMesh) -> Vec<FaceId> {
    let mut first = HashMap::with_capacity(mesh.triangles.len());
    let mut is_again = |(face, &corners): (FaceId, &[VertexId; 3])| {
        let mut sorted = corners;
        sorted.sort_unstable();
        (*first.entry(sorted).or_insert(face) != face).then_some(face)
    };
    mesh.triangles.enumerate().filter_map(&mut is_again).collect()
}

/// Drops duplicate faces; returns them as the file numbers them.
fn drop_duplicates(mesh: &mut TriMesh, file_faces: &mut IdVec<FaceId, FaceId>) -> Vec<FaceId> {
    let dropped: BTreeSet<FaceId> = duplicate_faces(mesh).into_iter().collect();
    let kept: Vec<FaceId> = mesh.triangles.ids().filter(|face| !dropped.contains(face)).collect();
    let dropped = dropped.into_iter().map(|face| file_faces[face]).collect();
    mesh.triangles = kept.iter().map(|&face| mesh.triangles[face]).collect();
    *file_faces = kept.iter().map(|&face| file_faces[face]).collect();
    dropped
}

/// For every vertex the first one of the same taxel.
///
/// Vertices are one taxel if their positions are exactly equal and so are their ids, or there are no ids. Ids
/// alone never weld: vendors repeat placeholders all over a skin. Coincident vertices with different ids are
/// two taxels, unless a face has both as corners: the edge between them has no length, so only one of them
/// can be kept.
fn weld<'a>(
    mesh: &TriMesh,
    ids: Option<&[TaxelId]>,
    triangles: impl Iterator<Item = &'a [VertexId; 3]>,
) -> IdVec<VertexId, VertexId> {
    let key = |v: VertexId| (bits(mesh.positions[v].to_array()), ids.map(|ids| ids[v.index()]), v);
    let mut keys: Vec<_> = par_ids(mesh.positions.len(), key).into();
    keys.par_sort_unstable();
    let mut taxel: IdVec<VertexId, VertexId> = mesh.positions.ids().collect();
    for same in keys.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        same.iter().for_each(|&(.., v)| taxel[v] = same[0].2);
    }
    let mut sets: Option<DisjointSets<VertexId>> = None;
    for t in triangles.filter(|_| ids.is_some()) {
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

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// A tetrahedron with a flap that continues one of its faces: the face on the other side of the edge
    /// is connected with that face around both ends. Nothing is lost; the edge gets a vertex in the middle.
    #[test]
    fn an_edge_between_sheets_that_are_connected_is_divided() {
        let positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Y];
        let triangles = vec![[0, 1, 2], [1, 0, 3], [1, 0, 4], [0, 2, 3], [1, 3, 2]];
        let sheet = Sheet { positions, triangles, ..Sheet::default() };
        let whole = WeldedMesh::new(&sheet, WeldOptions { weld: Weld::Auto, repair: true }, |_| true);
        assert!(whole.edges.iter().all(|uses| uses.len() <= 2));
        assert_eq!((whole.divided.len(), whole.mesh.triangles.len()), (1, 6));
        let area = TriMesh::from_arrays(sheet.positions.clone(), &sheet.triangles).area();
        assert!((whole.mesh.area() - area).abs() < 1e-15);
        let as_it_is = WeldedMesh::new(&sheet, WeldOptions { weld: Weld::Auto, repair: false }, |_| true);
        assert!(as_it_is.edges.iter().any(|uses| uses.len() > 2));
    }
}
