//! Draws frames: work grows with the taxels that changed.

use crate::{
    atlas::{Atlas, AtlasPart, Chart, LevelImage},
    image::{
        ImageError, Interpolation, RenderOptions, TactileImage,
        direction::{ChannelLayer, DirectionPixels},
        tile::{Gutter, Tile},
        weights::surface::Surface,
    },
    map::SkinMap,
    pyramid::LevelId,
    signal::{Channel, LevelFrame, Quantity},
    skin::PatchId,
};

/// Draws frames of values into images.
///
/// It owns its buffers: after the first frame it allocates nothing unless taxels come or go. It
/// draws only what changed since the frame before, and what it draws does not depend on the frames
/// before. One thread.
///
/// ```
/// use dermatome::{
///     atlas::{Atlas, AtlasOptions},
///     image::{RenderOptions, Renderer},
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, Frame, Restrictor},
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let atlas = Atlas::new(&map, &AtlasOptions::default())?;
/// let channels = [Channel::default()];
/// let mut restrictor = Restrictor::new(&map, &channels);
/// let mut renderer = Renderer::new(&map, &atlas, &channels, &RenderOptions::default())?;
///
/// let mut frame = Frame::new(&map, channels.len());
/// for value in frame.values.iter_mut().flatten().flat_map(|channel| channel.iter_mut()) {
///     *value = 2.5;
/// }
/// let images = renderer.render(restrictor.restrict(&frame));
/// assert_eq!(images[0].name, "skin/L0");
/// assert!(images[0].values.iter().any(|x| x.is_nan()), "the margin");
/// let covered = images[0].values.iter().zip(&images[0].coverage).filter(|(_, covered)| **covered == 1);
/// assert!(covered.into_iter().all(|(value, _)| (value - 2.5).abs() < 1e-6));
/// # Ok::<(), dermatome::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Renderer<'a> {
    pub(super) map: &'a SkinMap,
    pub(super) quantities: Vec<Quantity>,
    pub(super) canvases: Vec<Canvas<'a>>,
    images: Vec<TactileImage>,
}

/// What is drawn into one image.
#[derive(Debug, Clone)]
pub(super) struct Canvas<'a> {
    pub(super) tiles: Vec<(PatchId, Tile<'a>)>,
    /// Of every tile, one for each channel.
    layers: Vec<Vec<ChannelLayer>>,
    /// Of every channel.
    directions: Vec<DirectionPixels>,
}

impl<'a> Renderer<'a> {
    /// A renderer of frames with these channels into the images of `atlas`, which is of `map`.
    ///
    /// # Errors
    /// If the map breaks a rule of [`SkinMap::validate`], the atlas was made of another one, there
    /// is no such level, or a patch covers no pixel and an extensive channel has to be drawn on it.
    pub fn new(
        map: &'a SkinMap,
        atlas: &'a Atlas,
        channels: &[Channel],
        options: &RenderOptions,
    ) -> Result<Self, ImageError> {
        map.validate()?;
        let last = atlas.parts.iter().map(|part| part.level).max().unwrap_or_default();
        if let Some(level) = options.level.filter(|&level| level > last) {
            return Err(ImageError::Level { level, last });
        }
        let quantities: Vec<_> = channels.iter().map(|channel| channel.quantity).collect();
        let (mut canvases, mut images) = (Vec::new(), Vec::new());
        for part in atlas.parts.iter().filter(|part| options.level.is_none_or(|level| part.level == level)) {
            let (canvas, image) = Canvas::new(map, atlas, part, &quantities, options.interpolation)?;
            canvases.push(canvas);
            images.push(image);
        }
        Ok(Self { map, quantities, canvases, images })
    }

    /// Draws a frame: the images in the order of the atlas.
    ///
    /// # Panics
    /// If the frame has not the patches, channels, levels and vertices of the map.
    pub fn render(&mut self, frame: &LevelFrame) -> &[TactileImage] {
        for (canvas, image) in self.canvases.iter_mut().zip(&mut self.images) {
            let count = image.coverage.len();
            for channel in 0..self.quantities.len() {
                let pixels = &mut image.values[channel * count..(channel + 1) * count];
                canvas.draw(frame, image.level, channel, pixels);
            }
        }
        &self.images
    }

    /// The images as they were drawn last; before the first frame they hold nothing but NaN.
    #[must_use]
    pub fn images(&self) -> &[TactileImage] {
        &self.images
    }
}

