//! What the first frames show of sign, zero and axes (*heuristic*, measured on 331 recordings of CySkin with a clear press:
//! the sign of 98.8 % is right and of none wrong; of recordings that begin under load up to a quarter is wrong. So it is a
//! statement, and refused is only what contradicts a zero that the layout states).

use crate::numeric::median_of;

/// Frames from which it is judged.
pub(super) const CHECKED_FRAMES: usize = 256;

/// A channel has moved if it is this many times its noise away.
const CLEAR: f64 = 20.0;

/// Channels that move, at least, for a statement: fewer may move by chance.
const ENOUGH: usize = 6;

/// A move is one of taxels if it is this share of the largest one of a taxel.
const SHARE_OF_TAXELS: f64 = 0.2;

/// A level differs from the stated zero by more than this share of it, or it is the zero.
const SHARE_OF_ZERO: f64 = 0.01;

/// How each taxel moves in the first frames, in units of its noise.
pub(super) struct Moves {
    /// The noise of most taxels, in the unit of the values.
    noise: f64,
    /// Taxels that rise and that fall from where they began.
    pub(super) rising: usize,
    pub(super) falling: usize,
    /// Taxels above and below zero.
    above: usize,
    below: usize,
    /// The middle of all values, and the largest size of any.
    middle: f64,
    largest: f64,
    /// The largest range of values of a taxel.
    range: f64,
}

fn median(values: &mut [f64]) -> f64 {
    median_of(values).unwrap_or_default()
}

fn range_of(values: &[f64]) -> f64 {
    let [low, high] = values.iter().fold([f64::MAX, f64::MIN], |[l, h], &x| [l.min(x), h.max(x)]);
    (high - low).max(0.0)
}

/// The median step between frames, slightly enlarged.
fn noise_of(values: &[f64]) -> f64 {
    let mut steps: Vec<f64> = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    (1.05 * median(&mut steps)).max(1e-12)
}

impl Moves {
    /// Of the values of each taxel, in the order of frames; missing ones are left out. `zero` is the stated one, in the
    /// same unit.
    pub(super) fn of(series: &[Vec<f64>], zero: f64) -> Self {
        let noises: Vec<f64> = series.iter().map(|values| noise_of(values)).collect();
        let noise = median(&mut noises.clone());
        let least = SHARE_OF_ZERO * zero.abs();
        let mut moves =
            Self { noise, rising: 0, falling: 0, above: 0, below: 0, middle: 0.0, largest: 0.0, range: 0.0 };
        let mut middles = Vec::new();
        for (values, own) in series.iter().zip(noises) {
            let clear = CLEAR * own.max(noise);
            let start = median(&mut values[..values.len().min(5)].to_vec());
            let [low, high] = values.iter().fold([0.0_f64, 0.0_f64], |[l, h], &x| [l.min(x), h.max(x)]);
            moves.rising += usize::from(values.iter().any(|x| x - start > clear));
            moves.falling += usize::from(values.iter().any(|x| start - x > clear));
            moves.above += usize::from(high > clear.max(least));
            moves.below += usize::from(-low > clear.max(least));
            moves.largest = moves.largest.max(high).max(-low);
            moves.range = moves.range.max(range_of(values));
            middles.extend((!values.is_empty()).then(|| median(&mut values.clone())));
        }
        moves.middle = median(&mut middles);
        if moves.middle.abs() <= (CLEAR * noise).max(least) {
            moves.middle = 0.0;
        }
        moves
    }

    /// What contradicts a zero that is stated: most readings lie near it, and presses above it.
    pub(super) fn against_zero(&self) -> Option<String> {
        let share = self.middle / self.largest.max(1e-12);
        let is_wrong = self.below >= ENOUGH && self.below >= 2 * self.above || share.abs() > 0.5;
        let Self { below, above, .. } = self;
        let percent = 100.0 * share;
        is_wrong.then(|| {
            format!("{below} taxels below it and {above} above, the middle at {percent:.0} % of the range")
        })
    }

    /// The sign, where taxels move clearly and twice as many fall as rise.
    pub(super) fn sign_remark(&self, press: &str) -> Option<String> {
        let Self { rising, falling, .. } = self;
        (*falling >= ENOUGH && *falling >= 2 * rising).then(|| {
            format!(
                "{falling} taxels fall and {rising} rise in the first frames: is `press: {press}` right, or does it \
                 begin under load?"
            )
        })
    }

    /// How many other cells move like taxels; `per_unit` is what a change by 1 of the file is in the values.
    pub(super) fn moving(&self, others: &[Vec<f64>], per_unit: f64) -> usize {
        let least = (CLEAR * self.noise).max(SHARE_OF_TAXELS * self.range) / per_unit.abs();
        others.iter().filter(|values| range_of(values) > least).count()
    }

    /// Whether this count is too high to be a coincidence.
    pub(super) const fn is_enough(count: usize) -> bool {
        count >= ENOUGH
    }
}
