//! [`FieldWeights`]: the receptive fields that a contact lies in, added up from those of the corners of its
//! face.

use crate::id::VertexId;

/// Fields that a contact can lie in: each of a face's three corners lies in up to three.
pub(super) const MOST_FIELDS: usize = 9;

/// The receptive fields a contact lies in: ids rising, weights positive with sum 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldWeights {
    pub(super) len: usize,
    pub(super) fields: [VertexId; MOST_FIELDS],
    pub(super) weights: [f64; MOST_FIELDS],
}

impl FromIterator<(VertexId, f64)> for FieldWeights {
    /// The sums of the weights of each field.
    ///
    /// # Panics
    /// If there are more than nine fields.
    fn from_iter<I: IntoIterator<Item = (VertexId, f64)>>(fields: I) -> Self {
        let mut all: Vec<_> = fields.into_iter().filter(|(_, weight)| *weight != 0.0).collect();
        all.sort_by_key(|(field, _)| *field);
        let mut sum = Self::none();
        for (field, weight) in all {
            if sum.len == 0 || sum.fields[sum.len - 1] != field {
                sum.fields[sum.len] = field;
                sum.len += 1;
            }
            sum.weights[sum.len - 1] += weight;
        }
        sum
    }
}

/// How the fields of the three rows of a face add up on one level: for each of the nine its place among
/// those of some weight, ids rising, in four bits.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Union(pub(super) u64);

impl Union {
    /// The place of a field without weight.
    const NOWHERE: usize = 15;

    pub(super) fn new(parts: &[(VertexId, f64); MOST_FIELDS]) -> Self {
        let is_one_face = (3..MOST_FIELDS).all(|k| parts[k].0 == parts[k % 3].0);
        if is_one_face {
            let [a, b] = [0, 1].map(|k| usize::from((k..MOST_FIELDS).step_by(3).any(|k| parts[k].1 != 0.0)));
            return Self::coded(parts, |k| [0, a, a + b][k % 3]);
        }
        let mut fields = [VertexId::from(u32::MAX); MOST_FIELDS + 1];
        let mut len = 0;
        for &(field, _) in parts.iter().filter(|(_, weight)| *weight != 0.0) {
            let place = fields.iter().take_while(|&&other| other < field).count();
            if fields[place] != field {
                fields.copy_within(place..len, place + 1);
                fields[place] = field;
                len += 1;
            }
        }
        Self::coded(parts, |k| fields.iter().take_while(|&&other| other < parts[k].0).count())
    }

    fn coded(parts: &[(VertexId, f64); MOST_FIELDS], place: impl Fn(usize) -> usize) -> Self {
        let place = |k: usize| if parts[k].1 == 0.0 { Self::NOWHERE } else { place(k) };
        Self((0..MOST_FIELDS).rev().fold(0, |code, k| code << 4 | place(k) as u64))
    }

    /// The sums of the weights of each field, added in their order; and the field of the largest sum, the
    /// smallest of several.
    #[inline(always)]
    pub(super) fn sums(self, parts: &[(VertexId, f64); MOST_FIELDS]) -> (FieldWeights, VertexId) {
        let (mut fields, mut weights) = ([VertexId::default(); 16], [0.0; 16]);
        let mut code = self.0;
        for &(field, weight) in parts {
            let place = (code & 15) as usize;
            fields[place] = field;
            weights[place] += weight;
            code >>= 4;
        }
        let mut all = FieldWeights::none();
        let (mut strongest, mut most) = (VertexId::default(), f64::NEG_INFINITY);
        for (field, weight) in fields.into_iter().zip(weights).take(MOST_FIELDS) {
            let is_field = weight != 0.0;
            let is_most = is_field & (weight > most);
            (all.fields[all.len % MOST_FIELDS], all.weights[all.len % MOST_FIELDS]) = (field, weight);
            all.len += usize::from(is_field);
            strongest = if is_most { field } else { strongest };
            most = if is_most { weight } else { most };
        }
        if all.len < MOST_FIELDS {
            (all.fields[all.len], all.weights[all.len]) = (VertexId::default(), 0.0);
        }
        (all, strongest)
    }
}