impl<'a> Canvas<'a> {
    fn new(
        map: &'a SkinMap,
        atlas: &'a Atlas,
        part: &'a AtlasPart,
        quantities: &[Quantity],
        interpolation: Interpolation,
    ) -> Result<(Self, TactileImage), ImageError> {
        let foreign = || ImageError::Atlas { part: part.name.clone() };
        let surface = surface_of(atlas, part, interpolation).ok_or_else(foreign)?;
        let width = surface.frame.size_px[0] as usize;
        let area = surface.frame.size.x * surface.frame.size.y
            / surface.frame.size_px.map(f64::from).iter().product::<f64>();
        let mut tiles = Vec::new();
        for Chart { patch: id, level, .. } in &part.charts {
            let chart = surface.charts.iter().find(|chart| chart.patch == *id).ok_or_else(foreign)?;
            let patch = map.patches.get(*id).ok_or_else(foreign)?;
            let shown = patch.levels.get(chart.level).ok_or_else(foreign)?;
            let values = &patch.levels.get(*level).ok_or_else(foreign)?.level;
            if !chart.fits(shown) {
                return Err(foreign());
            }
            if quantities.contains(&Quantity::Extensive) && chart.covered == 0 {
                return Err(ImageError::NoPixel { part: part.name.clone(), patch: patch.name.clone() });
            }
            let lift = if interpolation == Interpolation::Field { values.to_finest.as_ref() } else { None };
            let lift = lift.map(|prolongation| (values, prolongation));
            let tile = Tile::new(Surface::new(chart, shown, width), interpolation, lift, area);
            tiles.push((*id, tile));
        }
        let image = blank(surface, part, &tiles, quantities.len());
        add_gutters(&surface.gutter, &mut tiles, image.coverage.len());
        let layers =
            tiles.iter().map(|(_, tile)| quantities.iter().map(|&q| ChannelLayer::new(tile, q)).collect());
        let directions = quantities.iter().map(|quantity| match quantity {
            Quantity::Direction => [0, 1].map(|_| vec![f32::NAN; image.coverage.len()]),
            Quantity::Intensive | Quantity::Extensive => DirectionPixels::default(),
        });
        Ok((Self { layers: layers.collect(), directions: directions.collect(), tiles }, image))
    }

    fn draw(&mut self, frame: &LevelFrame, level: LevelId, channel: usize, pixels: &mut [f32]) {
        for ((patch, tile), layers) in self.tiles.iter().zip(&mut self.layers) {
            let values = &frame.values[*patch][channel][level];
            layers[channel].draw(tile, values, &mut self.directions[channel], pixels);
        }
    }
}

/// Gives the pixels of the gutter of an image of `count` pixels to the tiles whose pixels they repeat.
fn add_gutters(gutter: &[[u32; 2]], tiles: &mut [(PatchId, Tile<'_>)], count: usize) {
    let mut face_of = vec![u32::MAX; count];
    for (_, tile) in tiles {
        let runs = &tile.surface.runs.all;
        let pixels = |at: u32, length: u16| at as usize..at as usize + usize::from(length);
        runs.iter().for_each(|run| face_of[pixels(run.at, run.length)].fill(run.source));
        let of_tile = gutter.iter().map(|&[to, from]| (face_of[from as usize], [to, from]));
        let of_tile = of_tile.filter(|(face, _)| *face != u32::MAX);
        let of_tile = of_tile.map(|(face, pair)| (face as usize, pair)).collect();
        tile.gutter = Gutter::new(tile.surface.faces.len(), of_tile);
        runs.iter().for_each(|run| face_of[pixels(run.at, run.length)].fill(u32::MAX));
    }
}

/// What the pixels of each image of a [`Renderer`] with these options show, in its order: places,
/// normals, ids and stretch.
///
/// ```
/// use dermatome::{
///     atlas::{Atlas, AtlasOptions, ImageRows},
///     image::{RenderOptions, static_images},
///     map::SkinMap,
///     mesh::shapes,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let atlas = Atlas::new(&map, &AtlasOptions::default())?;
/// let images = static_images(&map, &atlas, &RenderOptions::default());
/// assert_eq!(images[0].frame(), &atlas.parts[0].frame);
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Panics
/// If the atlas was made of another map.
#[must_use]
pub fn static_images<'a>(map: &'a SkinMap, atlas: &'a Atlas, options: &RenderOptions) -> Vec<LevelImage<'a>> {
    let parts = atlas.parts.iter().filter(|part| options.level.is_none_or(|level| part.level == level));
    let shown = |part| Some(LevelImage::of_part(map, surface_of(atlas, part, options.interpolation)?, part));
    parts.filter_map(shown).collect()
}

/// An image before its first frame.
fn blank(
    surface: &AtlasPart,
    part: &AtlasPart,
    tiles: &[(PatchId, Tile<'_>)],
    channels: usize,
) -> TactileImage {
    let size_px = surface.frame.size_px;
    let count = size_px.map(|n| n as usize).iter().product();
    let mut coverage = vec![0; count];
    for run in tiles.iter().flat_map(|(_, tile)| &tile.surface.runs.all) {
        coverage[run.at as usize..][..usize::from(run.length)].fill(1);
    }
    TactileImage {
        name: part.name.clone(),
        level: part.level,
        size_px,
        frame: surface.frame,
        channels,
        values: vec![f32::NAN; channels * count],
        coverage,
    }
}

/// The image whose pixels show `part`: where fields are drawn on the map of level 0, that of level 0.
pub(crate) fn surface_of<'a>(
    atlas: &'a Atlas,
    part: &'a AtlasPart,
    interpolation: Interpolation,
) -> Option<&'a AtlasPart> {
    let patch = part.charts.first()?.patch;
    match interpolation {
        Interpolation::Field => {
            atlas.parts.iter().find(|other| other.level == LevelId::default() && other.shows(patch))
        }
        _ => Some(part),
    }
}
