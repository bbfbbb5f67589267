//! Arrays for the page: a header as JSON, then the planes of every array, gzip and base64.
//!
//! A plane contains the differences of consecutive numbers, both signs coded as `0, -1, 1, -2, ...`: first
//! the lowest bytes of all of them, then the next. Neighbours on the skin are neighbours in the file, so most
//! bytes are small. Of 100 000 taxels that takes a fourteenth of `map.glb`.

use std::io::Write;

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::GzEncoder};
use glam::{DVec2, DVec3};
use serde::Serialize;

/// The number of a share of 1.
pub(super) const WHOLE: f64 = 65535.0;

#[derive(Debug, Default)]
pub(super) struct Packer {
    /// For each array: planes, bytes of a number, and numbers of a plane.
    arrays: Vec<[usize; 3]>,
    bytes: Vec<u8>,
}

/// A box in which shares of 65535 are positions; one number for each axis.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Region {
    lo: Vec<f64>,
    size: Vec<f64>,
}

impl Packer {
    /// Adds an array of planes of equal length, in as few bytes a number as all of them need; returns its index.
    pub(super) fn planes(&mut self, planes: &[Vec<u32>]) -> usize {
        let most = planes.iter().flatten().copied().max().unwrap_or_default();
        let width = match most {
            0..=0xff => 1,
            0x100..=0xffff => 2,
            _ => 4,
        };
        self.array(planes, width)
    }

    /// Adds an array of one plane of numbers up to 255.
    pub(super) fn bytes(&mut self, plane: Vec<u32>) -> usize {
        self.array(&[plane], 1)
    }

    /// Adds an array of numbers of `width` bytes.
    fn array(&mut self, planes: &[Vec<u32>], width: usize) -> usize {
        let count = planes.first().map_or(0, Vec::len);
        self.arrays.push([planes.len(), width, count]);
        let unused = 32 - 8 * width;
        for plane in planes {
            let mut last = 0_u32;
            let differences: Vec<u32> = plane
                .iter()
                .map(|&x| {
                    // Differences wrap within the width; the sign becomes the lowest bit.
                    let shifted = x.wrapping_sub(last) << unused;
                    last = x;
                    let difference = shifted.cast_signed() >> unused;
                    (difference << 1 ^ difference >> 31).cast_unsigned()
                })
                .collect();
            for byte in 0..width {
                self.bytes.extend(differences.iter().map(|x| x.to_le_bytes()[byte]));
            }
        }
        self.arrays.len() - 1
    }

    /// Shares of 65535 of points in the box around them; further points may share the box.
    pub(super) fn points(&mut self, points: &[&[DVec3]]) -> (usize, Region) {
        let all = || points.iter().copied().flatten();
        let lo = all().copied().fold(DVec3::INFINITY, DVec3::min);
        let size = all().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - lo;
        let share = |x: f64, axis: usize| share(x - lo[axis], size[axis]);
        let plane = |(points, axis): (&[DVec3], usize)| points.iter().map(|p| share(p[axis], axis)).collect();
        let planes: Vec<Vec<u32>> =
            points.iter().flat_map(|&points| [0, 1, 2].map(|axis| plane((points, axis)))).collect();
        let index = self.array(&planes, 2);
        (index, Region { lo: lo.to_array().to_vec(), size: size.to_array().to_vec() })
    }

