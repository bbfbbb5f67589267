//! The pixels of one chart, and the plane of each face.

use glam::DVec2;

use crate::atlas::Chart;
use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::image::face_weights::FaceWeights;
use crate::image::runs::{Run, Runs};
use crate::map::MapLevel;

/// One chart in an image: the data that does not change from frame to frame.
#[derive(Debug, Clone)]
pub(super) struct PixelSurface {
    chart: Chart,
    width: usize,
    /// Area of a pixel, in m^2.
    pub(super) pixel_area: f64,
    /// Number of vertices of the level: of its values.
    pub(super) vertices: usize,
    /// Positions of the places of the map, in pixels of the chart: right, and down.
    at: IdVec<PlaceId, DVec2>,
    /// The faces that cover pixels, and their pixels.
    pub(super) faces: Vec<FaceWeights>,
    pub(super) runs: Runs,
}

impl PixelSurface {
    /// The pixels of a chart of `level`, in an image of `width` columns.
    pub(super) fn new(chart: &Chart, level: &MapLevel, width: usize, pixel_area: f64) -> Self {
        let at: IdVec<PlaceId, DVec2> = level.uv.map(|&uv| chart.pixel_position(uv));
        let triangles = &level.level.mesh.triangles;
        // The number of each face among those that cover pixels.
        let mut source_of = IdVec::<FaceId, u32>::filled(u32::MAX, triangles.len());
        let mut faces = Vec::new();
        let mut all = Vec::new();
        for ((start, spans), row) in chart.rows(width).zip(0_u16..) {
            let start = u32::try_from(start).unwrap_or(u32::MAX);
            for span in spans {
                let source = &mut source_of[span.face];
                if *source == u32::MAX {
                    *source = u32::try_from(faces.len()).unwrap_or(u32::MAX);
                    let places = level.places(span.face);
                    faces.push(FaceWeights::new(triangles[span.face], places.map(|place| at[place])));
                }
                all.push(Run {
                    at: start + u32::from(span.column),
                    source: *source,
                    column: span.column,
                    row,
                    length: span.length,
                });
            }
        }
        let vertices = level.level.mesh.positions.len();
        let runs = Runs::new(&all, faces.len());
        Self { chart: chart.clone(), width, pixel_area, vertices, at, faces, runs }
    }

    /// Calls `visit` with the vertices and weights of every pixel that has a live vertex, in the order of
    /// the runs.
    pub(super) fn each_row(&self, live: &[bool], mut visit: impl FnMut(u32, &[(u32, f64)])) {
        for (pixel, face, [column, row]) in self.pixels() {
            let corners = face.corners;
            if let Some(weights) = face.live_at(column, row, corners.map(|v| live[v.index()])) {
                visit(pixel, &[0, 1, 2].map(|k| (corners[k].raw(), weights[k])));
            }
        }
    }

    /// The covered pixels: index in the image, face, column and row in the chart.
    fn pixels(&self) -> impl Iterator<Item = (u32, &FaceWeights, [u16; 2])> {
        self.runs.all.iter().flat_map(|run| {
            let face = &self.faces[run.source as usize];
            (0..run.length).map(move |k| (run.at + u32::from(k), face, [run.column + k, run.row]))
        })
    }

    /// The covered pixel whose centre is nearest to a vertex, of equally near ones the first; `None` without
    /// covered pixels.
    pub(super) fn nearest_pixel(&self, vertex: VertexId) -> Option<u32> {
        let p = self.at[PlaceId::first_of(vertex)];
        let size = self.chart.frame.size_px;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the chart first"
        )]
        let [x, y] = [(p.x, size[0]), (p.y, size[1])].map(|(x, n)| x.clamp(0.0, f64::from(n - 1)) as u32);
        let mut best: Option<(f64, [u32; 2])> = None;
        for ring in 0..size[0].max(size[1]) {
            // Least distance of the pixels of this ring.
            let least = (f64::from(ring) - 1.0).max(0.0);
            if best.is_some_and(|(square, _)| square < least * least) {
                break;
            }
            let (rows, columns) = (y.saturating_sub(ring)..=y + ring, x.saturating_sub(ring)..=x + ring);
            for row in rows.filter(|&row| row < size[1]) {
                let on_side = row.abs_diff(y) == ring;
                for column in columns.clone().filter(|c| *c < size[0] && (on_side || c.abs_diff(x) == ring)) {
                    let centre = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
                    let square = centre.distance_squared(p);
                    let is_better = best.is_none_or(|(least, _)| square < least);
                    if is_better && self.chart.face(column, row).is_some() {
                        best = Some((square, [column, row]));
                    }
                }
            }
        }
        let [left, top] = self.chart.corner_px;
        best.and_then(|(_, [column, row])| {
            u32::try_from((top + row) as usize * self.width + (left + column) as usize).ok()
        })
    }
}
