//! [`Cell`]: where a hit lies on the map of a level, and what an index keeps of a map for it.

use glam::DVec2;

use crate::{
    id::{FaceId, IdVec, VertexId},
    map::{ImageFrame, MapError, MapLevel, PatchMap, carried_places},
    mesh::{SurfacePoint, TriMesh},
    pyramid::LevelId,
    skin::TaxelId,
};

/// Fields that a contact can lie in: each of a face's three corners lies in up to three.
const MOST_FIELDS: usize = 9;

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

/// The receptive fields a contact lies in: ids rising, weights positive with sum 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldWeights {
    len: usize,
    fields: [VertexId; MOST_FIELDS],
    weights: [f64; MOST_FIELDS],
}

impl FromIterator<(VertexId, f64)> for FieldWeights {
    /// The sums of the weights of each field.
    ///
    /// # Panics
    /// If there are more than nine fields.
    fn from_iter<I: IntoIterator<Item = (VertexId, f64)>>(fields: I) -> Self {
        let mut all: Vec<_> = fields.into_iter().filter(|(_, weight)| *weight != 0.0).collect();
        all.sort_by_key(|(field, _)| *field);
        let mut sum = Self::none();
        for (field, weight) in all {
            if sum.len == 0 || sum.fields[sum.len - 1] != field {
                sum.fields[sum.len] = field;
                sum.len += 1;
            }
            sum.weights[sum.len - 1] += weight;
        }
        sum
    }
}

/// Fields, ids rising and ended by [`none`], and their weights.
type Part = ([VertexId; 4], [f64; 4]);

/// Ends a [`Part`]: larger than every vertex.
fn none() -> VertexId {
    VertexId::from(u32::MAX)
}

fn single((field, weight): (VertexId, f64)) -> Part {
    ([field, none(), none(), none()], [weight, 0.0, 0.0, 0.0])
}

impl FieldWeights {
    fn none() -> Self {
        Self { len: 0, fields: [VertexId::default(); MOST_FIELDS], weights: [0.0; MOST_FIELDS] }
    }

    /// The sums of the weights of each field of three parts.
    #[inline(always)]
    fn merged([a, b, c]: [Part; 3]) -> Self {
        let mut sum =
            Self { len: 0, fields: [VertexId::default(); MOST_FIELDS], weights: [0.0; MOST_FIELDS] };
        let (mut i, mut j, mut k) = (0, 0, 0);
        loop {
            // Never beyond the fourth; the mask spares the test.
            let (x, y, z) = (i & 3, j & 3, k & 3);
            let field = a.0[x].min(b.0[y]).min(c.0[z]);
            if field == none() {
                return sum;
            }
            let (in_a, in_b, in_c) = (a.0[x] == field, b.0[y] == field, c.0[z] == field);
            let part = |is_in: bool, weight: f64| if is_in { weight } else { 0.0 };
            let weight = part(in_a, a.1[x]) + part(in_b, b.1[y]) + part(in_c, c.1[z]);
            if weight != 0.0
                && let Some(slot) = sum.fields.get_mut(sum.len)
            {
                (*slot, sum.weights[sum.len]) = (field, weight);
                sum.len += 1;
            }
            (i, j, k) = (i + usize::from(in_a), j + usize::from(in_b), k + usize::from(in_c));
        }
    }

    /// Fields and weights, smallest id first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (VertexId, f64)> + '_ {
        self.fields[..self.len].iter().copied().zip(self.weights[..self.len].iter().copied())
    }

    /// The field of the largest weight, the smallest of several.
    fn strongest(&self) -> VertexId {
        let best = self.iter().reduce(|a, b| if b.1 > a.1 { b } else { a });
        best.map_or(VertexId::default(), |(field, _)| field)
    }
}

/// A point of level 0, the same on every level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Anchor {
    at: SurfacePoint,
    /// The corners of its face, and the nearest of them, the smallest of several.
    corners: [VertexId; 3],
    nearest: VertexId,
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
        let nearest = corners[if is_nearer(2, first) { 2 } else { first }];
        Some(Self { at: *at, corners, nearest })
    }
}

