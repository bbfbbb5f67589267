//! Which places of two skins are the same, and whether they can be.

use std::collections::{BTreeMap, HashMap};

use glam::{DVec2, DVec3};

use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, Regions, SkinMap, mirrored};
use crate::mesh::TriMesh;
use crate::pyramid::LevelId;
use crate::registration::RegistrationError;
use crate::registration::place::{Placing, Similarity, breadth};
use crate::skin::{PatchId, RegionName, TaxelId, Taxels};

/// Fewer landmarks do not determine how a patch is bent: with three, the places of hands are missed by 1.3 to 13 mm.
pub(super) const FEWEST: usize = 4;

/// Landmarks whose shorter axis is this share of the longer one lie on a line: those of one finger have 0.1.
const LINE: f64 = 0.02;

/// The landmarks are those of the other hand where the mirror image misses by less than this share. The same hand
/// misses by 1 to 18 mm, the other one by 51 to 97.
const OTHER_HAND: f64 = 0.5;

/// A taxel of a skin and the taxel of the atlas at the same place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Landmark {
    /// What it is called in notes and errors, as in `line 3`.
    pub name: String,
    /// The taxel of the skin.
    pub taxel: (PatchId, VertexId),
    /// The taxel of the atlas.
    pub atlas: (PatchId, VertexId),
}

/// What is the same on a skin and on its atlas.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Landmarks {
    /// These taxels.
    Taxels(Vec<Landmark>),
    /// The centres of regions that have the same name.
    Regions,
}

impl Landmarks {
    /// Pairs of ids: of a taxel of a skin, whose patches are `own`, and of the one of the atlas at the same place. They are
    /// called `landmarks[0]`, `landmarks[1]`, ... in errors.
    ///
    /// # Errors
    /// If an id is not that of exactly one taxel.
    pub fn of_ids<'a>(
        own: impl IntoIterator<Item = &'a Taxels>,
        atlas: &SkinMap,
        pairs: &[[TaxelId; 2]],
    ) -> Result<Self, RegistrationError> {
        let homes = [homes_of(own), homes_of(atlas.patches.iter().map(|patch| &patch.taxels))];
        let landmark = |(number, ids): (usize, &[TaxelId; 2])| {
            let name = format!("landmarks[{number}]");
            let of = |side: usize, whose: &str| match homes[side].get(&ids[side]) {
                Some(&(patch, taxel, 1)) => Ok((patch, taxel)),
                found => Err(RegistrationError::NoTaxel {
                    landmark: name.clone(),
                    id: ids[side].0,
                    found: found.map_or(0, |(.., count)| *count),
                    whose: whose.to_owned(),
                }),
            };
            let (taxel, atlas) = (of(0, "the skin")?, of(1, "the atlas")?);
            Ok(Landmark { name, taxel, atlas })
        };
        Ok(Self::Taxels(pairs.iter().enumerate().map(landmark).collect::<Result<_, RegistrationError>>()?))
    }
}

/// Where the taxel of each id is, and how many have it.
fn homes_of<'a>(
    patches: impl IntoIterator<Item = &'a Taxels>,
) -> HashMap<TaxelId, (PatchId, VertexId, usize)> {
    let mut homes: HashMap<TaxelId, (PatchId, VertexId, usize)> = HashMap::new();
    for (patch, taxels) in patches.into_iter().enumerate() {
        for (taxel, name) in taxels.ids.enumerate() {
            homes.entry(*name).or_insert((PatchId::new(patch), taxel, 0)).2 += 1;
        }
    }
    homes
}

/// A landmark of a patch: a place of its map, and where it comes to.
#[derive(Debug, Clone)]
pub(super) struct Mark {
    pub(super) name: String,
    pub(super) place: PlaceId,
    pub(super) to: DVec2,
}

/// The landmarks of one patch, all in one patch of the atlas, and the names of those left out.
#[derive(Debug, Default)]
pub(super) struct Marks {
    pub(super) atlas: PatchId,
    pub(super) marks: Vec<Mark>,
    pub(super) left_out: Vec<String>,
}