    /// As [`Self::points`], in the plane.
    pub(super) fn places(&mut self, points: &[DVec2]) -> (usize, Region) {
        let lo = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let size = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max) - lo;
        let plane = |axis: usize| points.iter().map(|p| share(p[axis] - lo[axis], size[axis])).collect();
        let index = self.array(&[plane(0), plane(1)], 2);
        (index, Region { lo: lo.to_array().to_vec(), size: size.to_array().to_vec() })
    }

    /// Numbers as shares of the range between the least and the largest.
    pub(super) fn values(&mut self, name: &'static str, unit: &'static str, of: &[f64]) -> Values {
        let known = || of.iter().copied().filter(|x| x.is_finite());
        let (lo, hi) = (known().fold(f64::INFINITY, f64::min), known().fold(f64::NEG_INFINITY, f64::max));
        let (lo, hi) = if lo <= hi { (lo, hi) } else { (0.0, 0.0) };
        let data = self.array(&[of.iter().map(|x| share(x - lo, hi - lo)).collect()], 2);
        Values { name, unit, lo, hi, data }
    }

    /// Rows of three indices with weights that add up to 1: the largest weight comes first and is not stored,
    /// the others are in units of `1 / whole`, and no weight above 0 becomes 0.
    pub(super) fn rows(
        &mut self,
        rows: impl Iterator<Item = ([u32; 3], [f64; 3])>,
        whole: u32,
    ) -> PackedRows {
        let (mut indices, mut weights) = ([(); 3].map(|()| Vec::new()), [(); 2].map(|()| Vec::new()));
        for (named, shares) in rows {
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| shares[b].total_cmp(&shares[a]));
            for (list, k) in indices.iter_mut().zip(order) {
                list.push(if shares[k] > 0.0 { named[k] } else { named[order[0]] });
            }
            for (list, k) in weights.iter_mut().zip(&order[1..]) {
                let units = (shares[*k] * f64::from(whole)).round();
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "at most half of `whole`"
                )]
                list.push(if shares[*k] > 0.0 { (units as u32).max(1) } else { 0 });
            }
        }
        PackedRows { indices: self.planes(&indices), weights: self.planes(&weights) }
    }

    /// The text for the page: a header, which names the arrays, and the arrays.
    pub(super) fn finish(&self, header: &impl Serialize) -> String {
        #[derive(Serialize)]
        struct Whole<'a, H> {
            #[serde(flatten)]
            header: &'a H,
            arrays: &'a [[usize; 3]],
        }
        let json = serde_json::to_vec(&Whole { header, arrays: &self.arrays });
        let json = json.expect("numbers and texts are JSON");
        let length = u32::try_from(json.len()).unwrap_or(u32::MAX).to_le_bytes();
        let mut gzip = GzEncoder::new(Vec::new(), Compression::new(6));
        let written = [&length[..], &json, &self.bytes].iter().try_for_each(|part| gzip.write_all(part));
        STANDARD.encode(written.and_then(|()| gzip.finish()).expect("memory takes what is written"))
    }
}

/// Numbers as shares of a range.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Values {
    name: &'static str,
    unit: &'static str,
    lo: f64,
    hi: f64,
    data: usize,
}

/// Convex combinations of three entries.
#[derive(Debug, Clone, Serialize)]
pub(super) struct PackedRows {
    indices: usize,
    weights: usize,
}

/// A share of a whole in 65535ths; 0 if the whole is 0.
pub(super) fn share(part: f64, whole: f64) -> u32 {
    let share = (WHOLE * part / whole).round().clamp(0.0, WHOLE);
    // A NaN becomes 0.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "it is clamped to 0 to 65535"
    )]
    {
        share as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads as the page does.
    fn read(bytes: &[u8], width: usize, count: usize) -> Vec<u32> {
        let mut last = 0_u32;
        let number =
            |k: usize| (0..width).map(|byte| u32::from(bytes[byte * count + k]) << (8 * byte)).sum::<u32>();
        let mask = u32::MAX >> (32 - 8 * width);
        (0..count)
            .map(|k| {
                let zigzag = number(k);
                last = last.wrapping_add((zigzag >> 1) ^ (zigzag & 1).wrapping_neg()) & mask;
                last
            })
            .collect()
    }

    #[test]
    fn planes_are_read_as_they_were_written() {
        for (plane, width) in [
            (vec![0, 255, 0, 128, 127, 3], 1),
            (vec![65535, 0, 32768, 32767, 1], 2),
            (vec![u32::MAX, 0, 1 << 31, (1 << 31) - 1, 7], 4),
        ] {
            let mut packer = Packer::default();
            packer.planes(std::slice::from_ref(&plane));
            assert_eq!(packer.arrays, [[1, width, plane.len()]]);
            assert_eq!(read(&packer.bytes, width, plane.len()), plane);
        }
    }

    #[test]
    fn a_weight_stays_above_zero_and_the_largest_is_the_rest() {
        let mut packer = Packer::default();
        packer.rows([([7, 8, 9], [1e-9, 0.0, 1.0 - 1e-9])].into_iter(), 255);
        assert_eq!(packer.arrays, [[3, 1, 1], [2, 1, 1]]);
        assert_eq!(packer.bytes, [2 * 9, 2 * 7, 2 * 9, 2, 0], "indices 9, 7 and none; weights 1/255 and 0");
    }
}
