//! The channels of `map.exr`, filled from the chart of each level. The shading channel `Y` is a
//! *heuristic* for the eye, without a physical light; all others are measures or ids.

use std::{borrow::Cow, ops::Range};

use glam::DVec3;

use crate::{
    atlas::{
        AtlasError, AtlasPart, Chart, ImageRows, Samples, Stretch,
        bound::check_map,
        chart::largest,
        face_stretch,
        layout::{Place, image_name},
    },
    id::{FaceId, IdVec, VertexId},
    map::{ImageFrame, MapLevel, PatchMap, SkinMap},
    mesh::TriMesh,
    pyramid::LevelId,
    skin::PatchId,
};

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
/// | `taxel.id` | of the nearest corner: its vendor id, above level 0 its index | `u32::MAX` |
/// | `face.id` | index of the face in the level's mesh | `u32::MAX` |
/// | `bary.{U,V}` | weights of the face's second and third corner | 0 |
/// | `stretch.angle` | `s1/s2`, the ratio of the singular values of the map's Jacobian: 1 at a conformal map, negative if the face is mirrored, infinite if it is squeezed to a line | 0 |
/// | `stretch.area` | `s1 s2`, the area on the map over the area on the skin; infinite if the face has no area on the skin | 0 |
///
/// Where charts are packed into one image it shows all of them.
#[derive(Debug, Clone)]
pub struct LevelImage<'a> {
    name: String,
    frame: ImageFrame,
    tiles: Vec<(Surface<'a>, Cow<'a, Chart>)>,
}

/// What one level of a patch shows.
#[derive(Debug, Clone)]
struct Surface<'a> {
    patch: &'a PatchMap,
    level: &'a MapLevel,
    normals: IdVec<VertexId, DVec3>,
    finest: bool,
    light: DVec3,
}

impl<'a> Surface<'a> {
    fn new(patch: &'a PatchMap, level: LevelId) -> Self {
        let at = &patch.levels[level];
        let (normals, light) = (patch.normals(&at.level), light(&at.level.mesh));
        Self { patch, level: at, normals, finest: level == LevelId::default(), light }
    }

    /// The measures of one pixel, in the order of [`MEASURES`].
    fn measures(&self, face: FaceId, weights: [f64; 3], stretch: Stretch) -> [f64; 12] {
        let mesh = &self.level.level.mesh;
        let corners = mesh.triangles[face];
        let mix = |of: &dyn Fn(VertexId) -> DVec3| {
            corners.iter().zip(weights).map(|(&v, w)| w * of(v)).sum::<DVec3>()
        };
        let p = mix(&|v| mesh.positions[v]);
        let n = mix(&|v| self.normals[v]).normalize_or_zero();
        // Half-Lambert: what faces away is dim, not black.
        let shade = 0.5 + 0.5 * n.dot(self.light);
        let [_, u, v] = weights;
        [shade, 1.0, p.x, p.y, p.z, n.x, n.y, n.z, u, v, stretch.angle, stretch.area]
    }

    /// The ids of one pixel, in the order of [`IDS`].
    fn ids(&self, face: FaceId, weights: [f64; 3]) -> [u32; 2] {
        let nearest = self.level.level.mesh.triangles[face][largest(weights)];
        let id = if self.finest { self.patch.taxels.ids[nearest].0 } else { nearest.raw() };
        [id, face.raw()]
    }

    /// Fills a row of the chart, whose first pixel has the index `start`.
    fn fill(
        &self,
        chart: &Chart,
        row: u32,
        start: usize,
        (measures, ids): (&mut [Vec<f32>; 12], &mut [Vec<u32>; 2]),
    ) {
        let mut current: Option<(FaceId, Stretch)> = None;
        chart.each_in_row(self.level, row, |column, face, weights| {
            let stretch = match current {
                Some((of, stretch)) if of == face => stretch,
                _ => face_stretch(self.level, face),
            };
            current = Some((face, stretch));
            let at = start + column;
            for (samples, value) in measures.iter_mut().zip(self.measures(face, weights, stretch)) {
                samples[at] = narrow(value);
            }
            for (samples, id) in ids.iter_mut().zip(self.ids(face, weights)) {
                samples[at] = id;
            }
        });
    }
}

