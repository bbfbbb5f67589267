//! Eight `f32` numbers in one AVX register.

use std::arch::x86_64::{__m128, __m128i, __m256, __m256i, _CMP_LE_OQ};

use pulp::{cast, x86::V3};

use crate::lanes::{LANES, Lanes, numbers};

impl Lanes for V3 {
    type F = __m256;

    #[inline(always)]
    fn splat(self, x: f32) -> __m256 {
        self.avx._mm256_set1_ps(x)
    }

    #[inline(always)]
    fn load(self, x: &[f32; LANES]) -> __m256 {
        cast(*x)
    }

    #[inline(always)]
    fn bytes(self, x: &[u8; LANES]) -> __m256 {
        let x: __m128i = cast([u64::from_le_bytes(*x), 0]);
        self.avx._mm256_cvtepi32_ps(self.avx2._mm256_cvtepu8_epi32(x))
    }

    #[inline(always)]
    fn whole(self, a: __m256) -> [u8; LANES] {
        let [low, high]: [__m128i; 2] = cast(self.avx._mm256_cvttps_epi32(a));
        let words = self.sse4_1._mm_packus_epi32(low, high);
        let [bytes, _]: [u64; 2] = cast(self.sse2._mm_packus_epi16(words, words));
        bytes.to_le_bytes()
    }

    #[inline(always)]
    fn points(self, [a, b, c, d, e, f, g, h]: [&[f32; 4]; LANES]) -> [__m256; 3] {
        let avx = self.avx;
        let (ae, bf): (__m256, __m256) = (cast([*a, *e]), cast([*b, *f]));
        let (cg, dh): (__m256, __m256) = (cast([*c, *g]), cast([*d, *h]));
        let (ab, cd) = (avx._mm256_unpacklo_ps(ae, bf), avx._mm256_unpacklo_ps(cg, dh));
        let (z_ab, z_cd) = (avx._mm256_unpackhi_ps(ae, bf), avx._mm256_unpackhi_ps(cg, dh));
        [
            avx._mm256_shuffle_ps::<0b01_00_01_00>(ab, cd),
            avx._mm256_shuffle_ps::<0b11_10_11_10>(ab, cd),
            avx._mm256_shuffle_ps::<0b01_00_01_00>(z_ab, z_cd),
        ]
    }

    #[inline(always)]
    fn least_of_rows(self, [a, b, c, d, e, f, g, h]: [__m256; LANES]) -> __m256 {
        let avx = self.avx;
        // Reduces each row to four numbers, then to two, then to one.
        let ab = self.min(avx._mm256_unpacklo_ps(a, b), avx._mm256_unpackhi_ps(a, b));
        let cd = self.min(avx._mm256_unpacklo_ps(c, d), avx._mm256_unpackhi_ps(c, d));
        let ef = self.min(avx._mm256_unpacklo_ps(e, f), avx._mm256_unpackhi_ps(e, f));
        let gh = self.min(avx._mm256_unpacklo_ps(g, h), avx._mm256_unpackhi_ps(g, h));
        let low = avx._mm256_shuffle_ps::<0b01_00_01_00>(ab, cd);
        let low = self.min(low, avx._mm256_shuffle_ps::<0b11_10_11_10>(ab, cd));
        let high = avx._mm256_shuffle_ps::<0b01_00_01_00>(ef, gh);
        let high = self.min(high, avx._mm256_shuffle_ps::<0b11_10_11_10>(ef, gh));
        let one = avx._mm256_permute2f128_ps::<0x20>(low, high);
        self.min(one, avx._mm256_permute2f128_ps::<0x31>(low, high))
    }

    #[inline(always)]
    fn store(self, a: __m256) -> [f32; LANES] {
        cast(a)
    }

    numbers! {
        fn add(self, a, b) { self.avx._mm256_add_ps(a, b) }
        fn sub(self, a, b) { self.avx._mm256_sub_ps(a, b) }
        fn mul(self, a, b) { self.avx._mm256_mul_ps(a, b) }
        fn div(self, a, b) { self.avx._mm256_div_ps(a, b) }
        fn sqrt(self, a) { self.avx._mm256_sqrt_ps(a) }
        fn max(self, a, b) { self.avx._mm256_max_ps(a, b) }
        fn min(self, a, b) { self.avx._mm256_min_ps(a, b) }
        fn mul_add(self, a, b, c) { self.fma._mm256_fmadd_ps(a, b, c) }
        fn sub_mul(self, c, a, b) { self.fma._mm256_fnmadd_ps(a, b, c) }
    }

    #[inline(always)]
    fn le(self, a: __m256, b: __m256) -> u32 {
        self.avx._mm256_movemask_ps(self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(a, b)).cast_unsigned()
    }

    #[inline(always)]
    fn select(self, [p, q, r, s]: [(__m256, __m256); 4], yes: __m256, no: __m256) -> __m256 {
        let p = self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(p.0, p.1);
        let q = self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(q.0, q.1);
        let r = self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(r.0, r.1);
        let s = self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(s.0, s.1);
        let all = self.avx._mm256_and_ps(self.avx._mm256_and_ps(p, q), self.avx._mm256_and_ps(r, s));
        self.avx._mm256_blendv_ps(no, yes, all)
    }

    #[inline(always)]
    fn least(self, a: __m256) -> u32 {
        let lane: __m256i = cast([0_u32, 1, 2, 3, 4, 5, 6, 7]);
        let cleared = self.avx2._mm256_andnot_si256(self.avx._mm256_set1_epi32(7), cast(a));
        let [low, high]: [__m128i; 2] = cast(self.avx2._mm256_or_si256(cleared, lane));
        let a = self.sse4_1._mm_min_epu32(low, high);
        let b = self.sse4_1._mm_min_epu32(a, self.sse2._mm_shuffle_epi32::<0b01_00_11_10>(a));
        let c = self.sse4_1._mm_min_epu32(b, self.sse2._mm_shuffle_epi32::<0b10_11_00_01>(b));
        self.sse2._mm_cvtsi128_si32(c).cast_unsigned()
    }

    #[inline(always)]
    fn affine(self, columns: &[[f32; 4]; 4], p: [f32; 3]) -> [__m256; 3] {
        let (fma, sse) = (self.fma, self.sse);
        let [x, y, z, shift]: [__m128; 4] = cast(*columns);
        let v = fma._mm_fmadd_ps(z, sse._mm_set1_ps(p[2]), shift);
        let v = fma._mm_fmadd_ps(y, sse._mm_set1_ps(p[1]), v);
        let v = fma._mm_fmadd_ps(x, sse._mm_set1_ps(p[0]), v);
        let (v1, v2) = (sse._mm_shuffle_ps::<0x55>(v, v), sse._mm_shuffle_ps::<0xaa>(v, v));
        [
            self.avx2._mm256_broadcastss_ps(v),
            self.avx2._mm256_broadcastss_ps(v1),
            self.avx2._mm256_broadcastss_ps(v2),
        ]
    }
}
