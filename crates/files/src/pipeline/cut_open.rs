//! Decides where to cut a patch, by trial maps of a level of a few thousand vertices.

use std::borrow::Cow;

use glam::DVec3;

use crate::Error;
use crate::cut::{Cut, CutMesh, Recipe, decide, may_be_poor, seam_costs, with_falling_ratios};
use crate::flatten::{Method, distortion, flatten_roughly};
use crate::mesh::TriMesh;
use crate::pipeline::coarsened::{Coarsened, Flattened};
use crate::pipeline::options::BuildOptions;
use crate::pyramid::{CoarsenOptions, Level, LevelId, Pyramid, coarsen};
use crate::run::Run;
use crate::skin::Taxels;

/// Seams are decided on a level of about this many vertices: a trial map of it takes a tenth of a
/// second, and its seam differs little from that of the skin.
const DECISION_VERTICES: usize = 2000;

/// Vertices of a level over those of the next, about: a level within this factor of [`DECISION_VERTICES`] is of that size.
const USUAL_FACTOR: f64 = 4.0;

/// Seams are also sought on the skin itself, up to this many vertices, where none of the level keeps a ratio: a cone is
/// sharper there. More would take minutes.
const MAX_ON_SKIN: usize = 10_000;

/// The level of a mesh on which seams are decided; `None` where that is the mesh itself. It is taken from the pyramid of
/// the uncut mesh where there is one with a level of that size.
fn decided_level<'a>(
    mesh: &TriMesh,
    taxels: &Taxels,
    whole: Option<&'a Pyramid>,
    run: Run<'_>,
) -> Result<Option<Cow<'a, Level>>, Error> {
    let factor = |level: &Level| (level.mesh.positions.len() as f64 / DECISION_VERTICES as f64).ln().abs();
    let nearest =
        whole.and_then(|whole| whole.levels.enumerate().min_by(|a, b| factor(a.1).total_cmp(&factor(b.1))));
    if let Some((id, level)) = nearest.filter(|(_, level)| factor(level) <= USUAL_FACTOR.ln()) {
        return Ok((id != LevelId::new(0)).then_some(Cow::Borrowed(level)));
    }
    // In steps of a factor of about four.
    let factor = mesh.positions.len() as f64 / DECISION_VERTICES as f64;
    if factor < 1.6 {
        return Ok(None);
    }
    let steps = factor.log(USUAL_FACTOR).ceil().max(1.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
    let options = CoarsenOptions {
        ratio: Some(factor.powf(steps.recip()).max(1.5)),
        levels: Some(steps as usize),
        coarsest: 1,
    };
    Ok(coarsen(mesh, taxels, &options, run)?.levels.into_iter().last().map(Cow::Owned))
}

/// Whether a mesh is a plain disk that stays uncut, judged by its pyramid; most do, and need no trial map.
pub(super) fn stays_whole(
    mesh: &TriMesh,
    taxels: &Taxels,
    whole: &Pyramid,
    run: Run<'_>,
) -> Result<bool, Error> {
    let level = decided_level(mesh, taxels, Some(whole), run)?;
    Ok(!may_be_poor(level.as_ref().map_or(mesh, |level| &level.mesh)))
}

