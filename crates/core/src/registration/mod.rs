//! The map of a skin drawn on that of another one, its atlas: the same pixels for a glove and a robot hand.
//!
//! # Algorithm
//!
//! [`register`] takes finished maps with a free boundary. Of each patch:
//!
//! 1. **Place**: turn, scale and move the map so that its landmarks come near those of the atlas (least squares); with
//!    six or more, halfway to the affine map that does so.
//! 2. **Bend**: what each landmark still misses is its displacement; the biharmonic field continues it over the map
//!    (`field`). Rims that come to cross each other, as those of two fingers, are moved apart. Where one step folds a
//!    face or that does not help, the map is bent in up to eight, each on the map of the last; where that folds, too, the
//!    landmark nearest to the fold is left out, and, where eight are, those nearest to the most folds at once.
//!    A closed skin whose seam has the shape of that of its atlas is bent so that its banks, too, come to those of the atlas
//!    (`banks`), unless that folds the map.
//! 3. **Levels**: a coarser level is placed alike, and each vertex moves as the taxel at its centre. Where that folds,
//!    it takes the place of its taxel, or is bent so that its rim does; also where rims would cross.
//!
//! A penalty for landmarks in the energy of the free map keeps the stretch near the landmarks; the field spreads it: of
//! 16 pairs of hands with 13 landmarks, taxels missed their places by 0.67 mm in the median, and by 1.6 mm so
//! (SLIM `(rabinovich2017)`).
//!
//! A closed skin is first cut along the seam of its atlas: [`carried_seams`].
//!
//! [`Carry`](crate::signal::Carry) takes readings from the taxels of one map to those of another on the same atlas.
//!
//! # Guarantees
//!
//! A map that had no flips and did not overlap itself has none and does not; landmarks that are not left out lie at
//! their places to rounding. The same input gives the same bits.
//!
//! # Not guaranteed
//!
//! Between landmarks nothing says where a place belongs: the largest error of hands is some 10 mm.

mod banks;
mod bend;
mod contradict;
mod error;
mod field;
mod landmarks;
mod place;
mod seam;

use std::fmt;

use glam::DVec2;

use crate::body::Body;
use crate::cut::PlaceId;
use crate::flatten::distortion;
use crate::id::{IdVec, VertexId};
use crate::map::{OnAtlas, OnPatch, PatchMap, SkinMap};
use crate::mesh::{TriMesh, boundary_loops};
use crate::pyramid::LevelId;
use crate::run::Run;
pub use contradict::Doubt;
pub use error::RegistrationError;
pub use landmarks::{Landmark, Landmarks};
pub use seam::carried_seams;

use banks::bank_marks;
use bend::{Bent, bend, first_flip};
use contradict::contradictions;
use landmarks::{FEWEST, Mark, marks_of, placing};

/// The map that another skin is drawn on.
#[derive(Debug, Clone, Copy)]
pub struct Onto<'a> {
    /// The map.
    pub atlas: &'a SkinMap,
    /// Its name, for people.
    pub name: &'a str,
    /// Its hash (`io::map_hash`), by which it is known again.
    pub hash: u64,
    /// What is the same on both skins.
    pub landmarks: &'a Landmarks,
    /// Whether the skin is that of the other hand.
    pub is_mirrored: bool,
}

/// What became of the patches of a skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Registered {
    /// The patches that are on the atlas.
    pub patches: Vec<RegisteredPatch>,
    /// The patches with fewer than four landmarks, and how many they have: they are no longer in the map.
    pub left_out: Vec<(String, usize)>,
}

/// A patch on an atlas.
#[derive(Debug, Clone, PartialEq)]
pub struct RegisteredPatch {
    /// Its name, and that of the patch of the atlas.
    pub name: String,
    /// The patch of the atlas that it lies on.
    pub atlas: String,
    /// Landmarks that lie at their places.
    pub landmarks: usize,
    /// Names of those that lie in another patch of the atlas than most.
    pub elsewhere: Vec<String>,
    /// Names of those without which the map would fold.
    pub folding: Vec<String>,
    /// Lengths on the atlas over lengths on the free map.
    pub scale: f64,
    /// How far the landmarks were from their places before the map was bent: root of the mean square, in m.
    pub missed: f64,
    /// In how many steps the map was bent.
    pub steps: u32,
    /// A landmark that may be wrong.
    pub doubtful: Option<Doubt>,
}

