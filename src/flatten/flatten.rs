//! The two entry points: one mesh, or every level of a pyramid, coarse to fine.

use glam::DVec2;

use crate::{
    flatten::{
        Boundary, Convergence, Energy, FlattenError, FlattenOptions, Method, Overlap,
        bijective::{fillers::Fillers, overlap::is_one_to_one},
        domain::{
            disk::Disk, elements::Uv, flatten_domain::FlattenDomain, magnification::Magnification,
            prescribed::prescribed,
        },
        energy::newton::NewtonLimits,
        levels::{
            insertion::Insertion,
            refine::refine,
            relax::{Goal, Relaxed, Start, Walls, minimise_from_scratch, relax, solve_from_scratch},
        },
        placement::{direction_like, main_direction, normalise_map},
        start::tutte::tutte,
    },
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
    pyramid::{CoarsenOptions, LevelId, Pyramid, PyramidError, coarsen},
    skin::Taxels,
};

/// Meshes up to this size are flattened at once, larger ones through a pyramid: at 5000 vertices at
/// once takes half the time with holes and as long without, at 10 000 a pyramid is quicker.
const AT_ONCE: usize = 6000;

/// Vertices of a level over those of the next coarser one, above which its map starts anew: the
/// coarse map knows too little. A star of 20k faces, whose coarser level has ten, took 30 s from it.
const TOO_COARSE: usize = 16;

/// Flattens one mesh: map positions in m, isometric in scale on average, never mirrored.
///
/// The intrinsic method never flips a face. A conformal or linear map may:
/// [`distortion()`](crate::flatten::distortion()) counts flips and overlaps.
///
/// ```
/// use dermatome::{flatten::{Energy, FlattenOptions, distortion, flatten}, mesh::shapes};
///
/// // A fingertip: a cap of 110 degrees, radius 8 mm.
/// let skin = shapes::cap(500, 8e-3, 110_f64.to_radians());
/// let uv = flatten(&skin, &FlattenOptions::default())?;
/// assert_eq!(distortion(&skin, &uv).flips, 0);
///
/// // More weight on areas: every taxel closer to its true share of the map, at more angle distortion.
/// let energy = Energy::Sum { angle: 0.1, area: 1.0, perimeter: 0.0 };
/// let authalic = flatten(&skin, &energy.into())?;
/// assert!(distortion(&skin, &authalic).area_mean < distortion(&skin, &uv).area_mean);
/// # Ok::<(), dermatome::flatten::FlattenError>(())
/// ```
///
/// # Errors
/// If the mesh is not a disk with holes, an option is out of range or a face is too degenerate to be
/// mapped.
pub fn flatten(mesh: &TriMesh, options: &FlattenOptions) -> Result<IdVec<VertexId, DVec2>, FlattenError> {
    flatten_with_convergence(mesh, None, options).map(|(uv, _)| uv)
}

/// The same as [`flatten`], and how far the minimisation came. The densities, weights and acuities
/// of the taxels at the vertices drive the intrinsic method.
pub(crate) fn flatten_with_convergence(
    mesh: &TriMesh,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
) -> Result<(IdVec<VertexId, DVec2>, Convergence), FlattenError> {
    options.validate()?;
    let is_free = options.boundary == Boundary::Free;
    if is_free && matches!(options.method, Method::Intrinsic { .. }) && mesh.positions.len() > AT_ONCE {
        // Refuse a mesh that is not a disk before the work of coarsening it.
        Disk::new(mesh)?;
        let maps = flatten_pyramid_with_convergence(&pyramid_of(mesh)?, taxels, options)?;
        return maps.into_iter().next().ok_or(FlattenError::Size { area: mesh.area() });
    }
    let magnification = Magnification::new(options.method, taxels, &mesh.vertex_areas())?;
    let mut domain = FlattenDomain::new(mesh)?.magnified(&magnification);
    let prescribed = prescribed_by(options, mesh)?;
    if let Some(places) = &prescribed {
        domain = domain.prescribed(places.iter().copied());
    }
    let Relaxed { uv, convergence, .. } = solve_from_scratch(&domain, options)?;
    let placed = match prescribed {
        Some(_) => domain.to_metres(&uv),
        None => {
            let weights = magnification.face_weights(mesh);
            normalise_map(mesh, &uv, main_direction(mesh, &uv), weights.as_ref())
        }
    };
    Ok((placed, convergence))
}

