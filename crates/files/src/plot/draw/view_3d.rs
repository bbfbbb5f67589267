//! The skin in space from a camera. Hidden surfaces are found with a depth buffer; visible lines and dots are
//! drawn over it.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::boundary_edges;
use crate::plot::colour::ColouredMesh;
use crate::plot::draw::camera::Camera;
use crate::plot::draw::depth_buffer::DepthBuffer;
use crate::plot::draw::drawn_mesh::{DrawnMesh, boundary_line, dot_radius, taxel_dots, triangle_lines};
use crate::plot::layout::View;
use crate::plot::patch_view::PatchView;
use crate::plot::picture::{Path, Shape};

/// Brightness of an unlit surface; light from the viewer's upper left adds the rest.
const AMBIENT: f64 = 0.62;

/// Brightness of an unlit surface whose colours belong to a scale.
const AMBIENT_OF_SCALE: f64 = 0.9;

/// Brightness of the inside over that of the outside.
const INSIDE: f64 = 0.62;

/// Steps of brightness: more could not be distinguished, and fewer colours make smaller files.
const STEPS: f64 = 64.0;

/// Lines and dots at most this far behind the surface are shown, in pixels: up to rounding they lie on it.
const SLACK_PX: f64 = 1.5;

/// Longest piece of a line that is shown or hidden as one, in pixels.
const PIECE_PX: f64 = 2.0;

/// Most pieces of a line: no picture is wider.
const MOST_PIECES: f64 = 4096.0;

/// Draws a coloured skin from a camera, with lines along its boundary and the `seam` of the coloured mesh, and
/// dots at some of its taxels.
pub(crate) fn draw_in_space(
    patch: &PatchView<'_>,
    coloured: &ColouredMesh<'_>,
    camera: &Camera,
    view: &View,
    seam: Vec<[VertexId; 2]>,
    dots: &[VertexId],
) -> Vec<Shape> {
    let mesh = coloured.mesh;
    let place = |&p: &DVec3| view.to_pixels(camera.project(p)).extend(view.scale * camera.nearness(p));
    let drawn = DrawnMesh::new(mesh, mesh.positions.map(place));
    let buffer = drawn.depth_buffer(view);
    let ambient = if coloured.is_scale { AMBIENT_OF_SCALE } else { AMBIENT };
    let brightness: IdVec<FaceId, f64> =
        mesh.triangles.ids().map(|face| brightness(camera, mesh.face_cross(face), ambient)).collect();
    let mut shapes = vec![drawn.image(&buffer, view, &coloured.fill, |face| brightness[face])];
    let lines = unhidden(&drawn, &drawn.edges, &buffer);
    shapes.extend(triangle_lines(&drawn, lines, &coloured.fill));
    let mut rims = boundary_edges(mesh);
    rims.extend(seam);
    shapes.push(boundary_line(unhidden(&drawn, &rims, &buffer)));
    if let (Some(radius), false) = (dot_radius(drawn.edge_px), dots.is_empty()) {
        let normals = mesh.vertex_normals();
        let is_seen = |v: &&VertexId| camera.sees(normals[**v]) && buffer.shows(drawn.places[**v], SLACK_PX);
        let dot = |&v: &VertexId| (drawn.at(v), patch.is_live(v));
        shapes.extend(taxel_dots(dots.iter().filter(is_seen).map(dot), radius, &coloured.fill));
    }
    shapes
}

/// The pieces of edges whose midpoint is visible.
fn unhidden(drawn: &DrawnMesh<'_>, edges: &[[VertexId; 2]], buffer: &DepthBuffer) -> Path {
    let mut path = Path::default();
    for &[a, b] in edges {
        let (from, to) = (drawn.places[a], drawn.places[b]);
        let pieces = (from.truncate().distance(to.truncate()) / PIECE_PX).ceil().clamp(1.0, MOST_PIECES);
        let at = |k: f64| from.lerp(to, k / pieces);
        let mut is_drawing = false;
        let mut k = 0.0;
        while k < pieces {
            let is_shown = buffer.shows(at(k + 0.5), SLACK_PX);
            if is_shown && !is_drawing {
                path.move_to(at(k).truncate());
            }
            if is_drawing && !is_shown {
                path.line_to(at(k).truncate());
            }
            is_drawing = is_shown;
            k += 1.0;
        }
        if is_drawing {
            path.line_to(to.truncate());
        }
    }
    path
}

/// The brightness of a surface with this normal, of any length.
fn brightness(camera: &Camera, normal: DVec3, ambient: f64) -> f64 {
    let normal = normal.normalize_or_zero();
    let (seen, side) = if camera.sees(normal) { (normal, 1.0) } else { (-normal, INSIDE) };
    let exact = side * (ambient + (1.0 - ambient) * camera.light(seen));
    (STEPS * exact).round() / STEPS
}