impl fmt::Display for RegisteredPatch {
    /// Where the patch lies, in a sentence.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, atlas, landmarks, scale, missed, steps, .. } = self;
        let steps = if *steps == 1 { "one step".to_owned() } else { format!("{steps} steps") };
        write!(
            f,
            "{name}: on the atlas patch {atlas} by {landmarks} landmarks, {scale:.3} times as large; they missed it by \
             {:.1} mm before the map was bent, in {steps}",
            1e3 * missed
        )
    }
}

impl Registered {
    /// What was left out, in sentences.
    pub fn remarks(&self) -> Vec<String> {
        let missing = self.left_out.iter().map(|(patch, found)| {
            format!(
                "{patch}: left out: it has {found} landmarks, and four are needed to place it on the atlas"
            )
        });
        let of_patch = |patch: &RegisteredPatch| {
            let RegisteredPatch { name, atlas, elsewhere, folding, doubtful, .. } = patch;
            let most = |names: String| {
                format!(
                    "{name}: left out {names}: most landmarks lie in patch {atlas} of the atlas, not these"
                )
            };
            let folds = |names: String| format!("{name}: left out {names}: with them the map would fold");
            let some = |names: &[String]| (!names.is_empty()).then(|| names.join(", "));
            let doubt = |Doubt { landmark, miss, times }: &Doubt| {
                format!(
                    "{name}: {landmark} may be wrong: it is {:.0} mm from where the other landmarks put it, {times:.0} times as \
                     unlikely as they are by each other",
                    1e3 * miss
                )
            };
            let remarks = [some(elsewhere).map(most), some(folding).map(folds), doubtful.as_ref().map(doubt)];
            remarks.into_iter().flatten().collect::<Vec<_>>()
        };
        missing.chain(self.patches.iter().flat_map(of_patch)).collect()
    }
}

/// Draws a map on that of another skin, in place. If it is mirrored, the skin is that of the other hand: it lies on the
/// mirror image of the atlas, so that its faces stay upright.
///
/// Image frames are made anew with their pixels; the maps are not measured. Tangents of taxels stay as they are. What joins the
/// patches is not known afterwards: [`SkinMap::body`] is empty.
///
/// # Errors
/// If landmarks contradict each other or lie on a seam, no patch has four, a map has flips, it folds, or the run is
/// cancelled. The map is then as it was.
pub fn register(map: &mut SkinMap, onto: &Onto<'_>, run: Run<'_>) -> Result<Registered, RegistrationError> {
    run.check()?;
    let &Onto { atlas, is_mirrored, .. } = onto;
    let all = marks_of(map, atlas, onto.landmarks, is_mirrored)?;
    let mut registered = Registered::default();
    let mut patches = Vec::new();
    for (patch, marks) in map.patches.iter().zip(all) {
        run.check()?;
        let found = marks.marks.len();
        if found < FEWEST {
            registered.left_out.push((patch.name.clone(), found));
            continue;
        }
        let finest = &patch.levels[LevelId::new(0)];
        let fit = placing(&patch.name, finest, &marks.marks)?;
        let placed: Vec<IdVec<PlaceId, DVec2>> =
            patch.levels.iter().map(|level| level.uv.map(|&at| fit.apply(at))).collect();
        let squares = marks.marks.iter().map(|mark| placed[0][mark.place].distance_squared(mark.to));
        let missed = (squares.sum::<f64>() / found as f64).sqrt();
        let of_atlas = &atlas.patches[marks.atlas].levels[LevelId::new(0)];
        let banks = bank_marks(finest, &placed[0], of_atlas, is_mirrored);
        let BentPatch { uv, landmarks, folding, steps, doubtful } =
            bend_patch(patch, &placed[0], &marks.marks, &banks, run)?;
        let mut bent = patch.clone();
        bend_levels(&mut bent, placed, uv);
        let name = atlas.patches[marks.atlas].name.clone();
        bent.atlas = Some(OnPatch {
            patch: atlas.patches[marks.atlas].plane().to_owned(),
            landmarks,
            left_out: marks.left_out.len() + folding.len(),
            free_dirichlet: Some(finest.distortion.symmetric_dirichlet).filter(|energy| energy.is_finite()),
        });
        registered.patches.push(RegisteredPatch {
            name: patch.name.clone(),
            atlas: name,
            landmarks,
            elsewhere: marks.left_out,
            folding,
            scale: fit.scale(),
            missed,
            steps,
            doubtful,
        });
        patches.push(bent);
    }
    if patches.is_empty() {
        let found = registered.left_out.iter().map(|(name, count)| format!("{name:?} has {count}"));
        return Err(RegistrationError::TooFew { found: found.collect::<Vec<_>>().join(", ") });
    }
    map.patches = patches.into();
    // Its patches have other numbers where some were left out.
    map.body = Body::default();
    // A map on a map that is drawn on a third lies on the plane of the third.
    map.atlas = Some(match &atlas.atlas {
        Some(on) => OnAtlas { is_mirrored: is_mirrored != on.is_mirrored, ..on.clone() },
        None => OnAtlas { name: onto.name.to_owned(), hash: onto.hash, is_mirrored },
    });
    Ok(registered)
}

