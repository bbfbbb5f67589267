//! The whole flow, from a skin to its map.
//!
//! [`build`] coarsens every patch into a pyramid ([`coarsen`](crate::pyramid::coarsen())), cut open
//! where it needs a seam, maps every level of it to the plane
//! ([`flatten_pyramid`](crate::flatten::flatten_pyramid)) and returns the [`SkinMap`].
//!
//! Every map is measured in the 32-bit numbers of `map.glb` (`written`). How a patch is cut depends on that
//! patch alone (`cut_open`).
//!
//! Patches are independent: they are built in parallel, and the result does not depend on the
//! number of threads. Before it, [`read_draft`] and
//! [`assemble`](crate::skin::assemble()) make the skin; after it,
//! [`measure`](crate::report::measure) measures how faithful the map is,
//! [`write_map`] keeps it, and [`skin_images`]
//! rasterises its levels. [`build_file`] goes from file to files.
//!
//! ```
//! use dermatome::{mesh::shapes, pipeline, skin::Skin};
//!
//! let skin = Skin::from_mesh("cap", shapes::cap(500, 0.1, 0.6));
//! let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
//! assert!(map.patches.iter().all(|patch| patch.levels.len() > 1));
//! # Ok::<_, dermatome::Error>(())
//! ```

mod attempts;
mod coarsened;
mod cut_open;
mod options;
mod register;
mod remarks;
mod written;

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;
use rayon::prelude::*;

use crate::Error;
use crate::atlas::{check_pixel, fitting_pixel, pixels_of, skin_images};
use crate::cut::{Cut, cut_along, is_plain_disk, pairs_by_patch};
use crate::flatten::{Boundary, patch_scales};
use crate::id::{IdVec, VertexId};
use crate::io::{IoError, Outputs, read_draft, write_images, write_map};
use crate::map::{PatchMap, SkinMap};
use crate::pipeline::attempts::{SAME, attempts, energy, is_better, is_magnified, keep_held};
use crate::pipeline::coarsened::{Coarsened, Flattened};
use crate::pipeline::cut_open::{cut_open, stays_whole};
use crate::pipeline::options::Numbers;
pub use crate::pipeline::options::{BuildOptions, MagnifyOver};
pub use crate::pipeline::remarks::BuildRemark;
use crate::pyramid::{CoarsenOptions, coarsen};
use crate::run::{Progress, Run, Stage};
use crate::skin::{AssembleOptions, Patch, PatchId, Skin, assemble, named_links, world_pose};

/// Default side of a pixel, in m.
const PIXEL: f64 = 1e-3;

/// Coarsens and flattens every patch of a skin.
///
/// # Errors
/// If the skin is not valid ([`Skin::validate`]); or patches cannot be cut as requested or flattened, with
/// all of them; with [`BuildOptions::keep_going`] only if no patch can.
pub fn build(skin: &Skin, options: &BuildOptions) -> Result<SkinMap, Error> {
    build_with(skin, options, Run::default()).map(|built| Arc::unwrap_or_clone(built.map))
}

/// As [`build`], with level 0 of each patch alone, measured and kept one to one in 64-bit numbers. Coarser
/// levels are made only where the map of level 0 starts from theirs, and none is counted as left out.
///
/// # Errors
/// As [`build`].
pub fn build_finest(skin: &Skin, options: &BuildOptions, run: Run<'_>) -> Result<Built, Error> {
    let levels = if options.flatten.starts_coarse() { options.coarsen.levels } else { Some(0) };
    let coarsen = CoarsenOptions { levels, ..options.coarsen.clone() };
    let options = BuildOptions { coarsen, ..options.clone() };
    let built = build_for(skin, &options, Numbers::F64, run)?;
    let mut map = Arc::unwrap_or_clone(built.map);
    map.patches.iter_mut().for_each(|patch| patch.keep_finest(1));
    map.find_body(options.across);
    let left_out = built.left_out.map(|_| 0);
    // Nothing is drawn.
    Ok(Built { map: Arc::new(map), left_out, enlarged: None, ..built })
}

