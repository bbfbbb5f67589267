//! [`MapPosition`]: where a hit lies on the maps of all levels, without its fields.
//!
//! On every level a map position is linear in the barycentric coordinates of the hit in its face of
//! level 0: it takes the positions of the three corners, which are side by side for all levels of a
//! corner.

use glam::DVec2;

use crate::{
    id::{FaceId, IdVec, VertexId},
    map::PixelGrid,
    mesh::SurfacePoint,
    parallel::par_collect,
    pyramid::LevelId,
};

/// Where a contact lies on the map of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPosition {
    /// The level.
    pub level: LevelId,
    /// Map position, in m: that of [`Cell::uv`](crate::contact::Cell::uv).
    pub uv: DVec2,
    /// Pixel (column, row from the top) of the level's image.
    pub pixel: [u32; 2],
}

/// Positions in a line of the cache.
const LINE: usize = 4;

/// A line of the cache.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
struct Line([DVec2; LINE]);

/// Where the places of level 0 lie on the maps of all levels.
#[derive(Debug, Clone)]
pub(super) struct Positions {
    /// For each place its positions on all levels, in m, level 0 first, and then up to a multiple
    /// of `stride`: in as few lines as they fit into.
    lines: Vec<Line>,
    stride: usize,
    /// The images of the levels.
    pub(super) images: IdVec<LevelId, PixelGrid>,
    /// The corners of the faces as places of the map of level 0, where that is cut; else they are
    /// the vertices.
    places: Option<IdVec<FaceId, [VertexId; 3]>>,
}

impl Positions {
    /// `levels`: where each place lies on the map of each level, level 0 first, in m.
    pub(super) fn new(
        levels: &[IdVec<VertexId, DVec2>],
        images: IdVec<LevelId, PixelGrid>,
        places: Option<IdVec<FaceId, [VertexId; 3]>>,
    ) -> Self {
        // Three would lie in two lines every other time.
        let stride = levels.len() + usize::from(levels.len() % LINE == 3);
        let slots = stride * levels.first().map_or(0, |level| level.len());
        let lines = par_collect(slots.div_ceil(LINE), |range, lines| {
            let at = |slot: usize| {
                let level = levels.get(slot % stride);
                level.and_then(|level| level.get(VertexId::new(slot / stride))).copied().unwrap_or_default()
            };
            lines.extend(range.map(|line| Line(std::array::from_fn(|k| at(line * LINE + k)))));
        });
        Self { lines, stride, images, places }
    }

    /// The corners of a face, by its vertices, as places.
    #[inline(always)]
    pub(super) fn corners(&self, face: FaceId, vertices: [VertexId; 3]) -> [VertexId; 3] {
        self.places.as_ref().map_or(vertices, |places| places[face])
    }

    #[inline(always)]
    fn slot(&self, place: VertexId, level: usize) -> DVec2 {
        let slot = place.index() * self.stride + level;
        self.lines[slot / LINE].0[slot % LINE]
    }

    /// Where a point of a face lies on the map of a level; `corners` are places.
    #[inline(always)]
    pub(super) fn at(&self, level: LevelId, corners: [VertexId; 3], barycentric: [f64; 3]) -> MapPosition {
        let [u, v, w] = corners.map(|place| self.slot(place, level.index()));
        let [a, b, c] = barycentric;
        let uv = u * a + v * b + w * c;
        MapPosition { level, uv, pixel: self.images[level].pixel(uv) }
    }

    /// Where a point of a face lies on the maps of all levels, finest first; `vertices` are the
    /// corners of the face.
    #[inline(always)]
    pub(super) fn all(&self, vertices: [VertexId; 3], point: SurfacePoint) -> OnAllLevels<'_> {
        let corners = self.corners(point.face, vertices);
        let last = self.images.len() - 1;
        // Fetches the last lines at once with the first.
        std::hint::black_box(corners.map(|place| self.slot(place, last).x));
        OnAllLevels { positions: Some(self), corners, barycentric: point.barycentric, level: 0 }
    }
}

/// Where a point of level 0 lies on the maps of all levels, finest first.
///
/// A plain counter: adapters of iterators take longer than the positions themselves.
#[derive(Debug, Clone, Default)]
pub(super) struct OnAllLevels<'a> {
    positions: Option<&'a Positions>,
    /// The corners of the face as places.
    corners: [VertexId; 3],
    barycentric: [f64; 3],
    level: usize,
}

impl Iterator for OnAllLevels<'_> {
    type Item = MapPosition;

    #[inline(always)]
    fn next(&mut self) -> Option<MapPosition> {
        let positions = self.positions.filter(|positions| self.level < positions.images.len())?;
        let position = positions.at(LevelId::new(self.level), self.corners, self.barycentric);
        self.level += 1;
        Some(position)
    }
}
