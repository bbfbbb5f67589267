//! The point of the skin that each pixel shows: every chart is rasterised once, then filled with values.
//!
//! A [`Chart`] gives the face and the point in it that every pixel of a level's image shows. An [`Atlas`] has
//! the charts of all levels and patches, one image each or packed into one image per level; [`crate::image`]
//! draws values through it. [`LevelImage`] fills the channels of `map.exr`, a band of rows at a time, so that
//! an image of a whole skin is never in memory at once.

mod bound;
mod chart;
mod error;
mod grid;
mod layout;
mod level_image;
mod nearest;
mod pack;
mod rasterize;
mod stretch;
mod turn;

use std::{collections::BTreeSet, sync::Arc};

use glam::DVec2;

use crate::atlas::bound::{check_size, check_total};
use crate::atlas::layout::{ChartPosition, PartLayout, image_name, layout};
use crate::body::FieldLevel;
use crate::id::VertexId;
use crate::map::{ImageFrame, PatchMap, SkinMap};
use crate::pyramid::LevelId;
use crate::skin::PatchId;

pub use bound::{fitting_pixel, pixels_of};
pub use chart::Chart;
pub use error::AtlasError;
pub use layout::check_pixel;
pub use layout::{AtlasOptions, Resolution};
pub use level_image::{ImageRows, SampleType, Samples};
pub use level_image::{LevelImage, skin_images};
pub use nearest::NearestVertices;
pub use pack::Pack;
pub use stretch::{Stretch, face_stretch};

/// The images of a map, with the point of the skin that each pixel shows.
///
/// ```
/// use dermatome::{
///     atlas::{Atlas, AtlasOptions, Resolution},
///     map::SkinMap,
///     mesh::shapes,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let options = AtlasOptions { resolution: Resolution::Canvas([64, 128]), ..AtlasOptions::default() };
/// let atlas = Atlas::new(&map, &options)?;
/// let part = &atlas.parts[0];
/// assert_eq!((part.name.as_str(), part.frame.size_px), ("skin/L0", [128, 64]));
/// assert!(part.charts[0].point(&map, 64, 32).is_some(), "the middle shows the skin");
/// # Ok::<(), dermatome::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Atlas {
    /// The images: patch by patch, finest level first, or one for each level where charts are
    /// packed.
    pub parts: Vec<AtlasPart>,
}

/// One image of an [`Atlas`]: the chart of one level of a patch, or those of one level of all
/// patches.
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasPart {
    /// `palm/L0`, or `L0` where charts are packed.
    pub name: String,
    /// The level it shows.
    pub level: LevelId,
    /// Its size. The origin has no meaning if charts are packed.
    pub frame: ImageFrame,
    /// The charts, in the order in which they were packed.
    pub charts: Vec<Chart>,
}

/// A name in an image, for human readers.
#[derive(Debug, Clone, PartialEq)]
pub struct Label {
    /// The name of a link.
    pub text: String,
    /// Position of its centre, in pixels right and down.
    pub at: DVec2,
}

/// Every image of readings has one channel and its coverage.
const LEAST_SAMPLES: u64 = 2;

impl Atlas {
    /// Rasterises every level of a map.
    ///
    /// # Errors
    /// If the map breaks a rule of [`SkinMap::validate`], the options are invalid, the charts do not fit into
    /// the canvas, or an image would be larger than 16384 pixels a side or all together than `2^26` pixels.
    pub fn new(map: &SkinMap, options: &AtlasOptions) -> Result<Self, AtlasError> {
        map.validate()?;
        let layouts = layout(map, options)?;
        for part in &layouts {
            check_size(&part.frame, &part.name)?;
        }
        check_total(layouts.iter().map(|part| &part.frame), LEAST_SAMPLES)?;
        Ok(Self {
            parts: layouts.into_iter().map(|part| AtlasPart::new(map, part)).collect::<Result<_, _>>()?,
        })
    }

