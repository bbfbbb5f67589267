//! [`Cell`]: the location of a hit on the map of a level, and the data of a map from which it is computed.

mod field_weights;
mod places;

use glam::DVec2;

pub use field_weights::FieldWeights;
use places::{Positions, Row, Rows};

use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::{MapError, MapLevel, PatchMap, PixelGrid, carried_places};
use crate::mesh::{Halfedge, SurfacePoint, TriMesh, closest_point};
use crate::pyramid::LevelId;
use crate::skin::TaxelId;

/// The location of a contact on the map of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// The level.
    pub level: LevelId,
    /// The level's face and the barycentric coordinates in it: on level 0 those of the hit, on a coarser
    /// level the position of `uv` on the level's map; off the map the nearest position of a face near it.
    pub point: SurfacePoint,
    /// Map position, in m: the weighted mean of the fields' positions. Where a map is cut, a field on the
    /// seam counts at its place on the side of the hit.
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

/// A point of level 0, from which its cells on all levels are computed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Anchor {
    at: SurfacePoint,
    /// The corners of its face, and the nearest of them, the smallest id of several.
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

/// The data of the levels of one patch that a lookup needs.
#[derive(Debug, Clone)]
pub(super) struct PatchCells {
    levels: IdVec<LevelId, LevelCells>,
    positions: Positions,
    rows: Rows,
}

/// The data of one level that a lookup needs.
#[derive(Debug, Clone)]
struct LevelCells {
    taxels: IdVec<VertexId, TaxelId>,
    /// Map positions of its places, in m.
    uv: IdVec<PlaceId, DVec2>,
    triangles: IdVec<FaceId, [VertexId; 3]>,
    /// The places of the corners of each face, and the faces across the sides opposite to them, the face
    /// itself where there is none; of coarse levels.
    corners: IdVec<FaceId, [PlaceId; 3]>,
    across: IdVec<FaceId, [FaceId; 3]>,
    /// The first face of each vertex; arbitrary for one without.
    first_faces: IdVec<VertexId, FaceId>,
}

/// A face of a level: its corners in their order, their map positions (m), and their taxels.
#[derive(Debug, Clone)]
pub(super) struct OwnFace {
    pub(super) fields: [VertexId; 3],
    pub(super) taxels: [TaxelId; 3],
    pub(super) uv: [DVec2; 3],
}

impl OwnFace {
    /// The cell of a point of the face.
    #[inline(always)]
    pub(super) fn cell(&self, level: LevelId, point: SurfacePoint, image: &PixelGrid) -> Cell {
        let [a, b, c] = point.barycentric;
        let (weights, field) = FieldWeights::of_corners(self.fields, point.barycentric);
        let uv = self.uv[0] * a + self.uv[1] * b + self.uv[2] * c;
        let corner = self.fields.iter().position(|other| *other == field).unwrap_or_default();
        Cell { level, point, uv, pixel: image.pixel(uv), field, taxel: self.taxels[corner], weights }
    }
}

impl PatchCells {
    /// From a patch of a valid map.
    pub(super) fn new(patch: &PatchMap) -> Result<Self, MapError> {
        let levels: IdVec<_, _> = patch.levels.iter().map(|map| LevelCells::new(patch, map)).collect();
        let finest = &patch.levels[LevelId::new(0)];
        let (mut uv, mut rows) = (vec![finest.uv.clone()], Vec::new());
        for (id, map) in patch.levels.enumerate() {
            let Some(to_finest) = &map.level.to_finest else { continue };
            let wrong = |source| MapError::Level { patch: patch.name.clone(), level: id, source };
            let faces = map.row_faces(to_finest).map_err(wrong)?;
            let row = |place: PlaceId| {
                let vertex = finest.vertex_of(place);
                let parts = to_finest.indices[vertex].into_iter().zip(to_finest.weights[vertex]);
                row_in(map, faces[vertex], parts)
            };
            let level: IdVec<PlaceId, Row> = finest.uv.ids().map(row).collect();
            uv.push(match &finest.cut {
                Some(_) => carried_places(finest, map),
                None => level.map(|row| row.position(map)),
            });
            rows.push(level);
        }
        let places = finest.cut.as_ref().map(|cut| cut.triangles.clone());
        let images = patch.levels.map(|map| PixelGrid::new(map.frame));
        let positions = Positions::new(&uv, images, places);
        let rows = Rows::new(&rows, &finest.level.mesh.triangles, &positions);
        Ok(Self { levels, positions, rows })
    }

