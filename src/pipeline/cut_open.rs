//! Decides where to cut a patch, by trial maps of a level of a few thousand vertices.

use std::borrow::Cow;

use glam::DVec3;

use crate::Error;
use crate::cut::{Cut, CutMesh, Decision, Recipe, decide, may_be_poor, seam_costs};
use crate::flatten::{FlattenOptions, Method, distortion, flatten, flatten_roughly};
use crate::mesh::TriMesh;
use crate::pyramid::{CoarsenOptions, Level, LevelId, Pyramid, coarsen};
use crate::run::Run;
use crate::skin::Taxels;

/// Seams are decided on a level of about this many vertices: a trial map of it takes a tenth of a
/// second, and its seam differs little from that of the skin.
const DECISION_VERTICES: usize = 2000;

/// Vertices of a level over those of the next, about: a level within this factor of [`DECISION_VERTICES`] is of that size.
const USUAL_FACTOR: f64 = 4.0;

/// Most maps of the skin whose area ratio is measured: the first one shows how much higher it is than on the
/// level.
const MAX_MAPS: usize = 3;

/// No other seams are tried for a ratio above this: a surface keeps it, or has no map.
const MAX_EASED: f64 = 10.0;

/// Exponent of the wanted ratio that gives the one to aim at: a map that is made through the pyramid has a
/// slightly larger ratio than one made without.
const AIM_EXPONENT: f64 = 0.995;

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
/// Seams prefer skin that faces `side`, a unit vector; `options` are those of the map; `whole` is the pyramid of the
/// uncut mesh, if it is made already.
/// Fails if the mesh is not an oriented manifold in one piece, or not a disk with holes after the cut.
pub(super) fn cut_open(
    mesh: &TriMesh,
    taxels: &Taxels,
    whole: Option<&Pyramid>,
    cut: &Cut,
    side: Option<DVec3>,
    options: &FlattenOptions,
    run: Run<'_>,
) -> Result<Option<CutMesh>, Error> {
    cut.validate()?;
    if *cut == Cut::None {
        return Ok(None);
    }
    let costs = seam_costs(taxels, side);
    let level = decided_level(mesh, taxels, whole, run)?;
    let of_level = level.as_ref().zip(costs.as_ref());
    let of_level = of_level.map(|(level, costs)| level.origins.map(|&v| costs[v]));
    // A seam is as good as the best map after it, which may overlap itself.
    let map = |mesh: &TriMesh, most: f64| flatten_roughly(mesh, most, run).ok();
    let decided = |limit: Option<f64>| match &level {
        None => decide(mesh, costs.as_ref(), cut, &map, limit),
        Some(level) => decide(&level.mesh, of_level.as_ref(), cut, &map, limit),
    };
    let made = |recipe: &Recipe| match &level {
        None => recipe.cut(mesh, costs.as_ref()),
        Some(level) => recipe.on_finer(&level.origins).cut(mesh, costs.as_ref()),
    };
    let Cut::AreaRatio(limit) = *cut else {
        let decided = decided(None)?.pop();
        run.check()?;
        return Ok(decided.map(|decided| made(&decided.recipe)).transpose()?.flatten());
    };
    let mut best: Option<(f64, Option<CutMesh>)> = None;
    // The best seams of a ratio that is out of reach are often those of a larger one.
    let mut wanted = limit.powf(AIM_EXPONENT);
    while best.as_ref().is_none_or(|(ratio, _)| *ratio > wanted) {
        let mut aim = wanted;
        for _ in 0..MAX_MAPS {
            run.check()?;
            let mut tried = decided(Some(aim))?;
            let on_trial = tried.last().map_or(f64::INFINITY, |last| last.area_ratio);
            // If no trial map keeps the ratio, another seam may give the better map of the skin.
            if on_trial <= aim {
                tried = tried.split_off(tried.len() - 1);
            }
            let mut least = f64::INFINITY;
            for Decision { recipe, .. } in tried.iter().rev() {
                let cut = made(recipe)?;
                let area_ratio = area_ratio(mesh, taxels, cut.as_ref(), options, run);
                least = least.min(area_ratio);
                if best.as_ref().is_none_or(|(best, _)| area_ratio < *best) {
                    best = Some((area_ratio, cut));
                }
                if area_ratio <= wanted {
                    break;
                }
            }
            // If the trial map does not keep the ratio, a lower aim changes nothing.
            if least <= wanted || on_trial > aim || least.is_infinite() {
                break;
            }
            aim = on_trial.powf(wanted.ln() / least.ln());
        }
        if wanted > MAX_EASED {
            break;
        }
        wanted *= wanted;
    }
    Ok(best.and_then(|(_, cut)| cut))
}

/// The largest area ratio of the map of a mesh that is cut, without magnification, which changes areas on
/// purpose; infinite without a map.
fn area_ratio(
    mesh: &TriMesh,
    taxels: &Taxels,
    cut: Option<&CutMesh>,
    options: &FlattenOptions,
    run: Run<'_>,
) -> f64 {
    let opened = cut.map(|cut| (cut.mesh(&mesh.positions), taxels.select(&cut.unsplit)));
    let (mesh, taxels) = opened.as_ref().map_or((mesh, taxels), |(mesh, taxels)| (mesh, taxels));
    let mut options = options.clone();
    if let Method::Intrinsic { magnify, .. } = &mut options.method {
        *magnify = 0.0;
    }
    let taxels = Taxels { acuities: None, ..taxels.clone() };
    let map = flatten(mesh, Some(&taxels), &options, run);
    map.map_or(f64::INFINITY, |map| distortion(mesh, &map.uv).area_max)
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
        let cut = cut_open(
            &mesh,
            &Taxels::from(&mesh),
            None,
            &Cut::Auto,
            None,
            &FlattenOptions::default(),
            Run::default(),
        )
        .unwrap();
        let opened = Adjacency::new(&cut.unwrap().mesh(&mesh.positions)).unwrap();
        assert_eq!((opened.euler_characteristic(), opened.boundary_loops().len()), (1, 1));
    }
}