    /// Rasterises every level of a map on the canvas of another one that lies on the same plane
    /// (`io::share_plane`): images have the names, the sizes and the pixels of the other one. Where
    /// a patch has no such level, its coarsest is drawn. Pixels that only one of both covers are not covered; what lies
    /// beyond the canvas is not drawn.
    ///
    /// # Errors
    /// As [`Self::new`] for the other map, and if no patch lies on a patch of it.
    pub fn onto(map: &SkinMap, canvas: &SkinMap, options: &AtlasOptions) -> Result<Self, AtlasError> {
        map.validate()?;
        let whole = Self::new(canvas, options)?;
        let is_mirrored = map.is_mirrored() != canvas.is_mirrored();
        let mut is_any = false;
        let mut parts = Vec::with_capacity(whole.parts.len());
        for AtlasPart { name, level, frame, charts } in whole.parts {
            let [width, height] = frame.size_px.map(|n| n as usize);
            let mut taken = vec![false; width * height];
            let mut drawn = Vec::new();
            for chart in charts {
                let plane = canvas.patches[chart.patch].plane();
                for (id, patch) in map.patches.enumerate().filter(|(_, patch)| patch.plane() == plane) {
                    let Chart { turns, frame, corner_px, .. } = chart;
                    let at = patch.nearest_level(level);
                    let place = ChartPosition { patch: id, level: at, turns, frame, corner_px };
                    drawn.push(Chart::onto(
                        &name,
                        &patch.levels[at],
                        &place,
                        is_mirrored,
                        &mut taken,
                        width,
                    )?);
                }
            }
            is_any |= !drawn.is_empty();
            parts.push(AtlasPart { name, level, frame, charts: drawn });
        }
        if is_any {
            Ok(Self { parts })
        } else {
            let planes = |map: &SkinMap| map.patches.iter().map(|patch| patch.plane().to_owned()).collect();
            Err(AtlasError::OtherPlane { found: planes(map), needed: planes(canvas) })
        }
    }

    /// The images of level 0 for values of a level without a mesh, which are carried down to the taxels: those that show a
    /// patch with fields of it, `arm/body.L1`, `arm/thermal.L0` or where charts are packed `body.L1`, `arm.thermal.L0`.
    ///
    /// # Panics
    /// If the atlas was made of another map.
    #[must_use]
    pub fn of_fields(mut self, map: &SkinMap, at: FieldLevel) -> Self {
        let rows = map.field_rows(at);
        let modality = at.modality.and_then(|number| map.body.modalities.get(number));
        let body = if modality.is_some_and(|of| of.patch.is_some()) { "" } else { "body." };
        let level = match modality {
            Some(of) => format!("{body}{}.L{}", of.name, at.level),
            None => format!("{body}L{}", at.level),
        };
        let whole = map.field_levels().find_map(|(known, name)| (known == at).then_some(name));
        self.parts.retain(|part| {
            part.level == LevelId::default() && part.charts.iter().any(|chart| rows[chart.patch].is_some())
        });
        for part in &mut self.parts {
            part.name = match part.name.rsplit_once('/') {
                Some((patch, _)) => format!("{patch}/{level}"),
                None => whole.clone().unwrap_or_else(|| level.clone()),
            };
        }
        self
    }

    /// The images of one level, or of all.
    #[doc(hidden)]
    pub fn parts_of(&self, level: Option<LevelId>) -> impl Iterator<Item = &AtlasPart> + Clone {
        self.parts.iter().filter(move |part| level.is_none_or(|level| part.level == level))
    }

    /// The channels of its images, of one level or of all: positions, normals, ids and stretch.
    ///
    /// ```
    /// use std::sync::Arc;
    ///
    /// use dermatome::{
    ///     atlas::{Atlas, AtlasOptions},
    ///     map::SkinMap,
    ///     mesh::shapes,
    /// };
    ///
    /// let map = Arc::new(SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3));
    /// let atlas = Atlas::new(&map, &AtlasOptions::default())?;
    /// assert_eq!(atlas.images(&map, None).len(), atlas.parts.len());
    /// # Ok::<(), dermatome::Error>(())
    /// ```
    ///
    /// # Panics
    /// If the atlas was made of another map.
    pub fn images(&self, map: &Arc<SkinMap>, level: Option<LevelId>) -> Vec<LevelImage> {
        self.parts_of(level).map(|part| LevelImage::of_part(map, part)).collect()
    }
}

