//! Random numbers with the same bytes on every system.

use glam::DVec3;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng, SeedableRng};

use crate::numeric::bits;

/// Uses neither the generator nor the logarithm of the system.
#[derive(Debug, Clone)]
pub(crate) struct Random {
    generator: Pcg64,
    spare: Option<f64>,
}

impl Random {
    /// Streams of one seed are independent, so that adding outliers leaves the noise as it was.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        // Seeds are small numbers: no two of them share a stream.
        let generator = Pcg64::seed_from_u64(seed.wrapping_mul(16).wrapping_add(stream));
        Self { generator, spare: None }
    }

    /// Uniform in [0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        const STEP: f64 = 1.0 / (1_u64 << 53) as f64;
        (self.generator.next_u64() >> 11) as f64 * STEP
    }

    /// Uniform among `0..count`; 0 if there is nothing to choose from.
    #[expect(clippy::cast_possible_truncation, reason = "below `count`, not negative")]
    pub(crate) fn below(&mut self, count: usize) -> usize {
        ((self.uniform() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Standard normal, by the polar method `(marsaglia1964)`.
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let (x, y) = (2.0 * self.uniform() - 1.0, 2.0 * self.uniform() - 1.0);
            let s = x * x + y * y;
            if s > 0.0 && s < 1.0 {
                let factor = (-2.0 * libm::log(s) / s).sqrt();
                self.spare = Some(y * factor);
                return x * factor;
            }
        }
    }

    /// Three independent normal numbers of standard deviation `sigma`.
    pub(crate) fn vector(&mut self, sigma: f64) -> DVec3 {
        sigma * DVec3::new(self.normal(), self.normal(), self.normal())
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        loop {
            if let Some(unit) = self.vector(1.0).try_normalize() {
                return unit;
            }
        }
    }
}

/// SplitMix64 `(steele2014)`: a bijection that looks like noise.
#[doc(hidden)]
pub const fn hash(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// A hash of a position.
pub(crate) fn place_hash(p: DVec3) -> u64 {
    bits(p.to_array()).into_iter().fold(0, |of, x| hash(of ^ x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let mut random = Random::new(7, 0);
        let numbers: Vec<f64> = (0..100_000).map(|_| random.normal()).collect();
        let mean = numbers.iter().sum::<f64>() / 1e5;
        let variance = numbers.iter().map(|x| x * x).sum::<f64>() / 1e5;
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "{mean}, {variance}");
    }

    #[test]
    fn a_seed_gives_the_same_bits_everywhere() {
        let mut random = Random::new(1, 2);
        let bits = [random.normal(), random.normal(), random.uniform()].map(f64::to_bits);
        assert_eq!(bits, [0xbfe4_c761_419b_22ad, 0xbfc0_63ad_8fd3_fbd0, 0x3fd7_b180_a9a3_f6aa]);
    }
}
