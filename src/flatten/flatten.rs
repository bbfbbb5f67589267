use glam::DVec2;

use crate::{
    flatten::{
        FlattenError, FlattenOptions, Method, Overlap,
        bijective::overlap::overlaps,
        domain::flatten_domain::Surface,
        domain::magnification::Magnification,
        levels::refine::{from_nothing, refine},
        placement::{direction_like, main_direction, place},
        start::conformal::spectral_conformal,
        start::linear::linear,
    },
    id::{IdVec, VertexId},
    mesh::TriMesh,
    pyramid::{CoarsenOptions, Level, LevelId, Pyramid, coarsen},
    skin::{LinkId, Patch},
};

/// Meshes up to this size are flattened at once, larger ones through a pyramid: about where both take equally long.
const AT_ONCE: usize = 3000;

/// Flattens one mesh: map positions in m, isometric in scale on average, never mirrored.
///
/// The intrinsic method never flips a face. A conformal or linear map may: [`crate::flatten::distortion`] tells. The
/// boundary may cross itself unless [`FlattenOptions::overlap`] prevents it.
///
/// # Errors
/// If the mesh is no disk with holes, an option is out of range, a face is too degenerate to be mapped, or the map lies over
/// itself although that was to be prevented.
pub fn flatten(mesh: &TriMesh, options: &FlattenOptions) -> Result<IdVec<VertexId, DVec2>, FlattenError> {
    options.validate()?;
    if options.method == Method::Intrinsic && mesh.positions.len() > AT_ONCE {
        // Refuse a mesh that is no disk before the work of coarsening it.
        crate::flatten::domain::disk::Disk::new(mesh)?;
        let mut patch = Patch::from_mesh("", LinkId::new(0), mesh.clone());
        // A vertex between faces without area still needs a field.
        let least = mesh.area() / mesh.positions.len() as f64 * f64::EPSILON;
        patch.taxels.areas.iter_mut().for_each(|a| *a = a.max(least));
        let pyramid = coarsen(&patch, &CoarsenOptions::default())?;
        let maps = flatten_pyramid(&pyramid, None, options)?;
        return Ok(maps.into_iter().next().unwrap_or_default());
    }
    let magnification = Magnification::new(options, None, &mesh.vertex_areas())?;
    let surface = Surface::new(mesh)?.magnified(&magnification.of_faces(mesh));
    let uv = first_map(&surface, options)?;
    let placed = place(mesh, &uv, main_direction(mesh, &uv));
    check_overlap(mesh, &placed, options)?;
    Ok(placed)
}

/// Refuses a map that lies over itself where that was to be prevented: what is promised is measured on the final numbers.
fn check_overlap(
    mesh: &TriMesh,
    uv: &IdVec<VertexId, DVec2>,
    options: &FlattenOptions,
) -> Result<(), FlattenError> {
    let crossings = match options.overlap {
        Overlap::Allowed => 0,
        Overlap::Prevented => overlaps(mesh, uv),
    };
    if crossings > 0 { Err(FlattenError::Overlap { crossings }) } else { Ok(()) }
}

/// The map of a mesh by itself, in units of its surface.
fn first_map(
    surface: &Surface<'_>,
    options: &FlattenOptions,
) -> Result<IdVec<VertexId, DVec2>, FlattenError> {
    match options.method {
        Method::Conformal => spectral_conformal(surface),
        Method::Linear => linear(surface, options),
        Method::Intrinsic => from_nothing(surface, options),
    }
}

/// Puts level 0 in its place and turns the coarser maps so that their vertices lie near the same taxels of level 0.
fn lay_alike(pyramid: &Pyramid, maps: &[IdVec<VertexId, DVec2>]) -> IdVec<LevelId, IdVec<VertexId, DVec2>> {
    let mut placed: IdVec<LevelId, IdVec<VertexId, DVec2>> = IdVec::new();
    for (level, uv) in pyramid.levels.iter().zip(maps) {
        let direction = match placed.get(LevelId::new(0)) {
            None => main_direction(&level.mesh, uv),
            Some(finest) => direction_like(uv.iter().zip(level.origins.iter().map(|&v| &finest[v]))),
        };
        placed.push(place(&level.mesh, uv, direction));
    }
    placed
}

/// Flattens every level of a pyramid, coarse to fine. `densities` of the level-0 vertices drive
/// [`FlattenOptions::magnify`]; without them the areas do.
///
/// All levels lie alike: what is left of a coarse map is left of the fine one.
///
/// # Errors
/// If the patch is no disk with holes, an option or a density is out of range, a face is too degenerate to be mapped, or a
/// map lies over itself although that was to be prevented.
pub fn flatten_pyramid(
    pyramid: &Pyramid,
    densities: Option<&IdVec<VertexId, f64>>,
    options: &FlattenOptions,
) -> Result<IdVec<LevelId, IdVec<VertexId, DVec2>>, FlattenError> {
    options.validate()?;
    let Some(finest) = pyramid.levels.get(LevelId::new(0)) else {
        return Ok(IdVec::new());
    };
    let magnification = Magnification::new(options, densities, &finest.areas)?;
    let mut maps: Vec<IdVec<VertexId, DVec2>> = Vec::new();
    let mut coarser: Option<&Level> = None;
    for level in pyramid.levels.iter().rev() {
        let magnification = magnification.restricted(level, &finest.areas);
        let surface = Surface::new(&level.mesh)?.magnified(&magnification.of_faces(&level.mesh));
        let uv = match (coarser, maps.last()) {
            (Some(coarse), Some(uv)) if options.method == Method::Intrinsic => {
                refine(&surface, level, coarse, uv, &magnification, options)?
            }
            _ => first_map(&surface, options)?,
        };
        // In metres, so that the next level starts at the right size.
        maps.push(uv.map(|&p| p * surface.unit));
        coarser = Some(level);
    }
    maps.reverse();
    let placed = lay_alike(pyramid, &maps);
    for (level, uv) in pyramid.levels.iter().zip(&placed) {
        check_overlap(&level.mesh, uv, options)?;
    }
    Ok(placed)
}
