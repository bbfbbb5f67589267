//! The pixels of one chart and the values that each follows from: a plane for each face, or a sparse
//! matrix for a given set of live vertices.

use std::collections::HashSet;

use glam::DVec2;

use crate::atlas::Chart;
use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::image::face_weights::FaceWeights;
use crate::image::natural::{Neighbours, Scratch};
use crate::image::runs::{Run, Runs};
use crate::map::MapLevel;
use crate::numeric::Csr;

/// How a pixel follows from the values around it. Only live vertices, those with a value, take
/// part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Barycentric in the face that the pixel shows. Where a corner of the face has no value, the
    /// weights of the others are scaled to the sum 1; without any live corner the pixel is NaN.
    #[default]
    Linear,
    /// The value of the live corner with the largest weight: on equilateral faces the Voronoi cells
    /// of the vertices. NaN without any live corner.
    Nearest,
    /// Natural neighbours of the live vertices on the map (sibson1981): the area of a vertex
    /// without a value is taken over by its neighbours, so that no pixel of the chart is NaN. Linear
    /// fields are reproduced within the convex hull of the live vertices; a pixel outside of it has
    /// the value of the nearest one.
    Natural,
}

/// One chart in an image: what does not change from frame to frame.
#[derive(Debug, Clone)]
pub(super) struct PixelSurface {
    chart: Chart,
    width: usize,
    /// Area of a pixel, in m^2.
    pub(super) pixel_area: f64,
    interpolation: Interpolation,
    /// Number of vertices of the level: of its values.
    pub(super) vertices: usize,
    /// Where the places of the map lie, in pixels of the chart: right, and down.
    at: IdVec<PlaceId, DVec2>,
    /// The vertex of each place; `None` where each is itself.
    unsplit: Option<IdVec<PlaceId, VertexId>>,
    /// The faces that cover pixels, their pixels, and those around each vertex.
    pub(super) faces: Vec<FaceWeights>,
    pub(super) runs: Runs,
    pub(super) around: Csr<u32>,
}

/// Sparse rows: pixels in terms of vertices.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    /// Index of each row's pixel in the image.
    pub(super) pixels: Vec<u32>,
    pub(super) entries: Csr<(u32, f64)>,
}

/// How pixels follow from the live vertices.
#[derive(Debug, Clone, Default)]
pub(super) enum Pattern {
    /// Planes through the corners of faces.
    #[default]
    Faces,
    /// Runs of pixels that have the value of one vertex.
    Cells(Runs),
    /// Any weights.
    Rows(Rows),
}

impl Rows {
    fn push(&mut self, pixel: u32, row: impl IntoIterator<Item = (u32, f64)>) {
        self.pixels.push(pixel);
        self.entries.push(row.into_iter().filter(|(_, w)| *w != 0.0));
    }

    #[inline]
    pub(super) fn value(&self, row: usize, x: &[f64]) -> f64 {
        self.entries[row].iter().map(|&(v, w)| w * x[v as usize]).sum()
    }
}

impl PixelSurface {
    /// The pixels of a chart of `level`, in an image of `width` columns.
    pub(super) fn new(
        chart: &Chart,
        level: &MapLevel,
        width: usize,
        pixel_area: f64,
        interpolation: Interpolation,
    ) -> Self {
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
        let corners = faces.iter().zip(0_u32..);
        let corners = corners.flat_map(|(face, k)| face.corners.map(move |v| (v.index(), k)));
        let around = Csr::from_pairs(vertices, corners);
        let runs = Runs::new(&all, faces.len());
        let (chart, unsplit) = (chart.clone(), level.unsplit().cloned());
        Self { chart, width, pixel_area, interpolation, vertices, at, unsplit, faces, runs, around }
    }

    /// The pattern for these live vertices.
    pub(super) fn pattern(&self, live: &[bool]) -> Pattern {
        match self.interpolation {
            Interpolation::Linear => Pattern::Faces,
            Interpolation::Nearest => Pattern::Cells(self.cells(live)),
            Interpolation::Natural => Pattern::Rows(self.natural(live)),
        }
    }

