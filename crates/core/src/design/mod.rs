//! Designing a skin: modules on a surface, their wiring, and each chain unrolled in the plane.
//!
//! A [`Module`] does not stretch: it lies on the surface as a [`Plate`], bent as a cylinder, and no point of it is farther
//! from the surface than a tolerance. [`design`] grows a skin in space from several first modules (`starts`), each new one
//! across a free edge of another (`grow`), fitted for the largest distance (`fit`); it keeps the skin with the most modules,
//! grows further pieces in what is left, and wires each piece in chains or trees across shared edges (`chains`).
//! [`strips`] unrolls them at 1:1. A lattice on a map would be cut by its seams and stretched with it: on robot
//! links it leaves up to three quarters of its modules alone, which cannot be wired.
//!
//! The least largest distance of a triangle of side `L` is about `k2 L^2 / 16` where `k2` is the principal curvature of smaller
//! size, so the side that fits a tolerance `t` is `sqrt(16 t / k2)` ([`Design::sides`]): measured by linear programs over bending, tilt
//! and direction, for small slopes.
//!
//! Not guaranteed: that no more modules fit.

mod chains;
mod error;
mod fit;
mod grow;
mod module;
mod plate;
mod skin;
mod starts;
mod strips;
mod surface;

use glam::DVec3;

use crate::design::chains::{joints, pieces, wire};
use crate::design::fit::{Fitted, Shape};
use crate::design::grow::{Layout, MOST_MODULES};
use crate::design::starts::{on_area, settle, starts};
use crate::design::surface::Surface;
use crate::mesh::TriMesh;
use crate::parallel::par_map;
use crate::run::{Cancelled, Run};

pub use chains::{Chain, Step, Wiring};
pub use error::DesignError;
pub use module::Module;
pub use plate::Plate;
pub use skin::{PlacedModule, skin_draft};
pub use strips::{Strip, strips};

/// A piece of fewer modules is left out if there is a larger one: it would need a cable of its own.
const LEAST_PIECE: usize = 4;

/// Points of the surface at which its curvature is measured.
const CURVATURE_POINTS: usize = 400;

/// Places at which further pieces may begin, in each of at most so many rounds.
const FURTHER: usize = 100;
const FURTHER_ROUNDS: usize = 3;

/// What a module may do, and how modules are wired.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesignOptions {
    /// Largest distance of a point of a module from the surface, in m: what foam or glue takes up.
    pub tolerance: f64,
    /// Least radius to which a module bends, in m; `None`: modules are rigid.
    pub bend_radius: Option<f64>,
    /// Modules of a chain, and whether it may branch.
    pub wiring: Wiring,
}

impl Default for DesignOptions {
    fn default() -> Self {
        Self { tolerance: 1e-3, bend_radius: None, wiring: Wiring { most: 16, has_branches: false } }
    }
}

/// A module in its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Where it is, in the frame of the mesh.
    pub plate: Plate,
    /// Largest distance from the surface, in m.
    pub gap: f64,
    /// The piece it belongs to, counted from 0.
    pub piece: usize,
}

/// A skin of modules on one patch.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    /// The modules, chain after chain.
    pub modules: Vec<Placed>,
    /// The chains; numbers are those of `modules`.
    pub chains: Vec<Chain>,
    /// The pieces: modules that are connected across edges.
    pub pieces: usize,
    /// No wiring of these modules has fewer chains: they must hold all modules and, without branches, end where a module
    /// has one neighbour.
    pub bound: usize,
    /// Area of the patch, in m^2.
    pub area: f64,
    /// Share of it that modules cover.
    pub covered: f64,
    /// The sides of triangles that would fit on 90 % and on half of the area, in m; infinite where it can be unrolled.
    pub sides: [f64; 2],
}

impl Design {
    /// Largest distance of a module from the surface, in m.
    pub fn gap(&self) -> f64 {
        self.modules.iter().map(|placed| placed.gap).fold(0.0, f64::max)
    }