/// Newton steps of a map by which a seam is judged: what it still gains does not change the judgement.
const ROUGH: NewtonLimits = NewtonLimits { decrement: 1e-4, steps: 60, gain: 3e-3, most: f64::INFINITY };

/// Symmetric Dirichlet energy of an isometry.
const ISOMETRY: f64 = 4.0;

/// About the map (m) of least symmetric Dirichlet energy, to judge a seam by: from a map of the same
/// faces without flips, if one is given. A map that will hardly get closer to the energy of an isometry
/// than `most` is given up.
///
/// # Errors
/// As [`flatten`].
pub(crate) fn flatten_roughly(
    mesh: &TriMesh,
    start: Option<&Uv>,
    overlap: Overlap,
    most: f64,
) -> Result<Uv, FlattenError> {
    let domain = FlattenDomain::new(mesh)?;
    let goal = Goal { energy: Energy::SymmetricDirichlet, overlap };
    let limits = NewtonLimits { most: ISOMETRY + most, ..ROUGH };
    let start = start.map(|uv| domain.to_units(uv)).filter(|uv| domain.elements.is_flip_free(uv));
    let reached = match start {
        Some(uv) if overlap == Overlap::Allow => relax(&domain, Start::Far(uv), goal, Some(limits))?,
        Some(uv) if is_one_to_one(&domain, &uv) => return Ok(domain.to_metres(&uv)),
        // The free map overlaps itself: a frame is needed in any case.
        Some(_) => relax(&domain, Start::Near(tutte(&domain)?, Walls::Framed), goal, Some(limits))?,
        None => minimise_from_scratch(&domain, goal, Some(limits))?,
    };
    Ok(domain.to_metres(&reached.uv))
}

/// Places of the outer loop, where the options prescribe them.
fn prescribed_by(
    options: &FlattenOptions,
    mesh: &TriMesh,
) -> Result<Option<IdVec<VertexId, Option<DVec2>>>, FlattenError> {
    match options.method {
        Method::Intrinsic { .. } => prescribed(mesh, &options.boundary),
        Method::Conformal | Method::Linear { .. } => Ok(None),
    }
}

/// The pyramid of a mesh with a taxel at every vertex.
fn pyramid_of(mesh: &TriMesh) -> Result<Pyramid, FlattenError> {
    let taxels = Taxels { areas: mesh.positive_vertex_areas(), ..Taxels::from(mesh) };
    Ok(coarsen(mesh, &taxels, &CoarsenOptions::default())?)
}

/// Flattens every level of a pyramid, coarse to fine. The weights and acuities of the taxels, its
/// level-0 vertices, drive [`Method::Intrinsic`], and so do their densities its magnification; without
/// densities the areas do.
///
/// All levels are aligned: what is left on a coarse map is left on the fine one. Where a coarse level
/// of a long thin tube has no map in 64-bit numbers, it and all coarser ones are left out: there are
/// fewer maps than levels then.
///
/// ```
/// use dermatome::{
///     flatten::{FlattenOptions, distortion, flatten_pyramid},
///     mesh::shapes,
///     pyramid::{CoarsenOptions, coarsen},
///     skin::Taxels,
/// };
///
/// let skin = shapes::cap(500, 8e-3, 1.9);
/// let pyramid = coarsen(&skin, &Taxels::from(&skin), &CoarsenOptions::default())?;
/// let maps = flatten_pyramid(&pyramid, None, &FlattenOptions::default())?;
/// for (level, uv) in pyramid.levels.iter().zip(&maps) {
///     assert_eq!(distortion(&level.mesh, uv).flips, 0);
/// }
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Errors
/// If the patch is not a disk with holes, an option, density, weight or acuity is out of range, or a face is too
/// degenerate to be mapped.
pub fn flatten_pyramid(
    pyramid: &Pyramid,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
) -> Result<IdVec<LevelId, IdVec<VertexId, DVec2>>, FlattenError> {
    let maps = flatten_pyramid_with_convergence(pyramid, taxels, options)?;
    Ok(maps.into_iter().map(|(uv, _)| uv).collect())
}