    /// Calls `visit` with the vertices and weights of every pixel that has a live vertex, in the order of
    /// the runs.
    pub(super) fn each_row(
        &self,
        pattern: &Pattern,
        live: &[bool],
        mut visit: impl FnMut(u32, &[(u32, f64)]),
    ) {
        match pattern {
            Pattern::Faces => {
                for (pixel, face, [column, row]) in self.pixels() {
                    let corners = face.corners;
                    if let Some(weights) = face.live_at(column, row, corners.map(|v| live[v.index()])) {
                        visit(pixel, &[0, 1, 2].map(|k| (corners[k].raw(), weights[k])));
                    }
                }
            }
            Pattern::Cells(cells) => {
                for run in &cells.all {
                    (0..run.length).for_each(|k| visit(run.at + u32::from(k), &[(run.source, 1.0)]));
                }
            }
            Pattern::Rows(rows) => {
                rows.pixels.iter().zip(rows.entries.iter()).for_each(|(&pixel, row)| visit(pixel, row));
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

    /// The cells of the live vertices.
    fn cells(&self, live: &[bool]) -> Runs {
        let mut all: Vec<Run> = Vec::new();
        for run in &self.runs.all {
            let face = &self.faces[run.source as usize];
            for k in 0..run.length {
                let column = run.column + k;
                let mut corners = face.corners.into_iter().zip(face.at(column, run.row));
                let first = corners.find(|(v, _)| live[v.index()]);
                let larger = |best: (VertexId, f64), next: (VertexId, f64)| {
                    if live[next.0.index()] && next.1 > best.1 { next } else { best }
                };
                let Some(source) = first.map(|first| corners.fold(first, larger).0.raw()) else { continue };
                match all.last_mut() {
                    Some(last)
                        if last.source == source
                            && last.row == run.row
                            && last.column + last.length == column =>
                    {
                        last.length += 1;
                    }
                    _ => all.push(run.pixel(k, source)),
                }
            }
        }
        Runs::new(&all, live.len())
    }

    fn natural(&self, live: &[bool]) -> Rows {
        /// What is smaller is 0 to the triangulation.
        const ZERO: f64 = 1e-40;
        let at = |place: PlaceId| {
            let p = self.at[place];
            DVec2::select(p.abs().cmplt(DVec2::splat(ZERO)), DVec2::ZERO, p)
        };
        // Where a map is cut, a vertex of the seam is a site at each of its places.
        let vertex = |place: PlaceId| self.unsplit.as_ref().map_or(place.opened(), |unsplit| unsplit[place]);
        let mut places: Vec<PlaceId> = self.at.ids().filter(|&place| live[vertex(place).index()]).collect();
        // Of places at one position the first counts.
        let mut positions = HashSet::with_capacity(places.len());
        places.retain(|&place| positions.insert(at(place).to_array().map(f64::to_bits)));
        if places.is_empty() {
            return Rows::default();
        }
        let sites: Vec<DVec2> = places.iter().map(|&place| at(place)).collect();
        let neighbours = Neighbours::new(sites.clone());
        let columns = self.chart.frame.size_px[0] as usize;
        let mut triangle_of = vec![u32::MAX; columns * self.chart.frame.size_px[1] as usize];
        self.chart.each_pixel_in(&sites, &neighbours.triangles, |column, row, triangle| {
            let pixel = usize::from(row) * columns + usize::from(column);
            triangle_of[pixel] = u32::try_from(triangle).unwrap_or(u32::MAX);
        });
        let mut scratch = Scratch::default();
        let (mut rows, mut near, mut named) = (Rows::default(), 0, Vec::new());
        for (pixel, _, [column, row]) in self.pixels() {
            let p = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            match triangle_of[usize::from(row) * columns + usize::from(column)] {
                u32::MAX => {
                    near = neighbours.nearest(p, near);
                    rows.push(pixel, [(vertex(places[near]).raw(), 1.0)]);
                }
                triangle => {
                    neighbours.weights(p, triangle as usize, &mut scratch);
                    named.clear();
                    for &(s, w) in &scratch.weights {
                        let v = vertex(places[s as usize]).raw();
                        match named.iter_mut().find(|x: &&mut (u32, f64)| x.0 == v) {
                            Some(known) => known.1 += w,
                            None => named.push((v, w)),
                        }
                    }
                    rows.push(pixel, named.iter().copied());
                }
            }
        }
        rows
    }

    /// The covered pixel whose centre is nearest to a vertex; the first of equal ones. `None` if
    /// there is none.
    pub(super) fn nearest_pixel(&self, vertex: VertexId) -> Option<u32> {
        let p = self.at[PlaceId::of_opened(vertex)];
        let size = self.chart.frame.size_px;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the chart first"
        )]
        let [x, y] = [(p.x, size[0]), (p.y, size[1])].map(|(x, n)| x.clamp(0.0, f64::from(n - 1)) as u32);
        let mut best: Option<(f64, [u32; 2])> = None;
        for ring in 0..size[0].max(size[1]) {
            // Pixels of this ring are at least so far away.
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
