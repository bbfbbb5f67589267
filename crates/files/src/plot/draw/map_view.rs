//! A level on its own map: coloured areas, triangles, boundary, and dots.

use std::{borrow::Cow, collections::BTreeMap};

use glam::DVec2;

use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, carried_places};
use crate::mesh::{TriMesh, boundary_loops};
use crate::plot::colour::{Colour, ColouredMesh, Fill, MeshOwner};
use crate::plot::draw::drawn_mesh::{DrawnMesh, boundary_line, dot_radius, taxel_dots, triangle_lines};
use crate::plot::draw::outline::outlines;
use crate::plot::layout::View;
use crate::plot::patch_view::PatchView;
use crate::plot::picture::{Path, Shape, Stroke};
use crate::pyramid::LevelId;

/// Triangles with edges shorter than this on the picture are drawn as pixels, not one by one. This bounds the
/// size of a picture for every size of mesh.
const LEAST_EDGE_PX: f64 = 3.0;

/// Lines around areas: fields are separated by white ones; gaps between other areas are painted over.
const SEPARATION_PX: f64 = 1.5;
const SEAM_PX: f64 = 0.6;

pub(crate) fn draw_map(
    patch: &PatchView<'_>,
    level: &MapLevel,
    coloured: &ColouredMesh<'_>,
    view: &View,
) -> Vec<Shape> {
    let opened = level.opened();
    let own = lay_out(&opened, &level.opened_uv(), view);
    let mut shapes = match coloured.owner {
        MeshOwner::Level => areas(&own, &on_places(&coloured.fill, level.unsplit()), coloured.is_scale, view),
        MeshOwner::Taxels => match patch.level(LevelId::new(0)).filter(|finest| finest.cut.is_some()) {
            None => {
                let carried = lay_out(coloured.mesh, &carry(level), view);
                areas(&carried, &coloured.fill, coloured.is_scale, view)
            }
            Some(finest) => {
                let mesh = finest.opened();
                let places = carried_places(finest, level).reindexed();
                let carried = lay_out(&mesh, &places, view);
                areas(&carried, &on_places(&coloured.fill, finest.unsplit()), coloured.is_scale, view)
            }
        },
    };
    let mut lines = Path::default();
    for &[a, b] in &own.edges {
        lines.move_to(own.at(a));
        lines.line_to(own.at(b));
    }
    shapes.extend(triangle_lines(&own, lines, &coloured.fill));
    let mut boundary = Path::default();
    for walk in boundary_loops(own.mesh) {
        boundary.polygon(walk.into_iter().map(|v| own.at(v)));
    }
    shapes.push(boundary_line(boundary));
    if let (true, Some(radius)) = (coloured.has_dots, dot_radius(own.edge_px)) {
        let dot = |(place, &at): (PlaceId, &DVec2)| {
            (view.to_pixels(at), patch.is_live(level.level.origins[level.vertex_of(place)]))
        };
        shapes.extend(taxel_dots(level.uv.enumerate().map(dot), radius, &coloured.fill));
    }
    shapes
}

fn lay_out<'a>(mesh: &'a TriMesh, uv: &IdVec<VertexId, DVec2>, view: &View) -> DrawnMesh<'a> {
    DrawnMesh::new(mesh, uv.map(|&at| view.to_pixels(at).extend(0.0)))
}

/// The taxels on the map of a level: each at the weighted mean of its fields.
fn carry(level: &MapLevel) -> IdVec<VertexId, DVec2> {
    let Some(to_finest) = &level.level.to_finest else { return level.opened_uv() };
    let at = |(v, t): (VertexId, &[VertexId; 3])| {
        let places = t.iter().map(|&field| PlaceId::first_of(field));
        places.zip(to_finest.weights[v]).map(|(place, w)| w * level.uv[place]).sum()
    };
    to_finest.indices.enumerate().map(at).collect()
}

/// Transfers the colours of vertices to their places.
pub(super) fn on_places<'a>(fill: &'a Fill, unsplit: Option<&IdVec<PlaceId, VertexId>>) -> Cow<'a, Fill> {
    match (fill, unsplit) {
        (Fill::Cells { groups, colours }, Some(unsplit)) => Cow::Owned(Fill::Cells {
            groups: unsplit.map(|&v| groups[v]).reindexed(),
            colours: colours.clone(),
        }),
        (&Fill::Values { ref values, scale, has_lines }, Some(unsplit)) => {
            Cow::Owned(Fill::Values { values: unsplit.map(|&v| values[v]).reindexed(), scale, has_lines })
        }
        _ => Cow::Borrowed(fill),
    }
}

/// A path for each colour, or an image if triangles are small or colours change within them.
/// Neighbouring groups of one colour merge; white lines separate receptive fields.
fn areas(drawn: &DrawnMesh<'_>, fill: &Fill, is_scale: bool, view: &View) -> Vec<Shape> {
    let is_separated = matches!(fill, Fill::Cells { .. }) && !is_scale;
    let image = || vec![drawn.image(&drawn.depth_buffer(view), view, fill, |_| 1.0)];
    let mut paths = BTreeMap::<Colour, Path>::new();
    match fill {
        _ if drawn.edge_px < LEAST_EDGE_PX => return image(),
        Fill::Values { .. } => return image(),
        Fill::Cells { groups, colours } => {
            let places = drawn.places.map(|p| p.truncate());
            for outline in outlines(drawn.mesh, &places, groups) {
                paths.entry(colours[outline.group as usize]).or_default().polygon(outline.corners);
            }
        }
        Fill::Faces(colours) => {
            for (face, t) in drawn.mesh.triangles.enumerate() {
                paths.entry(colours[face]).or_default().polygon(t.map(|v| drawn.at(v)));
            }
        }
    }
    let area = |(colour, path)| {
        let (line, width) = if is_separated { (Colour::WHITE, SEPARATION_PX) } else { (colour, SEAM_PX) };
        let stroke = Stroke { colour: line, width, opacity: 1.0 };
        Shape::Path { path, fill: Some(colour), stroke: Some(stroke) }
    };
    paths.into_iter().map(area).collect()
}
