//! Which vertices every pixel of a chart shows, and with what weights: the plain matrix behind each
//! interpolation, for a given set of live vertices.

use std::collections::HashSet;

use glam::DVec2;

use crate::{
    atlas::Chart,
    id::VertexId,
    image::{
        Interpolation,
        weights::{
            face_weights::FaceWeights,
            natural::{Neighbours, Scratch},
            points::Points,
            runs::{Run, Runs, row_start},
        },
    },
    map::MapLevel,
};

/// Faces of at most this many pixels are drawn pixel by pixel, larger ones by their planes. *Heuristic*:
/// 4, 8 and 16 draw the hand of `meshes/` (1.8 pixels a face on level 0) alike, in 0.7 of the time of
/// planes alone; at 16 the robot's level 0 takes 1.15 times as long as by planes, at 8 no longer
/// (`benches/image.rs`).
const SMALL: u32 = 8;

/// What is fixed of a chart: its faces and the pixels that they cover.
#[derive(Debug, Clone)]
pub(in crate::image) struct Surface<'a> {
    pub(in crate::image) chart: &'a Chart,
    pub(in crate::image) level: &'a MapLevel,
    /// Columns of the image.
    pub(in crate::image) width: usize,
    pub(in crate::image) faces: Vec<FaceWeights>,
    pub(in crate::image) runs: Runs,
    /// The pixels of small faces, and the other faces.
    pub(in crate::image) points: Points,
    pub(in crate::image) large: Vec<u32>,
}

/// Sparse rows: pixels in terms of vertices.
#[derive(Debug, Clone, Default)]
pub(in crate::image) struct Rows {
    /// Index of each row's pixel in the image.
    pub(in crate::image) pixels: Vec<u32>,
    /// Where each row ends.
    ends: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

/// How pixels follow from the live vertices, where that is not a plane per face.
#[derive(Debug, Clone, Default)]
pub(in crate::image) enum Pattern {
    /// Planes through the corners of faces.
    #[default]
    Faces,
    /// Runs of pixels that have the value of one vertex.
    Cells(Runs),
    /// Any weights.
    Rows(Rows),
}

impl Rows {
    pub(in crate::image) fn push(&mut self, pixel: u32, row: impl IntoIterator<Item = (u32, f64)>) {
        self.pixels.push(pixel);
        self.entries.extend(row.into_iter().filter(|(_, w)| *w != 0.0));
        self.ends.push(u32::try_from(self.entries.len()).unwrap_or(u32::MAX));
    }

    #[inline]
    pub(in crate::image) fn row(&self, row: usize) -> &[(u32, f64)] {
        let start = if row == 0 { 0 } else { self.ends[row - 1] };
        &self.entries[start as usize..self.ends[row] as usize]
    }

    /// Value of a row.
    #[inline]
    pub(in crate::image) fn value(&self, row: usize, x: &[f64]) -> f64 {
        self.row(row).iter().map(|&(v, w)| w * x[v as usize]).sum()
    }
}

impl<'a> Surface<'a> {
    pub(in crate::image) fn new(chart: &'a Chart, level: &'a MapLevel, width: usize) -> Self {
        let faces = FaceWeights::of_chart(chart, level);
        let runs = Runs::of_faces(chart, faces.len(), width, SMALL);
        let is_small = |k: usize| runs.pixels_of(k) <= SMALL;
        let points = Points::new(&faces, &runs, is_small);
        let large = (0_u32..).take(faces.len()).filter(|&k| !is_small(k as usize)).collect();
        Self { runs, points, large, chart, level, width, faces }
    }

    /// Whether a face is drawn by its plane.
    pub(in crate::image) fn is_large(&self, face: usize) -> bool {
        !self.points.has(face)
    }

    /// The pattern of an interpolation for these live vertices.
    pub(in crate::image) fn pattern(&self, interpolation: Interpolation, live: &[bool]) -> Pattern {
        match interpolation {
            Interpolation::Linear | Interpolation::Field => Pattern::Faces,
            Interpolation::Nearest => Pattern::Cells(self.cells(live)),
            Interpolation::Natural => Pattern::Rows(self.natural(live)),
        }
    }

    /// Calls `visit(pixel, row)` for every pixel with a live vertex, in the order of the runs.
    pub(in crate::image) fn each_row(
        &self,
        pattern: &Pattern,
        live: &[bool],
        mut visit: impl FnMut(u32, &[(u32, f64)]),
    ) {
        match pattern {
            Pattern::Faces => {
                for (at, face, [column, row]) in self.pixels() {
                    let corners = face.corners;
                    let Some(weights) = face.live_at(column, row, corners.map(|v| live[v.index()])) else {
                        continue;
                    };
                    visit(at, &[0, 1, 2].map(|k| (corners[k].raw(), weights[k])));
                }
            }
            Pattern::Cells(cells) => {
                for run in &cells.all {
                    for at in run.at..run.at + u32::from(run.length) {
                        visit(at, &[(run.source, 1.0)]);
                    }
                }
            }
            Pattern::Rows(rows) => (0..rows.pixels.len()).for_each(|k| visit(rows.pixels[k], rows.row(k))),
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
        Runs::new(all, live.len(), &|_| true)
    }

    /// Natural neighbours of the live vertices.
    fn natural(&self, live: &[bool]) -> Rows {
        /// What is smaller is 0 to the triangulation.
        const ZERO: f64 = 1e-40;
        let at = |v: VertexId| {
            let p = self.chart.pixel_position(self.level.uv[v]);
            DVec2::select(p.abs().cmplt(DVec2::splat(ZERO)), DVec2::ZERO, p)
        };
        // Where a map is cut, a vertex of the seam is a site at each of its places.
        let vertex = |place: VertexId| self.level.unsplit().map_or(place, |unsplit| unsplit[place]);
        let mut vertices: Vec<VertexId> =
            self.level.uv.ids().filter(|&place| live[vertex(place).index()]).collect();
        // Of vertices at one place the first counts.
        let mut places = HashSet::with_capacity(vertices.len());
        vertices.retain(|&v| places.insert(at(v).to_array().map(f64::to_bits)));
        if vertices.is_empty() {
            return Rows::default();
        }
        let sites: Vec<DVec2> = vertices.iter().map(|&v| at(v)).collect();
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
                    rows.push(pixel, [(vertex(vertices[near]).raw(), 1.0)]);
                }
                triangle => {
                    neighbours.weights(p, triangle as usize, &mut scratch);
                    named.clear();
                    for &(s, w) in &scratch.weights {
                        let v = vertex(vertices[s as usize]).raw();
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
    pub(in crate::image) fn nearest_pixel(&self, vertex: VertexId) -> Option<u32> {
        let p = self.chart.pixel_position(self.level.uv[vertex]);
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
        best.map(|(_, [column, row])| row_start(self.chart, row, self.width) + column)
    }
}
