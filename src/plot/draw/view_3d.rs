use std::{borrow::Cow, collections::BTreeMap};

use glam::{DVec2, DVec3};
use svg::node::element::{Group, Path};

use crate::{
    id::{FaceId, IdVec, VertexId},
    plot::{
        colour::coloured_mesh::Coat,
        colour::scales::Colour,
        draw::camera::Camera,
        draw::depth_buffer::DepthBuffer,
        draw::depth_order::back_to_front,
        draw::outline::{boundary_edges, edges},
        draw::panel::{BOUNDARY_PX, INK, LEAST_LINE_PX, LINE_PX, add_areas, circle, dot_radius, stroke},
        draw::svg_path::PathData,
        draw::view::{Areas, Canvas, View, draw_row, largest},
    },
};

/// Brightness of a surface that no light falls on; light from the viewer's upper left adds the rest.
const AMBIENT: f64 = 0.62;

/// The same of colours that are read off a scale.
const AMBIENT_OF_SCALE: f64 = 0.9;

/// Brightness of the inside over that of the outside.
const INSIDE: f64 = 0.62;

/// Brightness of the lines between triangles over that of their surface.
const LINE: f64 = 0.68;

/// Steps of brightness: more cannot be told apart, and each is a path of its own where colours are pixels.
const STEPS: f64 = 64.0;

/// How far something may lie behind what is drawn and still be a part of it, in pixels.
const SLACK_PX: f64 = 1.5;

/// Longest piece of a line that is shown or hidden as one, in pixels.
const PIECE_PX: f64 = 4.0;

/// Most pieces of a line: no picture is wider.
const MOST_PIECES: f64 = 4096.0;

/// Draws a coated skin as a camera sees it, with dots at some of its vertices.
///
/// Triangles that are large enough for lines are drawn from the farthest to the nearest; smaller ones, and such as have no
/// such order, pixel by pixel with the lines and dots that are not hidden.
pub(crate) fn draw_in_space(coat: &Coat<'_>, camera: &Camera, view: &View, dots: &[VertexId]) -> Group {
    let scene = Scene::new(coat, camera, view, dots);
    let order = if scene.has_lines() { back_to_front(coat.mesh, &scene.places) } else { None };
    match order {
        Some(order) => scene.draw_ordered(&order),
        None => scene.draw_pixels(view),
    }
}

/// A coated skin laid out in a panel.
struct Scene<'a> {
    coat: &'a Coat<'a>,
    /// Pixels to the right and down from the panel's corner, and towards the viewer.
    places: IdVec<VertexId, DVec3>,
    /// The panel's corner on the picture, in pixels.
    corner: DVec2,
    brightness: IdVec<FaceId, f64>,
    /// Mean length of the edges on the picture.
    edge_px: f64,
    /// Vertices with a dot, of those whose outside is seen, ascending; and the radius of dots.
    dots: Vec<VertexId>,
    radius: f64,
}

impl<'a> Scene<'a> {
    fn new(coat: &'a Coat<'a>, camera: &Camera, view: &View, dots: &[VertexId]) -> Self {
        let mesh = coat.mesh;
        let place =
            |&p: &DVec3| (view.place(camera.place(p)) - view.corner).extend(view.scale * camera.nearness(p));
        let ambient = if coat.is_scale { AMBIENT_OF_SCALE } else { AMBIENT };
        let brightness = mesh.triangles.ids().map(|face| brightness(camera, mesh.face_cross(face), ambient));
        let edge_px = Canvas { mesh, uv: Cow::Owned(camera.project(mesh)) }.edge_px(view);
        let radius = dot_radius(edge_px).filter(|_| !dots.is_empty());
        let mut seen = Vec::new();
        if radius.is_some() {
            let normals = mesh.vertex_normals();
            seen.extend(dots.iter().copied().filter(|&v| camera.sees(normals[v])));
            seen.sort_unstable();
        }
        Self {
            coat,
            places: mesh.positions.map(place),
            corner: view.corner,
            brightness: brightness.collect(),
            edge_px,
            dots: seen,
            radius: radius.unwrap_or_default(),
        }
    }

    fn has_lines(&self) -> bool {
        self.edge_px >= LEAST_LINE_PX
    }

    /// A place of the panel on the picture.
    fn on_picture(&self, place: DVec3) -> DVec2 {
        self.corner + place.truncate()
    }

    fn corners(&self, face: FaceId) -> [DVec2; 3] {
        self.coat.mesh.triangles[face].map(|v| self.on_picture(self.places[v]))
    }

    fn colours(&self, face: FaceId) -> [Colour; 3] {
        self.coat.mesh.triangles[face].map(|v| self.coat.fill.colour(face, v).lit(self.brightness[face]))
    }

