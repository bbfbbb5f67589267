//! [`Cell`]: where a hit lies on the map of a level, and what an index keeps of a map for it.

use std::hint::black_box;

use glam::DVec2;

use crate::{
    contact::field_weights::{FieldWeights, MOST_FIELDS, Union},
    id::{FaceId, IdVec, VertexId},
    map::{ImageFrame, MapError, MapLevel, PatchMap, carried_places},
    mesh::{SurfacePoint, TriMesh},
    parallel::par_collect,
    pyramid::LevelId,
    skin::TaxelId,
};

/// Where a contact lies on the map of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// The level.
    pub level: LevelId,
    /// The level's face and the barycentric coordinates in it: on level 0 those of the hit, on a
    /// coarser level those that the level's direct prolongation gives the hit's nearest corner.
    pub point: SurfacePoint,
    /// Map position, in m: the mean of the fields' positions by their weights. Where a map is cut, a
    /// field of the seam counts with its place on the side of the hit.
    pub uv: DVec2,
    /// Pixel (column, row from the top) of the level's image.
    pub pixel: [u32; 2],
    /// The receptive field of the largest weight, the smallest of several.
    pub field: VertexId,
    /// Vendor id of the taxel at the centre of that field.
    pub taxel: TaxelId,
    /// All fields the contact lies in.
    pub weights: FieldWeights,
}

/// A point of level 0, the same on every level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Anchor {
    at: SurfacePoint,
    /// The corners of its face, and which of them is the nearest, the smallest of several.
    corners: [VertexId; 3],
    nearest: usize,
}

impl Anchor {
    /// `None` if the mesh does not have the face.
    #[inline]
    pub(super) fn new(mesh: &TriMesh, at: &SurfacePoint) -> Option<Self> {
        let corners = *mesh.triangles.get(at.face)?;
        let [a, b, c] = corners.map(|v| mesh.positions[v]);
        let here = a * at.barycentric[0] + b * at.barycentric[1] + c * at.barycentric[2];
        let away = [a, b, c].map(|p| p.distance_squared(here));
        let is_nearer = |k: usize, than: usize| (away[k], corners[k]) < (away[than], corners[than]);
        let first = usize::from(is_nearer(1, 0));
        let nearest = if is_nearer(2, first) { 2 } else { first };
        Some(Self { at: *at, corners, nearest })
    }
}

/// What a lookup needs of the levels of one patch.
#[derive(Debug, Clone)]
pub(super) struct PatchCells {
    levels: IdVec<LevelId, LevelCells>,
    /// For each vertex of level 0 its rows on the coarser levels, side by side: they are read together.
    rows: Vec<Row>,
    /// For each face of level 0 how its rows add up on the coarser levels, side by side.
    unions: Vec<Union>,
}

/// What a lookup needs of one level.
#[derive(Debug, Clone)]
struct LevelCells {
    frame: ImageFrame,
    fields: IdVec<VertexId, Field>,
    triangles: IdVec<FaceId, Corners>,
    /// The first face of each vertex.
    first_faces: IdVec<VertexId, FaceId>,
    cut: Option<Opened>,
    /// Where the places of level 0 lie on this map, where level 0 is cut; `None` on level 0.
    carried: Option<IdVec<VertexId, DVec2>>,
}

#[derive(Debug, Clone, Copy)]
struct Field {
    /// The first of its places.
    uv: DVec2,
    taxel: TaxelId,
}

/// The corners of a face, ids rising.
#[derive(Debug, Clone, Copy)]
struct Corners {
    fields: [VertexId; 3],
    /// Which corner of the face each of them is.
    order: [u8; 3],
}

/// A map that is cut open.
#[derive(Debug, Clone)]
struct Opened {
    /// The corners of the faces as places of the map.
    triangles: IdVec<FaceId, [VertexId; 3]>,
    uv: IdVec<VertexId, DVec2>,
}

/// Where a vertex of level 0 lies on a coarser level.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// How much of each corner of the face it is, ids of the corners rising.
    weights: [f64; 3],
    /// See [`MapLevel::row_faces`].
    face: FaceId,
}

/// A face of a level: its corners in their order, where they lie on its map (m), and the taxels that they are.
#[derive(Debug, Clone)]
pub(super) struct OwnFace {
    pub(super) fields: [VertexId; 3],
    pub(super) taxels: [TaxelId; 3],
    pub(super) uv: [DVec2; 3],
}

