//! Across which edges the faces of a sheet are joined, and the vertices that follow from it: one for
//! every fan of faces.
//!
//! Two faces at an edge are joined, unless the file separates them. Of more than two faces those are joined
//! that share both vertices in the file, and on request those that `crowded` pairs. Also on request, a
//! one-sided surface is cut open where its faces are wound differently.

use std::collections::BTreeSet;

use glam::DVec2;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Edges, Halfedge, TriMesh};
use crate::numeric::{DisjointSets, Relation};
use crate::skin::Sheet;
use crate::skin::weld::crowded::{Content, is_turned, pairs};
use crate::skin::weld::fans::join;
use crate::skin::weld::opening::kept_open;
use crate::skin::weld::{Weld, WeldOptions};

/// Texture coordinates nearer than this, or than this share of them, are the same one, rounded: a tenth of a
/// pixel of a texture of 1000 pixels. Charts that are apart are at least a pixel from each other.
const SAME_TEXTURE: f64 = 1e-4;

/// Which faces are joined across each edge of a welded sheet.
pub(in crate::skin) struct JoinedFaces<'a> {
    sheet: &'a Sheet,
    mesh: &'a TriMesh,
    file_faces: &'a IdVec<FaceId, FaceId>,
    options: WeldOptions,
    /// For every face whether its component stays cut as in the file; empty if none does.
    open: Vec<bool>,
    /// The content of the file.
    content: Content,
    /// Pairs of faces that were separated, since their component would be one-sided.
    one_sided: BTreeSet<[Halfedge; 2]>,
}

impl<'a> JoinedFaces<'a> {
    pub(in crate::skin) fn new(
        sheet: &'a Sheet,
        mesh: &'a TriMesh,
        edges: &Edges,
        file_faces: &'a IdVec<FaceId, FaceId>,
        options: WeldOptions,
    ) -> Self {
        let content = if options.repair { Content::of(mesh, edges) } else { Content::Faces };
        let (open, one_sided) = (Vec::new(), BTreeSet::new());
        let mut joined = Self { sheet, mesh, file_faces, options, open, content, one_sided };
        // Vertices of one id are one taxel with several positions on a map: only the map is cut there.
        let corners = |face: FaceId| sheet.triangles[file_faces[face].index()].map(VertexId::from);
        let is_welded = || mesh.triangles.enumerate().any(|(face, t)| *t != corners(face));
        if options.weld == Weld::Auto && sheet.ids.is_none() && is_welded() {
            let (is_cut, in_file) = (|uses: &[Halfedge]| joined.is_cut_in_file(uses), |h| joined.in_file(h));
            joined.open = kept_open(mesh, edges, is_cut, in_file);
        }
        if options.repair {
            joined.one_sided = joined.conflicts(edges);
        }
        joined
    }

    /// The vertex of the file that a halfedge starts from.
    pub(in crate::skin) fn in_file(&self, h: Halfedge) -> VertexId {
        VertexId::from(self.sheet.triangles[self.file_faces[h.face()].index()][h.side()])
    }

    /// The vertices of the file at the ends of a halfedge, that at the smaller welded vertex first.
    fn ends_in_file(&self, h: Halfedge) -> [VertexId; 2] {
        let ends = [self.in_file(h), self.in_file(h.next())];
        if h.start(self.mesh) < h.end(self.mesh) { ends } else { [ends[1], ends[0]] }
    }

    /// Whether an edge has two faces that share no edge in the file.
    pub(in crate::skin) fn is_cut_in_file(&self, uses: &[Halfedge]) -> bool {
        matches!(*uses, [a, b] if self.ends_in_file(a) != self.ends_in_file(b))
    }

    /// Whether an edge of two faces stays cut open.
    fn is_cut(&self, uses: &[Halfedge]) -> bool {
        match self.options.weld {
            Weld::All => false,
            Weld::None => self.is_cut_in_file(uses),
            Weld::Auto => {
                self.open.get(uses[0].face().index()).copied().unwrap_or(false) && self.is_cut_in_file(uses)
            }
            Weld::Texture => self.is_texture_seam(uses),
        }
    }

    /// Whether the texture coordinates of two faces differ at their edge.
    fn is_texture_seam(&self, uses: &[Halfedge]) -> bool {
        let Some(texture) = &self.sheet.texture else { return false };
        let at = |h: Halfedge| texture[self.file_faces[h.face()].index()][h.side()];
        let ends = |h: Halfedge| {
            let ends = [at(h), at(h.next())];
            if h.start(self.mesh) < h.end(self.mesh) { ends } else { [ends[1], ends[0]] }
        };
        let differ = |a: DVec2, b: DVec2| a.distance(b) > SAME_TEXTURE * a.length().max(1.0);
        matches!(*uses, [a, b] if ends(a).into_iter().zip(ends(b)).any(|(a, b)| differ(a, b)))
    }

