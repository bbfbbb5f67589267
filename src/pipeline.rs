//! The whole flow as one short function: skin in, maps out.

use std::{
    sync::atomic::{AtomicUsize, Ordering},
    time::Instant,
};

use rayon::prelude::*;

use crate::{
    Error,
    flatten::{FlattenOptions, flatten_pyramid},
    map::{PatchMap, SkinMap},
    pyramid::{CoarsenOptions, coarsen},
    skin::Skin,
};

/// Options of [`build`].
#[derive(Debug, Clone, PartialEq)]
pub struct BuildOptions {
    /// How to coarsen.
    pub coarsen: CoarsenOptions,
    /// How to flatten.
    pub flatten: FlattenOptions,
    /// Side of a pixel of the images, in m.
    pub pixel: f64,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self { coarsen: CoarsenOptions::default(), flatten: FlattenOptions::default(), pixel: 1e-3 }
    }
}

/// What [`build`] is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Making the pyramids.
    Coarsen,
    /// Making the maps of every level.
    Flatten,
}

/// Told how many patches of a stage are done, and of how many.
pub type Watch<'a> = dyn Fn(Stage, usize, usize) + Sync + 'a;

/// Wall-clock seconds of the stages of [`build`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Seconds {
    /// Making the pyramids.
    pub coarsen: f64,
    /// Making the maps.
    pub flatten: f64,
}

/// Coarsens and flattens every patch of a skin.
///
/// # Errors
/// The first patch, in their order, that is no oriented manifold or no disk with holes.
pub fn build(skin: &Skin, options: &BuildOptions, watch: &Watch<'_>) -> Result<(SkinMap, Seconds), Error> {
    let patches = skin.patches.as_slice();
    let mut seconds = Seconds::default();

    let start = Instant::now();
    let done = Counter::new(Stage::Coarsen, patches.len(), watch);
    let pyramids: Vec<_> = patches
        .par_iter()
        .map(|patch| {
            let pyramid = coarsen(&patch.mesh, &patch.taxels, &options.coarsen)
                .map_err(|e| Error::from(e).in_patch(&patch.name));
            done.step();
            pyramid
        })
        .collect();
    let pyramids = pyramids.into_iter().collect::<Result<Vec<_>, _>>()?;
    seconds.coarsen = start.elapsed().as_secs_f64();

    let start = Instant::now();
    let done = Counter::new(Stage::Flatten, patches.len(), watch);
    let maps: Vec<_> = patches
        .par_iter()
        .zip(pyramids)
        .map(|(patch, pyramid)| {
            let flat = flatten_pyramid(&pyramid, patch.taxels.densities.as_ref(), &options.flatten)
                .map_err(|e| Error::from(e).in_patch(&patch.name))?;
            let map = PatchMap::new(patch, pyramid, flat, options.pixel);
            done.step();
            Ok::<_, Error>(map)
        })
        .collect();
    let maps = maps.into_iter().collect::<Result<Vec<_>, _>>()?;
    seconds.flatten = start.elapsed().as_secs_f64();

    Ok((SkinMap { links: skin.links.clone(), patches: maps.into() }, seconds))
}

/// Counts finished patches from any thread.
struct Counter<'a> {
    stage: Stage,
    total: usize,
    done: AtomicUsize,
    watch: &'a Watch<'a>,
}

impl<'a> Counter<'a> {
    fn new(stage: Stage, total: usize, watch: &'a Watch<'a>) -> Self {
        watch(stage, 0, total);
        Self { stage, total, done: AtomicUsize::new(0), watch }
    }

    fn step(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.watch)(self.stage, done, self.total);
    }
}
