//! Flattening: a disk-like mesh with holes to the plane, with a free boundary and no flips.
//!
//! Tactile images are drawn on the map of a patch, so it should be as close to an isometry as the skin's
//! curvature allows, everywhere, and never fold. This module follows Cannata, Denei and Mastrogiovanni, "On
//! Internal Models for Representing Tactile Information" (`(cannata)`), whose weighted sum of angle, area and
//! perimeter distortion it minimises as one nonlinear energy instead of by linear rows.
//!
//! # The energy
//!
//! Of a face of area `A`, let `J` be the 2 x 2 Jacobian from the skin to the plane and `s1 >= |s2|`
//! its signed singular values; of a boundary edge of length `L`, let `r` be its stretch; let `h` be
//! the mean edge. The map minimises (eq. 4 of `(cannata)`)
//!
//! ```text
//! E = sum over faces of A [ l1 (s1/s2 + s2/s1)/2 + l2 (s1 s2 + 1/(s1 s2))/2 ]
//!   + l3 h sum over boundary edges of L (r + 1/r)/2
//! ```
//!
//! Each term is 1 at an isometry, and infinite for a face that collapses, so a descent never flips one. There
//! are no pins, and the boundary is free unless [`Boundary`] prescribes it. The alternative is the symmetric
//! Dirichlet energy, `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`. *Magnification* makes each face aim at `a^2 (rho / mean
//! rho)^gamma` times its area, with `rho` the density of taxels and `a` their acuity, and a face counts by
//! the mean weight of its taxels.
//!
//! # The algorithm
//!
//! 1. **Domain.** Check that the mesh is a disk with holes; lay each face flat, in units of the
//!    square root of the whole area.
//! 2. **Start**, on the coarsest level: the spectral natural conformal map (`(mullen2008)`), one sparse
//!    Hermitian eigenproblem. Flipped faces are repaired locally (`(garanzha2021)`). If that fails, or the
//!    map winds twice about a vertex, a hole is not a hole or the energy is beyond 50, the start is instead:
//!    the outer loop on a circle and holes closed by a vertex each (`(tutte1963)`), which cannot flip in
//!    exact arithmetic, solved again with springs that are stiff where the map is too large
//!    (`(yoshizawa2004)`). From a map that is still poor because faces have collapsed, the descent is
//!    repeated with rest shapes that change gradually.
//! 3. **Minimise** by projected Newton: the Hessian of each face, clamped to be positive
//!    semi-definite along its four known eigenvectors (`(smith2019)`, `(teran2005)`), a step below
//!    the first collapse of a face (`(smith2015)`), a line search. Up to 3000 vertices systems
//!    are factored, larger ones are solved by conjugate gradients in single precision, along a space-filling curve.
//! 4. **Fill, if needed.** If a hole turns inside out, the descent continues from the last map that kept it,
//!    with light triangles in the holes, which may not flip and are made anew every few steps; if the map
//!    overlaps itself, with such triangles also between its outer loop and a frame (`(jiang2017)`).
//! 5. **Next finer level**: undo the removals of the pyramid on the map: place each vertex in the kernel of
//!    its ring, which includes a filler next to it; then go to 3. Small levels and suspicious ones are also
//!    solved from scratch, and the better map is kept. The table of all fallbacks is at the top of
//!    `refine.rs`.
//! 6. **Place** every level: centred, turned to its main direction, scaled to the area of the skin; coarse
//!    levels are aligned with the finest.
//!
//! # Guarantees
//!
//! - The intrinsic method returns a map without flips on every level, or an error
//!   ([`FlattenError::NoStart`]).
//! - The intrinsic method keeps holes: one loop runs counter-clockwise, all others clockwise. With
//!   [`Overlap::Prevent`] its map is one to one.
//! - The same input gives the same bits with any number of threads.
//!
//! # Not guaranteed
//!
//! - The minimum is local; nothing proves that it is the global one.
//! - With [`Overlap::Allow`] a map may overlap itself. [`distortion()`] counts overlaps.
//! - [`Method::Conformal`] and [`Method::Linear`] may flip faces and overlap.
//! - Closed surfaces and handles are refused, and patches around a limb become rings, far from isometric:
//!   [`crate::cut`] finds a seam for them first.
//!
//! # Files, in reading order
//!
//! - `options`, `error`: choices of the user, and reasons of failure
//! - `domain`, `magnification`, `boundary`: the skin, and prescriptions for its map
//! - `energy/` (`elements`, `face_energy`, `assembly`, `objective`, `newton`): the faces, the energy of one,
//!   sums over all, and the minimiser; a new energy goes into `face_energy`
//! - `start/` (`conformal`, `linear`, `tutte`, `untangle`): maps that need no start
//! - `crossings`, `overlap`, `fillers`: whether a map overlaps itself, and how that is prevented
//! - `relax`, `insertion`, `refine`: least energy on one level; from one level to the next
//! - `placement`: position and rotation of the finished map; `distortion`: measures of any map

