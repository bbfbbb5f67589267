//! Eight `f32` numbers side by side.

use glam::Vec3;
use wide::f32x8;

/// Lanes of `f32x8`: boxes of a node, triangles of a packet.
pub(super) const LANES: usize = 8;

/// A point, the same in every lane.
pub(super) type Wide3 = [f32x8; 3];

pub(super) fn splat(p: Vec3) -> Wide3 {
    p.to_array().map(f32x8::splat)
}

/// The lane of the least of eight numbers that are not negative.
#[inline]
pub(super) fn least_lane(numbers: f32x8) -> usize {
    // Bits of such numbers sort as they do; the lane takes the place of the last three. Without a
    // branch, since which lane it is cannot be foreseen.
    let mut lane = 0;
    let keys = numbers.to_array().map(|x| {
        let key = x.to_bits() & !7 | lane;
        lane += 1;
        key
    });
    let least = |a: &[u32], b: &[u32]| [a[0].min(b[0]), a[1].min(b[1])];
    let [a, b] = [least(&keys[0..2], &keys[2..4]), least(&keys[4..6], &keys[6..8])];
    let [c, d] = least(&a, &b);
    (c.min(d) & 7) as usize
}

/// The numbers of the bits set in `mask`, lowest first.
#[inline]
pub(super) fn lanes(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros();
        mask &= mask.wrapping_sub(1);
        (lane < u32::BITS).then_some(lane as usize)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_lane_is_that_of_the_least_number() {
        for least in 0..LANES {
            let mut numbers = [f32::INFINITY; LANES];
            numbers[(least + 3) % LANES] = 2.0;
            numbers[least] = if least == 0 { 0.0 } else { 1e-20 };
            assert_eq!(least_lane(f32x8::new(numbers)), least);
        }
    }

    #[test]
    fn lanes_are_the_bits_of_a_mask() {
        assert_eq!(lanes(0b1010_0001).collect::<Vec<_>>(), [0, 5, 7]);
        assert_eq!(lanes(0).count(), 0);
    }
}
