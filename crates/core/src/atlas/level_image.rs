//! The channels of `map.exr`, filled from the chart of each level. The shading channel `Y` is a *heuristic*
//! for viewers, not a physical light; all others are measures or ids.

use std::{ops::Range, sync::Arc};

use glam::DVec3;

use crate::atlas::bound::check_map;
use crate::atlas::layout::{ChartPosition, image_name};
use crate::atlas::nearest::NearestVertices;
use crate::atlas::shown_id;
use crate::atlas::{AtlasError, AtlasPart, Chart, Stretch, face_stretch};
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::{ImageFrame, MapLevel, PatchMap, SkinMap};
use crate::mesh::TriMesh;
use crate::numeric::narrow;
use crate::pyramid::LevelId;
use crate::skin::PatchId;

/// The values of one channel, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
#[doc(hidden)]
pub enum Samples {
    /// Measures.
    F32(Vec<f32>),
    /// Ids.
    U32(Vec<u32>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[doc(hidden)]
pub enum SampleType {
    F32,
    U32,
}

/// An image that is computed in bands of rows, so that it need not be in memory as a whole.
#[doc(hidden)]
pub trait ImageRows: Sync {
    /// Patch and level, as `palm/L0`.
    fn name(&self) -> &str;

    /// The rectangle of the map it shows, and its size in pixels.
    fn frame(&self) -> &ImageFrame;

    /// The names of the channels, as `position.X`, and their types.
    fn channels(&self) -> Vec<(String, SampleType)>;

    /// The samples of the channels in that order, for `rows` counted from the top: width times the
    /// number of rows each. The rows lie inside of the image.
    fn rows(&self, rows: Range<u32>) -> Vec<Samples>;
}

/// Channels of measures; 0 where no face is.
const MEASURES: [&str; 12] = [
    "Y",
    "A",
    "position.X",
    "position.Y",
    "position.Z",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "bary.U",
    "bary.V",
    "stretch.angle",
    "stretch.area",
];

/// Channels of ids; `u32::MAX` where no face is.
const IDS: [&str; 2] = ["taxel.id", "face.id"];

/// The image of one level of a patch, computed row by row from its [`Chart`].
///
/// | channel | content | where no face is |
/// |---|---|---|
/// | `Y` | shading from the normal, 0 to 1, so that any viewer shows something | 0 |
/// | `A` | coverage: 1 or 0 | 0 |
/// | `position.{X,Y,Z}` | point of the level's mesh in the link's frame, in m | 0 |
/// | `normal.{X,Y,Z}` | unit normal, interpolated | 0 |
/// | `taxel.id` | of the nearest vertex: its vendor id, above level 0 its index | `u32::MAX` |
/// | `face.id` | index of the face in the level's mesh | `u32::MAX` |
/// | `bary.{U,V}` | weights of the face's second and third corner | 0 |
/// | `stretch.angle` | `s1/s2`, the ratio of the singular values of the map's Jacobian: 1 at a conformal map, negative if the face is mirrored, infinite if it is squeezed to a line | 0 |
/// | `stretch.area` | `s1 s2`, the area on the map over the area on the skin; infinite if the face has no area on the skin | 0 |
///
/// Where charts are packed into one image it shows all of them.
#[derive(Debug, Clone)]
pub struct LevelImage {
    name: String,
    frame: ImageFrame,
    map: Arc<SkinMap>,
    charts: Vec<ShadedChart>,
}

#[derive(Debug, Clone)]
struct ShadedChart {
    chart: Chart,
    normals: IdVec<VertexId, DVec3>,
    nearest: NearestVertices,
    light: DVec3,
}

impl ShadedChart {
    fn new(map: &SkinMap, chart: Chart) -> Self {
        let patch = &map.patches[chart.patch];
        let level = &patch.levels[chart.level].level;
        Self {
            normals: patch.normals(level),
            nearest: NearestVertices::new(&level.mesh),
            light: light(&level.mesh),
            chart,
        }
    }

    /// The measures of one pixel, in the order of [`MEASURES`].
    fn measures(&self, level: &MapLevel, face: FaceId, weights: [f64; 3], stretch: Stretch) -> [f64; 12] {
        let mesh = &level.level.mesh;
        let corners = mesh.triangles[face];
        let mix = |of: &dyn Fn(VertexId) -> DVec3| {
            corners.iter().zip(weights).map(|(&v, w)| w * of(v)).sum::<DVec3>()
        };
        let p = mix(&|v| mesh.positions[v]);
        let n = mix(&|v| self.normals[v]).normalize_or_zero();
        // Half-Lambert: surfaces that face away are dim, not black.
        let shade = 0.5 + 0.5 * n.dot(self.light);
        let [_, u, v] = weights;
        [shade, 1.0, p.x, p.y, p.z, n.x, n.y, n.z, u, v, stretch.angle, stretch.area]
    }

    /// Fills a row of the chart, whose first pixel has the index `start`.
    fn fill(
        &self,
        patch: &PatchMap,
        row: u32,
        start: usize,
        measures: &mut [Vec<f32>; 12],
        ids: &mut [Vec<u32>; 2],
    ) {
        let level = &patch.levels[self.chart.level];
        let (mut current, mut seen): (Option<(FaceId, Stretch)>, _) = (None, Vec::new());
        self.chart.each_in_row(level, row, |column, face, weights| {
            let stretch = match current {
                Some((of, stretch)) if of == face => stretch,
                _ => face_stretch(level, face),
            };
            current = Some((face, stretch));
            let at = start + column;
            for (samples, value) in measures.iter_mut().zip(self.measures(level, face, weights, stretch)) {
                samples[at] = narrow(value);
            }
            let vertex = self.nearest.find(level.level.mesh.triangles[face], weights, &mut seen);
            let shown = [shown_id(patch, self.chart.level, vertex), face.raw()];
            ids.iter_mut().zip(shown).for_each(|(samples, id)| samples[at] = id);
        });
    }
}

impl LevelImage {
    /// Rasterises a level of a map that is known to be valid.
    fn new(map: &Arc<SkinMap>, id: PatchId, level: LevelId) -> Result<Self, AtlasError> {
        let patch = &map.patches[id];
        let (at, name) = (&patch.levels[level], image_name(patch, level));
        let place = ChartPosition { patch: id, level, turns: 0, frame: at.frame, corner_px: [0, 0] };
        let chart = Chart::new(&name, at, &place)?;
        let (frame, charts) = (chart.frame, vec![ShadedChart::new(map, chart)]);
        Ok(Self { name, frame, map: Arc::clone(map), charts })
    }

    /// The channels of an image of an atlas.
    pub(super) fn of_part(map: &Arc<SkinMap>, part: &AtlasPart) -> Self {
        let charts = part.charts.iter().map(|chart| ShadedChart::new(map, chart.clone())).collect();
        Self { name: part.name.clone(), frame: part.frame, map: Arc::clone(map), charts }
    }
}

impl ImageRows for LevelImage {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame(&self) -> &ImageFrame {
        &self.frame
    }

    fn channels(&self) -> Vec<(String, SampleType)> {
        let measures = MEASURES.into_iter().map(|name| (name.to_owned(), SampleType::F32));
        measures.chain(IDS.map(|name| (name.to_owned(), SampleType::U32))).collect()
    }

    fn rows(&self, rows: Range<u32>) -> Vec<Samples> {
        let width = self.frame.size_px[0] as usize;
        let count = width * rows.len();
        let mut measures = MEASURES.map(|_| vec![0.0_f32; count]);
        let mut ids = IDS.map(|_| vec![u32::MAX; count]);
        for shaded in &self.charts {
            let Chart { patch, corner_px: [left, top], frame, .. } = shaded.chart;
            for (start, row) in (0..).step_by(width).zip(rows.clone()) {
                let inside = row.checked_sub(top).filter(|&row| row < frame.size_px[1]);
                if let Some(row) = inside {
                    let start = start + left as usize;
                    shaded.fill(&self.map.patches[patch], row, start, &mut measures, &mut ids);
                }
            }
        }
        measures.into_iter().map(Samples::F32).chain(ids.into_iter().map(Samples::U32)).collect()
    }
}

/// Direction towards the light: the mean direction of the mesh, or up if there is none.
fn light(mesh: &TriMesh) -> DVec3 {
    let sum: DVec3 = mesh.triangles.ids().map(|f| mesh.face_cross(f)).sum();
    sum.try_normalize().unwrap_or(DVec3::Z)
}

/// The images of every level of every patch, rasterised but not yet filled: patch by patch, finest
/// level first.
///
/// # Errors
/// If the map breaks a rule of [`SkinMap::validate`], if an image would be larger than 16384 pixels
/// a side or all together than 256 pixels a taxel (at least `2^20`, at most `2^26`), or if a map
/// does not lie in its frame.
pub fn skin_images(map: &Arc<SkinMap>) -> Result<Vec<LevelImage>, AtlasError> {
    map.validate()?;
    check_map(map, (MEASURES.len() + IDS.len()) as u64)?;
    let all =
        map.patches.enumerate().flat_map(|(id, patch)| patch.levels.ids().map(move |level| (id, level)));
    all.map(|(id, level)| LevelImage::new(map, id, level)).collect()
}