/// The landmarks of each patch of a skin. Those in another patch of the atlas than most are left out.
pub(super) fn marks_of(
    map: &SkinMap,
    atlas: &SkinMap,
    landmarks: &Landmarks,
    is_mirrored: bool,
) -> Result<IdVec<PatchId, Marks>, RegistrationError> {
    let found = match landmarks {
        Landmarks::Taxels(landmarks) => of_taxels(map, atlas, landmarks)?,
        Landmarks::Regions => of_regions(map, atlas, is_mirrored),
    };
    let turn = |at: DVec2| if is_mirrored { mirrored(at) } else { at };
    let chosen = |found: &Vec<(PatchId, Mark)>| {
        let count = |patch: PatchId| found.iter().filter(|(other, _)| *other == patch).count();
        let most = found
            .iter()
            .map(|&(patch, _)| patch)
            .max_by_key(|&patch| (count(patch), std::cmp::Reverse(patch)));
        let mut marks = Marks { atlas: most.unwrap_or_default(), ..Marks::default() };
        for (patch, mark) in found {
            if *patch == marks.atlas {
                marks.marks.push(Mark { to: turn(mark.to), ..mark.clone() });
            } else {
                marks.left_out.push(mark.name.clone());
            }
        }
        marks
    };
    Ok(found.map(chosen))
}

type Found = IdVec<PatchId, Vec<(PatchId, Mark)>>;

fn of_taxels(map: &SkinMap, atlas: &SkinMap, landmarks: &[Landmark]) -> Result<Found, RegistrationError> {
    let mut found: Found = map.patches.map(|_| Vec::new());
    for Landmark { name, taxel, atlas: at } in landmarks {
        let place = only_place(map, *taxel, name, "the skin")?;
        let to = only_place(atlas, *at, name, "the atlas")?;
        let to = finest(&atlas.patches[at.0]).uv[to];
        found[taxel.0].push((at.0, Mark { name: name.clone(), place, to }));
    }
    Ok(found)
}

/// The only place of a taxel on the finest map.
fn only_place(
    map: &SkinMap,
    (patch, taxel): (PatchId, VertexId),
    name: &str,
    whose: &str,
) -> Result<PlaceId, RegistrationError> {
    let patch = &map.patches[patch];
    let copies =
        finest(patch).unsplit().into_iter().flat_map(|unsplit| unsplit.iter().skip(patch.taxels.ids.len()));
    if copies.into_iter().any(|&other| other == taxel) {
        let (landmark, taxel) = (name.to_owned(), patch.taxels.ids[taxel].0);
        return Err(RegistrationError::OnSeam { landmark, taxel, whose: whose.to_owned() });
    }
    Ok(PlaceId::first_of(taxel))
}

/// The taxel nearest to the centre of each region, and its place relative to that of the region of the same name.
fn of_regions(map: &SkinMap, atlas: &SkinMap, is_mirrored: bool) -> Found {
    let theirs: Vec<(PatchId, Vec<Centre>)> =
        atlas.patches.enumerate().map(|(id, patch)| (id, centres(patch, id, &atlas.regions()))).collect();
    let regions = map.regions();
    let turn = |at: DVec2| if is_mirrored { mirrored(at) } else { at };
    let of_patch = |(id, patch): (PatchId, &PatchMap)| {
        let own = centres(patch, id, &regions);
        let mut pairs: Vec<(PatchId, &Centre, DVec2)> = Vec::new();
        for centre in &own {
            // The patch of the atlas that has most of the region.
            let same = theirs.iter().flat_map(|(id, centres)| {
                centres.iter().filter(|other| other.name == centre.name).map(move |other| (*id, other))
            });
            let largest = same.max_by(|(a, x), (b, y)| x.area.total_cmp(&y.area).then(b.cmp(a)));
            pairs.extend(largest.map(|(id, other)| (id, centre, turn(other.at))));
        }
        // Each patch of the atlas has a plane of its own.
        let fit = |id: PatchId| {
            let on_it = pairs.iter().filter(|(other, ..)| *other == id);
            Similarity::of(&on_it.map(|(_, own, to)| [own.at, *to]).collect::<Vec<_>>()).0
        };
        let level = finest(patch);
        let mut marks: Vec<(PatchId, Mark)> = Vec::new();
        for &(id, centre, to) in &pairs {
            let place = centre.nearest;
            let beside = fit(id).turned(level.uv[place] - centre.at);
            let name = format!("region {:?}", centre.name);
            if marks.iter().all(|(_, other)| other.place != place) {
                marks.push((id, Mark { name, place, to: turn(to + beside) }));
            }
        }
        marks
    };
    map.patches.enumerate().map(of_patch).collect()
}

/// The centre of a region on a map.
struct Centre {
    name: String,
    at: DVec2,
    area: f64,
    /// The place of its taxel that is nearest to the centre.
    nearest: PlaceId,
}

