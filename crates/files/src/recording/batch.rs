//! Many frames of readings that are in the order of a map, on all threads: the values of a level, or images of it.

use rayon::prelude::*;

use crate::image::{BatchRenderer, Renderer};
use crate::map::{PatchMap, SkinMap};
use crate::numeric::narrow;
use crate::pyramid::LevelId;
use crate::recording::Carried;
use crate::recording::levels::Levels;
use crate::signal::{Channel, Duplicates, Frame, Join, JoinReport, LevelFrame, SignalError};
use crate::skin::TaxelId;

/// Carries frames of readings to a level and draws them: what [`Recording`](crate::recording::Recording) does with frames of
/// which none depends on another, in any order.
///
/// A frame has its readings channel by channel, in the order of the map. Taxels that are not present have none.
///
/// ```
/// use dermatome::map::SkinMap;
/// use dermatome::mesh::shapes;
/// use dermatome::pyramid::LevelId;
/// use dermatome::recording::{Batch, Carried};
/// use dermatome::signal::Channel;
///
/// let map = SkinMap::flat(shapes::lattice(4, 3, 0.004), 1e-3);
/// let batch = Batch::new(&map, &[Channel::default()], Carried::Values, Some(LevelId::new(0)))?;
/// let mut fields = vec![0.0; 5 * 12];
/// batch.pool(&map, LevelId::new(0), &[2.5; 5 * 12], &mut fields, || ());
/// assert!(fields.iter().all(|&x| x == 2.5));
/// # Ok::<(), dermatome::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Batch {
    join: Join,
    levels: Levels,
    frame: Frame,
    width: usize,
}

/// How images are laid out in a batch.
#[derive(Debug, Clone, Copy)]
pub struct BatchImages {
    /// Frames of one image, one after the other: an image has the channels of all of them.
    pub parts: usize,
    /// What is drawn where nothing is known.
    pub fill: f32,
    /// Whether an image has a channel more, the last: 1 where all others are known, 0 elsewhere.
    pub has_mask: bool,
}

impl Batch {
    /// For frames with these channels; of levels above 0 for `level` alone, if there is one.
    ///
    /// # Errors
    /// If the map has no taxel.
    pub fn new(
        map: &SkinMap,
        channels: &[Channel],
        carried: Carried,
        level: Option<LevelId>,
    ) -> Result<Self, SignalError> {
        let taxels = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let mut join = Join::new(map, None, taxels, Duplicates::Refuse)?;
        join.follow(map, channels);
        Ok(Self {
            join,
            levels: Levels::new(map, channels, carried, level),
            frame: Frame::new(map, channels.len()),
            width: channels.len() * taxels,
        })
    }

    /// A frame on all levels.
    ///
    /// # Panics
    /// If it has not a reading for each channel and taxel.
    pub fn levels<T: Copy + Into<f64>>(&mut self, values: &[T]) -> &LevelFrame {
        self.join.fill(values, &mut self.frame);
        let [levels, _] = self.levels.of(&self.frame);
        levels
    }

    /// The values of a level in the first channel of each frame, patch after patch; patches without the level have those
    /// of their coarsest. `check` is called for each frame, and may unwind.
    ///
    /// # Panics
    /// If `pooled` has not the fields of the level for each frame.
    pub fn pool(
        &self,
        map: &SkinMap,
        level: LevelId,
        values: &[f64],
        pooled: &mut [f32],
        check: impl Fn() + Sync,
    ) {
        let on_level = |patch: &PatchMap| patch.nearest_level(level);
        let fields = map.patches.iter().map(|patch| patch.levels[on_level(patch)].level.mesh.positions.len());
        let fields: usize = fields.sum();
        if pooled.is_empty() {
            return;
        }
        let share = (pooled.len() / fields).div_ceil(4 * rayon::current_num_threads());
        let shares = pooled.par_chunks_mut(share * fields).zip(values.par_chunks(share * self.width));
        shares.for_each_init(
            || self.clone(),
            |batch, (out, values)| {
                for (out, values) in out.chunks_mut(fields).zip(values.chunks(batch.width)) {
                    check();
                    let mut out = out.iter_mut();
                    for (channels, patch) in batch.levels(values).values.iter().zip(&map.patches) {
                        let of_level = channels[0][on_level(patch)].iter();
                        out.by_ref().zip(of_level).for_each(|(out, &value)| *out = narrow(value));
                    }
                }
            },
        );
    }

