//! Eight `f32` numbers at once: with AVX2 and FMA where the processor has them (pulp detects this at run
//! time), else with wide.
//!
//! These computations only select what is measured exactly, in `f64`: the answers are the same on every
//! processor.

use wide::f32x8;

/// Lanes: boxes of a node, triangles or points of a packet.
pub(crate) const LANES: usize = 8;

/// A back-end that computes with eight numbers at a time.
///
/// Everything that uses it down to the innermost function must be `#[inline(always)]`, and must not contain a
/// closure: only functions inlined into [`Simd::run`] are compiled for the processor's instructions.
pub(crate) trait Lanes: Copy {
    /// Eight numbers.
    type F: Copy;
    fn splat(self, x: f32) -> Self::F;
    fn load(self, x: &[f32; LANES]) -> Self::F;
    fn bytes(self, x: &[u8; LANES]) -> Self::F;
    /// Numbers from 0 up to 256 without their fractions.
    fn whole(self, a: Self::F) -> [u8; LANES];
    /// The first three coordinates of eight points.
    fn points(self, points: [&[f32; 4]; LANES]) -> [Self::F; 3];
    /// The least number of each of eight rows.
    fn least_of_rows(self, rows: [Self::F; LANES]) -> Self::F;
    fn store(self, a: Self::F) -> [f32; LANES];
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    fn sqrt(self, a: Self::F) -> Self::F;
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b + c`, rounded once or twice.
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `c - a * b`, rounded once or twice.
    fn sub_mul(self, c: Self::F, a: Self::F, b: Self::F) -> Self::F;
    /// One bit for each lane where `a <= b`.
    fn le(self, a: Self::F, b: Self::F) -> u32;
    /// `yes` where all four `a <= b`, else `no`.
    fn select(self, le: [(Self::F, Self::F); 4], yes: Self::F, no: Self::F) -> Self::F;
    /// The least of numbers that are not negative, as bits, the last three of which are its lane.
    fn least(self, a: Self::F) -> u32;
    /// A point moved by a matrix of columns `x, y, z, shift`; each coordinate in all lanes.
    fn affine(self, columns: &[[f32; 4]; 4], p: [f32; 3]) -> [Self::F; 3];
}

/// Functions of eight numbers each.
macro_rules! numbers {
    ($(fn $name:ident($self:ident $(, $x:ident)*) $body:block)*) => {$(
        #[inline(always)]
        fn $name($self $(, $x: Self::F)*) -> Self::F $body
    )*};
}
#[cfg(target_arch = "x86_64")]
pub(crate) use numbers;

/// For every processor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain;

impl Lanes for Plain {
    type F = f32x8;

    #[inline(always)]
    fn splat(self, x: f32) -> f32x8 {
        f32x8::splat(x)
    }

    #[inline(always)]
    fn load(self, x: &[f32; LANES]) -> f32x8 {
        f32x8::new(*x)
    }

    #[inline(always)]
    fn bytes(self, x: &[u8; LANES]) -> f32x8 {
        f32x8::new(x.map(f32::from))
    }

    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "they fit into a byte")]
    fn whole(self, a: f32x8) -> [u8; LANES] {
        a.to_array().map(|x| x as u8)
    }

    #[inline(always)]
    fn points(self, points: [&[f32; 4]; LANES]) -> [f32x8; 3] {
        [0, 1, 2].map(|c: usize| f32x8::new(points.map(|p| p[c])))
    }

    #[inline(always)]
    fn least_of_rows(self, rows: [f32x8; LANES]) -> f32x8 {
        let [a, b, c, d, e, f, g, h] = f32x8::transpose(rows);
        let (a, b) = (a.fast_min(e).fast_min(b.fast_min(f)), c.fast_min(g).fast_min(d.fast_min(h)));
        a.fast_min(b)
    }

    #[inline(always)]
    fn store(self, a: f32x8) -> [f32; LANES] {
        a.to_array()
    }

    numbers! {
        fn add(self, a, b) { a + b }
        fn sub(self, a, b) { a - b }
        fn mul(self, a, b) { a * b }
        fn div(self, a, b) { a / b }
        fn sqrt(self, a) { a.sqrt() }
        fn max(self, a, b) { a.fast_max(b) }
        fn min(self, a, b) { a.fast_min(b) }
        fn mul_add(self, a, b, c) { a * b + c }
        fn sub_mul(self, c, a, b) { c - a * b }
    }

    #[inline(always)]
    fn le(self, a: f32x8, b: f32x8) -> u32 {
        a.simd_le(b).to_bitmask()
    }

    #[inline(always)]
    fn select(self, [p, q, r, s]: [(f32x8, f32x8); 4], yes: f32x8, no: f32x8) -> f32x8 {
        let all = p.0.simd_le(p.1) & q.0.simd_le(q.1) & r.0.simd_le(r.1) & s.0.simd_le(s.1);
        all.select(yes, no)
    }

    #[inline(always)]
    fn least(self, a: f32x8) -> u32 {
        // Bits of such numbers sort as they do. Without a branch, since the lane is unpredictable.
        let mut lane = 0;
        let keys = a.to_array().map(|x| {
            let key = x.to_bits() & !7 | lane;
            lane += 1;
            key
        });
        let [a, b] = [keys[0].min(keys[1]), keys[2].min(keys[3])];
        let [c, d] = [keys[4].min(keys[5]), keys[6].min(keys[7])];
        a.min(b).min(c.min(d))
    }

    #[inline(always)]
    fn affine(self, m: &[[f32; 4]; 4], p: [f32; 3]) -> [f32x8; 3] {
        [0, 1, 2].map(|k| f32x8::splat(m[0][k] * p[0] + m[1][k] * p[1] + m[2][k] * p[2] + m[3][k]))
    }
}

/// The largest number of each of eight rows.
#[inline(always)]
pub(crate) fn most_of_rows<L: Lanes>(l: L, mut rows: [L::F; LANES]) -> L::F {
    let zero = l.splat(0.0);
    for row in &mut rows {
        *row = l.sub(zero, *row);
    }
    l.sub(zero, l.least_of_rows(rows))
}

/// A computation that is generic over the back-end.
pub(crate) trait Kernel {
    type Output;
    /// Must be `#[inline(always)]`.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// The fastest back-end of this processor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Simd {
    #[cfg(target_arch = "x86_64")]
    v3: Option<pulp::x86::V3>,
}

