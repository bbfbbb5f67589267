//! The places of level 0 on the maps of all levels, prepared for sums over the corners of a face: their
//! positions ([`Positions`]) and their fields ([`Rows`]).
//!
//! On every level a map position is linear in the barycentric coordinates of the hit in its face of level 0.
//! The data of a corner is contiguous for all levels.

use glam::DVec2;

use crate::contact::cell::field_weights::{FieldWeights, MOST_FIELDS};
use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::{MapLevel, PixelGrid};
use crate::parallel::par_collect;
use crate::pyramid::LevelId;

/// Positions in a line of the cache.
const LINE: usize = 4;

/// A line of the cache.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
struct Line([DVec2; LINE]);

/// Positions of the places of level 0 on the maps of all levels.
#[derive(Debug, Clone)]
pub(super) struct Positions {
    /// For each place its positions on all levels, in m, level 0 first, padded to `stride`, so that they are
    /// in as few lines as possible.
    lines: Vec<Line>,
    stride: usize,
    /// The images of the levels.
    pub(super) images: IdVec<LevelId, PixelGrid>,
    /// The corners of the faces as places of the map of level 0, where that is cut; else they are
    /// the vertices.
    places: Option<IdVec<FaceId, [PlaceId; 3]>>,
}

impl Positions {
    /// `levels`: the position of each place on the map of each level, level 0 first, in m.
    pub(super) fn new(
        levels: &[IdVec<PlaceId, DVec2>],
        images: IdVec<LevelId, PixelGrid>,
        places: Option<IdVec<FaceId, [PlaceId; 3]>>,
    ) -> Self {
        // Three positions would be in two lines every other time.
        let stride = levels.len() + usize::from(levels.len() % LINE == 3);
        let slots = stride * levels.first().map_or(0, |level| level.len());
        let lines = par_collect(slots.div_ceil(LINE), |range, lines| {
            let at = |slot: usize| {
                let level = levels.get(slot % stride);
                level.and_then(|level| level.get(PlaceId::new(slot / stride))).copied().unwrap_or_default()
            };
            lines.extend(range.map(|line| Line(std::array::from_fn(|k| at(line * LINE + k)))));
        });
        Self { lines, stride, images, places }
    }

    /// The corners of a face, by its vertices, as places.
    #[inline(always)]
    pub(super) fn corners(&self, face: FaceId, vertices: [VertexId; 3]) -> [PlaceId; 3] {
        match &self.places {
            Some(places) => places[face],
            None => vertices.map(PlaceId::first_of),
        }
    }

    #[inline(always)]
    fn slot(&self, place: PlaceId, level: usize) -> DVec2 {
        let slot = place.index() * self.stride + level;
        self.lines[slot / LINE].0[slot % LINE]
    }

    /// The position of a point of a face on the map of a level, in m; `corners` are places.
    #[inline(always)]
    pub(super) fn at(&self, level: LevelId, corners: [PlaceId; 3], barycentric: [f64; 3]) -> DVec2 {
        let [u, v, w] = corners.map(|place| self.slot(place, level.index()));
        let [a, b, c] = barycentric;
        u * a + v * b + w * c
    }
}

/// A vertex of level 0 on a coarser level.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Row {
    /// The weight of each corner of the face.
    pub(super) weights: [f64; 3],
    /// The corners of the face; a corner without weight is replaced by one with weight.
    pub(super) fields: [VertexId; 3],
    /// See [`MapLevel::row_faces`](crate::map::MapLevel::row_faces).
    pub(super) face: FaceId,
}

impl Row {
    /// Its position on the map of its level, if that is not cut, in m.
    pub(super) fn position(&self, map: &MapLevel) -> DVec2 {
        let corners = map.level.mesh.triangles[self.face];
        let places = corners.into_iter().map(PlaceId::first_of);
        places.zip(self.weights).map(|(place, weight)| map.uv[place] * weight).sum()
    }
}

/// How the fields of the three rows of a face are summed on one level: for each of the nine its rank among
/// the different fields, ids ascending, in four bits; then their number, and flags.
#[derive(Debug, Clone, Copy, Default)]
struct Union(u64);

/// The rows of a patch.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    /// For each place of level 0 its rows on the coarser levels.
    rows: Vec<Row>,
    /// For each face of level 0 how its rows are summed on the coarser levels.
    unions: Vec<Union>,
    /// Number of coarser levels.
    above: usize,
}

/// Products of shares and weights of at least this do not round to zero.
const SMALLEST: f64 = 1e-150;

impl Union {
    const LEN: u32 = 36;
    /// All three rows lie in one face, and have three fields.
    const ONE_FACE: u64 = 1 << 40;
    /// A weight is so small that its product with a share may round to zero.
    const TINY: u64 = 1 << 41;

    fn new(rows: [&Row; 3]) -> Self {
        let mut fields = [VertexId::default(); MOST_FIELDS];
        rows.iter().flat_map(|row| row.fields).enumerate().for_each(|(k, field)| fields[k] = field);
        let parts = fields;
        fields.sort_unstable();
        let mut len = 0;
        for k in 0..MOST_FIELDS {
            if k == 0 || fields[k] != fields[k - 1] {
                fields[len] = fields[k];
                len += 1;
            }
        }
        let place = |field: &VertexId| fields[..len].iter().take_while(|&other| other < field).count();
        let code = parts.iter().rev().fold(0, |code, field| code << 4 | place(field) as u64);
        let is_one = len == 3 && rows.iter().all(|row| row.fields == rows[0].fields);
        let is_tiny = rows.iter().flat_map(|row| row.weights).any(|w| w != 0.0 && w < SMALLEST);
        let flag = |is_set: bool, flag: u64| if is_set { flag } else { 0 };
        Self(code | (len as u64) << Self::LEN | flag(is_one, Self::ONE_FACE) | flag(is_tiny, Self::TINY))
    }

