//! Eight `f32` numbers side by side.

use glam::Vec3;
use wide::f32x8;

/// Lanes of `f32x8`: boxes of a node, triangles of a packet.
pub(super) const LANES: usize = 8;

/// A point, the same in every lane.
pub(super) type Wide3 = [f32x8; 3];

/// The same point in every lane.
pub(super) fn splat(p: Vec3) -> Wide3 {
    p.to_array().map(f32x8::splat)
}

/// The lane of the least of eight numbers that are not negative.
#[inline]
pub(super) fn least_lane(numbers: f32x8) -> usize {
    // Bits of such numbers sort as they do; the lane takes the place of the last three. Without a branch, since
    // which lane it is cannot be foreseen.
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
