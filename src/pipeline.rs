//! The whole flow, from a skin to the files of its map.
//!
//! 1. [`build`] coarsens every patch into a pyramid ([`coarsen`](crate::pyramid::coarsen())), maps
//!    every level of it to the plane ([`flatten_pyramid`](crate::flatten::flatten_pyramid)) and returns the [`SkinMap`].
//! 2. [`write_files`] rasterises the levels ([`skin_images`]) and writes `map.glb` and `map.exr`.
//!
//! Patches are independent: they are built in parallel, and the result does not depend on the
//! number of threads. Before it, [`read_draft`](crate::io::read_draft) and
//! [`assemble`](crate::skin::assemble()) make the skin; after it,
//! [`measure`](crate::report::measure) says how faithful the map is.
//!
//! ```
//! use dermatome::{mesh::shapes, pipeline, skin::Skin};
//!
//! let skin = Skin::from_mesh("cap", shapes::cap(500, 0.1, 0.6));
//! let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
//! assert!(map.patches.iter().all(|patch| patch.levels.len() > 1));
//! # Ok::<_, dermatome::Error>(())
//! ```

use std::{
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
    time::Instant,
};

use rayon::prelude::*;

use crate::{
    Error,
    atlas::skin_images,
    flatten::{FlattenOptions, flatten_pyramid_with_convergence},
    io::{write_images, write_map},
    map::{PatchMap, SkinMap},
    pyramid::{CoarsenOptions, coarsen},
    report::Seconds,
    skin::{Patch, Skin, named_links},
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

/// A step of the flow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Making the pyramids.
    Coarsen,
    /// Making the maps of every level.
    Flatten,
    /// Making the images.
    Rasterise,
    /// Writing the map and the images.
    Write,
}

/// How far a stage is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// Patches that are done.
    pub done: usize,
    /// Patches in all.
    pub total: usize,
}

/// Coarsens and flattens every patch of a skin.
///
/// # Errors
/// The first patch, in their order, that is not an oriented manifold or not a disk with holes.
pub fn build(skin: &Skin, options: &BuildOptions) -> Result<SkinMap, Error> {
    build_with_progress(skin, options, &|_| ()).map(|(map, _)| map)
}

/// The same as [`build`], with the time that its stages took; `progress` is called from any thread
/// at the start of a stage and after each patch.
///
/// # Errors
/// As [`build`].
pub fn build_with_progress(
    skin: &Skin,
    options: &BuildOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<(SkinMap, Seconds), Error> {
    let start = Instant::now();
    let patches: Vec<&Patch> = skin.patches.iter().collect();
    let pyramids = each_patch(Stage::Coarsen, patches, progress, |patch| {
        coarsen(&patch.mesh, &patch.taxels, &options.coarsen)
            .map_err(|e| Error::from(e).in_patch(&patch.name))
    })?;
    let coarsened = start.elapsed();
    // Every pyramid is taken once, by the thread that maps it.
    let jobs: Vec<_> = skin.patches.iter().zip(pyramids).collect();
    let maps = each_patch(Stage::Flatten, jobs, progress, |(patch, pyramid)| {
        let densities = patch.taxels.densities.as_ref();
        let maps = flatten_pyramid_with_convergence(&pyramid, densities, &options.flatten)
            .map_err(|e| Error::from(e).in_patch(&patch.name))?;
        let (maps, convergences): (Vec<_>, Vec<_>) = maps.into_iter().unzip();
        let mut map = PatchMap::new(patch, pyramid, maps.into(), options.pixel);
        for (level, convergence) in map.levels.iter_mut().zip(convergences) {
            level.convergence = Some(convergence);
        }
        Ok(map)
    })?;
    let flattened = start.elapsed() - coarsened;
    let seconds =
        Seconds { coarsen: coarsened.as_secs_f64(), flatten: flattened.as_secs_f64(), ..Seconds::default() };
    Ok((SkinMap { links: named_links(&skin.links), patches: maps.into() }, seconds))
}

/// The files that [`write_files`] writes.
pub const FILES: [&str; 2] = ["map.glb", "map.exr"];

/// Rasterises a map and writes [`FILES`] into a folder that exists; returns the time that took.
///
/// # Errors
/// If the images have too many pixels, the map is not valid or a file cannot be written.
pub fn write_files(
    map: &SkinMap,
    folder: &Path,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Seconds, Error> {
    let total = map.patches.len();
    let start = Instant::now();
    progress(Progress { stage: Stage::Rasterise, done: 0, total });
    let images = skin_images(map)?;
    let rasterised = start.elapsed();
    progress(Progress { stage: Stage::Write, done: 0, total });
    let [map_file, images_file] = FILES;
    write_map(&folder.join(map_file), map)?;
    write_images(&folder.join(images_file), &images)?;
    let written = start.elapsed() - rasterised;
    Ok(Seconds { rasterise: rasterised.as_secs_f64(), write: written.as_secs_f64(), ..Seconds::default() })
}

/// Does `job` for every patch in parallel; the error is that of the first patch.
fn each_patch<P: Send, T: Send>(
    stage: Stage,
    patches: Vec<P>,
    progress: &(dyn Fn(Progress) + Sync),
    job: impl Fn(P) -> Result<T, Error> + Sync,
) -> Result<Vec<T>, Error> {
    let (total, done) = (patches.len(), AtomicUsize::new(0));
    progress(Progress { stage, done: 0, total });
    let made: Vec<_> = patches
        .into_par_iter()
        .map(|patch| {
            let made = job(patch)?;
            progress(Progress { stage, done: done.fetch_add(1, Ordering::Relaxed) + 1, total });
            Ok(made)
        })
        .collect();
    made.into_iter().collect()
}
