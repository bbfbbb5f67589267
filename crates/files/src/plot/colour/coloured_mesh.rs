//! A mesh and the colours of its triangles or of the cells around its vertices.

use glam::DVec2;

use crate::atlas::{Stretch, face_stretch};
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::MapLevel;
use crate::mesh::{TriMesh, rectangle_around};
use crate::plot::colour::field_colours::{dominant_fields, field_colours, largest};
use crate::plot::colour::{Colour, DIVERGING, INK, SEQUENTIAL, SKIN, Scale, ScaleLimits, hatch};
use crate::plot::patch_view::PatchView;
use crate::plot::{Paint, PlotError};

/// A grey that is visible on both ends of every scale.
const DOT_ON_VALUES: Colour = Colour(0xc8, 0xc8, 0xc8);

/// The second colour of the checker on skin.
const SKIN_SHADE: Colour = Colour(0xc3, 0xcf, 0xdf);

/// Squares along the longer side of a map, and the least number of vertices for which they are drawn.
const SQUARES: f64 = 16.0;
const MIN_CHECKERED: usize = 1500;

/// Steps of a continuous scale: more could not be distinguished, and each is one path.
const STEPS: u32 = 64;

/// Colours of a surface, independent of its layout.
pub(crate) struct ColouredMesh<'a> {
    pub(crate) mesh: &'a TriMesh,
    pub(crate) owner: MeshOwner,
    pub(crate) fill: Fill,
    /// Whether the colours belong to a scale, so that shading must change them little.
    pub(crate) is_scale: bool,
    /// Whether the centres of taxels or fields are shown.
    pub(crate) has_dots: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MeshOwner {
    Taxels,
    Level,
}

#[derive(Debug, Clone)]
pub(crate) enum Fill {
    Cells {
        groups: IdVec<VertexId, u32>,
        colours: Vec<Colour>,
    },
    Faces(IdVec<FaceId, Colour>),
    /// Values from 0 to 1, linear between the corners of each triangle; NaN where nothing is known.
    Values {
        values: IdVec<VertexId, f64>,
        scale: Scale,
        /// Whether the triangles are those of the level of the values.
        has_lines: bool,
    },
}

impl Fill {
    /// The colour at a point of a face, by its barycentric coordinates times any positive number, on this
    /// diagonal of the pixels.
    pub(crate) fn colour(
        &self,
        face: FaceId,
        corners: [VertexId; 3],
        weights: [f64; 3],
        diagonal: usize,
    ) -> Colour {
        let nearest = corners[largest(weights)];
        match self {
            Self::Faces(colours) => colours[face],
            Self::Cells { groups, colours } => colours[groups[nearest] as usize],
            Self::Values { values, .. } if values[nearest].is_nan() => hatch(diagonal),
            Self::Values { values, scale, .. } => {
                step_colour(step(mean_of_known(corners.map(|v| values[v]).into_iter().zip(weights))), *scale)
            }
        }
    }

    /// Colour and opacity of the lines between triangles, and the least length of edges that are drawn, in
    /// pixels: shorter ones would only grey the picture. Lines of a fine mesh are faint.
    pub(crate) fn lines(&self, is_fine: bool) -> Option<(Colour, f64, f64)> {
        match self {
            Self::Values { has_lines: false, .. } => None,
            // Over values, which change within triangles, lines need longer edges.
            Self::Values { .. } => Some((Colour::WHITE, 0.3, 12.0)),
            _ if is_fine => Some((Colour(0, 0, 0), 0.1, 6.0)),
            _ => Some((Colour(0, 0, 0), 0.28, 6.0)),
        }
    }

    /// Colour and size of dots: over values they are small, so that they do not hide them.
    pub(crate) fn dots(&self) -> (Colour, f64) {
        match self {
            Self::Values { .. } => (DOT_ON_VALUES, 0.55),
            _ => (INK, 1.0),
        }
    }
}

