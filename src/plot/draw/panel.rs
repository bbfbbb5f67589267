use glam::DVec2;
use svg::node::element::{Circle, Group, Path};

use crate::{
    id::{IdVec, VertexId},
    map::MapLevel,
    plot::{
        Paint, PlotError, Viewpoint,
        colour::coloured_mesh::{Coat, Wearer},
        colour::scale_limits::Range,
        draw::camera::Camera,
        draw::outline::{boundary_loops, edges},
        draw::svg_path::PathData,
        draw::view::{Areas, Canvas, View},
        draw::view_3d::draw_in_space,
        layout::caption::{Caption, number},
        layout::grid::printable,
        patch_view::Subject,
    },
    pyramid::LevelId,
};

/// The triangles of a level are drawn if their edges are at least so long on the picture; shorter, they would grey it.
pub(crate) const LEAST_LINE_PX: f64 = 6.0;

/// Centres of fields, or taxels, are drawn if their distance on the picture is at least this.
const LEAST_DOT_PX: f64 = 7.0;

/// Width of the lines between triangles, in pixels.
pub(crate) const LINE_PX: f64 = 0.7;

/// Width of the line around a skin, in pixels.
pub(crate) const BOUNDARY_PX: f64 = 2.0;

/// Colour of the line around a skin, and of taxels.
pub(crate) const INK: &str = "#222";

/// One picture of one patch.
pub(crate) struct Panel<'a> {
    subject: &'a Subject<'a>,
    /// Number of the level that the colours tell about.
    number: LevelId,
    look: Look<'a>,
    /// Corners of the smallest rectangle around it, in m.
    pub(crate) bounds: (DVec2, DVec2),
}

/// How a patch is looked at.
enum Look<'a> {
    /// The map of a level.
    OnMap(&'a MapLevel),
    /// The skin itself, coloured by a level if it has a map.
    InSpace(Camera, Option<&'a MapLevel>),
}

impl<'a> Panel<'a> {
    /// The map of a level, if there is one.
    pub(crate) fn on_map(subject: &'a Subject<'a>, number: LevelId) -> Option<Self> {
        let level = subject.level(number)?;
        Some(Self { subject, number, look: Look::OnMap(level), bounds: bounds(&level.uv) })
    }

    /// The skin in space, with the colours of a level; of the coarsest if the patch has fewer.
    pub(crate) fn in_space(subject: &'a Subject<'a>, number: LevelId, viewpoint: Viewpoint) -> Self {
        let camera = Camera::new(viewpoint, subject.mesh, subject.pose);
        let bounds = bounds(&camera.project(subject.mesh));
        Self { subject, number, look: Look::InSpace(camera, subject.level_at_most(number)), bounds }
    }

    /// The level whose colours it has.
    pub(crate) fn level(&self) -> Option<&'a MapLevel> {
        match self.look {
            Look::OnMap(level) => Some(level),
            Look::InSpace(_, level) => level,
        }
    }

    /// What it is.
    pub(crate) fn caption(&self) -> Caption {
        let name = printable(self.subject.name);
        match &self.look {
            Look::OnMap(level) => {
                let (d, count) = (&level.distortion, level.uv.len());
                let kind = if self.number == LevelId::default() { "taxels" } else { "fields" };
                let stretch = format!("s1/s2 {} (max {})", number(d.qc_mean, 3), number(d.qc_max, 2));
                let area = format!("area {} (max {})", number(d.area_mean, 3), number(d.area_max, 2));
                Caption {
                    name,
                    which: format!(", level {}", self.number),
                    about: [format!("{count} {kind}, {} flips", d.flips), format!("{stretch}, {area}")],
                }
            }
            Look::InSpace(camera, _) => {
                let mesh = self.subject.mesh;
                let [azimuth, elevation] = camera.degrees.map(degrees);
                Caption {
                    name,
                    which: ", in space".into(),
                    about: [
                        format!("{} taxels, {} triangles", mesh.positions.len(), mesh.triangles.len()),
                        format!("seen from azimuth {azimuth}, elevation {elevation}"),
                    ],
                }
            }
        }
    }

    /// The map or the skin, coloured.
    pub(crate) fn draw(&self, view: &View, paint: Paint, range: &Range) -> Result<Group, PlotError> {
        let coat = Coat::new(self.subject, self.level(), paint, range)?;
        match &self.look {
            Look::OnMap(level) => draw_map(level, &coat, view, paint),
            Look::InSpace(camera, level) => {
                let dots: Vec<VertexId> = match level.filter(|level| level.direct.is_some()) {
                    _ if !has_dots(paint) => Vec::new(),
                    Some(level) if paint == Paint::Fields => level.origins.iter().copied().collect(),
                    _ => self.subject.mesh.positions.ids().collect(),
                };
                Ok(draw_in_space(&coat, camera, view, &dots))
            }
        }
    }
}

