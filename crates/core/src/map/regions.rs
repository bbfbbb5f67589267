//! Named regions of the skin: which taxels and receptive fields are in which, and regions from links and polygons.

use std::collections::{BTreeMap, HashMap};

use glam::DVec2;

use crate::id::{IdVec, VertexId, define_id};
use crate::map::{MapError, PatchMap, SkinMap};
use crate::pyramid::{LevelId, Prolongation};
use crate::skin::{LinkId, PatchId, RegionName, is_region_name, names_of};

define_id!(
    /// A named region of a map.
    pub RegionId, "r"
);

/// Most corners of a polygon.
const MOST_CORNERS: usize = 4096;

/// How far a polygon may reach beyond the image of its map, in sides of the image.
const MARGIN: f64 = 0.1;

/// The named regions of a map; they are numbered in the order of their first taxels.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Regions {
    /// Their names.
    pub names: IdVec<RegionId, RegionName>,
    /// The region of each taxel.
    pub of_taxels: IdVec<PatchId, IdVec<VertexId, Option<RegionId>>>,
}

impl Regions {
    /// The region of each receptive field of a level: the one whose taxels have the largest sum of weights in the
    /// field; the first of equal ones, and none if taxels without a region have the largest.
    ///
    /// # Panics
    /// If `patch` is not the one with this number.
    pub fn of_level(
        &self,
        id: PatchId,
        patch: &PatchMap,
        level: LevelId,
    ) -> IdVec<VertexId, Option<RegionId>> {
        let of_taxels = &self.of_taxels[id];
        let level = &patch.levels[level].level;
        let Some(rows) = &level.to_finest else { return of_taxels.clone() };
        largest([(of_taxels, rows)], level.mesh.positions.len())
    }

    /// The region of each field of a level without a mesh, from its [rows](SkinMap::field_rows).
    ///
    /// # Panics
    /// If the rows are of another map.
    pub fn of_fields(
        &self,
        rows: &IdVec<PatchId, Option<Prolongation>>,
    ) -> IdVec<VertexId, Option<RegionId>> {
        let count = rows.iter().flatten().next().map_or(0, |rows| rows.coarse_len);
        largest(self.of_taxels.iter().zip(rows).filter_map(|(of, rows)| Some((of, rows.as_ref()?))), count)
    }
}

/// The region with the largest sum of weights in each of `count` fields, of taxels with these regions and rows.
fn largest<'a>(
    taxels: impl IntoIterator<Item = (&'a IdVec<VertexId, Option<RegionId>>, &'a Prolongation)>,
    count: usize,
) -> IdVec<VertexId, Option<RegionId>> {
    let mut sums: IdVec<VertexId, Vec<(Option<RegionId>, f64)>> = IdVec::filled(Vec::new(), count);
    for (regions, rows) in taxels {
        for (taxel, region) in regions.enumerate() {
            for (field, weight) in rows.row(taxel) {
                match sums[field].iter_mut().find(|(known, _)| known == region) {
                    Some((_, sum)) => *sum += weight,
                    None => sums[field].push((*region, weight)),
                }
            }
        }
    }
    sums.map(|sums| {
        let mut largest = (None, 0.0);
        for &(region, sum) in sums {
            if sum > largest.1 {
                largest = (region, sum);
            }
        }
        largest.0
    })
}

/// The named region of every receptive field of a map.
#[derive(Debug, Clone, Default)]
pub struct FieldRegions {
    regions: Regions,
    /// By patch and level; empty where there are no regions.
    of_fields: IdVec<PatchId, IdVec<LevelId, IdVec<VertexId, Option<RegionId>>>>,
}

impl FieldRegions {
    /// The regions of the fields of all levels, as [`Regions::of_level`].
    pub fn new(map: &SkinMap) -> Self {
        let regions = map.regions();
        let of_patch = |(id, patch): (PatchId, &PatchMap)| {
            patch.levels.ids().map(|level| regions.of_level(id, patch, level)).collect()
        };
        let patches = map.patches.enumerate().filter(|_| !regions.names.is_empty());
        Self { of_fields: patches.map(of_patch).collect(), regions }
    }

    /// The region of a field, if it is in one.
    pub fn region(&self, patch: PatchId, level: LevelId, field: VertexId) -> Option<RegionId> {
        *self.of_fields.get(patch)?.get(level)?.get(field)?
    }

    /// The name of the region of a field.
    pub fn name(&self, patch: PatchId, level: LevelId, field: VertexId) -> Option<&str> {
        self.region(patch, level, field).map(|region| &*self.regions.names[region])
    }
}

impl SkinMap {
    /// The named regions.
    pub fn regions(&self) -> Regions {
        let names: IdVec<RegionId, RegionName> =
            names_of(self.patches.iter().map(|patch| &patch.taxels.regions)).into();
        let numbers: HashMap<&RegionName, RegionId> =
            names.enumerate().map(|(id, name)| (name, id)).collect();
        let number = |name: &Option<RegionName>| name.as_ref().and_then(|name| numbers.get(name).copied());
        let of_taxels = self.patches.map(|patch| match &patch.taxels.regions {
            Some(regions) => regions.map(number),
            None => IdVec::filled(None, patch.taxels.ids.len()),
        });
        Regions { names, of_taxels }
    }

