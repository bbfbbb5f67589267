//! [`Cell`]: where a hit lies on the map of a level, and what an index keeps of a map for it.

use glam::DVec2;

use crate::{
    id::{FaceId, IdVec, VertexId},
    map::{ImageFrame, MapError, MapLevel, PatchMap, carried_places},
    mesh::{SurfacePoint, TriMesh},
    pyramid::{LevelId, Prolongation, PyramidError},
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
        let mut weights = Self::none();
        fields.into_iter().for_each(|(field, weight)| weights.add(field, weight));
        weights
    }
}

impl FieldWeights {
    fn none() -> Self {
        Self { len: 0, fields: [VertexId::default(); MOST_FIELDS], weights: [0.0; MOST_FIELDS] }
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

    fn add(&mut self, field: VertexId, weight: f64) {
        if weight == 0.0 {
            return;
        }
        match self.fields[..self.len].binary_search(&field) {
            Ok(at) => self.weights[at] += weight,
            Err(at) if self.len < MOST_FIELDS => {
                self.fields.copy_within(at..self.len, at + 1);
                self.weights.copy_within(at..self.len, at + 1);
                (self.fields[at], self.weights[at]) = (field, weight);
                self.len += 1;
            }
            Err(_) => unreachable!("three rows of three fields"),
        }
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
    pub(super) fn new(mesh: &TriMesh, at: &SurfacePoint) -> Option<Self> {
        let corners = *mesh.triangles.get(at.face)?;
        let here = mesh.point(at);
        let key = |v: &VertexId| (mesh.positions[*v].distance_squared(here), *v);
        let nearer = |a: &VertexId, b: &VertexId| {
            let ((a, first), (b, second)) = (key(a), key(b));
            a.total_cmp(&b).then(first.cmp(&second))
        };
        let nearest = corners.into_iter().min_by(nearer)?;
        Some(Self { at: *at, corners, nearest })
    }
}

/// What a lookup needs of the levels of one patch.
#[derive(Debug, Clone)]
pub(super) struct PatchCells {
    levels: IdVec<LevelId, LevelCells>,
}

#[derive(Debug, Clone)]
struct LevelCells {
    uv: IdVec<VertexId, DVec2>,
    frame: ImageFrame,
    /// Vendor id of the taxel at the centre of each field.
    taxels: IdVec<VertexId, TaxelId>,
    triangles: IdVec<FaceId, [VertexId; 3]>,
    /// The first face of each vertex.
    first_faces: IdVec<VertexId, FaceId>,
    /// The corners as places of the map, where it is cut.
    places: Option<IdVec<FaceId, [VertexId; 3]>>,
    /// Where the places of level 0 lie on this map, where level 0 is cut; `None` on level 0.
    carried: Option<IdVec<VertexId, DVec2>>,
    /// `None` on level 0.
    coarse: Option<IdVec<VertexId, Row>>,
}

/// Where a vertex of level 0 lies on a coarser level: all that a lookup reads of it, side by side.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// The corners of `face`, and how much of the vertex each is.
    fields: [VertexId; 3],
    weights: [f64; 3],
    /// See [`MapLevel::row_faces`].
    face: FaceId,
}

impl PatchCells {
    /// From a patch of a valid map.
    pub(super) fn new(patch: &PatchMap) -> Result<Self, MapError> {
        let levels = patch.levels.enumerate().map(|(id, map)| LevelCells::new(patch, id, map));
        Ok(Self { levels: levels.collect::<Result<Vec<_>, _>>()?.into() })
    }

    pub(super) fn len(&self) -> usize {
        self.levels.len()
    }