    /// Every face over those that it hides. With it come its part of the boundary, and dots as soon as all faces around
    /// them are there.
    fn draw_ordered(&self, order: &[FaceId]) -> Group {
        let mesh = self.coat.mesh;
        let boundary = boundary_edges(mesh);
        let mut last = IdVec::<VertexId, Option<FaceId>>::filled(None, mesh.positions.len());
        for &face in order {
            mesh.triangles[face].iter().for_each(|&v| last[v] = Some(face));
        }
        let mut group = Group::new().set("stroke-linejoin", "round").set("stroke-width", LINE_PX);
        for &face in order {
            group = self.add_face(group, face);
            let t = mesh.triangles[face];
            let mut rim = PathData::default();
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                if boundary.binary_search(&[a, b]).is_ok() {
                    rim.move_to(self.on_picture(self.places[a]));
                    rim.line_to(self.on_picture(self.places[b]));
                }
            }
            if !rim.is_empty() {
                group = group.add(stroke(rim, INK, BOUNDARY_PX).set("stroke-linecap", "round"));
            }
            for v in t.into_iter().filter(|&v| last[v] == Some(face) && self.dots.binary_search(&v).is_ok()) {
                group = group.add(self.dot(v));
            }
        }
        group
    }

    /// One face: its corners' cells if they differ, and a darker line around it.
    fn add_face(&self, mut group: Group, face: FaceId) -> Group {
        let (corners, colours) = (self.corners(face), self.colours(face));
        let polygon = |corners: &[DVec2]| {
            let mut path = PathData::default();
            path.polygon(corners.iter().copied());
            Path::new().set("d", path.into_text())
        };
        let line = Colour::mean(colours).lit(LINE).hex();
        if colours[0] == colours[1] && colours[1] == colours[2] {
            return group.add(polygon(&corners).set("fill", colours[0].hex()).set("stroke", line));
        }
        // Cells over a whole face: no ground shows through their seams.
        group = group.add(polygon(&corners).set("fill", colours[0].hex()));
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        for k in (1..3).filter(|&k| colours[k] != colours[0]) {
            let [at, next, before] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
            let cell = [at, 0.5 * (at + next), centre, 0.5 * (at + before)];
            group = group.add(polygon(&cell).set("fill", colours[k].hex()));
        }
        group.add(polygon(&corners).set("fill", "none").set("stroke", line))
    }

    fn dot(&self, v: VertexId) -> svg::node::element::Circle {
        circle(self.on_picture(self.places[v]), self.radius).set("fill", INK).set("stroke", "none")
    }

    /// The nearest face of each pixel, and over them the lines and dots that no face hides.
    fn draw_pixels(&self, view: &View) -> Group {
        let mesh = self.coat.mesh;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole pixels of a picture"
        )]
        let [width, height] = [view.size.x as usize, view.size.y as usize];
        let buffer = DepthBuffer::new(mesh, &self.places, [width, height]);
        let mut paths = BTreeMap::new();
        for row in 0..height {
            let colour = |column| {
                let face = buffer.face(column, row)?;
                let at = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                Some(self.colours(face)[self.nearest_corner(face, at)])
            };
            let colours: Vec<Option<Colour>> = (0..width).map(colour).collect();
            draw_row(&colours, self.corner + DVec2::new(0.0, row as f64), &mut paths);
        }
        let mut group = add_areas(Group::new(), &Areas { paths, exact: false }, false);
        if self.has_lines() {
            let lines = self.unhidden(&edges(mesh), &buffer);
            group = group.add(stroke(lines, "#000", LINE_PX).set("stroke-opacity", 0.28));
        }
        let rim = self.unhidden(&boundary_edges(mesh), &buffer);
        group = group.add(stroke(rim, INK, BOUNDARY_PX).set("stroke-linecap", "round"));
        let shown = |v: &&VertexId| buffer.shows(self.places[**v], SLACK_PX);
        self.dots.iter().filter(shown).fold(group, |group, &v| group.add(self.dot(v)))
    }

    /// The corner of a face whose cell a place lies in: that with the largest barycentric coordinate.
    fn nearest_corner(&self, face: FaceId, at: DVec2) -> usize {
        let [a, b, c] = self.coat.mesh.triangles[face].map(|v| self.places[v].truncate() - at);
        let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
        let sign = weights.iter().sum::<f64>().signum();
        largest(weights.map(|w| sign * w))
    }

    /// The pieces of edges whose middle no face hides.
    fn unhidden(&self, edges: &[[VertexId; 2]], buffer: &DepthBuffer) -> PathData {
        let mut path = PathData::default();
        for &[a, b] in edges {
            let (a, b) = (self.places[a], self.places[b]);
            let pieces = (a.truncate().distance(b.truncate()) / PIECE_PX).ceil().clamp(1.0, MOST_PIECES);
            let at = |k: f64| a.lerp(b, k / pieces);
            let mut drawing = false;
            let mut k = 0.0;
            while k < pieces {
                let shown = buffer.shows(at(k + 0.5), SLACK_PX);
                if shown && !drawing {
                    path.move_to(self.on_picture(at(k)));
                }
                if shown {
                    path.line_to(self.on_picture(at(k + 1.0)));
                }
                drawing = shown;
                k += 1.0;
            }
        }
        path
    }
}

/// How bright a surface with this normal, of any length, is.
fn brightness(camera: &Camera, normal: DVec3, ambient: f64) -> f64 {
    let normal = normal.normalize_or_zero();
    let (seen, side) = if camera.sees(normal) { (normal, 1.0) } else { (-normal, INSIDE) };
    let exact = side * (ambient + (1.0 - ambient) * camera.light(seen));
    (STEPS * exact).round() / STEPS
}