/// The centres of the regions of a patch: the means of their taxels by area. A region with a taxel on the seam has
/// none, for it may lie on both banks.
fn centres(patch: &PatchMap, id: PatchId, regions: &Regions) -> Vec<Centre> {
    let level = finest(patch);
    let count = patch.taxels.ids.len();
    let mut is_on_seam = IdVec::<VertexId, bool>::filled(false, count);
    level.unsplit().into_iter().flat_map(|at| at.iter().skip(count)).for_each(|&v| is_on_seam[v] = true);
    let Some(of_taxels) = regions.of_taxels.get(id) else { return Vec::new() };
    let of_region = |(region, name): (_, &RegionName)| {
        let taxels = || of_taxels.enumerate().filter(move |(_, of)| **of == Some(region)).map(|(v, _)| v);
        if taxels().any(|v| is_on_seam[v]) {
            return None;
        }
        let area: f64 = taxels().map(|v| patch.taxels.areas[v]).sum();
        let place = |v: VertexId| level.uv[PlaceId::first_of(v)];
        let at = taxels().map(|v| patch.taxels.areas[v] * place(v)).sum::<DVec2>() / area;
        let far = |v: &VertexId| place(*v).distance_squared(at);
        let nearest = taxels().min_by(|a, b| far(a).total_cmp(&far(b))).map(PlaceId::first_of);
        nearest.map(|nearest| Centre { name: name.to_string(), at, area, nearest })
    };
    regions.names.enumerate().filter_map(of_region).collect()
}

/// The taxel nearest to the centre of each region of a patch in space.
pub(super) fn nearest_in_space(mesh: &TriMesh, taxels: &Taxels) -> Vec<(RegionName, VertexId)> {
    let mut sums: BTreeMap<&RegionName, (DVec3, f64)> = BTreeMap::new();
    let Some(regions) = &taxels.regions else { return Vec::new() };
    for (v, name) in regions.enumerate() {
        if let Some(name) = name {
            let (sum, area) = sums.entry(name).or_default();
            *sum += taxels.areas[v] * mesh.positions[v];
            *area += taxels.areas[v];
        }
    }
    let nearest = |(name, (sum, area)): (&RegionName, (DVec3, f64))| {
        let far = |v: &VertexId| mesh.positions[*v].distance_squared(sum / area);
        let own = regions.enumerate().filter(|(_, other)| other.as_ref() == Some(name)).map(|(v, _)| v);
        own.min_by(|a, b| far(a).total_cmp(&far(b))).map(|v| (name.clone(), v))
    };
    sums.into_iter().filter_map(nearest).collect()
}

fn finest(patch: &PatchMap) -> &MapLevel {
    &patch.levels[LevelId::new(0)]
}

/// Where a whole patch comes to by its landmarks.
///
/// # Errors
/// If they cannot be those of this skin and this atlas.
pub(super) fn placing(patch: &str, level: &MapLevel, marks: &[Mark]) -> Result<Placing, RegistrationError> {
    for (k, mark) in marks.iter().enumerate() {
        let is_one = |whose: &str, other: &Mark| RegistrationError::OnePlace {
            first: other.name.clone(),
            second: mark.name.clone(),
            whose: whose.to_owned(),
        };
        if let Some(other) = marks[..k].iter().find(|other| level.uv[other.place] == level.uv[mark.place]) {
            return Err(is_one("the skin", other));
        }
        if let Some(other) = marks[..k].iter().find(|other| other.to == mark.to) {
            return Err(is_one("the atlas", other));
        }
    }
    let pairs: Vec<[DVec2; 2]> = marks.iter().map(|mark| [level.uv[mark.place], mark.to]).collect();
    if (0..2).any(|k| breadth(pairs.iter().map(|pair| pair[k])) < LINE) {
        return Err(RegistrationError::OnALine { patch: patch.to_owned(), count: marks.len() });
    }
    let (_, straight) = Similarity::of(&pairs);
    let (_, other_hand) = Similarity::of(&pairs.iter().map(|&[p, q]| [p, mirrored(q)]).collect::<Vec<_>>());
    if other_hand < OTHER_HAND * straight {
        let [straight_mm, mirrored_mm] = [straight, other_hand].map(|m| 1e3 * m);
        return Err(RegistrationError::OtherHand { patch: patch.to_owned(), straight_mm, mirrored_mm });
    }
    Ok(Placing::of(&pairs))
}