/// What a lookup needs of the levels of one patch.
#[derive(Debug, Clone)]
pub(super) struct PatchCells {
    levels: IdVec<LevelId, LevelCells>,
    /// For each vertex of level 0 its rows on the coarser levels, side by side: they are read together.
    rows: Vec<Row>,
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
    fields: [VertexId; 3],
    taxels: [TaxelId; 3],
    pub(super) uv: [DVec2; 3],
}

impl OwnFace {
    /// The cell of a point of the face.
    pub(super) fn cell(&self, level: LevelId, point: SurfacePoint, frame: &ImageFrame) -> Cell {
        let [a, b, c] = point.barycentric;
        let weights = FieldWeights::merged([0, 1, 2].map(|k| single((self.fields[k], point.barycentric[k]))));
        let (uv, field) = (self.uv[0] * a + self.uv[1] * b + self.uv[2] * c, weights.strongest());
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

    /// The fields of a row in this face, each with a share of its weight.
    fn part(&self, weights: [f64; 3], share: f64) -> Part {
        let ([a, b, c], [x, y, z]) = (self.fields, weights);
        ([a, b, c, none()], [share * x, share * y, share * z, 0.0])
    }
}

impl PatchCells {
    /// From a patch of a valid map.
    pub(super) fn new(patch: &PatchMap) -> Result<Self, MapError> {
        let mut cells = Self::without_rows(patch);
        let above = patch.levels.len() - 1;
        let blank = Row { weights: [0.0; 3], face: FaceId::default() };
        cells.rows = vec![blank; above * cells.levels[LevelId::new(0)].fields.len()];
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
        Ok(cells)
    }

    /// The same for points on a level's own mesh alone.
    pub(super) fn without_rows(patch: &PatchMap) -> Self {
        let levels = patch.levels.enumerate().map(|(id, map)| LevelCells::new(patch, id, map));
        Self { levels: levels.collect(), rows: Vec::new() }
    }

    pub(super) fn len(&self) -> usize {
        self.levels.len()
    }

    /// The cell of a point of level 0.
    #[inline]
    pub(super) fn cell(&self, level: LevelId, anchor: &Anchor) -> Option<Cell> {
        let Anchor { at, corners, nearest } = anchor;
        let cells = self.levels.get(level)?;
        let mut point = *at;
        let weights = match level.index().checked_sub(1) {
            None => FieldWeights::merged([0, 1, 2].map(|k| single((corners[k], at.barycentric[k])))),
            Some(above) => FieldWeights::merged([0, 1, 2].map(|k| {
                let Row { weights, face } = self.rows[corners[k].index() * (self.levels.len() - 1) + above];
                let triangle = &cells.triangles[face];
                if corners[k] == *nearest {
                    point = SurfacePoint { face, barycentric: triangle.in_face(weights) };
                }
                triangle.part(weights, at.barycentric[k])
            })),
        };
        let finest = self.levels.get(LevelId::new(0)).and_then(|finest| finest.cut.as_ref());
        let uv = finest.map(|finest| {
            // The corners of the face as they lie on its side of the seam.
            let carried = cells.carried.as_ref().unwrap_or(&finest.uv);
            finest.triangles[at.face].iter().zip(at.barycentric).map(|(&place, w)| carried[place] * w).sum()
        });
        Some(cells.cell(level, point, weights, uv))
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
        let weights = FieldWeights::merged([(field, 1.0), (none(), 0.0), (none(), 0.0)].map(single));
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

    /// The cell at a point; its map position is the mean of the fields' if `uv` is not known.
    #[inline(always)]
    fn cell(&self, level: LevelId, point: SurfacePoint, weights: FieldWeights, uv: Option<DVec2>) -> Cell {
        let mean = || weights.iter().map(|(field, weight)| self.fields[field].uv * weight).sum();
        let (uv, field) = (uv.unwrap_or_else(mean), weights.strongest());
        let (pixel, taxel) = (self.frame.pixel(uv), self.fields[field].taxel);
        Cell { level, point, uv, pixel, field, taxel, weights }
    }
}