/// Where the colours tell about taxels one by one, their centres are shown.
fn has_dots(paint: Paint) -> bool {
    matches!(paint, Paint::Fields | Paint::Sigma)
}

fn draw_map(level: &MapLevel, coat: &Coat<'_>, view: &View, paint: Paint) -> Result<Group, PlotError> {
    let own = Canvas::own(level);
    let coated = match coat.wearer {
        Wearer::Level => Canvas::own(level),
        Wearer::Taxels => Canvas::carried(coat.mesh, level),
    };
    let edge_px = own.edge_px(view);
    let mut group = Group::new().set("stroke-linejoin", "round");
    let parted = paint == Paint::Fields && level.direct.is_some();
    group = add_areas(group, &Areas::new(&coated, &coat.fill, view)?, parted);
    if edge_px >= LEAST_LINE_PX {
        group = group.add(triangles(&own, view));
    }
    group = group.add(boundary(&own, view));
    if let (true, Some(radius)) = (has_dots(paint), dot_radius(edge_px)) {
        let dots = Group::new().set("fill", INK);
        group = group.add(own.uv.iter().fold(dots, |dots, &at| dots.add(circle(view.place(at), radius))));
    }
    Ok(group)
}

fn triangles(canvas: &Canvas<'_>, view: &View) -> Path {
    let mut path = PathData::default();
    for [a, b] in edges(canvas.mesh) {
        path.move_to(view.place(canvas.uv[a]));
        path.line_to(view.place(canvas.uv[b]));
    }
    stroke(path, "#000", LINE_PX).set("stroke-opacity", 0.28)
}

fn boundary(canvas: &Canvas<'_>, view: &View) -> Path {
    let mut path = PathData::default();
    for walk in boundary_loops(canvas.mesh) {
        path.polygon(walk.into_iter().map(|v| view.place(canvas.uv[v])));
    }
    stroke(path, INK, BOUNDARY_PX)
}

/// Radius of dots between edges so long, in pixels; `None` where they would touch.
pub(crate) fn dot_radius(edge_px: f64) -> Option<f64> {
    (edge_px >= LEAST_DOT_PX).then_some((0.13 * edge_px).min(4.0))
}

pub(crate) fn circle(at: DVec2, radius: f64) -> Circle {
    let short = |x: f64| (10.0 * x).round() / 10.0;
    Circle::new().set("cx", short(at.x)).set("cy", short(at.y)).set("r", short(radius))
}

pub(crate) fn stroke(path: PathData, colour: &str, width: f64) -> Path {
    Path::new()
        .set("d", path.into_text())
        .set("fill", "none")
        .set("stroke", colour)
        .set("stroke-width", width)
}

/// Fields are parted by white lines; other areas of one colour flow together, so their seams are painted over.
pub(crate) fn add_areas(mut group: Group, areas: &Areas, parted: bool) -> Group {
    for (colour, path) in areas.paths.iter().filter(|(_, path)| !path.is_empty()) {
        let element = Path::new().set("d", path.clone().into_text()).set("fill", colour.hex());
        group = group.add(match (areas.exact, parted) {
            (true, true) => element.set("stroke", "#fff").set("stroke-width", 1.5),
            (true, false) => element.set("stroke", colour.hex()).set("stroke-width", 0.6),
            (false, _) => element.set("shape-rendering", "crispEdges"),
        });
    }
    group
}

/// Corners of the smallest rectangle around places, in m; the origin without a finite one.
fn bounds(places: &IdVec<VertexId, DVec2>) -> (DVec2, DVec2) {
    let grow = |(lo, hi): (DVec2, DVec2), p: &DVec2| (lo.min(*p), hi.max(*p));
    let (lo, hi) = places.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), grow);
    if lo.is_finite() && hi.is_finite() { (lo, hi) } else { (DVec2::ZERO, DVec2::ZERO) }
}

/// An angle in degrees with at most a tenth, and a minus as wide as a figure.
fn degrees(x: f64) -> String {
    let tenths = (10.0 * x).round() / 10.0;
    format!("{}{}°", if tenths < 0.0 { "\u{2212}" } else { "" }, tenths.abs())
}