#[cfg(target_arch = "x86_64")]
struct Wrapped<K> {
    kernel: K,
    v3: pulp::x86::V3,
}

#[cfg(target_arch = "x86_64")]
impl<K: Kernel> pulp::NullaryFnOnce for Wrapped<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.kernel.run(self.v3)
    }
}

impl Simd {
    pub(crate) fn detect() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            v3: pulp::x86::V3::try_new(),
        }
    }

    /// The back-end of processors without AVX2.
    #[cfg(test)]
    pub(crate) fn plain() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            v3: None,
        }
    }

    #[inline(always)]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = self.v3 {
            return v3.vectorize(Wrapped { kernel, v3 });
        }
        kernel.run(Plain)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Least([f32; LANES]);

    impl Kernel for Least {
        type Output = u32;

        fn run<L: Lanes>(self, l: L) -> u32 {
            l.least(l.load(&self.0))
        }
    }

    /// Bytes, coordinates and least and largest numbers of eight rows.
    struct Rows([[f32; LANES]; LANES]);

    impl Kernel for Rows {
        type Output = ([u8; LANES], [[f32; LANES]; 3], [f32; LANES], [f32; LANES]);

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let rows = self.0.map(|row| l.load(&row));
            let points = self.0.map(|[x, y, z, w, ..]| [x, y, z, w]);
            let [x, y, z] = l.points(points.each_ref());
            let least = l.store(l.least_of_rows(rows));
            let most = l.store(most_of_rows(l, rows));
            (l.whole(rows[1]), [l.store(x), l.store(y), l.store(z)], least, most)
        }
    }

    #[test]
    fn both_back_ends_reduce_rows_alike() {
        let number = |k: usize| f32::from(u8::try_from(k * 37 % 256).unwrap()) + 0.75;
        let rows: [[f32; LANES]; LANES] = [0, 1, 2, 3, 4, 5, 6, 7]
            .map(|i: usize| [0, 1, 2, 3, 4, 5, 6, 7].map(|j: usize| number(8 * i + j)));
        let bytes = rows[1].map(|x| x.floor().to_string().parse().unwrap());
        let points = [0, 1, 2].map(|c: usize| rows.map(|row| row[c]));
        let least = rows.map(|row| row.into_iter().fold(f32::INFINITY, f32::min));
        let most = rows.map(|row| row.into_iter().fold(f32::NEG_INFINITY, f32::max));
        let expected = (bytes, points, least, most);
        assert_eq!(Rows(rows).run(Plain), expected);
        assert_eq!(Simd::detect().run(Rows(rows)), expected);
    }

    #[test]
    fn the_least_lane_is_that_of_the_least_number() {
        for least in 0..LANES {
            let mut numbers = [f32::INFINITY; LANES];
            numbers[(least + 3) % LANES] = 2.0;
            numbers[least] = if least == 0 { 0.0 } else { 1e-20 };
            for found in [Least(numbers).run(Plain), Simd::detect().run(Least(numbers))] {
                assert_eq!(found as usize & 7, least);
            }
        }
    }
}
