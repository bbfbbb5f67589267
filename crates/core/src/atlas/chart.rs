//! The face that every pixel of a chart shows: sizes are checked, positions snapped to exact coordinates,
//! faces rasterised once. The map may overlap itself: there the smallest face wins, and such pixels are
//! counted.

use std::sync::Arc;

use glam::DVec2;

use crate::atlas::AtlasError;
use crate::atlas::bound::check_size;
use crate::atlas::layout::{ChartPosition, image_name};
use crate::atlas::rasterize::{PIXEL, Snapped, Span, Spans, rasterize};
use crate::atlas::turn::{TURNS, in_image, stand_in, turned};
use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec};
use crate::map::{ImageFrame, MapLevel, SkinMap, mirrored};
use crate::mesh::SurfacePoint;
use crate::pyramid::LevelId;
use crate::skin::PatchId;

/// One level of a patch in an image: the face and the point in it that each pixel shows.
///
/// A pixel is covered if its centre lies in a face; if no centre does, the pixel in the middle of the largest
/// face is covered. Where the map overlaps itself the smallest face id wins. Neighbouring pixels of a row that
/// show one face take eight bytes together: barycentric coordinates are computed from the face on demand.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// The patch it shows.
    pub patch: PatchId,
    /// The level it shows.
    pub level: LevelId,
    /// By how many eighths of a turn, counter-clockwise, the map is turned in the image.
    pub turns: u8,
    /// Whether the map is mirrored, `u` for `-u`, before it is turned.
    pub is_mirrored: bool,
    /// The rectangle of the turned map that it shows; its size in pixels is that of the chart.
    pub frame: ImageFrame,
    /// Column and row of its upper left pixel in the image.
    pub corner_px: [u32; 2],
    /// Shared, so that renderers can keep a chart.
    spans: Arc<Spans>,
}

impl Chart {
    /// Rasterises a level that is known to be valid; errors name it `image`. Work grows with the
    /// covered pixels and the triangles.
    /// Fails if the image would be larger than 16384 pixels a side or `2^26` in all, or if the map does not
    /// lie in its frame.
    pub(super) fn new(image: &str, at: &MapLevel, place: &ChartPosition) -> Result<Self, AtlasError> {
        let ChartPosition { patch, level, turns, frame, corner_px } = *place;
        check_size(&frame, image)?;
        let points = snap(&at.uv, turns, &frame, image)?;
        let mut spans = rasterize(&points, &at.corners(), frame.size_px.map(|n| n as usize));
        if spans.pixels() == 0
            && let Some((face, [column, row])) = stand_in(at, turns, &frame)
        {
            let height = frame.size_px[1];
            spans = Spans::of_pixel(face, [column, height - 1 - row], height);
        }
        Ok(Self { patch, level, turns, is_mirrored: false, frame, corner_px, spans: Arc::new(spans) })
    }

    /// Rasterises a level on the canvas of another map, where it may reach beyond the frame. A pixel of the image that is
    /// `taken` shows another chart; those that this one shows are taken then.
    pub(super) fn onto(
        image: &str,
        at: &MapLevel,
        place: &ChartPosition,
        is_mirrored: bool,
        taken: &mut [bool],
        width: usize,
    ) -> Result<Self, AtlasError> {
        let ChartPosition { patch, level, turns, frame, corner_px } = *place;
        check_size(&frame, image)?;
        let (points, corners) = snap_near(at, is_mirrored, turns, &frame);
        let spans = rasterize(&points, &corners, frame.size_px.map(|n| n as usize));
        let [left, top] = corner_px.map(|n| n as usize);
        let spans = spans.where_free(|row, column| {
            let pixel = &mut taken[(top + row) * width + left + column];
            !std::mem::replace(pixel, true)
        });
        Ok(Self { patch, level, turns, is_mirrored, frame, corner_px, spans: Arc::new(spans) })
    }