impl OwnFace {
    /// The cell of a point of the face.
    pub(super) fn cell(&self, level: LevelId, point: SurfacePoint, frame: &ImageFrame) -> Cell {
        let [a, b, c] = point.barycentric;
        let (weights, field) = FieldWeights::of_corners(self.fields, point.barycentric);
        let uv = self.uv[0] * a + self.uv[1] * b + self.uv[2] * c;
        let corner = self.fields.iter().position(|other| *other == field).unwrap_or_default();
        Cell { level, point, uv, pixel: frame.pixel(uv), field, taxel: self.taxels[corner], weights }
    }
}

impl Corners {
    fn of(corners: [VertexId; 3]) -> Self {
        let mut order = [0, 1, 2];
        order.sort_by_key(|&k: &u8| corners[usize::from(k)]);
        Self { fields: order.map(|k| corners[usize::from(k)]), order }
    }

    /// Numbers for the corners as the face has them, of numbers for rising ids.
    fn in_face<T: Copy>(&self, rising: [T; 3]) -> [T; 3] {
        let mut corners = rising;
        self.order.into_iter().zip(rising).for_each(|(corner, x)| corners[usize::from(corner)] = x);
        corners
    }
}

impl PatchCells {
    /// From a patch of a valid map.
    pub(super) fn new(patch: &PatchMap) -> Result<Self, MapError> {
        let levels = patch.levels.enumerate().map(|(id, map)| LevelCells::new(patch, id, map));
        let levels: IdVec<_, _> = levels.collect();
        let faces = &patch.levels[LevelId::new(0)].level.mesh.triangles;
        let above = levels.len() - 1;
        let blank = Row { weights: [0.0; 3], face: FaceId::default() };
        let rows = vec![blank; above * levels[LevelId::new(0)].fields.len()];
        let mut cells = Self { levels, rows, unions: Vec::new() };
        for (id, map) in patch.levels.enumerate() {
            let Some(to_finest) = &map.level.to_finest else { continue };
            let wrong = |source| MapError::Level { patch: patch.name.clone(), level: id, source };
            for (vertex, &face) in map.row_faces(to_finest).map_err(wrong)?.enumerate() {
                let fields = cells.levels[id].triangles[face].fields;
                let mut weights = [0.0; 3];
                for (field, weight) in to_finest.indices[vertex].into_iter().zip(to_finest.weights[vertex]) {
                    if let Some(k) = fields.iter().position(|&corner| corner == field) {
                        weights[k] += weight;
                    }
                }
                cells.rows[vertex.index() * above + id.index() - 1] = Row { weights, face };
            }
        }
        cells.unions = par_collect(faces.len(), |range, unions| {
            for face in range.map(FaceId::new) {
                for (k, level) in cells.levels.iter().skip(1).enumerate() {
                    let rows = faces[face].map(|v| &cells.rows[v.index() * above + k]);
                    unions.push(Union::new(&level.parts(rows, [1.0; 3])));
                }
            }
        });
        Ok(cells)
    }

    /// How many levels there are above level 0.
    fn above(&self) -> usize {
        self.levels.len() - 1
    }

    pub(super) fn len(&self) -> usize {
        self.levels.len()
    }

    /// Loads what the cells of a point need on all levels into the cache, so that they wait for memory
    /// together, not one after another.
    #[inline]
    pub(super) fn touch(&self, anchor: &Anchor) {
        let mut sum = self.unions.get(anchor.at.face.index() * self.above()).map_or(0, |union| union.0);
        for (above, level) in self.levels.iter().skip(1).enumerate() {
            for (k, v) in anchor.corners.into_iter().enumerate() {
                let row = &self.rows[v.index() * self.above() + above];
                sum ^= u64::from(level.fields[level.triangles[row.face].fields[k]].taxel.0);
            }
        }
        black_box(sum);
    }

    /// The cell of a point of level 0.
    #[inline]
    pub(super) fn cell(&self, level: LevelId, anchor: &Anchor) -> Option<Cell> {
        let Anchor { at, corners, nearest } = *anchor;
        let cells = self.levels.get(level)?;
        let mut point = at;
        let (weights, field) = match level.index().checked_sub(1) {
            None => FieldWeights::of_corners(corners, at.barycentric),
            Some(above) => {
                let rows = corners.map(|v| &self.rows[v.index() * self.above() + above]);
                let Row { weights, face } = *rows[nearest % 3];
                point = SurfacePoint { face, barycentric: cells.triangles[face].in_face(weights) };
                let parts = cells.parts(rows, at.barycentric);
                self.unions[at.face.index() * self.above() + above].sums(&parts)
            }
        };
        let finest = self.levels.get(LevelId::new(0)).and_then(|finest| finest.cut.as_ref());
        let uv = finest.map(|finest| {
            // The corners of the face as they lie on its side of the seam.
            let carried = cells.carried.as_ref().unwrap_or(&finest.uv);
            finest.triangles[at.face].iter().zip(at.barycentric).map(|(&place, w)| carried[place] * w).sum()
        });
        Some(cells.cell(level, point, (weights, field), uv))
    }