impl<'a> ColouredMesh<'a> {
    /// The colours of a level of a patch, or of a patch without a map.
    ///
    /// Stretch is shown on the triangles of the level, everything else on the taxels.
    pub(crate) fn new(
        patch: &PatchView<'a>,
        level: Option<&'a MapLevel>,
        paint: Paint,
        limits: &ScaleLimits,
    ) -> Result<Self, PlotError> {
        let need_map = |what| level.ok_or_else(|| patch.no_map(what));
        let (is_scale, has_dots) = (!matches!(paint, Paint::Fields | Paint::Regions), paint.has_dots());
        let of_taxels =
            |fill| Ok(Self { mesh: patch.mesh, owner: MeshOwner::Taxels, fill, is_scale, has_dots });
        match paint {
            Paint::Angle => {
                Ok(by_stretch(need_map("angles")?, SEQUENTIAL, &|s| limits.place(paint, s.angle.abs())))
            }
            Paint::Area => {
                Ok(by_stretch(need_map("areas")?, DIVERGING, &|s| limits.place(paint, s.area.abs())))
            }
            Paint::Fields => {
                match level.filter(|level| level.level.to_finest.is_some()) {
                    None => of_taxels(Fill::Faces(level.map_or_else(
                        || patch.mesh.triangles.map(|_| SKIN),
                        |level| checker(level, patch.mesh),
                    ))),
                    Some(level) => {
                        let groups = dominant_fields(level);
                        let colours = field_colours(&groups, patch.mesh, level.level.mesh.positions.len());
                        of_taxels(Fill::Cells { groups, colours })
                    }
                }
            }
            Paint::Regions => {
                let mut names = vec![None];
                let groups = patch.mesh.positions.ids().map(|taxel| {
                    let region = patch.region(taxel);
                    let known = names.iter().position(|name| *name == region);
                    let number = known.unwrap_or_else(|| {
                        names.push(region);
                        names.len() - 1
                    });
                    VertexId::new(number).raw()
                });
                let groups: IdVec<VertexId, u32> = groups.collect();
                let mut colours = field_colours(&groups, patch.mesh, names.len());
                // Taxels of no region have the colour of skin.
                colours.iter_mut().take(1).for_each(|colour| *colour = SKIN);
                of_taxels(Fill::Cells { groups, colours })
            }
            Paint::Sigma => {
                // Taxels of unknown covariance have the colour of skin.
                let group = |&s: &f64| if s.is_nan() { STEPS + 1 } else { step(limits.place(paint, s)) };
                let groups = patch.sigmas()?.map(group);
                let known = (0..=STEPS).map(|k| step_colour(k, SEQUENTIAL));
                let colours = known.chain([SKIN]).collect();
                of_taxels(Fill::Cells { groups, colours })
            }
        }
    }
}

/// Level 0 in the colour of skin; a mesh too fine for lines and dots has a checker of squares of the map,
/// which also shows how the map lies on the skin.
fn checker(level: &MapLevel, mesh: &TriMesh) -> IdVec<FaceId, Colour> {
    let (corner, end) = rectangle_around(level.uv.iter().copied());
    let side = (end - corner).max_element() / SQUARES;
    let is_fine = mesh.positions.len() > MIN_CHECKERED && side > 0.0;
    let colour = |face| {
        let at = level.uv_of(face).into_iter().sum::<DVec2>() / 3.0 - corner;
        let square = (at / side).floor();
        if is_fine && (square.x + square.y).rem_euclid(2.0) == 1.0 { SKIN_SHADE } else { SKIN }
    };
    mesh.triangles.ids().map(colour).collect()
}

fn by_stretch<'a>(level: &'a MapLevel, scale: Scale, value: &dyn Fn(Stretch) -> f64) -> ColouredMesh<'a> {
    let colour = |f: FaceId| step_colour(step(value(face_stretch(level, f))), scale);
    let fill = Fill::Faces(level.level.mesh.triangles.ids().map(colour).collect());
    ColouredMesh { mesh: &level.level.mesh, owner: MeshOwner::Level, fill, is_scale: true, has_dots: false }
}

/// The weighted mean of the values that are not NaN; NaN without any.
pub(crate) fn mean_of_known(weighted: impl Iterator<Item = (f64, f64)>) -> f64 {
    let known = weighted.filter(|(value, _)| !value.is_nan());
    let (sum, weight) = known.fold((0.0, 0.0), |(sum, weight), (x, w)| (sum + w * x, weight + w));
    sum / weight
}

fn step(x: f64) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "0 to 64")]
    let step = (f64::from(STEPS) * x.clamp(0.0, 1.0)).round() as u32;
    step
}

fn step_colour(step: u32, scale: Scale) -> Colour {
    scale.at(f64::from(step) / f64::from(STEPS))
}
