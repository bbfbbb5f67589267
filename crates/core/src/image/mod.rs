//! Values on pixels: tactile images from frames through an atlas.
//!
//! A pixel is a weighted sum of the values at the corners of the face that it shows, with its barycentric
//! weights. Where a corner has no value, the weights of the others are scaled to the sum 1. Without any the
//! pixel is NaN. The sum is a plane over each face, so a frame costs one plane for each face and then
//! one addition and one multiplication for each pixel. A frame is always drawn whole: where something
//! touches a real skin, most readings change in every frame.
//!
//! Intensive channels keep their values: a constant pressure is a constant image. Extensive channels
//! are drawn per area and keep their total: with the weights `w` of the pixels, each of area `A`,
//! the amount `f` of a vertex is drawn as `f / (A sum w)`, so the covered pixels times `A` add up to
//! the sum of all amounts, whatever the size of the pixels. An amount that no pixel shows is given
//! to the nearest one.

mod batch;
mod face_weights;
mod layer;
mod runs;
mod surface;

use crate::atlas::{Atlas, AtlasPart, Chart};
use crate::id::VertexId;
use crate::image::layer::Layer;
use crate::image::surface::PixelSurface;
use crate::map::{ImageFrame, MapError, SkinMap};
use crate::pyramid::LevelId;
use crate::signal::{Channel, LevelFrame, Quantity};
use crate::skin::PatchId;

pub use batch::BatchRenderer;

/// One frame of one image of an atlas.
#[derive(Debug, Clone, PartialEq)]
pub struct TactileImage {
    /// `palm/L0`, or `L0` where charts are packed.
    pub name: String,
    /// The level whose values it shows; of a patch without it, the coarsest.
    pub level: LevelId,
    /// The rectangle of the map that it shows, and its size in pixels, from which the area of a pixel follows.
    pub frame: ImageFrame,
    /// Number of channels.
    pub channels: usize,
    /// The values, channel by channel, each row by row from the top: NaN where nothing is known.
    /// Intensive channels in their unit, extensive ones in their unit per m^2 of the map.
    pub values: Vec<f32>,
    /// Whether each pixel shows the skin: 1 or 0, row by row from the top. Others are NaN in every
    /// channel, so the sum of the values times the area of a pixel is the amount of an extensive one.
    pub coverage: Vec<u8>,
}

/// Draws frames of values into images.
///
/// After the first frame it allocates nothing unless the set of taxels with readings changes. What it draws
/// does not depend on the frames before; channels of which no value changed keep their pixels. One thread.
///
/// ```
/// use dermatome::{
///     atlas::{Atlas, AtlasOptions},
///     image::Renderer,
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, Frame, Restrictor},
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let atlas = Atlas::new(&map, &AtlasOptions::default())?;
/// let channels = [Channel::default()];
/// let mut restrictor = Restrictor::new(&map, &channels);
/// let mut renderer = Renderer::new(&map, &atlas, &channels, None)?;
///
/// let mut frame = Frame::new(&map, channels.len());
/// for value in frame.values.iter_mut().flatten().flat_map(|channel| channel.iter_mut()) {
///     *value = 2.5;
/// }
/// let images = renderer.render(restrictor.restrict(&frame));
/// assert_eq!(images[0].name, "skin/L0");
/// for (value, covered) in images[0].values.iter().zip(&images[0].coverage) {
///     assert!(if *covered == 1 { (value - 2.5).abs() < 1e-6 } else { value.is_nan() });
/// }
/// # Ok::<(), dermatome::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Renderer {
    quantities: Vec<Quantity>,
    /// Of every image.
    tiles: Vec<Vec<Tile>>,
    images: Vec<TactileImage>,
}

#[derive(Debug, Clone)]
struct Tile {
    patch: PatchId,
    level: LevelId,
    surface: PixelSurface,
    /// One for each channel.
    layers: Vec<Layer>,
}

impl Renderer {
    /// A renderer of frames with these channels into the images of `atlas`, which is of `map`: of all levels,
    /// or of one.
    ///
    /// # Errors
    /// If the map breaks a rule of [`SkinMap::validate`], the atlas was made of another one, there
    /// is no such level, or a patch has no area on the map and an extensive channel has to be drawn on it.
    pub fn new(
        map: &SkinMap,
        atlas: &Atlas,
        channels: &[Channel],
        level: Option<LevelId>,
    ) -> Result<Self, ImageError> {
        map.validate()?;
        let last = atlas.parts.iter().map(|part| part.level).max().unwrap_or_default();
        if let Some(level) = level.filter(|&level| level > last) {
            return Err(ImageError::Level { level, last });
        }
        let quantities: Vec<_> = channels.iter().map(|channel| channel.quantity).collect();
        let (mut tiles, mut images) = (Vec::new(), Vec::new());
        for part in atlas.parts.iter().filter(|part| level.is_none_or(|level| part.level == level)) {
            let charts = part.charts.iter();
            let of_part: Vec<_> =
                charts.map(|chart| Tile::new(map, part, chart, &quantities)).collect::<Result<_, _>>()?;
            images.push(blank(part, &of_part, quantities.len()));
            tiles.push(of_part);
        }
        Ok(Self { quantities, tiles, images })
    }