    /// Pairs of faces without which every component has two sides: those that are wound alike are
    /// joined first.
    fn conflicts(&self, edges: &Edges) -> BTreeSet<[Halfedge; 2]> {
        let mut faces = DisjointSets::<FaceId, Relation>::new(self.mesh.triangles.len());
        let mut conflicts = BTreeSet::new();
        for turned in [false, true] {
            for uses in edges.iter() {
                self.each_pair(uses, |a, b| {
                    let relation = Relation::reversed_if(turned);
                    if is_turned(self.mesh, a, b) == turned && !faces.join(a.face(), b.face(), relation) {
                        conflicts.insert([a.min(b), a.max(b)]);
                    }
                });
            }
        }
        conflicts
    }

    /// Calls `join` for all pairs of halfedges of an edge whose faces are joined.
    pub(in crate::skin) fn each_pair(&self, uses: &[Halfedge], mut join: impl FnMut(Halfedge, Halfedge)) {
        let mut join = |a: Halfedge, b: Halfedge| {
            if !self.one_sided.contains(&[a.min(b), a.max(b)]) {
                join(a, b);
            }
        };
        match *uses {
            [] | [_] => {}
            [a, b] => {
                if !self.is_cut(uses) {
                    join(a, b);
                }
            }
            _ => match self.sheets(uses) {
                Some(pairs) => pairs.into_iter().for_each(|[a, b]| join(a, b)),
                None => uses[1..].iter().for_each(|&other| join(uses[0], other)),
            },
        }
    }

    /// The pairs of faces that are joined across an edge of more than two; `None` if the edge is not changed.
    fn sheets(&self, uses: &[Halfedge]) -> Option<Vec<[Halfedge; 2]>> {
        if let Some(pairs) = self.sheets_in_file(uses) {
            return Some(pairs);
        }
        self.options.repair.then(|| pairs(self.mesh, uses, self.content))
    }

    /// The pairs of faces that share both vertices in the file, if there is one and no third face
    /// shares them.
    fn sheets_in_file(&self, uses: &[Halfedge]) -> Option<Vec<[Halfedge; 2]>> {
        let mut by_ends: Vec<([VertexId; 2], Halfedge)> =
            uses.iter().map(|&h| (self.ends_in_file(h), h)).collect();
        by_ends.sort_unstable();
        let mut pairs = Vec::new();
        for group in by_ends.chunk_by(|a, b| a.0 == b.0) {
            match *group {
                [_] => {}
                [(_, a), (_, b)] => pairs.push([a, b]),
                _ => return None,
            }
        }
        (!pairs.is_empty()).then_some(pairs)
    }

    /// The edges of more than two faces that are split into sheets on request.
    pub(in crate::skin) fn split_edges(&self, edges: &Edges) -> Vec<[VertexId; 2]> {
        if !self.options.repair {
            return Vec::new();
        }
        let crowded = edges.iter().filter(|uses| uses.len() > 2 && self.sheets_in_file(uses).is_none());
        crowded.map(|uses| self.ends_in_file(uses[0])).collect()
    }

    /// For each edge at which faces are apart, of more than two or of a one-sided surface, the faces that are joined there.
    pub(in crate::skin) fn sheets_at_edges(&self, edges: &Edges) -> Vec<Vec<Vec<Halfedge>>> {
        let is_apart = |uses: &&[Halfedge]| match **uses {
            [a, b] => self.one_sided.contains(&[a.min(b), a.max(b)]),
            _ => uses.len() > 2,
        };
        let sheets = |uses: &[Halfedge]| {
            let mut sheets = Vec::new();
            self.each_pair(uses, |a, b| sheets.push(vec![a, b]));
            let alone: Vec<_> = uses.iter().filter(|h| !sheets.iter().flatten().any(|of| of == *h)).collect();
            sheets.extend(alone.into_iter().map(|&h| vec![h]));
            sheets
        };
        edges.iter().filter(is_apart).map(sheets).collect()
    }

    /// The edges along which one-sided components were cut open on request.
    pub(in crate::skin) fn one_sided(&self) -> Vec<[VertexId; 2]> {
        self.one_sided.iter().map(|&[h, _]| self.ends_in_file(h)).collect()
    }

    /// How many edges stay cut open as they are in the file.
    pub(in crate::skin) fn cut_edges(&self, edges: &Edges) -> usize {
        let is_asked = self.options.weld == Weld::Texture || !self.open.is_empty();
        if is_asked { edges.iter().filter(|uses| uses.len() == 2 && self.is_cut(uses)).count() } else { 0 }
    }
}

/// The fans of faces: sets of corners that are joined across edges. A corner is named by the
/// halfedge that leaves it.
pub(in crate::skin) fn fans(
    mesh: &TriMesh,
    edges: &Edges,
    joined: &JoinedFaces<'_>,
) -> DisjointSets<Halfedge> {
    let mut corners = DisjointSets::<Halfedge>::new(4 * mesh.triangles.len());
    for uses in edges.iter() {
        joined.each_pair(uses, |first, other| join(mesh, &mut corners, first, other));
    }
    corners
}