mod boundary;
mod crossings;
mod distortion;
mod domain;
mod energy;
mod error;
mod fillers;
mod insertion;
mod magnification;
mod options;
mod overlap;
mod placement;
mod refine;
mod relax;
mod start;

use glam::DVec2;

use crate::id::{IdVec, VertexId};
use crate::mesh::{SymmetricDirichlet, TriMesh};
use crate::pyramid::{CoarsenOptions, LevelId, Pyramid, PyramidError, coarsen};
use crate::run::Run;
use crate::skin::Taxels;

pub use crossings::crossing_vertices;
pub use distortion::{ABSURD, POOR, POOR_STRETCHES};
pub use distortion::{Convergence, Distortion, distortion};
pub(crate) use energy::elements::keeps_orientation;
pub use error::FlattenError;
pub use magnification::patch_scales;
pub use options::{Boundary, Energy, FlattenOptions, Method, Overlap};

use boundary::prescribed;
use domain::{Disk, FlattenDomain};
use energy::{elements::Uv, newton::NewtonLimits};
use fillers::Fillers;
use insertion::Insertion;
use magnification::Magnification;
use overlap::check_map;
use placement::{direction_like, main_direction, normalise_map};
use refine::{Inherited, best_map};
use relax::{Goal, Relaxed, Scaffold, Start, relax, start_from_scratch};

/// A map, and how far its minimisation came.
#[derive(Debug, Clone, PartialEq)]
pub struct Flattening {
    /// Map positions, in m.
    pub uv: IdVec<VertexId, DVec2>,
    /// How far the minimisation came.
    pub convergence: Convergence,
}

/// Meshes up to this size are flattened at once, larger ones through a pyramid: flattening 5000 vertices at
/// once takes half the time with holes and as long without; at 10 000 a pyramid is faster.
const MAX_AT_ONCE: usize = 6000;

/// If a level has more than this many times the vertices of the next coarser one, its map does not start from
/// that of the coarser level: a star of 20k faces, whose coarser level has ten, took 30 s from it.
const MAX_LEVEL_RATIO: usize = 16;

/// Flattens one mesh: map positions in m, isometric in scale on average, never mirrored. The densities,
/// weights and acuities of the taxels at its vertices, if they are given, drive [`Method::Intrinsic`], as
/// in [`flatten_pyramid`].
///
/// The intrinsic method never flips a face. A conformal or linear map may:
/// [`distortion()`](crate::flatten::distortion()) counts flips and overlaps.
///
/// ```
/// use dermatome::{flatten::{Energy, FlattenOptions, distortion, flatten}, mesh::shapes, run::Run};
///
/// // A fingertip: a cap of 110 degrees, radius 8 mm.
/// let skin = shapes::cap(500, 8e-3, 110_f64.to_radians());
/// let map = flatten(&skin, None, &FlattenOptions::default(), Run::default())?;
/// assert_eq!(distortion(&skin, &map.uv).flips, 0);
///
/// // More weight on areas: every taxel closer to its true share of the map, at more angle distortion.
/// let energy = Energy::Sum { angle: 0.1, area: 1.0, perimeter: 0.0 };
/// let authalic = flatten(&skin, None, &energy.into(), Run::default())?;
/// assert!(distortion(&skin, &authalic.uv).area_mean < distortion(&skin, &map.uv).area_mean);
/// # Ok::<(), dermatome::flatten::FlattenError>(())
/// ```
///
/// # Errors
/// If the mesh is not a disk with holes, an option, density, weight or acuity is out of range, a face is
/// too degenerate to be mapped, or the run is cancelled.
pub fn flatten(
    mesh: &TriMesh,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
    run: Run<'_>,
) -> Result<Flattening, FlattenError> {
    options.validate()?;
    if options.starts_coarse() && mesh.positions.len() > MAX_AT_ONCE {
        // Refuse a mesh that is not a disk before the work of coarsening it.
        Disk::new(mesh)?;
        let maps = flatten_pyramid(&pyramid_of(mesh, run)?, taxels, options, run)?;
        return maps.into_iter().next().ok_or(FlattenError::Size { area: mesh.area() });
    }
    let magnification = Magnification::new(options.method, taxels, &mesh.vertex_areas())?;
    let mut domain = FlattenDomain::new(mesh)?.magnified(&magnification);
    let prescribed = prescribed_by(options, mesh)?;
    if let Some(places) = &prescribed {
        domain = domain.prescribed(places.iter().copied());
    }
    let Relaxed { uv, convergence, .. } = best_map(&domain, None, options, run)?;
    let found = domain.to_metres(&uv);
    let placed = prescribed.is_none().then(|| {
        let weights = magnification.face_weights(mesh);
        normalise_map(mesh, &uv, main_direction(mesh, &uv), weights.as_ref())
    });
    let uv = verified(mesh, &domain.disk.loops, options, placed, found)?;
    Ok(Flattening { uv, convergence })
}

