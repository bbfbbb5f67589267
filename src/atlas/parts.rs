//! All charts of a skin, rasterised once and placed in images.

use std::borrow::Cow;

use crate::{
    atlas::{
        AtlasError, AtlasOptions, Chart,
        bound::{check_size, check_total},
        chart::largest,
        layout::{PartLayout, Place, image_name, layout},
        rasterize::Span,
    },
    map::{ImageFrame, SkinMap},
    pyramid::LevelId,
    skin::PatchId,
};

/// Which place of the skin every pixel of its images shows.
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
    /// Its size. Where charts are packed the origin has no meaning.
    pub frame: ImageFrame,
    /// The charts, in the order of the tree of links.
    pub charts: Vec<Chart>,
    /// Pixels of the gutter, and for each the covered pixel whose value it repeats; row by row from
    /// the top.
    pub(crate) gutter: Vec<[u32; 2]>,
}

/// Every image of readings has one channel and its coverage.
const LEAST_SAMPLES: u64 = 2;

impl Atlas {
    /// Rasterises every level of a map.
    ///
    /// # Errors
    /// If the map breaks a rule of [`SkinMap::validate`], the options make no sense, the charts do
    /// not fit into the canvas, or an image would be larger than 16384 pixels a side or all
    /// together than `2^26` pixels.
    pub fn new(map: &SkinMap, options: &AtlasOptions) -> Result<Self, AtlasError> {
        map.validate()?;
        let layouts = layout(map, options)?;
        for part in &layouts {
            check_size(&part.frame, &part.name)?;
        }
        check_total(layouts.iter().map(|part| &part.frame), LEAST_SAMPLES)?;
        let parts = layouts.into_iter().map(|part| AtlasPart::new(map, part, options.gutter));
        Ok(Self { parts: parts.collect::<Result<_, _>>()? })
    }
}

impl AtlasPart {
    fn new(map: &SkinMap, layout: PartLayout, gutter: bool) -> Result<Self, AtlasError> {
        let PartLayout { name, level, frame, places } = layout;
        let chart = |place: &Place| {
            let patch = &map.patches[place.patch];
            Chart::new(&image_name(patch, level), &patch.levels[level], level, place)
        };
        let charts = places.iter().map(chart).collect::<Result<_, _>>()?;
        let mut part = Self { name, level, frame, charts, gutter: Vec::new() };
        if gutter {
            part.gutter = part.find_gutter();
        }
        Ok(part)
    }

    /// Whether each pixel shows the skin: 1 or 0, row by row from the top.
    pub(crate) fn coverage(&self) -> Vec<u8> {
        let [width, height] = self.frame.size_px.map(|n| n as usize);
        let mut covered = vec![0; width * height];
        self.each_span(|start, span| covered[start..start + usize::from(span.length)].fill(1));
        covered
    }

    /// The taxel that each pixel shows, that of the largest weight: its vendor id, above level 0
    /// the index of the field in the level of its patch; `u32::MAX` where there is none.
    ///
    /// # Panics
    /// If `map` is not the one that was rasterised.
    pub(crate) fn taxel_ids(&self, map: &SkinMap) -> Vec<u32> {
        let [width, height] = self.frame.size_px.map(|n| n as usize);
        let mut ids = vec![u32::MAX; width * height];
        for chart in &self.charts {
            let patch = &map.patches[chart.patch];
            let level = &patch.levels[chart.level];
            let [left, top] = chart.corner_px.map(|n| n as usize);
            for row in 0..chart.frame.size_px[1] {
                let start = (top + row as usize) * width + left;
                chart.each_in_row(level, row, |column, face, weights| {
                    let nearest = level.level.mesh.triangles[face][largest(weights)];
                    let finest = chart.level == LevelId::default();
                    ids[start + column] = if finest { patch.taxels.ids[nearest].0 } else { nearest.raw() };
                });
            }
        }
        ids
    }

    /// Whether it has a chart of this patch.
    pub(crate) fn shows(&self, patch: PatchId) -> bool {
        self.charts.iter().any(|chart| chart.patch == patch)
    }

    /// The same image with the charts of those patches alone that `of` shows too.
    pub(crate) fn limited_to(&self, of: &Self) -> Cow<'_, Self> {
        let is_shown = |chart: &&Chart| of.shows(chart.patch);
        if self.charts.iter().all(|chart| is_shown(&chart)) {
            return Cow::Borrowed(self);
        }
        let charts = self.charts.iter().filter(is_shown).cloned().collect();
        Cow::Owned(Self { charts, name: self.name.clone(), gutter: Vec::new(), ..*self })
    }

    /// Calls `visit` for every span of every chart, with the index of its first pixel.
    fn each_span(&self, mut visit: impl FnMut(usize, &Span)) {
        let width = self.frame.size_px[0] as usize;
        for chart in &self.charts {
            let [left, top] = chart.corner_px.map(|n| n as usize);
            for row in 0..chart.frame.size_px[1] {
                let start = (top + row as usize) * width + left;
                chart.row(row).iter().for_each(|span| visit(start + usize::from(span.column), span));
            }
        }
    }

    /// Beside a covered pixel, above or below it, or else across a corner.
    fn find_gutter(&self) -> Vec<[u32; 2]> {
        const AROUND: [[i64; 2]; 8] = [[-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]];
        let covered = self.coverage();
        let [width, height] = self.frame.size_px.map(i64::from);
        let at = |x: i64, y: i64| usize::try_from(y * width + x).ok();
        let is_covered = |x: i64, y: i64| {
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            inside && at(x, y).is_some_and(|i| covered[i] == 1)
        };
        let rows: Vec<bool> =
            covered.chunks(self.frame.size_px[0] as usize).map(|r| r.contains(&1)).collect();
        let mut gutter = Vec::new();
        for (y, row) in (0_i64..).zip(0..rows.len()) {
            if !rows[row.saturating_sub(1)..rows.len().min(row + 2)].contains(&true) {
                continue;
            }
            for x in (0..width).filter(|&x| !is_covered(x, y)) {
                let source = AROUND.iter().map(|[dx, dy]| (x + dx, y + dy)).find(|&(x, y)| is_covered(x, y));
                let pixel = |(x, y)| at(x, y).and_then(|i| u32::try_from(i).ok());
                if let (Some(to), Some(from)) = (pixel((x, y)), source.and_then(pixel)) {
                    gutter.push([to, from]);
                }
            }
        }
        gutter
    }
}