    /// The cell of a point on a level's own mesh; its fields are the corners of its face.
    pub(super) fn own_cell(&self, level: LevelId, at: &SurfacePoint) -> Option<Cell> {
        let face = self.own_face(level, at.face)?;
        Some(face.cell(level, *at, &self.levels[level].frame))
    }

    /// A face of a level's own mesh.
    pub(super) fn own_face(&self, level: LevelId, face: FaceId) -> Option<OwnFace> {
        let cells = self.levels.get(level)?;
        let triangle = cells.triangles.get(face)?;
        let fields = triangle.in_face(triangle.fields);
        let uv = cells.cut.as_ref().map(|cut| cut.triangles[face].map(|place| cut.uv[place]));
        Some(OwnFace {
            fields,
            taxels: fields.map(|field| cells.fields[field].taxel),
            uv: uv.unwrap_or_else(|| fields.map(|field| cells.fields[field].uv)),
        })
    }

    /// Vendor id of the taxel at the centre of a field that exists.
    pub(super) fn taxel(&self, level: LevelId, field: VertexId) -> TaxelId {
        self.levels[level].fields[field].taxel
    }

    /// The cell of the centre of a field; of the places of a field on a seam the first.
    pub(super) fn field_cell(&self, level: LevelId, field: VertexId) -> Option<Cell> {
        let cells = self.levels.get(level)?;
        let face = *cells.first_faces.get(field)?;
        let triangle = cells.triangles.get(face)?;
        let barycentric = triangle.in_face(triangle.fields.map(|v| f64::from(u8::from(v == field))));
        let weights = FieldWeights::of_corners([field; 3], [1.0, 0.0, 0.0]);
        Some(cells.cell(level, SurfacePoint { face, barycentric }, weights, None))
    }
}

/// The first face of each vertex; face 0 for one without.
fn first_faces(mesh: &TriMesh) -> IdVec<VertexId, FaceId> {
    let mut first = IdVec::filled(FaceId::default(), mesh.positions.len());
    for (face, corners) in mesh.triangles.enumerate().rev() {
        corners.iter().for_each(|&v| first[v] = face);
    }
    first
}

impl LevelCells {
    fn new(patch: &PatchMap, id: LevelId, map: &MapLevel) -> Self {
        let finest = patch.levels.iter().next().filter(|finest| finest.cut.is_some() && id.index() > 0);
        let field =
            |(v, &origin): (VertexId, &VertexId)| Field { uv: map.uv[v], taxel: patch.taxels.ids[origin] };
        Self {
            frame: map.frame,
            fields: map.level.origins.enumerate().map(field).collect(),
            triangles: map.level.mesh.triangles.map(|corners| Corners::of(*corners)),
            first_faces: first_faces(&map.level.mesh),
            cut: map.cut.as_ref().map(|cut| Opened { triangles: cut.triangles.clone(), uv: map.uv.clone() }),
            carried: finest.map(|finest| carried_places(finest, map)),
        }
    }

    /// The fields of three rows and their weights, those of each row times its share.
    #[inline(always)]
    fn parts(&self, rows: [&Row; 3], shares: [f64; 3]) -> [(VertexId, f64); MOST_FIELDS] {
        let mut parts = [(VertexId::default(), 0.0); MOST_FIELDS];
        for ((row, share), parts) in rows.into_iter().zip(shares).zip(parts.chunks_exact_mut(3)) {
            let fields = self.triangles[row.face].fields;
            for k in 0..3 {
                parts[k] = (fields[k], share * row.weights[k]);
            }
        }
        parts
    }

    /// The cell at a point, of its fields and the strongest of them; its map position is the mean of the
    /// fields' if `uv` is not known.
    #[inline(always)]
    fn cell(
        &self,
        level: LevelId,
        point: SurfacePoint,
        (weights, field): (FieldWeights, VertexId),
        uv: Option<DVec2>,
    ) -> Cell {
        let mean = || {
            let mut mean = DVec2::ZERO;
            // The last of three may be one beyond the fields: field 0, of no weight.
            for k in 0..weights.len.div_ceil(3) * 3 {
                mean += self.fields[weights.fields[k]].uv * weights.weights[k];
            }
            mean
        };
        let uv = uv.unwrap_or_else(mean);
        let (pixel, taxel) = (self.frame.pixel(uv), self.fields[field].taxel);
        Cell { level, point, uv, pixel, field, taxel, weights }
    }
}
