use glam::DVec2;

use crate::{
    flatten::{
        Energy, FlattenError, FlattenOptions, Overlap,
        bijective::minimise::minimise_apart,
        bijective::overlap::{keeps_holes, overlaps, winds_once},
        domain::flatten_domain::Surface,
        domain::magnification::Magnification,
        energy::density::Density,
        energy::newton::{Limits, Solver},
        energy::objective::Problem,
        levels::insertion::Insertion,
        start::conformal::spectral_conformal,
        start::tutte::tutte,
        start::untangle::untangle,
    },
    id::{IdVec, VertexId},
    pyramid::Level,
    sparse::SparseError,
};

/// Systems up to this size are factored; above, conjugate gradients reach the same energy sooner.
const FACTORED: usize = 10_000;

/// Newton steps with a factored system: 3 to 10 are usual from a conformal start, 30 to 80 from a convex one.
const EXACT: Limits = Limits { decrement: 1e-12, steps: 200 };

/// Newton steps on a level too large to factor. From the optimum of the next coarser level four to eight end within 1e-5
/// of the optimum (measured at 100k faces); a convex start needs many more.
const TRUNCATED: Limits = Limits { decrement: 1e-6, steps: 100 };

/// Newton steps between two stages of an insertion: they only have to make room.
const STAGE: Limits = Limits { decrement: 1e-3, steps: 12 };

/// Vertices of a stage over those of the one before, where a level cannot be inserted at once.
const STAGE_GROWTH: f64 = 1.5;

/// Levels up to this size are also flattened from nothing: the coarsest level of a tube may fold into a local minimum that
/// every finer level would inherit, and a few dozen milliseconds find out.
const RESTARTED: usize = 3000;

/// The map of least energy of a surface, from nothing, in its units.
pub(crate) fn from_nothing(
    surface: &Surface<'_>,
    options: &FlattenOptions,
) -> Result<IdVec<VertexId, DVec2>, FlattenError> {
    let mut uv = spectral_conformal(surface)?;
    make_sound(surface, &mut uv)?;
    relax(surface, &mut uv, options, None)?;
    Ok(uv)
}

/// The map of least energy of `level`, in units of `surface`, from the map (m) of the next coarser level. `magnification` is
/// the level's, and `surface` has it already: only the stages between two levels need it.
///
/// Of a small level, and of one that lies over itself or had to be held apart around a hole, the better of this map and one
/// [`from_nothing`] is kept.
/// Usually every vertex finds its place at once. Where one does not, the level is inserted in stages with a few Newton
/// steps between them, and what still flips is untangled; a stage that resists starts again inside a circle.
pub(crate) fn refine(
    surface: &Surface<'_>,
    level: &Level,
    coarse: &Level,
    uv: &IdVec<VertexId, DVec2>,
    magnification: &Magnification,
    options: &FlattenOptions,
) -> Result<IdVec<VertexId, DVec2>, FlattenError> {
    let start = Insertion::new(level, coarse, uv);
    let mut insertion = start.clone();
    if insertion.undo_until(0) > 0 {
        insertion = start;
        while insertion.left() > 0 {
            stage(&mut insertion, magnification, options)?;
        }
    }
    let mut uv = insertion.map.map(|&p| p / surface.unit);
    make_sound(surface, &mut uv)?;
    let boundary = relax(surface, &mut uv, options, None)?;
    // Held apart, the rim of a hole may get stuck: one tapered tube ended at an energy of 16.8 instead of 9.6.
    let may_be_stuck = boundary == Boundary::HeldApart && surface.disk.loops.len() > 1;
    if surface.vertices() > RESTARTED && !may_be_stuck && overlaps(surface.mesh, &uv) == 0 {
        return Ok(uv);
    }
    let other = from_nothing(surface, options)?;
    let merit = |uv: &IdVec<VertexId, DVec2>| (overlaps(surface.mesh, uv), energy(surface, uv, options));
    let (inherited, fresh) = (merit(&uv), merit(&other));
    let is_better = fresh.0 < inherited.0 || (fresh.0 == inherited.0 && fresh.1 < inherited.1);
    Ok(if is_better { other } else { uv })
}