impl FieldWeights {
    fn none() -> Self {
        Self { len: 0, fields: [VertexId::default(); MOST_FIELDS], weights: [0.0; MOST_FIELDS] }
    }

    /// The weights of the corners of a face, and the field of the largest, the smallest of several.
    ///
    /// Without a branch: which corner comes first cannot be foreseen.
    #[inline(always)]
    pub(super) fn of_corners(corners: [VertexId; 3], weights: [f64; 3]) -> (Self, VertexId) {
        let key = |k: usize| u64::from(corners[k].raw()) << 2 | k as u64;
        let (a, b, c) = (key(0).min(key(1)), key(0).max(key(1)), key(2));
        let keys = [a.min(c), a.max(c).min(b), b.max(c)];
        let mut all = Self::none();
        let (mut sum, mut strongest, mut most) = (0.0, VertexId::default(), f64::NEG_INFINITY);
        for (k, key) in keys.into_iter().enumerate() {
            let field = corners[(key & 3) as usize % 3];
            sum += weights[(key & 3) as usize % 3];
            let is_last = keys.get(k + 1).is_none_or(|next| next >> 2 != key >> 2);
            let is_field = is_last & (sum != 0.0);
            let is_most = is_field & (sum > most);
            (all.fields[all.len % 3], all.weights[all.len % 3]) = (field, sum);
            all.len += usize::from(is_field);
            strongest = if is_most { field } else { strongest };
            most = if is_most { sum } else { most };
            sum = if is_last { 0.0 } else { sum };
        }
        (all.fields[all.len], all.weights[all.len]) = (VertexId::default(), 0.0);
        (all, strongest)
    }

    /// Fields and weights, smallest id first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (VertexId, f64)> + '_ {
        self.fields[..self.len].iter().copied().zip(self.weights[..self.len].iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;

    proptest! {
        #![proptest_config(soup::fixed(1000, 61))]

        /// Whatever the rows have in common, weights and shares of 0 included.
        #[test]
        fn sums_are_those_of_each_field(
            rows in prop::array::uniform3(prop::sample::subsequence((0..6_u32).collect::<Vec<_>>(), 3)),
            weights in prop::array::uniform9(prop_oneof![1 => Just(0.0), 2 => 0.01..1.0_f64]),
            shares in prop::array::uniform3(prop_oneof![1 => Just(0.0), 3 => 0.01..1.0_f64]),
        ) {
            let parts = |shares: [f64; 3]| -> [(VertexId, f64); MOST_FIELDS] {
                std::array::from_fn(|k| (VertexId::from(rows[k / 3][k % 3]), shares[k / 3] * weights[k]))
            };
            let (sums, strongest) = Union::new(&parts([1.0; 3])).sums(&parts(shares));
            let expected: FieldWeights = parts(shares).into_iter().collect();
            prop_assert_eq!(sums, expected);
            let most = expected.iter().map(|(_, weight)| weight).fold(0.0, f64::max);
            let first = expected.iter().find(|(_, weight)| *weight == most);
            prop_assert_eq!(strongest, first.map_or(VertexId::default(), |(field, _)| field));

            let corners = [0, 3, 6].map(|k| parts(shares)[k]);
            let (sums, strongest) = FieldWeights::of_corners(corners.map(|c| c.0), corners.map(|c| c.1));
            let expected: FieldWeights = corners.into_iter().collect();
            prop_assert_eq!(sums, expected);
            let most = expected.iter().map(|(_, weight)| weight).fold(0.0, f64::max);
            let first = expected.iter().find(|(_, weight)| *weight == most);
            prop_assert_eq!(strongest, first.map_or(VertexId::default(), |(field, _)| field));
        }
    }
}