/// The same as [`flatten_pyramid`], and how far the minimisation of each level came.
pub(crate) fn flatten_pyramid_with_convergence(
    pyramid: &Pyramid,
    taxels: Option<&Taxels>,
    options: &FlattenOptions,
) -> Result<IdVec<LevelId, (Uv, Convergence)>, FlattenError> {
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
    let (mut maps, mut weights, mut convergences) = (Vec::<Uv>::new(), Vec::new(), Vec::new());
    let (mut walls, mut fillers) = (Walls::None, Fillers::default());
    for (id, level) in pyramid.levels.enumerate().rev() {
        let magnification = magnification.restricted(level, &finest.areas);
        let mut domain = FlattenDomain::new(&level.mesh)?.magnified(&magnification);
        if let Some(places) = &prescribed {
            domain = domain.prescribed(level.origins.iter().map(|&v| places[v]));
        }
        let coarser = pyramid.levels.get(LevelId::new(id.index() + 1)).zip(maps.last());
        let coarser = coarser.filter(|(c, _)| domain.vertices() <= TOO_COARSE * c.mesh.positions.len());
        let reached = match (options.method, coarser) {
            (Method::Intrinsic { energy, .. }, Some((coarse, uv))) if prescribed.is_none() => {
                let goal = Goal { energy, overlap: options.overlap };
                let start = Insertion::new(level, &pyramid.removals[id], coarse, uv, &fillers)?;
                let refined = refine(&domain, start, walls, &magnification, goal);
                // A bad map of a coarser level may have needles that no step gets past.
                match refined {
                    Ok(reached) if reached.is_stuck(&domain) => solve_from_scratch(&domain, options),
                    refined => refined,
                }
            }
            _ => solve_from_scratch(&domain, options),
        };
        let reached = match reached {
            // The next finer level may be less thin.
            Err(FlattenError::NoStart { .. } | FlattenError::NoRoom { .. }) if id.index() > 0 => {
                maps.clear();
                weights.clear();
                convergences.clear();
                continue;
            }
            reached => reached?,
        };
        // In metres, so that the next level starts at the right size.
        let uv = domain.to_metres(&reached.uv);
        walls = reached.walls;
        fillers = walls.fillers(&domain, &uv).unwrap_or_default();
        maps.push(uv);
        weights.push(magnification.face_weights(&level.mesh));
        convergences.push(reached.convergence);
    }
    maps.reverse();
    weights.reverse();
    let placed = if prescribed.is_some() { maps.into() } else { align_levels(pyramid, &maps, &weights) };
    Ok(placed.into_iter().zip(convergences.into_iter().rev()).collect())
}

/// Normalises level 0 and turns the coarser maps so that their vertices lie near the same taxels of
/// level 0.
fn align_levels(
    pyramid: &Pyramid,
    maps: &[Uv],
    weights: &[Option<IdVec<FaceId, f64>>],
) -> IdVec<LevelId, Uv> {
    let mut placed: IdVec<LevelId, Uv> = IdVec::default();
    for ((level, uv), weights) in pyramid.levels.iter().zip(maps).zip(weights) {
        let direction = match placed.get(LevelId::new(0)) {
            None => main_direction(&level.mesh, uv),
            Some(finest) => direction_like(uv.iter().zip(level.origins.iter().map(|&v| &finest[v]))),
        };
        placed.push(normalise_map(&level.mesh, uv, direction, weights.as_ref()));
    }
    placed
}
