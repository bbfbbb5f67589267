//! Ends of a scale of colours for a whole recording.

use std::collections::BTreeMap;

/// Ends of a scale for a whole recording: percentiles of all that was added, in bounded memory.
///
/// Values are counted in bins of equal ratio, 50 to an octave, so a percentile is exact to 1.4 %.
///
/// ```
/// let mut range = dermatome::plot::ValueRange::default();
/// range.extend((0..=1000).map(f64::from));
/// let [low, high] = range.percentiles(1.0, 99.0).unwrap();
/// assert!((low / 10.0 - 1.0).abs() < 0.02 && (high / 990.0 - 1.0).abs() < 0.02);
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ValueRange {
    /// Number of values in each bin, by sign and logarithm.
    bins: BTreeMap<i64, u64>,
}

/// Bins for each factor of two.
const BINS_PER_OCTAVE: f64 = 50.0;

/// Added to the bin of a magnitude, so that those of positive numbers are positive.
const BIN_OF_ONE: f64 = 60_000.0;

impl ValueRange {
    /// The values that `low` and `high` percent of all are not above; `None` without values, or if
    /// both are the same.
    #[must_use]
    pub fn percentiles(&self, low: f64, high: f64) -> Option<[f64; 2]> {
        let total: u64 = self.bins.values().sum();
        let value_at = |percent: f64| {
            let mut left = (percent / 100.0).clamp(0.0, 1.0) * total as f64;
            let bin = self.bins.iter().find(|(_, count)| {
                left -= **count as f64;
                left <= 0.0
            });
            bin.map(|(&bin, _)| value_of(bin))
        };
        let [low, high] = [value_at(low)?, value_at(high)?];
        (low < high).then_some([low, high])
    }
}

/// Counts values; NaN and infinite ones are left out.
impl Extend<f64> for ValueRange {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        for value in values.into_iter().filter(|x| x.is_finite()) {
            *self.bins.entry(bin_of(value)).or_default() += 1;
        }
    }
}

fn bin_of(value: f64) -> i64 {
    if value == 0.0 {
        return 0;
    }
    #[expect(clippy::cast_possible_truncation, reason = "at most 120 000")]
    let bin = (BIN_OF_ONE + BINS_PER_OCTAVE * value.abs().log2()).round() as i64;
    if value < 0.0 { -bin } else { bin }
}

fn value_of(bin: i64) -> f64 {
    if bin == 0 {
        return 0.0;
    }
    let magnitude = ((bin.abs() as f64 - BIN_OF_ONE) / BINS_PER_OCTAVE).exp2();
    if bin < 0 { -magnitude } else { magnitude }
}