    /// Rasterises one level of a patch alone, with a margin of one pixel; pixels have the side `pixel` (m).
    /// Fails as [`Self::new`]; panics if the map has no such level.
    #[doc(hidden)]
    pub fn of_level(map: &SkinMap, patch: PatchId, level: LevelId, pixel: f64) -> Result<Self, AtlasError> {
        let at = &map.patches[patch].levels[level];
        let frame = ImageFrame::around(&at.uv, pixel);
        let place = ChartPosition { patch, level, turns: 0, frame, corner_px: [0, 0] };
        Self::new(&image_name(&map.patches[patch], level), at, &place)
    }

    /// Number of pixels that show a face.
    pub fn covered(&self) -> usize {
        self.spans.pixels()
    }

    /// How often a pixel centre was in a further face: 0 for a map that does not overlap itself.
    pub fn overlaps(&self) -> usize {
        self.spans.overlaps
    }

    /// The map position of a pixel's centre, in m; `column` and `row` are those of the image.
    pub fn centre(&self, column: u32, row: u32) -> DVec2 {
        self.map_position(DVec2::new(column.into(), row.into()))
    }

    /// The map position, in m, of a point of the image: column and row, whole at the centres of pixels.
    pub fn map_position(&self, at: DVec2) -> DVec2 {
        let [left, top] = self.corner_px.map(f64::from);
        let upright = turned(self.centre_at(at.x - left, at.y - top), (TURNS - self.turns) % TURNS);
        if self.is_mirrored { mirrored(upright) } else { upright }
    }

    /// The point of the image, column and row, of a map position (m): the inverse of [`Self::map_position`].
    pub fn image_position(&self, uv: DVec2) -> DVec2 {
        self.pixel_position(uv) + DVec2::from(self.corner_px.map(f64::from)) - 0.5
    }

    /// The point of the mesh that a pixel of the image shows; `None` if it does not show this
    /// chart.
    ///
    /// # Panics
    /// If `map` is not the one that was rasterised.
    pub fn point(&self, map: &SkinMap, column: u32, row: u32) -> Option<SurfacePoint> {
        let [left, top] = self.corner_px;
        let (column, row) = (column.checked_sub(left)?, row.checked_sub(top)?);
        let face = self.face(column, row)?;
        let level = &map.patches[self.patch].levels[self.level];
        let barycentric = Barycentric::new(self, level, face).at(self.centre_at(column.into(), row.into()));
        Some(SurfacePoint { face, barycentric })
    }

    /// The face that a pixel of the chart shows.
    pub(crate) fn face(&self, column: u32, row: u32) -> Option<FaceId> {
        let spans = self.spans.row(row);
        let after = spans.partition_point(|span| u32::from(span.column) <= column);
        let span = spans[..after].last()?;
        (column - u32::from(span.column) < u32::from(span.length)).then_some(span.face)
    }

    /// The spans of its rows from the top, in an image of `width` columns: with the index of the row's
    /// first pixel.
    pub(crate) fn rows(&self, width: usize) -> impl Iterator<Item = (usize, &[Span])> {
        let [left, top] = self.corner_px.map(|n| n as usize);
        (0..self.frame.size_px[1]).map(move |row| ((top + row as usize) * width + left, self.spans.row(row)))
    }

    /// The position of a point of the map in pixels of the chart: right, and down from the upper edge.
    pub(crate) fn pixel_position(&self, uv: DVec2) -> DVec2 {
        let [width, height] = self.frame.size_px.map(f64::from);
        let unit = (in_image(uv, self.is_mirrored, self.turns) - self.frame.origin) / self.frame.size;
        DVec2::new(unit.x * width, (1.0 - unit.y) * height)
    }

    /// Whether all faces that it shows are faces of `level`.
    pub(crate) fn fits(&self, level: &MapLevel) -> bool {
        let faces = level.level.mesh.triangles.len();
        self.rows(0).all(|(_, row)| row.iter().all(|span| span.face.index() < faces))
    }

    /// The position of a pixel's centre on the turned map; `column` and `row` are those of the chart.
    fn centre_at(&self, column: f64, row: f64) -> DVec2 {
        let [width, height] = self.frame.size_px.map(f64::from);
        self.frame.map_position(DVec2::new((column + 0.5) / width, (row + 0.5) / height))
    }