    /// Gives taxels other regions; those that are not named keep theirs.
    ///
    /// # Panics
    /// If there is no such taxel.
    pub fn set_regions(
        &mut self,
        taxels: impl IntoIterator<Item = (PatchId, VertexId)>,
        name: &str,
    ) -> Result<(), MapError> {
        if !is_region_name(name) {
            return Err(MapError::RegionName { found: name.into() });
        }
        let (name, mut is_empty) = (RegionName::from(name), true);
        for (patch, taxel) in taxels {
            let of = &mut self.patches[patch].taxels;
            let count = of.ids.len();
            of.regions.get_or_insert_with(|| IdVec::filled(None, count))[taxel] = Some(name.clone());
            is_empty = false;
        }
        if is_empty { Err(MapError::NoTaxelInRegion { region: name.to_string() }) } else { Ok(()) }
    }

    /// Makes each link that has a name a region of this name.
    ///
    /// # Errors
    /// If the name of a link cannot be that of a region, or several links with taxels have it.
    pub fn set_regions_by_link(&mut self) -> Result<(), MapError> {
        let has_taxels = |id: LinkId| self.patches.iter().any(|patch| patch.link == id);
        let mut named: BTreeMap<&str, usize> = BTreeMap::new();
        for (_, link) in self.links.enumerate().filter(|(id, link)| !link.name.is_empty() && has_taxels(*id))
        {
            *named.entry(&link.name).or_default() += 1;
        }
        if let Some((name, &links)) = named.iter().find(|(_, links)| **links > 1) {
            return Err(MapError::SharedLink { region: (*name).to_owned(), links });
        }
        for (id, link) in self.links.clone().enumerate().filter(|(_, link)| !link.name.is_empty()) {
            let on_link = self.patches.enumerate().filter(|(_, patch)| patch.link == id);
            let taxels: Vec<_> =
                on_link.flat_map(|(id, patch)| patch.taxels.ids.ids().map(move |v| (id, v))).collect();
            if !taxels.is_empty() {
                self.set_regions(taxels, &link.name)?;
            }
        }
        Ok(())
    }

    /// Makes the taxels that lie in a polygon on the map of level 0 of a patch, corners in m, a region: by the even-odd
    /// rule. A taxel on a seam is in it if one of its places is.
    ///
    /// # Errors
    /// If there is no such patch, a polygon has less than three corners, crosses itself, reaches beyond the image of
    /// the map by more than a tenth of its side, or has no taxel in it.
    pub fn set_region_in(&mut self, patch: &str, name: &str, polygon: &[DVec2]) -> Result<(), MapError> {
        let region = || name.to_owned();
        let Some((id, of)) = self.patches.enumerate().find(|(_, of)| of.name == patch) else {
            let known = self.patches.iter().map(|patch| patch.name.clone()).collect();
            return Err(MapError::NoPatchOfRegion { region: region(), patch: patch.into(), known });
        };
        if !(3..=MOST_CORNERS).contains(&polygon.len()) {
            return Err(MapError::Corners { region: region(), found: polygon.len(), most: MOST_CORNERS });
        }
        let finest = &of.levels[LevelId::default()];
        let (low, size) = (finest.frame.origin, finest.frame.size);
        let is_outside =
            |at: &DVec2| !((*at - low) / size - 0.5).abs().cmple(DVec2::splat(0.5 + MARGIN)).all();
        if let Some(corner) = polygon.iter().position(is_outside) {
            let (at, high) = (polygon[corner], low + size);
            return Err(MapError::OutsideMap {
                region: region(),
                patch: patch.into(),
                corner,
                at,
                low,
                high,
            });
        }
        if let Some([first, second]) = crossing(polygon) {
            return Err(MapError::Crosses { region: region(), first, second });
        }
        let places = finest.uv.enumerate().filter(|(_, at)| contains(polygon, **at));
        let taxels: Vec<_> = places.map(|(place, _)| (id, finest.vertex_of(place))).collect();
        self.set_regions(taxels, name)
    }
}

/// The sides of a polygon.
fn sides(polygon: &[DVec2]) -> impl DoubleEndedIterator<Item = [DVec2; 2]> + ExactSizeIterator + Clone {
    (0..polygon.len()).map(|k| [polygon[k], polygon[(k + 1) % polygon.len()]])
}

/// Two sides of a polygon that cross each other.
fn crossing(polygon: &[DVec2]) -> Option<[usize; 2]> {
    let side = |[a, b]: [DVec2; 2], c: DVec2| (b - a).perp_dot(c - a);
    let are_apart = |s: [DVec2; 2], t: [DVec2; 2]| {
        let [u, v] = t.map(|c| side(s, c));
        u * v >= 0.0
    };
    for (k, first) in sides(polygon).enumerate() {
        for (j, second) in sides(polygon).enumerate().skip(k + 1) {
            if !are_apart(first, second) && !are_apart(second, first) {
                return Some([k, j]);
            }
        }
    }
    None
}

/// Whether a point is in a polygon, by the even-odd rule.
fn contains(polygon: &[DVec2], at: DVec2) -> bool {
    let is_left_of = |[a, b]: &[DVec2; 2]| {
        (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
    };
    sides(polygon).filter(is_left_of).count() % 2 == 1
}