/// Cuts a mesh open where trial maps show that this is needed or pays; `None` if it is mapped uncut.
/// Seams prefer skin that faces `side`, a unit vector; `whole` is the pyramid of the uncut mesh, if it is made already.
/// With a limit of area ratios also returns the one that the cut was judged by.
/// Fails if the mesh is not an oriented manifold in one piece, or not a disk with holes after the cut.
pub(super) fn cut_open(
    mesh: &TriMesh,
    taxels: &Taxels,
    whole: Option<&Pyramid>,
    side: Option<DVec3>,
    options: &BuildOptions,
    run: Run<'_>,
) -> Result<(Option<CutMesh>, Option<f64>), Error> {
    let BuildOptions { cut, .. } = options;
    cut.validate()?;
    if *cut == Cut::None {
        return Ok((None, None));
    }
    let costs = seam_costs(taxels, side);
    let level = decided_level(mesh, taxels, whole, run)?;
    let of_level = level.as_ref().zip(costs.as_ref());
    let of_level = of_level.map(|(level, costs)| level.origins.map(|&v| costs[v]));
    // A seam is as good as the best map after it, which may overlap itself.
    let map = |mesh: &TriMesh, most: f64| flatten_roughly(mesh, most, run).ok();
    let made = |recipe: &Recipe, level: Option<&Level>| match level {
        None => recipe.cut(mesh, costs.as_ref()),
        Some(level) => recipe.on_finer(&level.origins).cut(mesh, costs.as_ref()),
    };
    let Cut::AreaRatio(limit) = *cut else {
        let decided = match &level {
            None => decide(mesh, costs.as_ref(), cut, &map),
            Some(level) => decide(&level.mesh, of_level.as_ref(), cut, &map),
        };
        run.check()?;
        return Ok((made(&decided?, level.as_deref())?, None));
    };
    let judged = |cut: &Option<CutMesh>| area_ratio(mesh, taxels, cut.as_ref(), options, run);
    let mut search = RatioSearch { limit, judged: &judged, best: None };
    if let Some(level) = level.as_deref() {
        let consider = &mut |seam: &Recipe| Ok(run.check().is_ok() && search.takes(made(seam, Some(level))?));
        with_falling_ratios(&level.mesh, of_level.as_ref(), &map, consider)?;
    }
    if level.is_none() || mesh.positions.len() <= MAX_ON_SKIN && !search.is_kept() {
        let consider = &mut |seam: &Recipe| Ok(run.check().is_ok() && search.takes(made(seam, None)?));
        with_falling_ratios(mesh, costs.as_ref(), &map, consider)?;
    }
    run.check()?;
    Ok(search.best.map_or((None, None), |(ratio, cut)| (cut, Some(ratio))))
}

/// Of the cuts that are shown, in an order that does not depend on the limit, the one with the least area ratio up to the
/// first that keeps the limit: a lower limit gives no larger ratio than a higher one.
struct RatioSearch<'a> {
    limit: f64,
    /// The area ratio of the map after a cut.
    judged: &'a dyn Fn(&Option<CutMesh>) -> f64,
    best: Option<(f64, Option<CutMesh>)>,
}

impl RatioSearch<'_> {
    fn is_kept(&self) -> bool {
        self.best.as_ref().is_some_and(|(ratio, _)| *ratio <= self.limit)
    }

    /// Judges a cut, and keeps it if it is the best; whether another one is needed.
    fn takes(&mut self, cut: Option<CutMesh>) -> bool {
        let ratio = (self.judged)(&cut);
        if self.best.as_ref().is_none_or(|(least, _)| ratio < *least) {
            self.best = Some((ratio, cut));
        }
        !self.is_kept()
    }
}

/// The largest area ratio of the map that is built after a cut, without magnification, which changes areas on purpose;
/// infinite without a map.
fn area_ratio(
    mesh: &TriMesh,
    taxels: &Taxels,
    cut: Option<&CutMesh>,
    options: &BuildOptions,
    run: Run<'_>,
) -> f64 {
    let mut flatten = options.flatten.clone();
    if let Method::Intrinsic { magnify, .. } = &mut flatten.method {
        *magnify = 0.0;
    }
    let taxels = Taxels { acuities: None, ..taxels.clone() };
    let ratio = || -> Result<f64, Error> {
        let coarsened = Coarsened::new(mesh, &taxels, cut, &options.coarsen, run)?;
        let Flattened { levels, maps } = coarsened.flattened(&taxels, &flatten, run)?;
        let finest = levels.first().zip(maps.iter().next());
        Ok(finest.map_or(f64::INFINITY, |((level, cut), map)| {
            let opened = cut.as_ref().map(|cut| cut.mesh(&level.mesh.positions));
            distortion(opened.as_ref().unwrap_or(&level.mesh), &map.uv).area_max
        }))
    };
    ratio().unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Adjacency;

    /// Both sides of a rectangle, 150 times as long as it is wide: the shortest seam is one edge, which
    /// opens nothing.
    #[test]
    fn a_flat_closed_needle_is_opened() {
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let corners = vec![at(0.0, 0.0), at(4.53e-4, 0.0), at(4.53e-4, 3e-6), at(0.0, 3e-6)];
        let mesh = TriMesh::from_arrays(corners, &[[1, 0, 2], [2, 0, 3], [2, 3, 1], [1, 3, 0]]);
        let taxels = Taxels::from(&mesh);
        let cut = cut_open(&mesh, &taxels, None, None, &BuildOptions::default(), Run::default()).unwrap();
        let opened = Adjacency::new(&cut.0.unwrap().mesh(&mesh.positions)).unwrap();
        assert_eq!((opened.euler_characteristic(), opened.boundary_loops().len()), (1, 1));
    }
}