    /// Least radius to which a module is bent, in m; infinite if it is over 1 km: rounding bends flat modules, too.
    pub fn radius(&self) -> f64 {
        let curvature = self.modules.iter().map(|placed| placed.plate.curvature.abs()).fold(0.0, f64::max);
        if curvature < 1e-3 { f64::INFINITY } else { 1.0 / curvature }
    }
}

/// Covers a patch with modules and wires them.
///
/// ```
/// use dermatome::{design::{DesignOptions, Module, design}, mesh::shapes, run::Run};
///
/// let tube = shapes::tube(60, 20, 0.06, 0.1);
/// let module = Module::triangle(0.032);
/// let options = DesignOptions { bend_radius: Some(0.02), ..DesignOptions::default() };
/// let skin = design(&tube, &module, &options, Run::default())?;
/// assert!(skin.covered > 0.6 && skin.gap() <= options.tolerance);
/// assert_eq!(skin.pieces, 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the module or an option is not valid, the module is larger than the patch or fits nowhere, more than 100,000
/// would fit, the surface cannot be searched, or `run` is cancelled.
pub fn design(
    mesh: &TriMesh,
    module: &Module,
    options: &DesignOptions,
    run: Run<'_>,
) -> Result<Design, DesignError> {
    module.validate()?;
    options.validate()?;
    let area = mesh.area();
    check_size(mesh, module, area)?;
    if options.tolerance >= module.diameter() {
        let (tolerance_mm, module_mm) = (1e3 * options.tolerance, 1e3 * module.diameter());
        return Err(DesignError::TooLoose { tolerance_mm, module_mm });
    }
    let surface = Surface::new(mesh.clone())?;
    let points = module.rim().0.into_iter().chain(module.taxels.iter().copied()).collect();
    let max_curvature = options.bend_radius.map_or(0.0, |radius| 1.0 / radius);
    let shape = Shape {
        surface: &surface,
        points,
        fine: module.fine_rim(),
        tolerance: options.tolerance,
        max_curvature,
    };
    let sides = sides(module, &shape);
    let tried = starts(module, &shape);
    run.step()?;
    let first: Vec<&Fitted> = tried.iter().filter(|fitted| shape.accepts(fitted)).collect();
    let grow = |fitted: &&Fitted| -> Result<Layout<'_>, Cancelled> {
        let mut layout = Layout::new(module, &shape);
        layout.add(fitted);
        layout.grow(0, run)?;
        run.step()?;
        Ok(layout)
    };
    let mut best: Option<(usize, Layout<'_>)> = None;
    for grown in par_map(&first, grow) {
        let grown = grown?;
        let wired: usize = in_pieces(&grown).iter().map(Vec::len).sum();
        if best.as_ref().is_none_or(|(known, _)| wired > *known) {
            best = Some((wired, grown));
        }
    }
    let Some((_, mut layout)) = best else {
        let gap = tried.iter().map(|fitted| fitted.gap).fold(f64::INFINITY, f64::min);
        return Err(DesignError::NothingFits {
            gap_mm: 1e3 * gap,
            tolerance_mm: 1e3 * options.tolerance,
            side_mm: 1e3 * sides[1],
        });
    };
    add_pieces(&mut layout, module, &shape, run)?;
    Ok(finish(&layout, module, options, area, sides))
}

impl DesignOptions {
    fn validate(&self) -> Result<(), DesignError> {
        let chain = self.wiring.most as f64;
        let all = [
            ("the tolerance", self.tolerance),
            ("the bend radius", self.bend_radius.unwrap_or(1.0)),
            ("the number of modules of a chain", chain),
        ];
        match all.into_iter().find(|(_, found)| !(found.is_finite() && *found > 0.0)) {
            Some((what, found)) => Err(DesignError::Option { what, found }),
            None => Ok(()),
        }
    }
}