    /// Draws a frame: the images in the order of the atlas.
    ///
    /// # Panics
    /// If the frame does not have the patches, channels, levels and vertices of the map.
    pub fn render(&mut self, frame: &LevelFrame) -> &[TactileImage] {
        for (tiles, image) in self.tiles.iter_mut().zip(&mut self.images) {
            let count = image.coverage.len();
            for Tile { patch, level, surface, layers } in tiles {
                let values = &frame.values[*patch];
                assert_eq!(values.len(), self.quantities.len(), "one entry per channel");
                for (channel, (layer, values)) in layers.iter_mut().zip(values).enumerate() {
                    let pixels = &mut image.values[channel * count..(channel + 1) * count];
                    layer.draw(surface, &values[*level], pixels);
                }
            }
        }
        &self.images
    }

    /// The matrix that draws a channel of this quantity where vertices have a value as `is_live` says: calls `visit`
    /// with each pixel of an image that shows one, its patch, its index (row by row from the top), and the vertices
    /// of the level with their weights. Those of an extensive channel are in 1/m^2, and a pixel that gets an amount
    /// that no pixel shows is visited once more with it.
    ///
    /// # Panics
    /// If there is no such image.
    pub fn each_pixel(
        &self,
        image: usize,
        quantity: Quantity,
        is_live: impl Fn(PatchId, VertexId) -> bool,
        mut visit: impl FnMut(PatchId, u32, &[(u32, f64)]),
    ) {
        for Tile { patch, surface, .. } in &self.tiles[image] {
            let live = (0..surface.vertices).map(|v| is_live(*patch, VertexId::new(v))).collect();
            let layer = Layer::of_mask(surface, quantity, live);
            layer.each_row(surface, |pixel, row| visit(*patch, pixel, row));
        }
    }

    /// The pixel of an image that gets the amount of a vertex that no pixel shows; `None` where no pixel shows its patch.
    ///
    /// # Panics
    /// If there is no such image.
    pub fn nearest_pixel(&self, image: usize, patch: PatchId, vertex: VertexId) -> Option<u32> {
        let tile = self.tiles[image].iter().find(|tile| tile.patch == patch)?;
        tile.surface.nearest_pixel(vertex)
    }

    /// The images as they were drawn last; before the first frame they are all NaN.
    pub fn images(&self) -> &[TactileImage] {
        &self.images
    }
}

impl Tile {
    fn new(
        map: &SkinMap,
        part: &AtlasPart,
        chart: &Chart,
        quantities: &[Quantity],
    ) -> Result<Self, ImageError> {
        let foreign = || ImageError::Atlas { part: part.name.clone() };
        let patch = map.patches.get(chart.patch).ok_or_else(foreign)?;
        let level = patch.levels.get(chart.level).filter(|level| chart.fits(level)).ok_or_else(foreign)?;
        if quantities.contains(&Quantity::Extensive) && chart.covered() == 0 {
            return Err(ImageError::NoPixel { part: part.name.clone(), patch: patch.name.clone() });
        }
        let ImageFrame { size, size_px, .. } = part.frame;
        let area = size.x * size.y / size_px.map(f64::from).iter().product::<f64>();
        let surface = PixelSurface::new(chart, level, size_px[0] as usize, area);
        let layers = quantities.iter().map(|&quantity| Layer::new(&surface, quantity)).collect();
        Ok(Self { patch: chart.patch, level: chart.level, surface, layers })
    }
}

/// An image before its first frame.
fn blank(part: &AtlasPart, tiles: &[Tile], channels: usize) -> TactileImage {
    let count = part.frame.size_px.map(|n| n as usize).iter().product();
    let mut coverage = vec![0; count];
    for run in tiles.iter().flat_map(|tile| &tile.surface.runs.all) {
        coverage[run.at as usize..][..usize::from(run.length)].fill(1);
    }
    TactileImage {
        name: part.name.clone(),
        level: part.level,
        frame: part.frame,
        channels,
        values: vec![f32::NAN; channels * count],
        coverage,
    }
}

/// Why values and pixels do not fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum ImageError {
    #[error(transparent)]
    Map(#[from] MapError),
    #[error("image {part} of the atlas shows a patch, a level or a face that the map does not have")]
    Atlas { part: String },
    #[error("no image shows level {level}; the levels are 0 to {last}")]
    Level { level: LevelId, last: LevelId },
    #[error(
        "no pixel of image {part} shows patch {patch}, which has no area there: its amounts cannot be kept"
    )]
    NoPixel { part: String, patch: String },
}