/// The finest map of a patch after it was bent.
struct BentPatch {
    uv: IdVec<PlaceId, DVec2>,
    /// How many landmarks lie at their places, and the names of those that would fold it.
    landmarks: usize,
    folding: Vec<String>,
    steps: u32,
    doubtful: Option<Doubt>,
}

/// Of the places along a seam, each of so many is held at first, then, where the map folds, of so many: see [`bank_marks`].
/// *Heuristic*
const BANKS: [usize; 2] = [2, 8];

/// So many landmarks that fold are left out one by one, each for a bend of the map. Then one in [`AT_ONCE`] of those left is,
/// each time: hundreds of landmarks that fold took a bend each. *Heuristic*: few wrong landmarks cost no right one, and 400
/// end after at most 40 bends.
const ONE_BY_ONE: usize = 8;
const AT_ONCE: usize = 8;

/// The finest map bent, with as many of the landmarks as keep it from folding, and with the banks of its seam.
fn bend_patch(
    patch: &PatchMap,
    placed: &IdVec<PlaceId, DVec2>,
    marks: &[Mark],
    banks: &[(PlaceId, DVec2)],
    run: Run<'_>,
) -> Result<BentPatch, RegistrationError> {
    let finest = &patch.levels[LevelId::new(0)];
    let mesh = &*finest.opened();
    let placed: IdVec<VertexId, DVec2> = placed.clone().reindexed();
    if first_flip(mesh, &placed).is_some() {
        let flips = distortion(mesh, &placed).flips;
        return Err(RegistrationError::Flipped { patch: patch.name.clone(), flips });
    }
    let free = finest.opened_uv();
    let doubtful = contradictions(&patch.name, mesh, [&free, &placed], marks)?;
    let mut marks: Vec<&Mark> = marks.iter().collect();
    let system = |source| RegistrationError::System { patch: patch.name.clone(), source };
    let held = |marks: &[&Mark]| marks.iter().map(|mark| (mark.place.opened(), mark.to)).collect::<Vec<_>>();
    for every in BANKS.into_iter().filter(|_| !banks.is_empty()) {
        // A landmark at the tip of the seam stays where it is.
        let is_free = |place: PlaceId| marks.iter().all(|mark| mark.place != place);
        let along = banks.iter().step_by(every).filter(|(place, _)| is_free(*place));
        let along: Vec<_> = along.map(|&(place, to)| (place.opened(), to)).collect();
        if let Bent::Done(uv, steps) = bend(mesh, &placed, &held(&marks), &along).map_err(system)? {
            let (uv, landmarks) = (uv.reindexed(), marks.len());
            return Ok(BentPatch { uv, landmarks, folding: Vec::new(), steps, doubtful });
        }
    }
    let mut folding = Vec::new();
    loop {
        run.step()?;
        match bend(mesh, &placed, &held(&marks), &[]).map_err(system)? {
            Bent::Done(uv, steps) => {
                let (uv, landmarks) = (uv.reindexed(), marks.len());
                return Ok(BentPatch { uv, landmarks, folding, steps, doubtful });
            }
            Bent::Folds(places) => {
                let most = if folding.len() < ONE_BY_ONE { 1 } else { marks.len().div_ceil(AT_ONCE) };
                for near in nearest_marks(&marks, &places, most) {
                    let name = marks.remove(near).name.clone();
                    if marks.len() < FEWEST {
                        return Err(RegistrationError::Folds { patch: patch.name.clone(), landmark: name });
                    }
                    folding.push(name);
                }
            }
        }
    }
}

