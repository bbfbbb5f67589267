use glam::DVec2;
use svg::node::element::{Circle, Group, Path};

use crate::{
    atlas::{Stretch, face_stretch},
    id::{FaceId, IdVec, VertexId},
    map::{MapLevel, PatchMap},
    report::{
        Paint, ReportError,
        cells::{Areas, Canvas, Fill, View, dominant_fields, field_colours},
        colours::{Colour, DIVERGING, ORDER, SEQUENTIAL, SKIN},
        outline::{boundary_loops, edges},
        path::PathData,
    },
};

/// The triangles of a level are drawn if their edges are at least so long on the picture; shorter, they would grey it.
const LEAST_LINE_PX: f64 = 6.0;

/// Centres of fields are drawn if their distance on the picture is at least this.
const LEAST_DOT_PX: f64 = 7.0;

/// Steps of a continuous scale: more cannot be told apart, and each is one path.
const STEPS: f64 = 64.0;

/// Ends of the scales, common to all panels of a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    /// Largest `s1/s2` shown.
    pub(super) angle: f64,
    /// Largest area ratio shown; its inverse is the smallest.
    pub(super) area: f64,
}

/// One level of one patch.
pub(super) struct Panel<'a> {
    pub(super) patch: &'a PatchMap,
    pub(super) level: &'a MapLevel,
    pub(super) number: usize,
    pub(super) view: View,
}

impl Panel<'_> {
    /// The map of the level, coloured.
    pub(super) fn draw(&self, paint: Paint, range: &Range) -> Result<Group, ReportError> {
        let own = Canvas::own(self.level);
        let edge_px = own.edge_px(&self.view);
        let mut group = Group::new().set("stroke-linejoin", "round");
        let parted = paint == Paint::Fields && self.level.direct.is_some();
        group = add_areas(group, &self.areas(paint, range)?, parted);
        if edge_px >= LEAST_LINE_PX {
            group = group.add(self.triangles());
        }
        group = group.add(self.boundary());
        if paint == Paint::Fields && edge_px >= LEAST_DOT_PX {
            group = group.add(self.centres((0.13 * edge_px).min(4.0)));
        }
        Ok(group)
    }

    fn areas(&self, paint: Paint, range: &Range) -> Result<Areas, ReportError> {
        let by_face = |t: &dyn Fn(Stretch) -> f64, at: &dyn Fn(f64) -> Colour| {
            let colour = |f: FaceId| at((STEPS * t(face_stretch(self.level, f))).round() / STEPS);
            let colours: IdVec<FaceId, Colour> = self.level.mesh.triangles.ids().map(colour).collect();
            Areas::new(&Canvas::own(self.level), &Fill::Faces(&colours), &self.view)
        };
        match paint {
            Paint::Angle => by_face(&|s| (s.angle.abs() - 1.0) / (range.angle - 1.0), &|t| {
                SEQUENTIAL.at(t.clamp(0.0, 1.0))
            }),
            Paint::Area => by_face(&|s| 0.5 + 0.5 * s.area.abs().ln() / range.area.ln(), &|t| {
                DIVERGING.at(t.clamp(0.0, 1.0))
            }),
            Paint::Fields if self.level.direct.is_none() => by_face(&|_| 0.0, &|_| SKIN),
            Paint::Fields => {
                let canvas = Canvas::carried(self.finest(), self.level);
                let groups = dominant_fields(self.level);
                let colours = field_colours(&groups, canvas.mesh, self.level.uv.len());
                Areas::new(&canvas, &Fill::Cells { groups: &groups, colours: &colours }, &self.view)
            }
            Paint::Taxel => {
                let canvas = Canvas::carried(self.finest(), self.level);
                let groups = self.ranks_of_ids();
                let colours: Vec<_> = (0..=64).map(|k| ORDER.at(f64::from(k) / STEPS)).collect();
                Areas::new(&canvas, &Fill::Cells { groups: &groups, colours: &colours }, &self.view)
            }
        }
    }

    fn finest(&self) -> &MapLevel {
        self.patch.levels.iter().next().unwrap_or(self.level)
    }

    /// Where each taxel's id stands in the order of the ids, in [`STEPS`].
    fn ranks_of_ids(&self) -> IdVec<VertexId, u32> {
        let mut sorted: Vec<_> = self.patch.ids.iter().copied().collect();
        sorted.sort_unstable();
        sorted.dedup();
        let last = sorted.len().saturating_sub(1).max(1) as f64;
        self.patch.ids.map(|id| {
            let rank = sorted.partition_point(|other| other < id) as f64 / last;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 64")]
            let step = (STEPS * rank).round() as u32;
            step
        })
    }

    fn triangles(&self) -> Path {
        let mut path = PathData::default();
        for [a, b] in edges(&self.level.mesh) {
            path.move_to(self.view.place(self.level.uv[a]));
            path.line_to(self.view.place(self.level.uv[b]));
        }
        stroke(path, "#000", 0.7).set("stroke-opacity", 0.28)
    }

    fn boundary(&self) -> Path {
        let mut path = PathData::default();
        for walk in boundary_loops(&self.level.mesh) {
            path.polygon(walk.into_iter().map(|v| self.view.place(self.level.uv[v])));
        }
        stroke(path, "#222", 2.0)
    }

    fn centres(&self, radius: f64) -> Group {
        let group = Group::new().set("fill", "#222");
        self.level.uv.iter().fold(group, |group, &at| group.add(circle(self.view.place(at), radius)))
    }
}

fn circle(at: DVec2, radius: f64) -> Circle {
    let short = |x: f64| (10.0 * x).round() / 10.0;
    Circle::new().set("cx", short(at.x)).set("cy", short(at.y)).set("r", short(radius))
}

fn stroke(path: PathData, colour: &str, width: f64) -> Path {
    Path::new()
        .set("d", path.into_text())
        .set("fill", "none")
        .set("stroke", colour)
        .set("stroke-width", width)
}

/// Fields are parted by white lines; other areas of one colour flow together, so their seams are painted over.
fn add_areas(mut group: Group, areas: &Areas, parted: bool) -> Group {
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
