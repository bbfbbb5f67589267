//! The attempts at the map of a patch, how they are judged, and which levels of a map are kept.

use crate::Error;
use crate::cut::{Cut, is_plain_disk};
use crate::flatten::{ABSURD, Distortion, Energy, FlattenError, FlattenOptions, Method, Overlap, POOR};
use crate::map::{MapError, MapLevel, PatchMap};
use crate::mesh::FARTHEST;
use crate::pipeline::options::{BuildOptions, Numbers};
use crate::pipeline::written::measure_as_written;
use crate::pyramid::{CoarsenOptions, LevelId};
use crate::skin::{Patch, Taxels};

/// Refuses a map whose file breaks what the intrinsic method promises.
fn check_promises(level: &MapLevel, options: &FlattenOptions) -> Result<(), Error> {
    let Distortion { flips, crossings: overlaps, .. } = level.distortion;
    let is_kept = flips == 0 && (overlaps == 0 || options.overlap == Overlap::Allow);
    if is_kept || !options.starts_coarse() {
        Ok(())
    } else {
        Err(FlattenError::NotInjective { flips, overlaps }.into())
    }
}

/// Vertices of a level over those of the next coarser one, where the default pyramid leads to an absurd map.
const GENTLE: f64 = 2.0;

/// Energies that differ by a smaller share are the same.
pub(super) const SAME: f64 = 0.01;

/// Another way to a map.
pub(super) struct Attempt {
    pub(super) options: BuildOptions,
    /// It is made where the best map so far has more energy than this.
    pub(super) good: f64,
    /// Whether it minimises the symmetric Dirichlet energy in place of the default one.
    pub(super) is_by_dirichlet: bool,
}

/// The attempts at a map after the first, in order, each as long as that one. *Heuristic*: loops that are joined leave
/// fewer holes to keep, and from a level of half the vertices, needles of CAD fold less (a foot of an iCub: energy
/// 59,876 with the default pyramid, 7.7 so). What is absurd, or fails, by the default energy is tried by the symmetric
/// Dirichlet energy, which keeps low faces from opening (needles of an iCub's chest, `icub_chest.dae` of icub-models:
/// 60.8 by the default energy, 4.2 by this one).
pub(super) fn attempts(patch: &Patch, options: &BuildOptions) -> Vec<Attempt> {
    if options.cut != Cut::Auto {
        return Vec::new();
    }
    let may_join = !is_plain_disk(&patch.mesh);
    let may_be_gentle = options.coarsen.ratio.is_none() && options.flatten.starts_coarse();
    let others = [(Cut::All, false), (Cut::All, true), (Cut::Auto, true)]
        .into_iter()
        .filter(|(cut, is_gentle)| (may_join || *cut == Cut::Auto) && (may_be_gentle || !is_gentle));
    let with = |(cut, is_gentle), method, is_by_dirichlet: bool| {
        let ratio = if is_gentle { Some(GENTLE) } else { options.coarsen.ratio };
        let coarsen = CoarsenOptions { ratio, ..options.coarsen.clone() };
        let flatten = FlattenOptions { method, ..options.flatten.clone() };
        let good = if is_by_dirichlet { ABSURD } else { POOR };
        Attempt { options: BuildOptions { cut, coarsen, flatten, ..options.clone() }, good, is_by_dirichlet }
    };
    let method = options.flatten.method;
    let mut attempts: Vec<_> = others.clone().map(|other| with(other, method, false)).collect();
    if let Method::Intrinsic { energy, magnify } = method
        && energy == Energy::default()
    {
        let method = Method::Intrinsic { energy: Energy::SymmetricDirichlet, magnify };
        let first = std::iter::once((Cut::Auto, false));
        attempts.extend(first.chain(others).map(|other| with(other, method, true)));
    }
    attempts
}

/// Whether areas of a patch change on purpose, so that its energy does not judge a map.
pub(super) fn is_magnified(taxels: &Taxels, options: &BuildOptions) -> bool {
    match options.flatten.method {
        Method::Intrinsic { magnify, .. } => magnify != 0.0 || taxels.relative_acuities().is_some(),
        Method::Linear { .. } | Method::Conformal => false,
    }
}

/// Symmetric Dirichlet energy of the finest level of a map; infinite without one, and 0 where areas change on purpose.
pub(super) fn energy(made: &Result<(PatchMap, usize), Error>, patch: &Patch, options: &BuildOptions) -> f64 {
    match made.as_ref().map(|(map, _)| map.levels.first()) {
        Ok(Some(level)) if !is_magnified(&patch.taxels, options) => level.distortion.symmetric_dirichlet,
        Ok(_) => 0.0,
        Err(_) => f64::INFINITY,
    }
}