    pub(super) fn len(&self) -> usize {
        self.levels.len()
    }

    /// The cell of a point of level 0, if the level exists.
    pub(super) fn cell(&self, level: LevelId, anchor: &Anchor) -> Option<Cell> {
        let is_there = level.index() < self.len();
        is_there.then(|| if level.index() == 0 { self.finest(anchor) } else { self.above(level, anchor) })
    }

    /// The cell of a point of level 0 on level 0: uses the positions of that level alone, which are closer in
    /// memory than those of all levels.
    fn finest(&self, anchor: &Anchor) -> Cell {
        let (level, at) = (LevelId::new(0), anchor.at);
        let cells = &self.levels[level];
        let [u, v, w] = self.positions.corners(at.face, anchor.corners).map(|place| cells.uv[place]);
        let [a, b, c] = at.barycentric;
        let uv = u * a + v * b + w * c;
        let (weights, field) = FieldWeights::of_corners(anchor.corners, at.barycentric);
        let (pixel, taxel) = (self.positions.images[level].pixel(uv), cells.taxels[field]);
        Cell { level, point: at, uv, pixel, field, taxel, weights }
    }

    /// The cell of a point of level 0 on an existing coarser level.
    #[inline(always)]
    fn above(&self, level: LevelId, Anchor { at, corners, nearest }: &Anchor) -> Cell {
        let (cells, above) = (&self.levels[level], level.index() - 1);
        let places = self.positions.corners(at.face, *corners);
        let uv = self.positions.at(level, places, at.barycentric);
        let rows = self.rows.of(places, above);
        let mut cell = Cell {
            level,
            point: cells.locate([0, 1, 2].map(|k| rows[(nearest + k) % 3].face), uv),
            uv,
            pixel: self.positions.images[level].pixel(uv),
            field: VertexId::default(),
            taxel: TaxelId::default(),
            weights: FieldWeights::none(),
        };
        cell.field = self.rows.add(at.face, above, rows, at.barycentric, &mut cell.weights);
        cell.taxel = cells.taxels[cell.field];
        cell
    }

    /// Vendor id of the taxel at the centre of an existing field.
    pub(super) fn taxel(&self, level: LevelId, field: VertexId) -> TaxelId {
        self.levels[level].taxels[field]
    }

