//! Carries readings from the taxels of one map to those of another on the same atlas.
//!
//! Each taxel of the first map has a row of weights over the taxels of the second, which sum to one. The rows integrate
//! the products of the hat functions of both maps over the plane, by the vertices of both: from a sparse skin to a dense
//! one a reading spreads over the taxels between, and from a dense one to a sparse one it goes to the nearest ones.
//! Values follow the law of fields (`restrict`): pressures are means by area, forces keep their sum.

use glam::DVec2;

use crate::contact::{ContactError, MapIndex, MapPlace};
use crate::cut::PlaceId;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, SkinMap, mirrored};
use crate::mesh::signed_area;
use crate::numeric::{Csr, storable};
use crate::pyramid::LevelId;
use crate::signal::{Channel, Frame, Quantity};
use crate::skin::PatchId;

/// Carries readings from the taxels of one map to those of another on the same plane: amounts keep their sum, averages are
/// means by area.
#[derive(Debug, Clone)]
pub struct Carry {
    /// The taxels of the second map in the order of its patches: the taxels of the first that they get a share of.
    members: Csr<(u32, f64)>,
    /// The areas of the taxels of the first map, in m^2.
    areas: Vec<f64>,
    /// The first taxel of each patch of the second map.
    starts: Vec<usize>,
    /// The taxels of the first map that lie on no patch of the second.
    outside: Vec<(PatchId, VertexId)>,
    /// How many taxels of the second map get a share of none.
    unreached: usize,
}

/// The maps of a patch on the plane of the atlas.
struct OnPlane<'m> {
    patch: PatchId,
    level: &'m MapLevel,
    /// The patch of the atlas that it lies on, and whether on its mirror image.
    plane: &'m str,
    is_mirrored: bool,
    /// The share of the plane of each place, in m^2, and the spacing of taxels there, in m.
    areas: IdVec<PlaceId, f64>,
    spacing: f64,
}

impl<'m> OnPlane<'m> {
    fn of(map: &'m SkinMap) -> Vec<Self> {
        let of_patch = |(patch, of): (PatchId, &'m PatchMap)| {
            let level = &of.levels[LevelId::new(0)];
            let mut areas = IdVec::filled(0.0, level.uv.len());
            for face in level.level.mesh.triangles.ids() {
                let share = signed_area(level.uv_of(face)).abs() / 3.0;
                level.places(face).iter().for_each(|&place| areas[place] += share);
            }
            // The side of a regular triangle of the mean area.
            let face = areas.iter().sum::<f64>() / level.level.mesh.triangles.len() as f64;
            let spacing = (face * 4.0 / 3.0_f64.sqrt()).sqrt();
            Self { patch, level, plane: of.plane(), is_mirrored: map.is_mirrored(), areas, spacing }
        };
        map.patches.enumerate().map(of_patch).collect()
    }

    /// A place of its map on the map of another patch.
    fn on(&self, other: &Self, at: DVec2) -> DVec2 {
        if self.is_mirrored == other.is_mirrored { at } else { mirrored(at) }
    }
}

impl Carry {
    /// From the taxels of the first map to those of the second. Both lie on one plane
    /// (`io::share_plane`).
    ///
    /// # Errors
    /// As [`MapIndex::new`].
    pub fn new(from: &SkinMap, to: &SkinMap) -> Result<Self, ContactError> {
        let starts = [from, to].map(|map| {
            let mut starts = vec![0];
            for patch in &map.patches {
                starts.push(starts[starts.len() - 1] + patch.taxels.ids.len());
            }
            starts
        });
        let [on_from, on_to] = [from, to].map(OnPlane::of);
        let indices = [MapIndex::new(from)?, MapIndex::new(to)?];
        let number =
            |side: usize, patch: PatchId, taxel: VertexId| starts[side][patch.index()] + taxel.index();
        // Weights by taxel of the first map and of the second.
        let mut entries: Vec<(usize, (u32, f64))> = Vec::new();
        let entry = |i: usize, j: usize, weight: f64| {
            (i, (u32::try_from(j).expect("fewer than 2^32 taxels"), weight))
        };
        let mut found = Vec::new();
        for patch in &on_from {
            for (place, &area) in patch.areas.enumerate() {
                let Some(at) = nearest(patch, place, &on_to, &indices[1], &mut found)? else { continue };
                let i = number(0, patch.patch, patch.level.vertex_of(place));
                for (field, weight) in corners(&at, &on_to) {
                    entries.push(entry(i, number(1, at.patch, field), area * weight));
                }
            }
        }
        for patch in &on_to {
            for (place, &area) in patch.areas.enumerate() {
                let Some(at) = nearest(patch, place, &on_from, &indices[0], &mut found)? else { continue };
                if at.off_chart > 0.0 {
                    continue;
                }
                let j = number(1, patch.patch, patch.level.vertex_of(place));
                for (field, weight) in corners(&at, &on_from) {
                    entries.push(entry(number(0, at.patch, field), j, area * weight));
                }
            }
        }
        // Taxels that are absent have no reading.
        let reads = [from, to].map(|map| {
            let patches = map.patches.iter().flat_map(|patch| patch.taxels.presence.iter());
            patches.map(|presence| presence.reads_pressure()).collect::<Vec<bool>>()
        });
        entries.retain(|&(i, (j, _))| reads[0][i] && reads[1][j as usize]);
        let [taxels, others] = [0, 1].map(|side| starts[side][starts[side].len() - 1]);
        let rows = Csr::from_pairs(taxels, entries.iter().copied());
        let (mut shares, mut outside) = (Vec::new(), Vec::new());
        for patch in from.patches.ids() {
            for taxel in from.patches[patch].taxels.ids.ids() {
                let i = number(0, patch, taxel);
                let sum: f64 = rows[i].iter().map(|(_, weight)| weight).sum();
                if sum > 0.0 {
                    let i = u32::try_from(i).expect("fewer than 2^32 taxels");
                    shares
                        .extend(rows[i as usize].iter().map(|&(j, weight)| (j as usize, (i, weight / sum))));
                } else if reads[0][i] {
                    outside.push((patch, taxel));
                }
            }
        }
        let members = Csr::from_pairs(others, shares.iter().copied());
        let unreached = (0..others).filter(|&j| reads[1][j] && members[j].is_empty()).count();
        let areas = from.patches.iter().flat_map(|patch| patch.taxels.areas.iter().copied()).collect();
        let [_, starts] = starts;
        Ok(Self { members, areas, starts, outside, unreached })
    }

