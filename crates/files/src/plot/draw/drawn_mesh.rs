//! A mesh laid out on the picture: its pixels, and the limits for drawing lines and dots.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, edges};
use crate::plot::colour::{Colour, Fill, INK};
use crate::plot::draw::depth_buffer::DepthBuffer;
use crate::plot::layout::View;
use crate::plot::picture::{Path, Pixels, Shape, Stroke};

/// Pixels of an image per pixel of the picture, in each direction: a PNG shows their mean, which smooths
/// edges between colours, and an SVG stays sharp when it is enlarged twice.
const FINENESS: usize = 2;

/// Panels with a longer side, in pixels, have images only as fine as the picture; four images of this size
/// fill a gigabyte.
const LARGE_PX: usize = 4096;

/// Above this many vertices lines are faint, and there are no dots.
pub(crate) const FINE: usize = 5000;

/// Dots are drawn if their distance on the picture is at least this, in pixels.
const LEAST_DOT_PX: f64 = 7.0;

pub(crate) struct DrawnMesh<'a> {
    pub(crate) mesh: &'a TriMesh,
    /// Pixels to the right, down and towards the viewer.
    pub(crate) places: IdVec<VertexId, DVec3>,
    pub(crate) edges: Vec<[VertexId; 2]>,
    /// Mean length of the edges, in pixels.
    pub(crate) edge_px: f64,
}

impl<'a> DrawnMesh<'a> {
    pub(crate) fn new(mesh: &'a TriMesh, places: IdVec<VertexId, DVec3>) -> Self {
        let edges = edges(mesh);
        let length = |&[a, b]: &[VertexId; 2]| places[a].truncate().distance(places[b].truncate());
        let edge_px = edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64;
        Self { mesh, places, edges, edge_px }
    }

    pub(crate) fn at(&self, v: VertexId) -> DVec2 {
        self.places[v].truncate()
    }

    /// The face that each pixel of a panel shows.
    pub(crate) fn depth_buffer(&self, view: &View) -> DepthBuffer {
        #[expect(clippy::cast_possible_truncation, reason = "whole pixels of a picture")]
        let size = view.size.to_array().map(|x| x as usize);
        let fineness = if size.iter().all(|&side| side < LARGE_PX) { FINENESS } else { 1 };
        let size = size.map(|side| fineness * side);
        DepthBuffer::new(self.mesh, &self.places, view.corner, size, fineness as f64)
    }

    /// The nearest face in each pixel, in the colours of `fill`; `brightness` is that of each face.
    pub(crate) fn image(
        &self,
        buffer: &DepthBuffer,
        view: &View,
        fill: &Fill,
        brightness: impl Fn(FaceId) -> f64,
    ) -> Shape {
        let width = buffer.size[0].max(1);
        let pixel = |(k, (face, at)): (usize, (Option<FaceId>, DVec2))| {
            let Some(face) = face else { return Colour::WHITE };
            let diagonal = k % width + k / width;
            fill.colour(face, self.mesh.triangles[face], self.weights(face, at), diagonal)
                .lit(brightness(face))
        };
        let pixels = Pixels { size: buffer.size, colours: buffer.pixels().enumerate().map(pixel).collect() };
        Shape::Image { corner: view.corner, size: view.size, pixels }
    }

    /// The barycentric coordinates of a point in a face, times twice its area.
    fn weights(&self, face: FaceId, at: DVec2) -> [f64; 3] {
        let [a, b, c] = self.mesh.triangles[face].map(|v| self.at(v) - at);
        let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
        let sign = weights.iter().sum::<f64>().signum();
        weights.map(|w| sign * w)
    }
}

pub(crate) fn triangle_lines(drawn: &DrawnMesh<'_>, path: Path, fill: &Fill) -> Option<Shape> {
    let edge_px = drawn.edge_px;
    let (colour, opacity, least_px) = fill.lines(drawn.mesh.positions.len() > FINE)?;
    let stroke = Stroke { colour, width: 0.7, opacity };
    (edge_px >= least_px).then_some(Shape::Path { path, fill: None, stroke: Some(stroke) })
}

pub(crate) fn boundary_line(path: Path) -> Shape {
    let stroke = Stroke { colour: INK, width: 2.0, opacity: 1.0 };
    Shape::Path { path, fill: None, stroke: Some(stroke) }
}

/// Dots of taxels, from their positions and whether they read pressure: those that do not are hollow.
pub(crate) fn taxel_dots(
    taxels: impl Iterator<Item = (DVec2, bool)>,
    radius: f64,
    fill: &Fill,
) -> Vec<Shape> {
    let (colour, size) = fill.dots();
    // Where taxels are dense, dots that would cover each other and the mesh are left out.
    let mut drawn = HashMap::<[i64; 2], Vec<DVec2>>::new();
    let apart = 2.0 * radius;
    let is_apart = |&(at, _): &(DVec2, bool)| {
        #[expect(clippy::cast_possible_truncation, reason = "places of a picture")]
        let [x, y] = (at / apart).floor().to_array().map(|k| k as i64);
        let cells = (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| [x, y]));
        let mut near = cells.filter_map(|cell| drawn.get(&cell)).flatten();
        let is_apart = near.all(|other| other.distance(at) >= apart);
        if is_apart {
            drawn.entry([x, y]).or_default().push(at);
        }
        is_apart
    };
    let (live, silent): (Vec<_>, Vec<_>) = taxels.filter(is_apart).partition(|taxel| taxel.1);
    let dots = |taxels: Vec<(DVec2, bool)>, colour, has_rim| Shape::Dots {
        centres: taxels.into_iter().map(|taxel| taxel.0).collect(),
        radius: size * radius,
        colour,
        has_rim,
    };
    let hollow = (!silent.is_empty()).then(|| dots(silent, Colour::WHITE, true));
    std::iter::once(dots(live, colour, false)).chain(hollow).collect()
}

/// Radius of dots between edges of this length, in pixels; `None` if they would touch.
pub(crate) fn dot_radius(edge_px: f64) -> Option<f64> {
    (edge_px >= LEAST_DOT_PX).then_some((0.13 * edge_px).min(4.0))
}