    /// Calls `visit(column, face, barycentric)` for the covered pixels of a row, left to right.
    pub(super) fn each_in_row(
        &self,
        level: &MapLevel,
        row: u32,
        mut visit: impl FnMut(usize, FaceId, [f64; 3]),
    ) {
        for span in self.spans.row(row) {
            let inside = Barycentric::new(self, level, span.face);
            for column in span.column..span.column + span.length {
                let centre = self.centre_at(column.into(), row.into());
                visit(column.into(), span.face, inside.at(centre));
            }
        }
    }
}

/// From the turned map to barycentric coordinates of one face.
#[derive(Clone, Copy)]
struct Barycentric {
    corners: [DVec2; 3],
}

impl Barycentric {
    fn new(chart: &Chart, level: &MapLevel, face: FaceId) -> Self {
        Self { corners: level.uv_of(face).map(|at| in_image(at, chart.is_mirrored, chart.turns)) }
    }

    /// Non-negative weights with sum 1. Snapping may have moved a centre out of its face by `2^-17` pixels,
    /// so they are clamped.
    fn at(&self, p: DVec2) -> [f64; 3] {
        let [a, b, c] = self.corners.map(|x| x - p);
        let cross = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
        let sign = (cross[0] + cross[1] + cross[2]).signum();
        let inside = cross.map(|x| (sign * x).max(0.0));
        let sum: f64 = inside.iter().sum();
        if sum > 0.0 && sum.is_finite() { inside.map(|x| x / sum) } else { [1.0, 0.0, 0.0] }
    }
}

/// Map positions in the integers of the rasteriser.
fn snap(
    uv: &IdVec<PlaceId, DVec2>,
    turns: u8,
    frame: &ImageFrame,
    image: &str,
) -> Result<IdVec<PlaceId, Snapped>, AtlasError> {
    let count = DVec2::new(f64::from(frame.size_px[0]), f64::from(frame.size_px[1]));
    let mut points = IdVec::default();
    for (place, &at) in uv.enumerate() {
        let px = (turned(at, turns) - frame.origin) / frame.size * count;
        // Texture coordinates from a file are rounded: up to a pixel beyond the border is allowed.
        let inside = px.cmpge(DVec2::NEG_ONE).all() && px.cmple(count + 1.0).all();
        if !inside {
            return Err(AtlasError::OutsideFrame { image: image.into(), place, at });
        }
        let snapped = (px * PIXEL as f64).round();
        #[expect(clippy::cast_possible_truncation, reason = "inside the image, so below 2^31")]
        let (x, y) = (snapped.x as i64, snapped.y as i64);
        points.push([x, i64::from(frame.size_px[1]) * PIXEL - y]);
    }
    Ok(points)
}

/// How far beyond its image a corner of a face may lie, in pixels: the arithmetic of the rasteriser is exact there.
const BEYOND: f64 = 4096.0;

/// Map positions as [`snap`], wherever they lie, and the corners of the faces; a face far beyond the image has no area.
fn snap_near(
    at: &MapLevel,
    is_mirrored: bool,
    turns: u8,
    frame: &ImageFrame,
) -> (IdVec<PlaceId, Snapped>, IdVec<FaceId, [PlaceId; 3]>) {
    let count = DVec2::from_array(frame.size_px.map(f64::from));
    let in_pixels = |at: &DVec2| (in_image(*at, is_mirrored, turns) - frame.origin) / frame.size * count;
    let is_near =
        |px: DVec2| px.cmpge(DVec2::splat(-BEYOND)).all() && px.cmple(count + DVec2::splat(BEYOND)).all();
    let points = at.uv.map(|at| {
        let px = in_pixels(at);
        let snapped = if is_near(px) { (px * PIXEL as f64).round() } else { DVec2::ZERO };
        #[expect(clippy::cast_possible_truncation, reason = "near the image, so below 2^31")]
        let (x, y) = (snapped.x as i64, snapped.y as i64);
        [x, i64::from(frame.size_px[1]) * PIXEL - y]
    });
    let corners = at.level.mesh.triangles.ids().map(|face| {
        let corners = at.places(face);
        if corners.iter().all(|&place| is_near(in_pixels(&at.uv[place]))) { corners } else { [corners[0]; 3] }
    });
    (points, corners.collect())
}