    /// Sums the weights of three rows, each times its share, field by field in the order of the rows; returns
    /// the field of the largest sum, the smallest id of several.
    #[inline(always)]
    fn add(self, rows: [&Row; 3], shares: [f64; 3], sums: &mut FieldWeights) -> VertexId {
        let Self(mut code) = self;
        let FieldWeights { len, fields, weights } = sums;
        *len = (code >> Self::LEN & 15) as usize;
        // Without a branch, since the strongest field is unpredictable: by the bits of positive sums, whose
        // order is that of the sums.
        let (mut most, mut strongest) = (0, 0);
        let mut compare = |place: usize, sum: f64| {
            let is_most = sum.to_bits() > most;
            strongest = if is_most { place } else { strongest };
            most = if is_most { sum.to_bits() } else { most };
        };
        if code & Self::ONE_FACE != 0 {
            for k in 0..3 {
                let place = (code & 3) as usize;
                fields[place] = rows[0].fields[k];
                weights[place] = rows[0].weights[k] * shares[0]
                    + rows[1].weights[k] * shares[1]
                    + rows[2].weights[k] * shares[2];
                code >>= 4;
            }
            (0..3).for_each(|place| compare(place, weights[place]));
        } else {
            for (row, share) in rows.into_iter().zip(shares) {
                for k in 0..3 {
                    let place = (code & 15) as usize;
                    fields[place] = row.fields[k];
                    weights[place] += row.weights[k] * share;
                    code >>= 4;
                }
            }
            (0..MOST_FIELDS).for_each(|place| compare(place, weights[place]));
        }
        let strongest = fields[strongest];
        let is_tiny = self.0 & Self::TINY != 0;
        if is_tiny || !shares.iter().all(|share| *share >= SMALLEST) {
            sums.leave_out_zeros();
        }
        strongest
    }
}

impl Rows {
    /// The rows of each place on the coarser levels, finest first.
    pub(super) fn new(
        levels: &[IdVec<PlaceId, Row>],
        triangles: &IdVec<FaceId, [VertexId; 3]>,
        positions: &Positions,
    ) -> Self {
        let above = levels.len();
        let count = levels.first().map_or(0, |values| values.len());
        let rows = par_collect(count, |range, rows| {
            for place in range.map(PlaceId::new) {
                rows.extend(levels.iter().map(|level| level[place]));
            }
        });
        let mut all = Self { rows, unions: Vec::new(), above };
        all.unions = par_collect(triangles.len(), |range, unions| {
            for face in range.map(FaceId::new) {
                let corners = positions.corners(face, triangles[face]);
                unions.extend((0..above).map(|k| Union::new(all.of(corners, k))));
            }
        });
        all
    }

    /// The rows of the corners of a face, as places, on the level `above + 1`.
    #[inline(always)]
    pub(super) fn of(&self, corners: [PlaceId; 3], above: usize) -> [&Row; 3] {
        corners.map(|place| &self.rows[place.index() * self.above + above])
    }

    /// The sums of the weights of the fields of three rows of a face, each times its share; and the field of
    /// the largest sum, the smallest id of several.
    #[inline(always)]
    pub(super) fn add(
        &self,
        face: FaceId,
        above: usize,
        rows: [&Row; 3],
        shares: [f64; 3],
        sums: &mut FieldWeights,
    ) -> VertexId {
        self.unions[face.index() * self.above + above].add(rows, shares, sums)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;

    proptest! {
        #![proptest_config(soup::fixed(1000, 61))]

        /// For rows with any fields in common, also with weights and shares of 0 and with products that
        /// underflow.
        #[test]
        fn sums_are_those_of_each_field(
            fields in prop::array::uniform3(prop::sample::subsequence((0..6_u32).collect::<Vec<_>>(), 3)),
            turns in prop::array::uniform3(0..3_usize),
            is_one_face in prop::bool::ANY,
            weights in prop::array::uniform9(prop_oneof![1 => Just(0.0), 1 => Just(1e-200), 4 => 0.01..1.0_f64]),
            shares in prop::array::uniform3(prop_oneof![1 => Just(0.0), 1 => Just(1e-200), 6 => 0.01..1.0_f64]),
        ) {
            let row = |i: usize| {
                let mut ids = fields[if is_one_face { 0 } else { i }].clone();
                ids.rotate_left(turns[if is_one_face { 0 } else { i }]);
                let weights = [weights[3 * i], weights[3 * i + 1], weights[3 * i + 2]];
                let some = (0..3).find(|&k| weights[k] != 0.0).unwrap_or(0);
                let field = |k: usize| VertexId::from(ids[if weights[k] == 0.0 { some } else { k }]);
                Row { weights, fields: [field(0), field(1), field(2)], ..Row::default() }
            };
            let rows = [row(0), row(1), row(2)];
            prop_assume!(rows.iter().all(|row| row.weights != [0.0; 3]));
            let rows = [&rows[0], &rows[1], &rows[2]];
            let mut found = FieldWeights::none();
            let strongest = Union::new(rows).add(rows, shares, &mut found);
            let part = |k: usize| (rows[k / 3].fields[k % 3], shares[k / 3] * rows[k / 3].weights[k % 3]);
            let expected: FieldWeights = (0..9).map(part).collect();
            prop_assert_eq!(found, expected);
            let most = expected.iter().map(|(_, weight)| weight).fold(0.0, f64::max);
            if let Some(first) = expected.iter().find(|(_, weight)| *weight == most) {
                prop_assert_eq!(strongest, first.0);
            }
        }
    }
}