/// The landmarks next to folds, at most so many, the last one first: the one that is nearest to the first fold, or those
/// that are nearest to most folds.
fn nearest_marks(marks: &[&Mark], folds: &[DVec2], most: usize) -> Vec<usize> {
    let nearest = |at: &DVec2| {
        let far = |k: &usize| marks[*k].to.distance_squared(*at);
        (0..marks.len()).min_by(|a, b| far(a).total_cmp(&far(b)))
    };
    if most <= 1 {
        return folds.first().and_then(nearest).into_iter().collect();
    }
    let mut counts = vec![0_usize; marks.len()];
    folds.iter().filter_map(nearest).for_each(|k| counts[k] += 1);
    let mut all: Vec<usize> = (0..marks.len()).filter(|&k| counts[k] > 0).collect();
    // Stable: of equal counts the first landmarks.
    all.sort_by_key(|&k| std::cmp::Reverse(counts[k]));
    all.truncate(most);
    all.sort_unstable_by(|a, b| b.cmp(a));
    all
}

/// Gives every level its map: the finest is `uv`, a coarser one is placed and moves with the taxels at its vertices.
fn bend_levels(patch: &mut PatchMap, placed: Vec<IdVec<PlaceId, DVec2>>, uv: IdVec<PlaceId, DVec2>) {
    let finest = patch.levels[LevelId::new(0)].clone();
    let mut places_of: IdVec<VertexId, Vec<PlaceId>> = IdVec::filled(Vec::new(), patch.taxels.ids.len());
    uv.ids().for_each(|place| places_of[finest.vertex_of(place)].push(place));
    for (number, (level, placed_level)) in patch.levels.iter_mut().zip(&placed).enumerate() {
        if number == 0 {
            level.uv = uv.clone();
        } else {
            // A taxel of the seam has several places: the one on the same bank is the nearest on the free map.
            let of_taxel = |place: PlaceId, at: DVec2| {
                let taxel = level.level.origins[level.vertex_of(place)];
                let far = |other: &PlaceId| placed[0][*other].distance_squared(at);
                places_of[taxel].iter().copied().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or_default()
            };
            let moved = placed_level.enumerate().map(|(place, &at)| {
                let taxel = of_taxel(place, at);
                at + (uv[taxel] - placed[0][taxel])
            });
            let moved: IdVec<PlaceId, DVec2> = moved.collect();
            let mesh = level.opened();
            let measure = |uv: &IdVec<PlaceId, DVec2>| distortion(&mesh, &uv.clone().reindexed());
            let crossings = measure(placed_level).crossings;
            let is_one_to_one = |uv: &IdVec<PlaceId, DVec2>| {
                let measured = measure(uv);
                measured.flips == 0 && measured.crossings <= crossings
            };
            level.uv = if is_one_to_one(&moved) {
                moved
            } else {
                let of_taxels: IdVec<PlaceId, DVec2> =
                    placed_level.enumerate().map(|(place, &at)| uv[of_taxel(place, at)]).collect();
                match is_one_to_one(&of_taxels) {
                    true => of_taxels,
                    false => bent_by_rim(&mesh, placed_level, &of_taxels).unwrap_or(of_taxels),
                }
            };
        }
        let pixel = level.frame.size.x / f64::from(level.frame.size_px[0]);
        level.set_pixel(pixel);
    }
}

/// A coarser level, bent so that each place of its rim, or every second, fourth or eighth, comes to that of its taxel; `None`
/// where that folds it.
fn bent_by_rim(
    mesh: &TriMesh,
    placed: &IdVec<PlaceId, DVec2>,
    of_taxels: &IdVec<PlaceId, DVec2>,
) -> Option<IdVec<PlaceId, DVec2>> {
    let placed: IdVec<VertexId, DVec2> = placed.clone().reindexed();
    let rim: Vec<VertexId> = boundary_loops(mesh).concat();
    first_flip(mesh, &placed).is_none().then_some(())?;
    [1, 2, 4, 8].into_iter().find_map(|every| {
        let held: Vec<_> =
            rim.iter().step_by(every).map(|&v| (v, of_taxels[PlaceId::of_opened(v)])).collect();
        match bend(mesh, &placed, &[], &held) {
            Ok(Bent::Done(uv, _)) => Some(uv.reindexed()),
            _ => None,
        }
    })
}