    /// The taxels of the first map that lie on no patch of the second: their readings are lost.
    pub fn outside(&self) -> &[(PatchId, VertexId)] {
        &self.outside
    }

    /// How many taxels of the second map no taxel of the first reaches: they have no reading.
    pub fn unreached(&self) -> usize {
        self.unreached
    }

    /// The weights of readings: for each taxel of the second map, in the order of its patches, numbers of taxels of the
    /// first. Those of amounts sum to one for each taxel of the first map, those of averages for each of the second; or
    /// there are none.
    pub fn weights(&self, quantity: Quantity) -> impl Iterator<Item = Vec<(u32, f64)>> {
        self.members.iter().map(move |members| {
            if quantity == Quantity::Extensive {
                return members.to_vec();
            }
            let by_area = members.iter().map(|&(i, share)| (i, share * self.areas[i as usize]));
            let total: f64 = by_area.clone().map(|(_, weight)| weight).sum();
            by_area.map(|(i, weight)| (i, weight / total)).collect()
        })
    }

    /// Carries the readings of one channel: those of the taxels of the first map to those of the second, both in the
    /// order of their patches. NaN where there is none.
    ///
    /// # Panics
    /// If there is not one value for each taxel of the first map.
    pub fn carry(&self, values: &[f64], quantity: Quantity) -> Vec<f64> {
        assert_eq!(values.len(), self.areas.len(), "one reading for each taxel");
        let value = |members: &[(u32, f64)]| {
            let (mut sum, mut total) = (0.0, 0.0);
            for &(i, share) in members {
                let value = values[i as usize];
                if storable(value).is_nan() {
                    continue;
                }
                let weight = share * quantity.weight(self.areas[i as usize]);
                sum += weight * value;
                total += weight;
            }
            quantity.of_sums(sum, total)
        };
        self.members.iter().map(value).collect()
    }

    /// Carries all channels of a frame of the first map to one of the second.
    pub fn carry_frame(&self, frame: &Frame, channels: &[Channel], to: &mut Frame) {
        for (number, channel) in channels.iter().enumerate() {
            let values: Vec<f64> =
                frame.values.iter().flat_map(|channels| channels[number].iter().copied()).collect();
            let carried = self.carry(&values, channel.quantity);
            for (patch, start) in to.values.iter_mut().zip(&self.starts) {
                let own = &mut patch[number];
                own.iter_mut().zip(&carried[*start..]).for_each(|(value, carried)| *value = *carried);
            }
        }
    }
}

/// The point of the nearest patch on the same patch of the atlas, for a place of a map: on the map or within the spacing
/// of its taxels beside it.
fn nearest(
    patch: &OnPlane<'_>,
    place: PlaceId,
    others: &[OnPlane<'_>],
    index: &MapIndex,
    found: &mut Vec<MapPlace>,
) -> Result<Option<MapPlace>, ContactError> {
    let mut best: Option<MapPlace> = None;
    for other in others.iter().filter(|other| other.plane == patch.plane) {
        found.clear();
        index.places(other.patch, LevelId::new(0), patch.on(other, patch.level.uv[place]), found)?;
        let first = found.first().filter(|at| at.off_chart <= other.spacing.max(patch.spacing));
        if let Some(at) = first.filter(|at| best.is_none_or(|best| at.off_chart < best.off_chart)) {
            best = Some(*at);
        }
    }
    Ok(best)
}

/// The taxels at the corners of the face of a point, with their weights.
fn corners(at: &MapPlace, maps: &[OnPlane<'_>]) -> impl Iterator<Item = (VertexId, f64)> {
    let point = at.cell.point;
    let fields = maps[at.patch.index()].level.level.mesh.triangles[point.face];
    fields.into_iter().zip(point.barycentric).filter(|(_, weight)| *weight > 0.0)
}