    /// The cell of a point of level 0.
    pub(super) fn cell(&self, level: LevelId, anchor: &Anchor) -> Option<Cell> {
        let Anchor { at, corners, nearest } = anchor;
        let cells = self.levels.get(level)?;
        let mut weights = FieldWeights::none();
        let mut point = *at;
        match &cells.coarse {
            None => corners.iter().zip(at.barycentric).for_each(|(&v, share)| weights.add(v, share)),
            Some(rows) => {
                for (corner, share) in corners.iter().zip(at.barycentric) {
                    let Row { fields, weights: row, face } = rows[*corner];
                    fields.into_iter().zip(row).for_each(|(field, w)| weights.add(field, share * w));
                    if corner == nearest {
                        point = SurfacePoint { face, barycentric: row };
                    }
                }
            }
        }
        let finest = self.levels.get(LevelId::new(0)).and_then(|finest| finest.places.as_ref());
        let uv = match finest {
            // The corners of the face as they lie on its side of the seam.
            Some(places) => {
                let carried = cells.carried.as_ref().unwrap_or(&cells.uv);
                places[at.face].iter().zip(at.barycentric).map(|(&place, w)| carried[place] * w).sum()
            }
            None => weights.iter().map(|(field, weight)| cells.uv[field] * weight).sum(),
        };
        let field = weights.strongest();
        let pixel = cells.frame.pixel(uv);
        Some(Cell { level, point, uv, pixel, field, taxel: cells.taxels[field], weights })
    }
}

impl PatchCells {
    /// The cell of a point on a level's own mesh; its fields are the corners of its face.
    pub(super) fn own_cell(&self, level: LevelId, at: &SurfacePoint) -> Option<Cell> {
        let cells = self.levels.get(level)?;
        let corners = *cells.triangles.get(at.face)?;
        let weights: FieldWeights = corners.into_iter().zip(at.barycentric).collect();
        let uv = match &cells.places {
            Some(places) => {
                places[at.face].iter().zip(at.barycentric).map(|(&place, w)| cells.uv[place] * w).sum()
            }
            None => weights.iter().map(|(field, weight)| cells.uv[field] * weight).sum(),
        };
        let (field, pixel) = (weights.strongest(), cells.frame.pixel(uv));
        Some(Cell { level, point: *at, uv, pixel, field, taxel: cells.taxels[field], weights })
    }
}

impl PatchCells {
    /// Vendor id of the taxel at the centre of a field that exists.
    pub(super) fn taxel(&self, level: LevelId, field: VertexId) -> TaxelId {
        self.levels[level].taxels[field]
    }

    /// The cell of the centre of a field.
    pub(super) fn field_cell(&self, level: LevelId, field: VertexId) -> Option<Cell> {
        let cells = self.levels.get(level)?;
        let face = *cells.first_faces.get(field)?;
        let corners = cells.triangles.get(face).copied().unwrap_or_default();
        let point = SurfacePoint { face, barycentric: corners.map(|v| f64::from(u8::from(v == field))) };
        // Of the places of a field on a seam the first.
        let (uv, weights) = (cells.uv[field], [(field, 1.0)].into_iter().collect());
        Some(Cell {
            level,
            point,
            uv,
            pixel: cells.frame.pixel(uv),
            field,
            taxel: cells.taxels[field],
            weights,
        })
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

/// The rows of a prolongation to level 0, each by the corners of the face that it lies in.
fn rows(map: &MapLevel, to_finest: &Prolongation) -> Result<IdVec<VertexId, Row>, PyramidError> {
    let faces = map.row_faces(to_finest)?;
    let row = |vertex: VertexId| {
        let face = faces[vertex];
        let fields = map.level.mesh.triangles[face];
        let mut weights = [0.0; 3];
        for (field, weight) in to_finest.indices[vertex].into_iter().zip(to_finest.weights[vertex]) {
            if let Some(k) = fields.iter().position(|&corner| corner == field) {
                weights[k] += weight;
            }
        }
        Row { fields, weights, face }
    };
    Ok(faces.ids().map(row).collect())
}

impl LevelCells {
    fn new(patch: &PatchMap, id: LevelId, map: &MapLevel) -> Result<Self, MapError> {
        let level = &map.level;
        let wrong = |source| MapError::Level { patch: patch.name.clone(), level: id, source };
        let finest = patch.levels.iter().next().filter(|finest| finest.cut.is_some() && id.index() > 0);
        let carried = finest.map(|finest| carried_places(finest, map));
        let coarse = level.to_finest.as_ref().map(|to_finest| rows(map, to_finest).map_err(wrong));
        Ok(Self {
            uv: map.uv.clone(),
            frame: map.frame,
            taxels: level.origins.map(|&origin| patch.taxels.ids[origin]),
            triangles: level.mesh.triangles.clone(),
            first_faces: first_faces(&level.mesh),
            places: map.cut.as_ref().map(|cut| cut.triangles.clone()),
            carried,
            coarse: coarse.transpose()?,
        })
    }
}