/// The one judge of two maps of a patch: less energy on the finest level; where that is the same, fewer coarse levels that
/// are left out, then less energy on the worst of them.
pub(super) fn is_better(
    made: &Result<(PatchMap, usize), Error>,
    best: &Result<(PatchMap, usize), Error>,
    patch: &Patch,
    options: &BuildOptions,
) -> bool {
    let [new, old] = [made, best].map(|made| energy(made, patch, options));
    if (new / old - 1.0).abs() >= SAME || !old.is_finite() {
        return new < old;
    }
    let coarse = |made: &Result<(PatchMap, usize), Error>| {
        let (map, left_out) = made.as_ref().ok()?;
        let energies = map.levels.iter().map(|level| level.distortion.symmetric_dirichlet);
        Some((*left_out, energies.fold(0.0, f64::max)))
    };
    let (Some(new), Some(old)) = (coarse(made), coarse(best)) else { return new < old };
    new.0 < old.0 || (new.0 == old.0 && new.1 < old.1)
}

/// Levels with a larger symmetric Dirichlet energy are left out where a finer one has less, also where all are absurd.
const OF_NO_USE: f64 = 100.0;

/// The largest energy of the next coarser level, from that of a level and its energy.
fn most_of_coarser(most: f64, energy: f64) -> f64 {
    if energy > most { energy.max(OF_NO_USE) } else { most }
}