    /// Draws frames into the first image of a renderer, as [`BatchImages`] says. `check` is called for each frame, and may
    /// unwind.
    ///
    /// # Panics
    /// If the renderer is of another map, other channels or another level, or the images have another size.
    pub fn draw<T: Copy + Into<f64> + Sync>(
        &self,
        renderer: &Renderer,
        values: &[T],
        images: &mut [f32],
        BatchImages { parts, fill, has_mask }: BatchImages,
        check: impl Fn() + Sync,
    ) {
        let image = &renderer.images()[0];
        let (pixels, drawn) = (image.coverage.len(), parts * image.values.len());
        let size = drawn + if has_mask { pixels } else { 0 };
        if images.is_empty() || parts == 0 {
            return;
        }
        let (width, known) = (self.width, |x: f32| if x.is_nan() { fill } else { x });
        let share = (images.len() / size).div_ceil(4 * rayon::current_num_threads()).max(1);
        images.par_chunks_mut(share * size).zip(values.par_chunks(share * parts * width)).for_each_init(
            || {
                let restrictor = self.levels.restrictor.clone();
                (BatchRenderer::new(restrictor, renderer.clone(), self.frame.clone()), Vec::new())
            },
            |(batch, bare), (images, values)| {
                let read = |k: usize, frame: &mut Frame| {
                    check();
                    self.join.fill(&values[k * width..(k + 1) * width], frame);
                };
                if !has_mask {
                    batch.render(read, images);
                    if !fill.is_nan() {
                        images.iter_mut().for_each(|x| *x = known(*x));
                    }
                    return;
                }
                bare.resize(images.len() / size * drawn, 0.0);
                batch.render(read, bare);
                for (image, bare) in images.chunks_mut(size).zip(bare.chunks(drawn)) {
                    let (image, mask) = image.split_at_mut(drawn);
                    image.iter_mut().zip(bare).for_each(|(x, &bare)| *x = known(bare));
                    for (pixel, is_known) in mask.iter_mut().enumerate() {
                        let all = bare.iter().skip(pixel).step_by(pixels).all(|x| !x.is_nan());
                        *is_known = f32::from(u8::from(all));
                    }
                }
            },
        );
    }
}

/// Readings of columns with these ids in the order of a map: frame after frame, and in each channel after channel, as
/// [`Join::follow`] has them; and how they fit. `check` is called for each frame, and may unwind.
///
/// # Errors
/// If no column is of a taxel of the map, or two are of one.
///
/// # Panics
/// If there is not a number for each channel and column.
pub fn in_order(
    map: &SkinMap,
    ids: &[TaxelId],
    channels: &[Channel],
    values: &[f64],
    check: impl Fn(),
) -> Result<(Vec<f64>, JoinReport), SignalError> {
    let mut join = Join::new(map, Some(ids), ids.len(), Duplicates::Refuse)?;
    join.follow(map, channels);
    let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let frames = values.chunks_exact((ids.len() * channels.len()).max(1));
    let mut joined = Vec::with_capacity(frames.len() * channels.len() * taxels);
    let mut frame = Frame::new(map, channels.len());
    for values in frames {
        check();
        join.fill(values, &mut frame);
        for channel in 0..channels.len() {
            joined.extend(frame.values.iter().flat_map(|channels| channels[channel].iter()));
        }
    }
    Ok((joined, join.report().clone()))
}