/// Refuses modules that are larger than the patch, and those so small that too many would fit.
fn check_size(mesh: &TriMesh, module: &Module, area: f64) -> Result<(), DesignError> {
    let least = mesh.positions.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let size = mesh.positions.iter().map(|p| *p - least).fold(DVec3::ZERO, DVec3::max).length();
    // Around a rod a module may be longer than the rod is wide, but not than it is long.
    if module.area() > area || module.diameter() > size.max(area.sqrt()) {
        return Err(DesignError::TooLarge {
            module_mm: 1e3 * module.diameter(),
            module_cm2: 1e4 * module.area(),
            patch_mm: 1e3 * size,
            patch_cm2: 1e4 * area,
        });
    }
    let modules = area / module.area();
    if modules > MOST_MODULES as f64 {
        return Err(DesignError::TooMany { modules, most: MOST_MODULES });
    }
    Ok(())
}

/// [`Design::sides`], from the curvature below flat modules spread over the area.
fn sides(module: &Module, shape: &Shape<'_>) -> [f64; 2] {
    let plates = on_area(module, shape, CURVATURE_POINTS, 1);
    let side = |plate: &Plate| {
        let found = shape.surface.curvature(plate, &shape.points)?;
        // A rigid plate follows neither curvature.
        let counts = if shape.max_curvature > 0.0 { found.least } else { found.most };
        Some((16.0 * shape.tolerance / counts.abs()).sqrt())
    };
    let mut all: Vec<f64> = par_map(&plates, side).into_iter().flatten().collect();
    all.sort_by(f64::total_cmp);
    [10, 50].map(|percent| all.get(percent * all.len() / 100).copied().unwrap_or(f64::NAN))
}

/// The pieces that are large enough to be wired, or the largest if none is.
fn in_pieces(layout: &Layout<'_>) -> Vec<Vec<usize>> {
    let mut all = pieces(layout.all.len(), &joints(layout.module, layout));
    let least = all.first().map_or(0, Vec::len).min(LEAST_PIECE);
    all.retain(|piece| piece.len() >= least);
    all
}

/// Grows further pieces where no module is.
fn add_pieces(
    layout: &mut Layout<'_>,
    module: &Module,
    shape: &Shape<'_>,
    run: Run<'_>,
) -> Result<(), Cancelled> {
    for round in 0..FURTHER_ROUNDS {
        let mut plates = on_area(module, shape, FURTHER, 2 + round as u64);
        let centre = module.centre();
        plates.retain(|plate| !layout.is_taken(plate.point(centre), module.depth(centre)));
        let found = par_map(&plates, |plate| settle(shape, *plate));
        let mut has_grown = false;
        for fitted in found.into_iter().flatten().filter(|fitted| shape.accepts(fitted)) {
            let before = layout.all.len();
            if layout.add(&fitted).is_some() {
                layout.grow(before, run)?;
                if layout.all.len() - before < LEAST_PIECE {
                    // Too few, unless they touch what is there.
                    let mut kept = in_pieces(layout).concat();
                    kept.sort_unstable();
                    *layout = layout.of(&kept);
                }
                has_grown |= layout.all.len() > before;
            }
        }
        if !has_grown {
            break;
        }
    }
    Ok(())
}

/// Wires the pieces and numbers the modules chain after chain.
fn finish(
    layout: &Layout<'_>,
    module: &Module,
    options: &DesignOptions,
    area: f64,
    sides: [f64; 2],
) -> Design {
    let joints = joints(module, layout);
    let count = layout.all.len();
    let pieces = in_pieces(layout);
    let (mut modules, mut chains, mut bound) = (Vec::new(), Vec::new(), 0);
    let mut number = vec![0; count];
    for (piece, members) in pieces.iter().enumerate() {
        let (wired, least) = wire(members, &joints, count, options.wiring, piece as u64);
        bound += least;
        for chain in wired {
            for &m in &chain.modules {
                number[m] = modules.len();
                let member = &layout.all[m];
                modules.push(Placed { plate: member.plate, gap: member.gap, piece });
            }
            chains.push(Chain {
                modules: chain.modules.iter().map(|&m| number[m]).collect(),
                steps: chain
                    .steps
                    .iter()
                    .map(|s| Step { modules: s.modules.map(|m| number[m]), ..*s })
                    .collect(),
            });
        }
    }
    let covered = modules.len() as f64 * module.area() / area;
    Design { modules, chains, pieces: pieces.len(), bound, area, covered, sides }
}