/// The `placed` map, or the map as `found` if rounding has turned faces of the first over or made it overlap
/// itself; checked exactly for the intrinsic method.
fn verified(
    mesh: &TriMesh,
    loops: &[Vec<VertexId>],
    options: &FlattenOptions,
    placed: Option<Uv>,
    found: Uv,
) -> Result<Uv, FlattenError> {
    if !matches!(options.method, Method::Intrinsic { .. }) {
        return Ok(placed.unwrap_or(found));
    }
    let overlap = if options.boundary == Boundary::Free { options.overlap } else { Overlap::Allow };
    match placed.filter(|placed| check_map(mesh, loops, overlap, placed).is_ok()) {
        Some(placed) => Ok(placed),
        None => check_map(mesh, loops, overlap, &found).map(|()| found),
    }
}

/// Limits of a map by which a seam is judged: further steps would not change the judgement.
const ROUGH: NewtonLimits = NewtonLimits { rest: 1e-4, steps: 60, gain: 3e-3, most: f64::INFINITY };

/// Approximately the map (m) of least symmetric Dirichlet energy, to judge a seam by; it may overlap itself.
/// Gives up if the energy will probably stay above `most`.
///
/// # Errors
/// As [`flatten`].
#[doc(hidden)]
pub fn flatten_roughly(mesh: &TriMesh, most: f64, run: Run<'_>) -> Result<Uv, FlattenError> {
    let domain = FlattenDomain::new(mesh)?;
    let goal = Goal { energy: Energy::SymmetricDirichlet, overlap: Overlap::Allow };
    let limits = NewtonLimits { most: SymmetricDirichlet::ISOMETRY + most, ..ROUGH };
    let reached = relax(&domain, Start::Far(start_from_scratch(&domain)?), goal, Some(limits), run)?;
    Ok(domain.to_metres(&reached.uv))
}

/// Positions of the outer loop, if the options prescribe them.
fn prescribed_by(
    options: &FlattenOptions,
    mesh: &TriMesh,
) -> Result<Option<IdVec<VertexId, Option<DVec2>>>, FlattenError> {
    match options.method {
        Method::Intrinsic { .. } | Method::Linear { .. } => prescribed(mesh, &options.boundary),
        Method::Conformal => Ok(None),
    }
}

/// The pyramid of a mesh with a taxel at every vertex.
fn pyramid_of(mesh: &TriMesh, run: Run<'_>) -> Result<Pyramid, FlattenError> {
    Ok(coarsen(mesh, &Taxels::from(mesh), &CoarsenOptions::default(), run)?)
}