/// The energy of a map, without any barrier.
fn energy(surface: &Surface<'_>, uv: &IdVec<VertexId, DVec2>, options: &FlattenOptions) -> f64 {
    Problem::new(&surface.net, Density::new(options), perimeter(options)).energy(uv)
}

/// The symmetric Dirichlet energy stands alone: it has no perimeter term.
fn perimeter(options: &FlattenOptions) -> f64 {
    match options.energy {
        Energy::Sum => options.perimeter,
        Energy::SymmetricDirichlet => 0.0,
    }
}

/// Undoes a part of the removals and makes the map of what is there free of flips and roughly optimal.
fn stage(
    insertion: &mut Insertion<'_>,
    magnification: &Magnification,
    options: &FlattenOptions,
) -> Result<(), FlattenError> {
    let present = insertion.map.len() - insertion.left();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a fraction of a vertex count"
    )]
    let more = ((STAGE_GROWTH - 1.0) * present as f64).ceil() as usize;
    insertion.undo_until(insertion.left().saturating_sub(more.max(1)));
    if insertion.left() == 0 {
        return Ok(());
    }
    let (mesh, vertices) = insertion.mesh();
    let factors = magnification.of_vertices(&vertices).of_faces(&mesh);
    let surface = Surface::new(&mesh)?.magnified(&factors);
    let mut uv: IdVec<VertexId, DVec2> = vertices.iter().map(|&v| insertion.map[v] / surface.unit).collect();
    make_sound(&surface, &mut uv)?;
    relax(&surface, &mut uv, options, Some(STAGE))?;
    for (&v, &p) in vertices.iter().zip(&uv) {
        insertion.map[v] = p * surface.unit;
    }
    Ok(())
}

/// Removes flips locally if that is possible, else by starting again inside a circle.
///
/// Flipped faces can be turned back so that the map winds twice about some vertices, and so does the conformal map of a coarse
/// tube. Newton steps, which flip nothing, would keep it so: that is no start either.
fn make_sound(surface: &Surface<'_>, uv: &mut IdVec<VertexId, DVec2>) -> Result<(), FlattenError> {
    if !(untangle(surface, uv).map_err(failed)? && winds_once(surface, uv)) {
        *uv = tutte(surface)?;
    }
    Ok(())
}

/// How the boundary of a map found its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Boundary {
    Free,
    /// Its parts had to repel each other.
    HeldApart,
}

/// Minimises the energy of the options from a map without flips.
///
/// Where the result overlaps although that is to be prevented, or a hole does not stay a hole, the energy is minimised again,
/// with a barrier, from the same start, or from inside a circle if that start overlaps too. A hole cannot be left to the
/// energy alone: the rim of a long tube's hole is pressed together, and gains by sliding through itself until the map around
/// it lies over the rest.
fn relax(
    surface: &Surface<'_>,
    uv: &mut IdVec<VertexId, DVec2>,
    options: &FlattenOptions,
    limits: Option<Limits>,
) -> Result<Boundary, FlattenError> {
    let perimeter = perimeter(options);
    let density = Density::new(options);
    let (solver, usual) =
        if surface.vertices() <= FACTORED { (Solver::Direct, EXACT) } else { (Solver::Iterative, TRUNCATED) };
    let limits = limits.unwrap_or(usual);
    let start = uv.clone();
    Problem::new(&surface.net, density, perimeter).minimise(uv, solver, limits).map_err(failed)?;
    let is_over_itself = |uv: &IdVec<VertexId, DVec2>| overlaps(surface.mesh, uv) > 0;
    let is_good = match options.overlap {
        Overlap::Allowed => keeps_holes(surface, uv),
        Overlap::Prevented => !is_over_itself(uv),
    };
    if is_good {
        return Ok(Boundary::Free);
    }
    *uv = if is_over_itself(&start) { tutte(surface)? } else { start };
    minimise_apart(&surface.net, density, perimeter, uv, solver, limits).map_err(failed)?;
    Ok(Boundary::HeldApart)
}

fn failed(source: SparseError) -> FlattenError {
    FlattenError::System { method: "intrinsic", source }
}
