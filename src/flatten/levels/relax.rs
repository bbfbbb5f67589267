//! Least energy on one level: from a map without flips, or from scratch.

use crate::{
    flatten::{
        Energy, FlattenError, FlattenOptions, Method,
        bijective::{
            barrier::minimise_bijective,
            overlap::{has_no_branch_points, keeps_holes, overlaps},
        },
        domain::elements::Uv,
        domain::flatten_domain::FlattenDomain,
        energy::{
            newton::{NewtonLimits, Solver},
            objective::Objective,
        },
        start::{conformal::spectral_conformal, linear::linear, tutte::tutte, untangle::untangle},
    },
    sparse::SparseError,
};

/// Systems up to this size are factored; above, conjugate gradients reach the same energy sooner.
const FACTORED: usize = 10_000;

/// Newton steps with a factored system: 3 to 10 are usual from a conformal start, 30 to 80 from a
/// convex one.
const EXACT: NewtonLimits = NewtonLimits { decrement: 1e-12, steps: 200 };

/// Newton steps on a level too large to factor. From the optimum of the next coarser level four to
/// eight end within 1e-5 of the optimum (measured at 100k faces); a convex start needs many more.
const TRUNCATED: NewtonLimits = NewtonLimits { decrement: 1e-6, steps: 100 };

/// What the intrinsic method minimises, and what it must keep.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Goal {
    pub(crate) energy: Energy,
    /// Whether the map must not overlap itself.
    pub(crate) bijective: bool,
}

/// A map without flips after Newton steps, in units of its domain.
#[derive(Debug)]
pub(crate) struct Relaxed {
    pub(crate) uv: Uv,
    /// Whether parts of the boundary had to repel each other.
    pub(crate) used_barrier: bool,
}

/// The map of a surface by the method of the options, in units of its domain, without any other map
/// to start from.
pub(crate) fn solve_from_scratch(
    domain: &FlattenDomain<'_>,
    options: &FlattenOptions,
) -> Result<Uv, FlattenError> {
    match options.method {
        Method::Conformal => spectral_conformal(domain),
        Method::Linear { angle, area } => linear(domain, angle, area),
        Method::Intrinsic { energy, .. } => {
            minimise_from_scratch(domain, Goal { energy, bijective: options.bijective })
        }
    }
}

/// The map of least energy from the conformal start.
pub(crate) fn minimise_from_scratch(domain: &FlattenDomain<'_>, goal: Goal) -> Result<Uv, FlattenError> {
    let start = make_locally_injective(domain, spectral_conformal(domain)?)?;
    Ok(relax(domain, start, goal, None)?.uv)
}

/// Removes flips locally if that is possible, else starts again inside a circle.
///
/// Flipped faces can be turned back so that the map winds twice about some vertices (branch
/// points), and so does the conformal map of a coarse tube. Newton steps, which flip nothing, would
/// keep it so: that is not a start either.
pub(crate) fn make_locally_injective(domain: &FlattenDomain<'_>, mut uv: Uv) -> Result<Uv, FlattenError> {
    let is_flip_free = untangle(domain, &mut uv).map_err(failed)?;
    if is_flip_free && has_no_branch_points(domain, &uv) { Ok(uv) } else { tutte(domain) }
}

/// Minimises the energy from a map without flips; `limits` instead of the usual ones for the size.
///
/// Where the result overlaps although it must not, or a hole does not stay a hole, the energy is
/// minimised again with a barrier, from the same start, or from inside a circle if that start
/// overlaps too. A hole cannot be left to the energy alone: the rim of a long tube's hole is
/// pressed together, and gains by sliding through itself until the map around it overlaps the rest.
pub(crate) fn relax(
    domain: &FlattenDomain<'_>,
    start: Uv,
    goal: Goal,
    limits: Option<NewtonLimits>,
) -> Result<Relaxed, FlattenError> {
    let (solver, usual) =
        if domain.vertices() <= FACTORED { (Solver::Direct, EXACT) } else { (Solver::Iterative, TRUNCATED) };
    let limits = limits.unwrap_or(usual);
    let overlaps_itself = |uv: &Uv| overlaps(domain.mesh, uv) > 0;

    let mut uv = start.clone();
    Objective::new(&domain.elements, goal.energy).minimise(&mut uv, solver, limits).map_err(failed)?;
    let is_good = if goal.bijective { !overlaps_itself(&uv) } else { keeps_holes(domain, &uv) };
    if is_good {
        return Ok(Relaxed { uv, used_barrier: false });
    }
    let mut uv = if overlaps_itself(&start) { tutte(domain)? } else { start };
    minimise_bijective(&domain.elements, goal.energy, &mut uv, solver, limits).map_err(failed)?;
    Ok(Relaxed { uv, used_barrier: true })
}

fn failed(source: SparseError) -> FlattenError {
    FlattenError::System { method: "intrinsic", source }
}
