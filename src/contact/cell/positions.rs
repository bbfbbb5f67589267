//! [`Positions`]: where the places of level 0 lie on the maps of all levels.
//!
//! On every level a map position is linear in the barycentric coordinates of the hit in its face of
//! level 0: it takes the positions of the three corners, which are side by side for all levels of a
//! corner.

use glam::DVec2;

use crate::{
    cut::PlaceId,
    id::{FaceId, IdVec, VertexId},
    map::PixelGrid,
    parallel::par_collect,
    pyramid::LevelId,
};

/// Where a contact lies on the map of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MapPosition {
    pub(super) level: LevelId,
    /// In m.
    pub(super) uv: DVec2,
    pub(super) pixel: [u32; 2],
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
    places: Option<IdVec<FaceId, [PlaceId; 3]>>,
}

impl Positions {
    /// `levels`: where each place lies on the map of each level, level 0 first, in m.
    pub(super) fn new(
        levels: &[IdVec<PlaceId, DVec2>],
        images: IdVec<LevelId, PixelGrid>,
        places: Option<IdVec<FaceId, [PlaceId; 3]>>,
    ) -> Self {
        // Three would lie in two lines every other time.
        let stride = levels.len() + usize::from(levels.len() % LINE == 3);
        let slots = stride * levels.first().map_or(0, |level| level.len());
        let lines = par_collect(slots.div_ceil(LINE), |range, lines| {
            let at = |slot: usize| {
                let level = levels.get(slot % stride);
                level.and_then(|level| level.get(PlaceId::new(slot / stride))).copied().unwrap_or_default()
            };
            lines.extend(range.map(|line| Line(std::array::from_fn(|k| at(line * LINE + k)))));
        });
        Self { lines, stride, images, places }
    }

    /// The corners of a face, by its vertices, as places.
    #[inline(always)]
    pub(super) fn corners(&self, face: FaceId, vertices: [VertexId; 3]) -> [PlaceId; 3] {
        match &self.places {
            Some(places) => places[face],
            None => vertices.map(PlaceId::of_opened),
        }
    }

    #[inline(always)]
    fn slot(&self, place: PlaceId, level: usize) -> DVec2 {
        let slot = place.index() * self.stride + level;
        self.lines[slot / LINE].0[slot % LINE]
    }

    /// Where a point of a face lies on the map of a level; `corners` are places.
    #[inline(always)]
    pub(super) fn at(&self, level: LevelId, corners: [PlaceId; 3], barycentric: [f64; 3]) -> MapPosition {
        let [u, v, w] = corners.map(|place| self.slot(place, level.index()));
        let [a, b, c] = barycentric;
        let uv = u * a + v * b + w * c;
        MapPosition { level, uv, pixel: self.images[level].pixel(uv) }
    }
}
