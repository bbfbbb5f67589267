//! [`FieldWeights`]: the receptive fields of a contact, summed over the corners of its face.

use crate::id::VertexId;

/// Most fields of a contact: each of a face's three corners lies in up to three.
pub(super) const MOST_FIELDS: usize = 9;

/// The receptive fields in which a contact lies: ids ascending, weights positive with sum 1.
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

impl FieldWeights {
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self { len: 0, fields: [VertexId::default(); MOST_FIELDS], weights: [0.0; MOST_FIELDS] }
    }

    /// Leaves out fields without weight.
    #[cold]
    #[inline(never)]
    pub(super) fn leave_out_zeros(&mut self) {
        let Self { len, fields, weights } = *self;
        *self = Self::none();
        for (field, weight) in fields.into_iter().zip(weights).take(len).filter(|part| part.1 != 0.0) {
            (self.fields[self.len], self.weights[self.len]) = (field, weight);
            self.len += 1;
        }
    }

    /// The weights of the corners of a face, and the field of the largest, the smallest of several.
    #[inline(always)]
    pub(super) fn of_corners(corners: [VertexId; 3], weights: [f64; 3]) -> (Self, VertexId) {
        let ([a, b, c], [u, v, w]) = (corners, weights);
        if (a == b) | (b == c) | (c == a) | (u == 0.0) | (v == 0.0) | (w == 0.0) {
            return Self::of_some(corners, weights);
        }
        // Without a branch: the order of the corners is unpredictable.
        let sorted = |a: (VertexId, f64), b: (VertexId, f64)| if a.0 < b.0 { (a, b) } else { (b, a) };
        let (a, b) = sorted((a, u), (b, v));
        let (b, c) = sorted(b, (c, w));
        let (a, b) = sorted(a, b);
        let stronger = |a: (VertexId, f64), b: (VertexId, f64)| if b.1 > a.1 { b } else { a };
        let strongest = stronger(stronger(a, b), c).0;
        let none = VertexId::default();
        let fields = [a.0, b.0, c.0, none, none, none, none, none, none];
        let weights = [a.1, b.1, c.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        (Self { len: 3, fields, weights }, strongest)
    }

    /// As [`Self::of_corners`], where corners are one field or have no weight.
    #[inline(never)]
    fn of_some(corners: [VertexId; 3], weights: [f64; 3]) -> (Self, VertexId) {
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

        /// Weights of 0 and corners that are one vertex included.
        #[test]
        fn corners_are_added_up_field_by_field(
            corners in prop::array::uniform3(0..4_u32),
            weights in prop::array::uniform3(prop_oneof![1 => Just(0.0), 3 => 0.01..1.0_f64]),
        ) {
            let corners = corners.map(VertexId::from);
            let (found, strongest) = FieldWeights::of_corners(corners, weights);
            let expected: FieldWeights = corners.into_iter().zip(weights).collect();
            prop_assert_eq!(found, expected);
            let most = expected.iter().map(|(_, weight)| weight).fold(0.0, f64::max);
            let first = expected.iter().find(|(_, weight)| *weight == most);
            prop_assert_eq!(strongest, first.map_or(VertexId::default(), |(field, _)| field));
        }
    }
}