    /// The cell of the centre of a field that belongs to a face; for a field on a seam at its first place.
    pub(super) fn field_cell(&self, level: LevelId, field: VertexId) -> Option<Cell> {
        let cells = self.levels.get(level)?;
        let face = *cells.first_faces.get(field)?;
        let corners = cells.triangles.get(face).filter(|corners| corners.contains(&field))?;
        let point = SurfacePoint { face, barycentric: corners.map(|v| f64::from(u8::from(v == field))) };
        let (weights, field) = FieldWeights::of_corners([field; 3], [1.0, 0.0, 0.0]);
        let uv = cells.uv[PlaceId::first_of(field)];
        let (pixel, taxel) = (self.positions.images[level].pixel(uv), cells.taxels[field]);
        Some(Cell { level, point, uv, pixel, field, taxel, weights })
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

/// The faces across the sides of each face, opposite to its corners; itself where there is none or several.
fn across(corners: &IdVec<FaceId, [PlaceId; 3]>) -> IdVec<FaceId, [FaceId; 3]> {
    let mut across = IdVec::from(corners.ids().map(|face| [face; 3]).collect::<Vec<_>>());
    let ends = |[a, b]: [PlaceId; 2]| u64::from(a.min(b).raw()) << 32 | u64::from(a.max(b).raw());
    let of_face = |(face, of): (FaceId, &[PlaceId; 3])| {
        let of = *of;
        Halfedge::of_face(face).map(|h| (ends([of[h.side()], of[h.next().side()]]), h))
    };
    let mut sides: Vec<_> = corners.enumerate().flat_map(of_face).collect();
    sides.sort_unstable();
    for pair in sides.chunk_by(|a, b| a.0 == b.0) {
        if let &[(_, h), (_, other)] = pair {
            across[h.face()][h.previous().side()] = other.face();
            across[other.face()][other.previous().side()] = h.face();
        }
    }
    across
}

/// A row of a prolongation that lies in a face of a level.
fn row_in(map: &MapLevel, face: FaceId, parts: impl Iterator<Item = (VertexId, f64)>) -> Row {
    let corners = map.level.mesh.triangles[face];
    let mut weights = [0.0; 3];
    for (field, weight) in parts {
        if let Some(k) = corners.iter().position(|&corner| corner == field) {
            weights[k] += weight;
        }
    }
    let some = corners.into_iter().zip(weights).find(|part| part.1 != 0.0).map_or(corners[0], |part| part.0);
    let mut fields = corners;
    for (field, _) in fields.iter_mut().zip(weights).filter(|part| part.1 == 0.0) {
        *field = some;
    }
    Row { weights, fields, face }
}

/// Faces that a walk over a map visits at most: it begins in a face of the nearest taxel.
const LONGEST_WALK: usize = 64;

impl LevelCells {
    /// Where a place (m) lies on the map, by walks towards it from some faces, which a hole may stop; off the map the
    /// nearest place at which one of them ended.
    #[inline]
    fn locate(&self, starts: [FaceId; 3], uv: DVec2) -> SurfacePoint {
        let mut ends = starts;
        for (end, start) in ends.iter_mut().zip(starts) {
            match self.walk(start, uv) {
                Ok(point) => return point,
                Err(face) => *end = face,
            }
        }
        let closest = ends.map(|face| {
            let corners = self.corners[face].map(|place| self.uv[place].extend(0.0));
            (face, closest_point(uv.extend(0.0), corners, self.triangles[face]))
        });
        let nearest =
            closest.into_iter().min_by(|a, b| a.1.squared.total_cmp(&b.1.squared)).unwrap_or(closest[0]);
        SurfacePoint { face: nearest.0, barycentric: nearest.1.barycentric }
    }

    /// Where a place (m) lies on the map, by a walk towards it from a face; else the face where the walk ended.
    #[inline]
    fn walk(&self, mut face: FaceId, uv: DVec2) -> Result<SurfacePoint, FaceId> {
        let mut last = face;
        for _ in 0..LONGEST_WALK {
            let [a, b, c] = self.corners[face].map(|place| self.uv[place] - uv);
            let areas = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
            let area = areas[0] + areas[1] + areas[2];
            let barycentric = areas.map(|opposite| opposite / area);
            if barycentric.iter().all(|&weight| weight >= 0.0) {
                return Ok(SurfacePoint { face, barycentric });
            }
            let beyond = |k: &usize| barycentric[*k] < 0.0 && ![face, last].contains(&self.across[face][*k]);
            let next = (0..3).filter(beyond).min_by(|&k, &l| barycentric[k].total_cmp(&barycentric[l]));
            let Some(next) = next else { break };
            (last, face) = (face, self.across[face][next]);
        }
        Err(face)
    }

    fn new(patch: &PatchMap, map: &MapLevel) -> Self {
        let is_coarse = map.level.to_finest.is_some();
        let corners = if is_coarse { map.corners() } else { IdVec::default() };
        Self {
            across: across(&corners),
            corners,
            taxels: map.level.origins.map(|&origin| patch.taxels.ids[origin]),
            uv: map.uv.clone(),
            triangles: map.level.mesh.triangles.clone(),
            first_faces: first_faces(&map.level.mesh),
        }
    }
}