impl<'a> LevelImage<'a> {
    /// Rasterises a level of a map that is known to be valid.
    fn new(patch: (PatchId, &'a PatchMap), level: LevelId) -> Result<Self, AtlasError> {
        let ((id, patch), at) = (patch, &patch.1.levels[level]);
        let name = image_name(patch, level);
        let place = Place { patch: id, turns: 0, frame: at.frame, corner_px: [0, 0] };
        let chart = Chart::new(&name, at, level, &place)?;
        let frame = chart.frame;
        Ok(Self { name, frame, tiles: vec![(Surface::new(patch, level), Cow::Owned(chart))] })
    }

    /// What the pixels of an image of an atlas show, of those patches alone that `of` shows too.
    pub(crate) fn of_part(map: &'a SkinMap, part: &'a AtlasPart, of: &AtlasPart) -> Self {
        let tile =
            |chart: &'a Chart| (Surface::new(&map.patches[chart.patch], chart.level), Cow::Borrowed(chart));
        let charts = part.charts.iter().filter(|chart| of.shows(chart.patch));
        Self { name: of.name.clone(), frame: part.frame, tiles: charts.map(tile).collect() }
    }
}

impl ImageRows for LevelImage<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame(&self) -> &ImageFrame {
        &self.frame
    }

    fn channels(&self) -> Vec<String> {
        MEASURES.into_iter().chain(IDS).map(str::to_owned).collect()
    }

    fn rows(&self, rows: Range<u32>) -> Vec<Samples> {
        let width = self.frame.size_px[0] as usize;
        let count = width * rows.len();
        let mut measures = MEASURES.map(|_| vec![0.0_f32; count]);
        let mut ids = IDS.map(|_| vec![u32::MAX; count]);
        for (surface, chart) in &self.tiles {
            let [left, top] = chart.corner_px;
            for (start, row) in (0..).step_by(width).zip(rows.clone()) {
                let inside = row.checked_sub(top).filter(|&row| row < chart.frame.size_px[1]);
                if let Some(row) = inside {
                    surface.fill(chart, row, start + left as usize, (&mut measures, &mut ids));
                }
            }
        }
        measures.into_iter().map(Samples::F32).chain(ids.into_iter().map(Samples::U32)).collect()
    }
}

/// Images are 32-bit floats.
#[expect(clippy::cast_possible_truncation, reason = "EXR stores f32")]
fn narrow(x: f64) -> f32 {
    x as f32
}

/// Direction the light comes from: where the mesh faces on the whole, or up if it faces everywhere.
fn light(mesh: &TriMesh) -> DVec3 {
    let sum: DVec3 = mesh.triangles.ids().map(|f| mesh.face_cross(f)).sum();
    sum.try_normalize().unwrap_or(DVec3::Z)
}

/// The images of every level of every patch, rasterised but not yet filled: patch by patch, finest
/// level first.
///
/// # Errors
/// If the map breaks a rule of [`SkinMap::validate`], if an image would be larger than 16384 pixels
/// a side or all together than 4096 pixels a taxel (at least `2^20`, at most `2^26`), or if a map
/// does not lie in its frame.
pub fn skin_images(map: &SkinMap) -> Result<Vec<LevelImage<'_>>, AtlasError> {
    map.validate()?;
    check_map(map, (MEASURES.len() + IDS.len()) as u64)?;
    let all = map.patches.enumerate().flat_map(|patch| patch.1.levels.ids().map(move |level| (patch, level)));
    all.map(|(patch, level)| LevelImage::new(patch, level)).collect()
}
