use crate::{
    atlas::{Stretch, face_stretch},
    id::{FaceId, IdVec, VertexId},
    map::MapLevel,
    mesh::TriMesh,
    plot::{
        Paint, PlotError,
        colour::scale_limits::Range,
        colour::scales::{Colour, DIVERGING, ORDER, SEQUENTIAL, SKIN, Scale},
        draw::view::{Fill, dominant_fields, field_colours},
        patch_view::Subject,
    },
};

/// Steps of a continuous scale: more cannot be told apart, and each is one path.
const STEPS: u32 = 64;

/// Colours of a surface, wherever it will be laid out.
pub(crate) struct Coat<'a> {
    /// The mesh that wears it.
    pub(crate) mesh: &'a TriMesh,
    /// Whose mesh that is.
    pub(crate) wearer: Wearer,
    pub(crate) fill: Fill,
    /// Whether the colours are read off a scale, so that shade must hardly change them.
    pub(crate) is_scale: bool,
}

/// Whose triangles are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wearer {
    Taxels,
    Level,
}

impl<'a> Coat<'a> {
    /// What the colours say about a level of a patch, or about a patch without a map.
    ///
    /// The stretch belongs to the level's own triangles, everything else to the taxels.
    pub(crate) fn new(
        subject: &Subject<'a>,
        level: Option<&'a MapLevel>,
        paint: Paint,
        range: &Range,
    ) -> Result<Self, PlotError> {
        let need_map = |what| level.ok_or_else(|| subject.no_map(what));
        let is_scale = paint != Paint::Fields;
        let of_taxels = |fill| Ok(Self { mesh: subject.mesh, wearer: Wearer::Taxels, fill, is_scale });
        match paint {
            Paint::Angle => Ok(by_stretch(need_map("angles")?, SEQUENTIAL, &|s| {
                (s.angle.abs() - 1.0) / (range.angle - 1.0)
            })),
            Paint::Area => Ok(by_stretch(need_map("areas")?, DIVERGING, &|s| {
                0.5 + 0.5 * s.area.abs().ln() / range.area.ln()
            })),
            Paint::Fields => match level.filter(|level| level.direct.is_some()) {
                None => of_taxels(Fill::Faces(subject.mesh.triangles.map(|_| SKIN))),
                Some(level) => {
                    let groups = dominant_fields(level);
                    let colours = field_colours(&groups, subject.mesh, level.uv.len());
                    of_taxels(Fill::Cells { groups, colours })
                }
            },
            Paint::Taxel => of_taxels(by_value(&ranks_of_ids(subject), ORDER)),
            Paint::Sigma => {
                let [least, most] = range.sigma;
                let values = subject.sigmas()?.map(|s| (s - least) / (most - least));
                of_taxels(by_value(&values, SEQUENTIAL))
            }
        }
    }
}

fn by_stretch<'a>(level: &'a MapLevel, scale: Scale, value: &dyn Fn(Stretch) -> f64) -> Coat<'a> {
    let colour = |f: FaceId| step_colour(step(value(face_stretch(level, f))), scale);
    let fill = Fill::Faces(level.mesh.triangles.ids().map(colour).collect());
    Coat { mesh: &level.mesh, wearer: Wearer::Level, fill, is_scale: true }
}

/// Cells coloured by values from 0 to 1.
fn by_value(values: &IdVec<VertexId, f64>, scale: Scale) -> Fill {
    Fill::Cells {
        groups: values.map(|&x| step(x)),
        colours: (0..=STEPS).map(|k| step_colour(k, scale)).collect(),
    }
}

/// Where each taxel's id stands in the order of the ids, 0 to 1.
fn ranks_of_ids(subject: &Subject<'_>) -> IdVec<VertexId, f64> {
    let mut sorted: Vec<_> = subject.ids.iter().copied().collect();
    sorted.sort_unstable();
    sorted.dedup();
    let last = sorted.len().saturating_sub(1).max(1) as f64;
    subject.ids.map(|id| sorted.partition_point(|other| other < id) as f64 / last)
}

fn step(x: f64) -> u32 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 64")]
    let step = (f64::from(STEPS) * x.clamp(0.0, 1.0)).round() as u32;
    step
}

fn step_colour(step: u32, scale: Scale) -> Colour {
    scale.at(f64::from(step) / f64::from(STEPS))
}