/// A map, with the times and the failures of its build.
#[derive(Debug)]
pub struct Built {
    /// The map, shared with the images of it.
    pub map: Arc<SkinMap>,
    /// How long making the pyramids took.
    pub coarsened_in: Duration,
    /// How long making the maps of every level took.
    pub flattened_in: Duration,
    /// How many of the coarsest levels of each patch are not in the map: they have no valid map in 64-bit
    /// numbers, or in the 32-bit ones of a file, as those of a long thin tube, or a symmetric Dirichlet energy above
    /// 15, which that of the finest level is not.
    pub left_out: IdVec<PatchId, usize>,
    /// Which patches have a map by the symmetric Dirichlet energy, since the default energy gave none or an absurd one.
    pub by_dirichlet: IdVec<PatchId, bool>,
    /// With [`Cut::AreaRatio`], the largest area ratio of each patch's map without acuities and magnification, where these
    /// change areas on purpose: that is what its cut was judged by.
    pub unmagnified_ratios: IdVec<PatchId, Option<f64>>,
    /// Why each patch that is not in the map could not be mapped; see [`BuildOptions::keep_going`].
    pub failed: Vec<Error>,
    /// The pixels, if they had to be larger than 1 mm.
    pub enlarged: Option<Enlarged>,
}

/// Pixels that are larger than by default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Enlarged {
    /// Side of a pixel of the images, in mm.
    pub pixel_mm: f64,
    /// How many pixels the images would have had.
    pub pixels: u64,
}

/// As [`build`], in a [`Run`], with times and failures.
///
/// # Errors
/// As [`build`], and if it is cancelled.
pub fn build_with(skin: &Skin, options: &BuildOptions, run: Run<'_>) -> Result<Built, Error> {
    build_for(skin, options, Numbers::F32, run)
}

fn build_for(skin: &Skin, options: &BuildOptions, numbers: Numbers, run: Run<'_>) -> Result<Built, Error> {
    let start = Instant::now();
    skin.validate()?;
    let without = skin.without_even_acuities();
    let skin = without.as_ref().unwrap_or(skin);
    if let Some(side) = options.pixel {
        check_pixel(side, skin.patches.iter().map(|patch| &patch.mesh))?;
    }
    let seams = given_seams(skin, &options.cut)?;
    let jobs: Vec<_> = skin.patches.iter().zip(seams).collect();
    let side = |patch: &Patch| {
        let side = options.seam_side.and_then(DVec3::try_normalize)?;
        Some(world_pose(&skin.links, patch.link).inverse().transform_vector3(side))
    };
    let coarsened = each_patch(Stage::Coarsen, jobs, run, |(patch, seam)| {
        let coarsened =
            coarsen_patch(patch, &seam, side(patch), options, run).map_err(|e| e.in_patch(&patch.name))?;
        Ok((patch, coarsened))
    });
    let mut failed = Vec::new();
    let coarsened_in = start.elapsed();
    // The thread that maps a pyramid takes it; none is taken twice.
    run.check()?;
    let jobs = good(coarsened, options, &mut failed)?;
    let patches: Vec<&Patch> = jobs.iter().map(|(patch, _)| *patch).collect();
    let scales = match options.magnify_over {
        MagnifyOver::Skin => patch_scales(options.flatten.method, &patches),
        MagnifyOver::Patch => vec![1.0; patches.len()],
    };
    let jobs: Vec<_> = jobs.into_iter().zip(scales).collect();
    let map_one = |patch: &Patch, pyramid: Coarsened, scale: f64, options: &BuildOptions| {
        let mut map = map_patch(patch, pyramid, scale, options, run)?;
        let left_out = keep_held(&mut map, options, numbers)?;
        Ok((map, left_out))
    };
    let maps = each_patch(Stage::Flatten, jobs, run, |((patch, (pyramid, ratio)), scale)| {
        let mut best = map_one(patch, pyramid, scale, options);
        let ratio = ratio.filter(|_| is_magnified(&patch.taxels, options));
        let (mut is_by_dirichlet, mut settled) = (false, None);
        for attempt in attempts(patch, options) {
            run.check()?;
            if settled == Some(attempt.is_by_dirichlet) || energy(&best, patch, options) <= attempt.good {
                continue;
            }
            let pyramid = coarsen_patch(patch, &[], side(patch), &attempt.options, run);
            let made = pyramid.and_then(|(pyramid, _)| map_one(patch, pyramid, scale, &attempt.options));
            // Where another seam ends at the same energy, another pyramid does so too.
            let ratio = energy(&made, patch, options) / energy(&best, patch, options);
            if (ratio - 1.0).abs() < SAME {
                settled = Some(attempt.is_by_dirichlet);
            }
            if is_better(&made, &best, patch, options) {
                (best, is_by_dirichlet) = (made, attempt.is_by_dirichlet);
            }
        }
        best.map(|(map, left_out)| (map, Made { left_out, is_by_dirichlet, ratio }))
            .map_err(|e| e.in_patch(&patch.name))
    });
    run.check()?;
    let maps = good(maps, options, &mut failed)?;
    let flattened_in = start.elapsed() - coarsened_in;
    let (patches, mut made): (Vec<_>, Vec<Made>) = maps.into_iter().unzip();
    let (links, animations) = (named_links(&skin.links), skin.animations.clone());
    let mut map = SkinMap { links, patches: patches.into(), animations, ..SkinMap::default() };
    let enlarged = match (options.pixel, numbers) {
        (None, Numbers::F32) => enlarge_pixels(&mut map, &mut made, options, &mut failed)?,
        _ => None,
    };
    map.find_body(options.across);
    let map = Arc::new(map);
    let left_out = made.iter().map(|made| made.left_out).collect();
    let by_dirichlet = made.iter().map(|made| made.is_by_dirichlet).collect();
    let unmagnified_ratios = made.iter().map(|made| made.ratio).collect();
    Ok(Built {
        map,
        coarsened_in,
        flattened_in,
        left_out,
        by_dirichlet,
        unmagnified_ratios,
        failed,
        enlarged,
    })
}