/// Flattens every level of a pyramid, coarse to fine. [`Method::Intrinsic`] uses the weights and acuities of
/// the taxels, its level-0 vertices, and their densities for magnification; without densities it uses the
/// areas.
///
/// The maps of all levels are aligned. If a coarse level of a long thin tube has no map in 64-bit numbers, it
/// and all coarser ones are left out: then there are fewer maps than levels.
///
/// ```
/// use dermatome::{
///     flatten::{FlattenOptions, distortion, flatten_pyramid},
///     mesh::shapes,
///     pyramid::{CoarsenOptions, coarsen},
///     run::Run,
///     skin::Taxels,
/// };
///
/// let skin = shapes::cap(500, 8e-3, 1.9);
/// let pyramid = coarsen(&skin, &Taxels::from(&skin), &CoarsenOptions::default(), Run::default())?;
/// let maps = flatten_pyramid(&pyramid, None, &FlattenOptions::default(), Run::default())?;
/// for (level, map) in pyramid.levels.iter().zip(&maps) {
///     assert_eq!(distortion(&level.mesh, &map.uv).flips, 0);
/// }
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Errors
/// If the patch is not a disk with holes, an option, density, weight or acuity is out of range, a face is too
/// degenerate to be mapped, or the run is cancelled.
pub fn flatten_pyramid(
    pyramid: &Pyramid,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
    run: Run<'_>,
) -> Result<IdVec<LevelId, Flattening>, FlattenError> {
    options.validate()?;
    let Some(finest) = pyramid.levels.get(LevelId::new(0)) else {
        return Ok(IdVec::default());
    };
    let (found, needed) = (pyramid.removals.len(), pyramid.levels.len() - 1);
    if found != needed {
        return Err(PyramidError::Length { what: "removals", found, needed }.into());
    }
    let magnification = Magnification::new(options.method, taxels, &finest.areas)?;
    let prescribed = prescribed_by(options, &finest.mesh)?;
    let (mut maps, mut weights, mut how) = (Vec::<Uv>::new(), Vec::new(), Vec::new());
    let (mut scaffold, mut fillers) = (Scaffold::None, Fillers::default());
    for (id, level) in pyramid.levels.enumerate().rev() {
        let magnification = magnification.restricted(level, &finest.areas);
        let mut domain = FlattenDomain::new(&level.mesh)?.magnified(&magnification);
        if let Some(places) = &prescribed {
            domain = domain.prescribed(level.origins.iter().map(|&v| places[v]));
        }
        let coarser = pyramid.levels.get(LevelId::new(id.index() + 1)).zip(maps.last());
        let coarser = coarser.filter(|(c, _)| domain.vertices() <= MAX_LEVEL_RATIO * c.mesh.positions.len());
        let inherited = match coarser.filter(|_| options.starts_coarse()) {
            Some((coarse, uv)) => {
                let start = Insertion::new(level, &pyramid.removals[id], coarse, uv, &fillers)?;
                Some(Inherited { start, scaffold, magnification: &magnification })
            }
            None => None,
        };
        let reached = match best_map(&domain, inherited, options, run) {
            // The next finer level may be less thin.
            Err(
                FlattenError::NoStart { .. }
                | FlattenError::NoRoom { .. }
                | FlattenError::NotInjective { .. },
            ) if id.index() > 0 => {
                (maps, weights, how) = (Vec::new(), Vec::new(), Vec::new());
                continue;
            }
            reached => reached?,
        };
        // In metres, so that the next level starts at the right size.
        let uv = domain.to_metres(&reached.uv);
        scaffold = reached.scaffold;
        fillers = scaffold.fillers(&domain, &uv).unwrap_or_default();
        maps.push(uv);
        weights.push(magnification.face_weights(&level.mesh));
        how.push((reached.convergence, domain.disk.loops));
    }
    // Level 0 is normalised; the coarser maps are turned so that their vertices lie near the same taxels of level 0.
    let mut flattenings: IdVec<LevelId, Flattening> = IdVec::default();
    let found = maps.into_iter().zip(weights).zip(how).rev();
    for (level, ((found, weights), (convergence, loops))) in pyramid.levels.iter().zip(found) {
        let direction = match flattenings.get(LevelId::new(0)) {
            None => main_direction(&level.mesh, &found),
            Some(Flattening { uv, .. }) => {
                direction_like(found.iter().zip(level.origins.iter().map(|&v| &uv[v])))
            }
        };
        let place = || normalise_map(&level.mesh, &found, direction, weights.as_ref());
        let placed = prescribed.is_none().then(place);
        let uv = verified(&level.mesh, &loops, options, placed, found)?;
        flattenings.push(Flattening { uv, convergence });
    }
    Ok(flattenings)
}
