//! The two entry points: one mesh, or every level of a pyramid, coarse to fine.

use glam::DVec2;

use crate::{
    flatten::{
        FlattenError, FlattenOptions, Method,
        bijective::overlap::overlaps,
        domain::{disk::Disk, elements::Uv, flatten_domain::FlattenDomain, magnification::Magnification},
        levels::{
            insertion::Insertion,
            refine::refine,
            relax::{Goal, solve_from_scratch},
        },
        placement::{direction_like, main_direction, normalise_map},
    },
    id::{IdVec, VertexId},
    mesh::TriMesh,
    pyramid::{CoarsenOptions, LevelId, Pyramid, PyramidError, coarsen},
    skin::Taxels,
};

/// Meshes up to this size are flattened at once, larger ones through a pyramid: about where both
/// take equally long.
const AT_ONCE: usize = 3000;

/// Flattens one mesh: map positions in m, isometric in scale on average, never mirrored.
///
/// The intrinsic method never flips a face. A conformal or linear map may:
/// [`distortion()`](crate::flatten::distortion()) counts the flips. The map may overlap itself
/// unless [`FlattenOptions::bijective`] is set.
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
/// If the mesh is not a disk with holes, an option is out of range, a face is too degenerate to be
/// mapped, or the map overlaps itself although it must not.
pub fn flatten(mesh: &TriMesh, options: &FlattenOptions) -> Result<IdVec<VertexId, DVec2>, FlattenError> {
    options.validate()?;
    if matches!(options.method, Method::Intrinsic { .. }) && mesh.positions.len() > AT_ONCE {
        // Refuse a mesh that is not a disk before the work of coarsening it.
        Disk::new(mesh)?;
        let maps = flatten_pyramid(&pyramid_of(mesh)?, None, options)?;
        return Ok(maps.into_iter().next().unwrap_or_default());
    }
    let magnification = Magnification::new(options.method, None, &mesh.vertex_areas())?;
    let domain = FlattenDomain::new(mesh)?.magnified(&magnification.of_faces(mesh));
    let uv = solve_from_scratch(&domain, options)?;
    let placed = normalise_map(mesh, &uv, main_direction(mesh, &uv));
    check_overlap(mesh, &placed, options)?;
    Ok(placed)
}

/// The pyramid of a mesh with a taxel at every vertex.
fn pyramid_of(mesh: &TriMesh) -> Result<Pyramid, FlattenError> {
    let mut taxels = Taxels::of_mesh(mesh);
    // A vertex between faces without area still needs a field.
    let least = mesh.area() / mesh.positions.len() as f64 * f64::EPSILON;
    taxels.areas.iter_mut().for_each(|a| *a = a.max(least));
    Ok(coarsen(mesh, &taxels, &CoarsenOptions::default())?)
}

/// Refuses a map that overlaps itself although it must not: the promise is checked on the final
/// numbers.
fn check_overlap(mesh: &TriMesh, uv: &Uv, options: &FlattenOptions) -> Result<(), FlattenError> {
    let crossings = if options.bijective { overlaps(mesh, uv) } else { 0 };
    if crossings > 0 { Err(FlattenError::Overlap { crossings }) } else { Ok(()) }
}

/// Flattens every level of a pyramid, coarse to fine. `densities` of the level-0 vertices drive the
/// magnification of [`Method::Intrinsic`]; without them the areas do.
///
/// All levels are aligned: what is left on a coarse map is left on the fine one.
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
/// let pyramid = coarsen(&skin, &Taxels::of_mesh(&skin), &CoarsenOptions::default())?;
/// let maps = flatten_pyramid(&pyramid, None, &FlattenOptions::default())?;
/// for (level, uv) in pyramid.levels.iter().zip(&maps) {
///     assert_eq!(distortion(&level.mesh, uv).flips, 0);
/// }
/// # Ok::<(), dermatome::Error>(())
/// ```
///
/// # Errors
/// If the patch is not a disk with holes, an option or a density is out of range, a face is too
/// degenerate to be mapped, or a map overlaps itself although it must not.
pub fn flatten_pyramid(
    pyramid: &Pyramid,
    densities: Option<&IdVec<VertexId, f64>>,
    options: &FlattenOptions,
) -> Result<IdVec<LevelId, IdVec<VertexId, DVec2>>, FlattenError> {
    options.validate()?;
    let Some(finest) = pyramid.levels.get(LevelId::new(0)) else {
        return Ok(IdVec::new());
    };
    let (found, needed) = (pyramid.removals.len(), pyramid.levels.len() - 1);
    if found != needed {
        return Err(PyramidError::Length { what: "removals", found, needed }.into());
    }
    let magnification = Magnification::new(options.method, densities, &finest.areas)?;
    let mut maps: Vec<Uv> = Vec::new();
    for (id, level) in pyramid.levels.enumerate().rev() {
        let magnification = magnification.restricted(level, &finest.areas);
        let domain = FlattenDomain::new(&level.mesh)?.magnified(&magnification.of_faces(&level.mesh));
        let coarser = pyramid.levels.get(LevelId::new(id.index() + 1)).zip(maps.last());
        let uv = match (options.method, coarser) {
            (Method::Intrinsic { energy, .. }, Some((coarse, uv))) => {
                let goal = Goal { energy, bijective: options.bijective };
                let start = Insertion::new(level, &pyramid.removals[id], coarse, uv)?;
                refine(&domain, start, &magnification, goal)?
            }
            _ => solve_from_scratch(&domain, options)?,
        };
        // In metres, so that the next level starts at the right size.
        maps.push(domain.to_metres(&uv));
    }
    maps.reverse();
    let placed = align_levels(pyramid, &maps);
    for (level, uv) in pyramid.levels.iter().zip(&placed) {
        check_overlap(&level.mesh, uv, options)?;
    }
    Ok(placed)
}

/// Normalises level 0 and turns the coarser maps so that their vertices lie near the same taxels of
/// level 0.
fn align_levels(pyramid: &Pyramid, maps: &[Uv]) -> IdVec<LevelId, Uv> {
    let mut placed: IdVec<LevelId, Uv> = IdVec::new();
    for (level, uv) in pyramid.levels.iter().zip(maps) {
        let direction = match placed.get(LevelId::new(0)) {
            None => main_direction(&level.mesh, uv),
            Some(finest) => direction_like(uv.iter().zip(level.origins.iter().map(|&v| &finest[v]))),
        };
        placed.push(normalise_map(&level.mesh, uv, direction));
    }
    placed
}