/// How the map of a patch was made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Made {
    /// How many levels it was made without.
    left_out: usize,
    is_by_dirichlet: bool,
    /// As [`Built::unmagnified_ratios`].
    ratio: Option<f64>,
}

/// Gives a map larger pixels where its images would have too many. `made` is of each patch. A patch whose map the 32-bit numbers of its file
/// cannot hold with these pixels fails as any other.
fn enlarge_pixels(
    map: &mut SkinMap,
    made: &mut Vec<Made>,
    options: &BuildOptions,
    failed: &mut Vec<Error>,
) -> Result<Option<Enlarged>, Error> {
    let Some(pixel_mm) = fitting_pixel(map) else { return Ok(None) };
    let pixels = pixels_of(map);
    let patches: Vec<(PatchMap, Made)> =
        std::mem::take(&mut map.patches).into_iter().zip(std::mem::take(made)).collect();
    let enlarged: Vec<_> = patches
        .into_par_iter()
        .map(|(mut patch, made)| {
            patch.levels.iter_mut().for_each(|level| level.set_pixel(1e-3 * pixel_mm));
            let more = keep_held(&mut patch, options, Numbers::F32).map_err(|e| e.in_patch(&patch.name))?;
            Ok((patch, Made { left_out: made.left_out + more, ..made }))
        })
        .collect();
    let (patches, kept): (Vec<_>, Vec<_>) = good(enlarged, options, failed)?.into_iter().unzip();
    (map.patches, *made) = (patches.into(), kept);
    Ok(Some(Enlarged { pixel_mm, pixels }))
}

/// The edges of each patch that the user gives as seams; none where trial maps decide.
fn given_seams(skin: &Skin, cut: &Cut) -> Result<IdVec<PatchId, Vec<[VertexId; 2]>>, Error> {
    Ok(match cut {
        Cut::Along(pairs) => pairs_by_patch(pairs, skin.patches.iter().map(|patch| &patch.taxels))?,
        Cut::Edges(edges) => {
            skin.patches.ids().map(|id| edges.get(id).cloned().unwrap_or_default()).collect()
        }
        _ => skin.patches.map(|_| Vec::new()),
    })
}

/// The pyramid of a patch, and the area ratio that its cut was judged by.
fn coarsen_patch(
    patch: &Patch,
    seam: &[[VertexId; 2]],
    side: Option<DVec3>,
    options: &BuildOptions,
    run: Run<'_>,
) -> Result<(Coarsened, Option<f64>), Error> {
    let Patch { mesh, taxels, .. } = patch;
    let BuildOptions { cut, flatten, .. } = options;
    let may_stay = !matches!(cut, Cut::AreaRatio(_)) && is_plain_disk(mesh);
    // A prescribed boundary is that of the uncut disk.
    let is_uncut = matches!(cut, Cut::None | Cut::All) || flatten.boundary != Boundary::Free;
    let whole = match seam {
        [] if may_stay => Some(coarsen(mesh, taxels, &options.coarsen, run)?),
        _ => None,
    };
    let (cut, ratio) = match (&whole, seam) {
        (Some(whole), _) if is_uncut || stays_whole(mesh, taxels, whole, run)? => (None, None),
        (whole, []) => cut_open(mesh, taxels, whole.as_ref(), side, options, run)?,
        (_, edges) => (Some(cut_along(mesh, edges, &taxels.ids)?), None),
    };
    let coarsened = match (cut, whole) {
        (None, Some(whole)) => Coarsened::Whole(whole),
        (cut, _) => Coarsened::new(mesh, taxels, cut.as_ref(), &options.coarsen, run)?,
    };
    Ok((coarsened, ratio))
}

