use std::{
    borrow::Cow,
    collections::{BTreeMap, BTreeSet},
};

use glam::DVec2;

use crate::{
    atlas::Chart,
    id::{FaceId, IdVec, VertexId},
    map::{MapFrame, MapLevel},
    mesh::TriMesh,
    plot::{
        PlotError,
        colour::scales::{Colour, FIELDS, colour_fields},
        draw::outline::{edges, outlines},
        draw::svg_path::PathData,
    },
};

/// Triangles with edges shorter than this on the picture are not drawn one by one: their colours are rasterised at
/// the picture's resolution. That bounds the size of a picture whatever the size of the mesh.
const LEAST_EDGE_PX: f64 = 3.0;

/// From the map to the picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    /// Pixels per metre.
    pub(crate) scale: f64,
    /// Where the panel's upper left corner lies on the picture, in whole pixels.
    pub(crate) corner: DVec2,
    /// The same corner on the map, in m.
    pub(crate) origin: DVec2,
    /// Width and height of the panel, in whole pixels.
    pub(crate) size: DVec2,
}

impl View {
    /// The place of a map position on the picture, in pixels.
    pub(crate) fn place(&self, at: DVec2) -> DVec2 {
        self.corner + DVec2::new(at.x - self.origin.x, self.origin.y - at.y) * self.scale
    }

    /// The same panel as an image of its own.
    fn frame(&self) -> MapFrame {
        let size = self.size / self.scale;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole pixels of a picture"
        )]
        let size_px = [self.size.x as u32, self.size.y as u32];
        MapFrame { origin: self.origin - DVec2::new(0.0, size.y), size, size_px }
    }
}

/// A mesh laid out in the plane of a panel.
pub(crate) struct Canvas<'a> {
    pub(crate) mesh: &'a TriMesh,
    pub(crate) uv: Cow<'a, IdVec<VertexId, DVec2>>,
}

impl<'a> Canvas<'a> {
    /// A level on its own map.
    pub(crate) fn own(level: &'a MapLevel) -> Self {
        Self { mesh: &level.mesh, uv: Cow::Borrowed(&level.uv) }
    }

    /// The taxels on the map of `level`, each where its fields pull it.
    pub(crate) fn carried(taxels: &'a TriMesh, level: &'a MapLevel) -> Self {
        let Some(direct) = &level.direct else { return Self::own(level) };
        let place = |(v, t): (VertexId, &[VertexId; 3])| {
            t.iter().zip(direct.weights[v]).map(|(&k, w)| w * level.uv[k]).sum()
        };
        Self { mesh: taxels, uv: Cow::Owned(direct.indices.enumerate().map(place).collect()) }
    }

    /// Mean length of the edges, in pixels of the picture.
    pub(crate) fn edge_px(&self, view: &View) -> f64 {
        let edges = edges(self.mesh);
        let sum: f64 = edges.iter().map(|&[a, b]| self.uv[a].distance(self.uv[b])).sum();
        view.scale * sum / edges.len().max(1) as f64
    }
}

/// The field that each taxel belongs to most, the first of several; on level 0 every taxel is its own.
pub(crate) fn dominant_fields(level: &MapLevel) -> IdVec<VertexId, u32> {
    let Some(direct) = &level.direct else {
        return level.mesh.positions.ids().map(VertexId::raw).collect();
    };
    let row = |(v, t): (VertexId, &[VertexId; 3])| t[largest(direct.weights[v])].raw();
    direct.indices.enumerate().map(row).collect()
}

/// A colour for each of `count` fields that differs from those of the fields beside it.
pub(crate) fn field_colours(groups: &IdVec<VertexId, u32>, mesh: &TriMesh, count: usize) -> Vec<Colour> {
    let mut neighbours = BTreeSet::new();
    for [a, b] in edges(mesh) {
        let (a, b) = (groups[a] as usize, groups[b] as usize);
        if a != b {
            neighbours.insert((a.min(b), a.max(b)));
        }
    }
    colour_fields(count, &neighbours).into_iter().map(|c| FIELDS[c]).collect()
}

/// What a mesh is filled with.
pub(crate) enum Fill {
    /// One colour for each group of cells.
    Cells { groups: IdVec<VertexId, u32>, colours: Vec<Colour> },
    /// One colour for each face.
    Faces(IdVec<FaceId, Colour>),
}

impl Fill {
    /// The colour of a corner of a face.
    pub(crate) fn colour(&self, face: FaceId, corner: VertexId) -> Colour {
        match self {
            Self::Faces(colours) => colours[face],
            Self::Cells { groups, colours } => colours[groups[corner] as usize],
        }
    }
}

/// The areas of each colour, and whether they are exact or pixels.
pub(crate) struct Areas {
    pub(crate) paths: BTreeMap<Colour, PathData>,
    pub(crate) exact: bool,
}

impl Areas {
    /// Fills the canvas. Neighbouring groups of one colour merge.
    pub(crate) fn new(canvas: &Canvas<'_>, fill: &Fill, view: &View) -> Result<Self, PlotError> {
        let mut paths = BTreeMap::<Colour, PathData>::new();
        let exact = canvas.edge_px(view) >= LEAST_EDGE_PX;
        match (exact, fill) {
            (true, Fill::Cells { groups, colours }) => {
                for outline in outlines(canvas.mesh, &canvas.uv, groups) {
                    let path = paths.entry(colours[outline.group as usize]).or_default();
                    path.polygon(outline.corners.into_iter().map(|p| view.place(p)));
                }
            }
            (true, Fill::Faces(colours)) => {
                for (face, t) in canvas.mesh.triangles.enumerate() {
                    let corners = t.map(|v| view.place(canvas.uv[v]));
                    paths.entry(colours[face]).or_default().polygon(corners);
                }
            }
            (false, _) => draw_runs(canvas, fill, view, &mut paths)?,
        }
        Ok(Self { paths, exact })
    }
}

/// Rasterises the colours: runs of equal pixels, row by row.
fn draw_runs(
    canvas: &Canvas<'_>,
    fill: &Fill,
    view: &View,
    paths: &mut BTreeMap<Colour, PathData>,
) -> Result<(), PlotError> {
    let chart = Chart::of("the picture", canvas.mesh, &canvas.uv, view.frame())?;
    let [width, height] = chart.size_px();
    let colour = |column, row| {
        let at = chart.point(column, row)?;
        Some(fill.colour(at.face, canvas.mesh.triangles[at.face][largest(at.barycentric)]))
    };
    for row in 0..height {
        let colours: Vec<Option<Colour>> = (0..width).map(|column| colour(column, row)).collect();
        draw_row(&colours, view.corner + DVec2::new(0.0, f64::from(row)), paths);
    }
    Ok(())
}

/// Adds the pixels of a row, which begins at `corner`, as runs of equal ones.
pub(crate) fn draw_row(colours: &[Option<Colour>], corner: DVec2, paths: &mut BTreeMap<Colour, PathData>) {
    let mut start = 0;
    for run in colours.chunk_by(|a, b| a == b) {
        if let Some(colour) = run[0] {
            paths.entry(colour).or_default().run(corner + DVec2::new(start as f64, 0.0), run.len());
        }
        start += run.len();
    }
}

/// The largest of three weights, the first of several.
pub(crate) fn largest(weights: [f64; 3]) -> usize {
    (1..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best })
}