/// Measures the levels of a map and leaves out the coarse ones from the first on that a file cannot hold or that
/// breaks a promise: that is no map either. An absurd one is of no use where the finest is not. Returns how many.
pub(super) fn keep_held(
    map: &mut PatchMap,
    options: &BuildOptions,
    numbers: Numbers,
) -> Result<usize, Error> {
    let (made, mut held) = (map.levels.len(), 0);
    let mut most = if options.flatten.starts_coarse() && !is_magnified(&map.taxels, options) {
        ABSURD
    } else {
        f64::INFINITY
    };
    for level in map.levels.iter_mut() {
        let measured = match numbers {
            Numbers::F32 => measure_as_written(level).map_err(Error::from),
            Numbers::F64 => {
                level.measure();
                Ok(())
            }
        };
        let far = level.uv.enumerate().find(|(_, at)| at.abs().max_element() > FARTHEST);
        let near = far.map_or(Ok(()), |(place, &at)| {
            let (patch, vertex) = (map.name.clone(), level.vertex_of(place));
            Err(MapError::TooFar { patch, level: LevelId::new(held), vertex, at }.into())
        });
        let energy = level.distortion.symmetric_dirichlet;
        match near.and(measured).and_then(|()| check_promises(level, &options.flatten)) {
            Ok(()) if held == 0 || energy <= most => {
                most = most_of_coarser(most, energy);
                held += 1;
            }
            Err(error) if held == 0 => return Err(error),
            Ok(()) | Err(_) => break,
        }
    }
    map.keep_finest(held);
    Ok(made - held)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flatten::FlattenOptions;
    use crate::mesh::shapes;
    use crate::pipeline::build;
    use crate::skin::{PatchId, Skin};

    /// A puck of 66 handles had an energy of 16.2 on the finest level, and of 4197 on the next.
    #[test]
    fn a_coarse_level_far_worse_than_an_absurd_finest_one_is_left_out() {
        assert_eq!(most_of_coarser(ABSURD, 4.2), ABSURD);
        assert_eq!(most_of_coarser(ABSURD, 16.2), OF_NO_USE);
        assert_eq!(most_of_coarser(ABSURD, 2000.0), 2000.0, "no worse than the finest");
        assert_eq!(most_of_coarser(f64::INFINITY, 2000.0), f64::INFINITY, "areas change on purpose");
    }

    /// Only the default energy is replaced.
    #[test]
    fn the_last_attempts_are_by_the_symmetric_dirichlet_energy() {
        let skin = Skin::from_mesh("tube", shapes::tube(12, 6, 0.02, 0.05));
        let patch = &skin.patches[PatchId::new(0)];
        let options = BuildOptions::default();
        let by_dirichlet = |options: &BuildOptions| -> Vec<bool> {
            attempts(patch, options).iter().map(|attempt| attempt.is_by_dirichlet).collect()
        };
        assert_eq!(by_dirichlet(&options), [false, false, false, true, true, true, true]);
        let is_so = |o: &BuildOptions| {
            o.flatten.method == Method::Intrinsic { energy: Energy::SymmetricDirichlet, magnify: 0.0 }
        };
        assert!(
            attempts(patch, &options)
                .iter()
                .all(|attempt| is_so(&attempt.options) == attempt.is_by_dirichlet)
        );
        let energy = Energy::Sum { angle: 1.0, area: 0.1, perimeter: 0.0 };
        let chosen = Method::Intrinsic { energy, magnify: 0.0 };
        for flatten in [chosen.into(), Method::Conformal.into()] {
            assert!(!by_dirichlet(&BuildOptions { flatten, ..options.clone() }).contains(&true));
        }
        assert!(attempts(patch, &BuildOptions { cut: Cut::None, ..options }).is_empty());
    }

    /// Of two maps that are equally good on the finest level, the one with better coarse levels is taken.
    #[test]
    fn coarse_levels_decide_between_equal_maps() {
        let skin = Skin::from_mesh("cap", shapes::cap(1000, 0.05, 1.0));
        let patch = &skin.patches[PatchId::new(0)];
        let options = BuildOptions::default();
        let map = build(&skin, &options).unwrap().patches[PatchId::new(0)].clone();
        let with = |level: u32, energy: f64, left_out: usize| {
            let mut map = map.clone();
            map.levels[LevelId::new(level as usize)].distortion.symmetric_dirichlet = energy;
            Ok((map, left_out))
        };
        let better = |new, old| is_better(&new, &old, patch, &options);
        assert!(better(with(0, 5.0, 2), with(0, 6.0, 0)), "the finest level decides");
        assert!(better(with(1, 9.0, 0), with(1, 5.0, 1)), "then what is left out");
        assert!(better(with(1, 5.0, 1), with(1, 9.0, 1)), "then the worst level");
        assert!(!better(with(1, 9.0, 1), with(1, 9.0, 1)));
        let failed = || Err(FlattenError::NotInjective { flips: 1, overlaps: 0 }.into());
        assert!(better(with(0, 500.0, 0), failed()) && !better(failed(), with(0, 500.0, 0)));
        assert!(!better(failed(), failed()));
    }

    /// A coarse level of CAD with many loops came out at an energy of 384, where level 0 had 4.6.
    #[test]
    fn absurd_coarse_levels_go_where_the_finest_is_not() {
        let skin = Skin::from_mesh("cap", shapes::cap(1000, 0.05, 1.0));
        let map = build(&skin, &BuildOptions::default()).unwrap().patches[PatchId::new(0)].clone();
        let count = map.levels.len();
        assert!(count > 2);
        let kept_after = |stretched: &[usize], options: &BuildOptions| {
            let mut map = map.clone();
            for &level in stretched {
                let level = &mut map.levels[LevelId::new(level)];
                level.uv.iter_mut().for_each(|at| at.x *= 40.0);
            }
            count - keep_held(&mut map, options, Numbers::F64).unwrap()
        };
        let options = BuildOptions::default();
        assert_eq!(kept_after(&[], &options), count);
        assert_eq!(kept_after(&[1], &options), 1, "and those above it");
        assert_eq!(kept_after(&[2], &options), 2);
        assert_eq!(kept_after(&[0, 1], &options), count, "no better level is there");
        let conformal = BuildOptions { flatten: Method::Conformal.into(), ..BuildOptions::default() };
        assert_eq!(kept_after(&[1], &conformal), count, "angles are what this method keeps");
    }

    /// A map that is valid in 64 bits may not be valid in the 32-bit numbers of its file.
    #[test]
    fn a_level_that_overlaps_itself_in_its_file_is_refused() {
        let skin = Skin::from_mesh("skin", shapes::lattice(4, 4, 0.01));
        let mut map = build(&skin, &BuildOptions::default()).unwrap();
        let level = &mut map.patches[PatchId::new(0)].levels[LevelId::new(0)];
        for (flips, crossings, overlap, is_kept) in [
            (0, 0, Overlap::Prevent, true),
            (0, 1, Overlap::Prevent, false),
            (0, 1, Overlap::Allow, true),
            (1, 0, Overlap::Allow, false),
        ] {
            (level.distortion.flips, level.distortion.crossings) = (flips, crossings);
            let options = FlattenOptions { overlap, ..FlattenOptions::default() };
            assert_eq!(check_promises(level, &options).is_ok(), is_kept, "{flips}, {crossings}, {overlap:?}");
            let conformal = FlattenOptions { method: Method::Conformal, ..options };
            assert!(check_promises(level, &conformal).is_ok(), "it promises nothing");
        }
    }
}