/// The map of a patch, `scale` times as long as the skin; not measured.
fn map_patch(
    patch: &Patch,
    pyramid: Coarsened,
    scale: f64,
    options: &BuildOptions,
    run: Run<'_>,
) -> Result<PatchMap, Error> {
    let Flattened { levels, maps } = pyramid.flattened(&patch.taxels, &options.flatten, run)?;
    let (maps, convergences): (Vec<_>, Vec<_>) =
        maps.into_iter().map(|map| (map.uv.map(|&p| p * scale), map.convergence)).unzip();
    let mut map = PatchMap::unmeasured(patch, levels, maps.into(), options.pixel.unwrap_or(PIXEL));
    for (level, convergence) in map.levels.iter_mut().zip(convergences) {
        level.convergence = Some(convergence);
    }
    Ok(map)
}

/// Does `job` for every patch in parallel.
fn each_patch<P: Send, T: Send>(
    stage: Stage,
    patches: Vec<P>,
    run: Run<'_>,
    job: impl Fn(P) -> Result<T, Error> + Sync,
) -> Vec<Result<T, Error>> {
    let (total, done) = (patches.len(), AtomicUsize::new(0));
    run.tell(Progress { stage, done: 0, total });
    let made = patches.into_par_iter().map(|patch| {
        run.check()?;
        let made = job(patch)?;
        run.tell(Progress { stage, done: done.fetch_add(1, Ordering::Relaxed) + 1, total });
        Ok(made)
    });
    made.collect()
}

/// The successful results; errors are added to `failed`.
fn good<T>(
    made: Vec<Result<T, Error>>,
    options: &BuildOptions,
    failed: &mut Vec<Error>,
) -> Result<Vec<T>, Error> {
    let mut good = Vec::with_capacity(made.len());
    for result in made {
        match result {
            Ok(value) => good.push(value),
            Err(error) => failed.push(error),
        }
    }
    match failed.len() {
        0 => Ok(good),
        _ if options.keep_going && !good.is_empty() => Ok(good),
        1 => Err(failed.remove(0)),
        _ => Err(Error::Several(std::mem::take(failed))),
    }
}