impl AtlasPart {
    fn new(map: &SkinMap, layout: PartLayout) -> Result<Self, AtlasError> {
        let PartLayout { name, level, frame, places } = layout;
        let chart = |place: &ChartPosition| {
            let patch = &map.patches[place.patch];
            Chart::new(&image_name(patch, place.level), &patch.levels[place.level], place)
        };
        let charts = places.iter().map(chart).collect::<Result<_, _>>()?;
        Ok(Self { name, level, frame, charts })
    }

    /// The share of its pixels that show the skin.
    pub fn fill(&self) -> f64 {
        let covered: usize = self.charts.iter().map(Chart::covered).sum();
        covered as f64 / self.frame.size_px.map(f64::from).iter().product::<f64>()
    }

    /// The names of the links that it shows, each at the centre of the link's largest chart, larger charts first.
    ///
    /// # Panics
    /// If `map` is not the one that was rasterised.
    pub fn labels(&self, map: &SkinMap) -> Vec<Label> {
        let mut charts: Vec<&Chart> = self.charts.iter().filter(|chart| chart.covered() > 0).collect();
        charts.sort_by_key(|chart| std::cmp::Reverse(chart.covered()));
        let mut named = BTreeSet::new();
        charts.retain(|chart| named.insert(map.patches[chart.patch].link));
        let width = self.frame.size_px[0] as usize;
        let label = |chart: &Chart| {
            let mut sum = DVec2::ZERO;
            for (start, row) in chart.rows(width) {
                let y = (start / width) as f64 + 0.5;
                for span in row {
                    let x = (start % width) as f64 + f64::from(span.column) + 0.5 * f64::from(span.length);
                    sum += f64::from(span.length) * DVec2::new(x, y);
                }
            }
            let text = map.links[map.patches[chart.patch].link].name.clone();
            Label { text, at: sum / chart.covered() as f64 }
        };
        charts.into_iter().map(label).collect()
    }

    /// Whether each pixel shows the skin: 1 or 0, row by row from the top.
    #[doc(hidden)]
    pub fn coverage(&self) -> Vec<u8> {
        let [width, height] = self.frame.size_px.map(|n| n as usize);
        let mut covered = vec![0; width * height];
        for (start, row) in self.charts.iter().flat_map(|chart| chart.rows(width)) {
            for span in row {
                covered[start + usize::from(span.column)..][..usize::from(span.length)].fill(1);
            }
        }
        covered
    }

    /// The id that each pixel shows, as in [`LevelImage`]; `u32::MAX` where there is none.
    ///
    /// # Panics
    /// If `map` is not the one that was rasterised.
    #[must_use]
    pub fn taxel_ids(&self, map: &SkinMap) -> Vec<u32> {
        let id = |shown: Option<(PatchId, VertexId)>| {
            let (patch, vertex) = shown?;
            let patch = &map.patches[patch];
            Some(shown_id(patch, patch.nearest_level(self.level), vertex))
        };
        self.vertices(map).into_iter().map(|shown| id(shown).unwrap_or(u32::MAX)).collect()
    }

    /// The patch that each pixel shows and the nearest vertex of its level, a taxel or a field; row by row from the top.
    ///
    /// # Panics
    /// If `map` is not the one that was rasterised.
    #[must_use]
    pub fn vertices(&self, map: &SkinMap) -> Vec<Option<(PatchId, VertexId)>> {
        let [width, height] = self.frame.size_px.map(|n| n as usize);
        let mut vertices = vec![None; width * height];
        for chart in &self.charts {
            let patch = &map.patches[chart.patch];
            let level = &patch.levels[chart.level];
            let (nearest, mut seen) = (NearestVertices::new(&level.level.mesh), Vec::new());
            for ((start, _), row) in chart.rows(width).zip(0..) {
                chart.each_in_row(level, row, |column, face, weights| {
                    let vertex = nearest.find(level.level.mesh.triangles[face], weights, &mut seen);
                    vertices[start + column] = Some((chart.patch, vertex));
                });
            }
        }
        vertices
    }
}

/// The id of a vertex in an image: the taxel's, above level 0 the index of the field.
fn shown_id(patch: &PatchMap, level: LevelId, vertex: VertexId) -> u32 {
    if level == LevelId::default() { patch.taxels.ids[vertex].0 } else { vertex.raw() }
}