/// Reads a skin, builds its maps and writes them to a folder, which is created if it does not exist:
/// `map.glb`, every level with its map, and `map.exr`, the images of what each pixel shows. Both appear
/// together, or neither. Returns the map.
///
/// The skin is assembled with the default options, and its remarks are not returned; for other options or the
/// remarks call [`read_draft`], [`assemble()`] and [`build`].
///
/// ```
/// use dermatome::{BuildOptions, build_file, read_map};
///
/// # let folder = tempfile::tempdir()?;
/// # let out = folder.path();
/// let skin = "meshes/sphere_cap.glb";
/// # let skin = "../../meshes/sphere_cap.glb";
/// let built = build_file(skin.as_ref(), out, &BuildOptions::default())?;
/// assert_eq!(read_map(&out.join("map.glb"))?.patches.len(), built.map.patches.len());
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A file that cannot be read or written, a skin that breaks a rule, and those of [`build`].
pub fn build_file(skin: &Path, folder: &Path, options: &BuildOptions) -> Result<Built, Error> {
    let draft = read_draft(skin)?;
    let assemble_options = AssembleOptions { keep_going: options.keep_going, ..AssembleOptions::default() };
    let skin = assemble(&draft, &assemble_options)?.skin;
    fs::create_dir_all(folder).map_err(|source| IoError::Write { path: folder.into(), source })?;
    let built = build_with(&skin, options, Run::default())?;
    let outputs = Outputs::default();
    let [map_file, images_file] = ["map.glb", "map.exr"].map(|name| outputs.file(folder.join(name)));
    let (map, images) = rayon::join(
        || write_map(map_file, &built.map),
        || Ok::<_, Error>(write_images(images_file, &skin_images(&built.map)?)?),
    );
    map?;
    images?;
    outputs.publish()?;
    Ok(built)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::{CutMesh, PlaceId};
    use crate::flatten::{distortion, flatten_pyramid};
    use crate::mesh::{Adjacency, TriMesh, shapes};
    use crate::pyramid::{LevelId, coarsen_cut};
    use crate::skin::PatchId;

    /// Euler characteristic and boundary loops of the mesh after the cut.
    fn shape(mesh: &TriMesh, cut: &CutMesh) -> (i64, usize) {
        let adjacency = Adjacency::new(&cut.mesh(&mesh.positions)).unwrap();
        (adjacency.euler_characteristic(), adjacency.boundary_loops().len())
    }

    /// A leg of Spot had a map that overlapped itself in its file as soon as the pixels were larger.
    #[test]
    fn a_map_that_larger_pixels_break_is_left_out_as_any_other() {
        let patches = ["a", "b"].map(|name| {
            let skin = Skin::from_mesh(name, shapes::lattice(10, 10, 0.15));
            build(&skin, &BuildOptions { pixel: Some(PIXEL), ..BuildOptions::default() }).unwrap().patches
        });
        let mut map = SkinMap { patches: patches.into_iter().flatten().collect(), ..SkinMap::default() };
        let level = &mut map.patches[PatchId::new(0)].levels[LevelId::new(0)];
        level.uv.iter_mut().for_each(|at| at.x = -at.x);
        let enlarge = |keep_going: bool| {
            let options = BuildOptions { keep_going, ..BuildOptions::default() };
            let made_by = |left_out, is_by_dirichlet| Made { left_out, is_by_dirichlet, ratio: None };
            let mut made = vec![made_by(0, false), made_by(1, true)];
            let (mut map, mut failed) = (map.clone(), Vec::new());
            let enlarged = enlarge_pixels(&mut map, &mut made, &options, &mut failed);
            (enlarged, map, made, failed)
        };
        let (enlarged, map, made, failed) = enlarge(true);
        assert!(enlarged.unwrap().is_some_and(|enlarged| enlarged.pixel_mm > 1.0));
        assert_eq!(map.patches.iter().map(|patch| &*patch.name).collect::<Vec<_>>(), ["b"]);
        assert_eq!(made, [Made { left_out: 1, is_by_dirichlet: true, ratio: None }]);
        assert!(failed.len() == 1 && failed[0].to_string().contains("\"a\""), "{failed:?}");
        let (enlarged, ..) = enlarge(false);
        assert!(enlarged.unwrap_err().to_string().contains("\"a\""));
    }

    /// Both sides of the seam are coarsened together: each level is a disk again, opened along the same seam.
    #[test]
    fn every_level_has_the_same_seam() {
        for mesh in [
            shapes::ball(12, 0.1),
            shapes::torus(40, 16, 0.1, 0.04),
            shapes::frame(2, 4, 0.01),
            shapes::tube(40, 24, 0.05, 0.2),
        ] {
            let patch = &Skin::from_mesh("skin", mesh.clone()).patches[PatchId::new(0)];
            let options = BuildOptions::default();
            let cut = cut_open(&patch.mesh, &patch.taxels, None, None, &options, Run::default());
            let cut = cut.unwrap().0.unwrap();
            let few = CoarsenOptions { coarsest: 20, ..CoarsenOptions::default() };
            let made = coarsen_cut(&mesh, &patch.taxels, &cut, &few, Run::default()).unwrap();
            made.pyramid.validate().unwrap();
            made.opened.validate().unwrap();
            assert!(made.pyramid.levels.len() > 2, "{} levels", made.pyramid.levels.len());
            let whole = shape(&mesh, &cut);
            for ((level, opened), cut) in made.pyramid.levels.iter().zip(&made.opened.levels).zip(&made.cuts)
            {
                assert_eq!(shape(&level.mesh, cut), whole, "{} vertices", level.mesh.positions.len());
                assert_eq!(opened.mesh, cut.mesh(&level.mesh.positions));
                for (place, &v) in cut.unsplit.enumerate() {
                    let origin = PlaceId::of_opened(opened.origins[place.opened()]);
                    assert_eq!(made.cuts[LevelId::new(0)].unsplit[origin], level.origins[v], "place {place}");
                }
            }
            let maps = flatten_pyramid(&made.opened, None, &options.flatten, Run::default()).unwrap();
            for (level, map) in made.opened.levels.iter().zip(&maps) {
                assert_eq!(distortion(&level.mesh, &map.uv).flips, 0);
            }
        }
    }
}
