//! The noise of one taxel, estimated all along from the differences of successive readings: touches, which change
//! slowly from frame to frame, change the estimate little.

/// The standard deviation of normal noise over the mean size of the difference of two readings: sqrt(pi) / 2.
const NOISE_OF_DIFFERENCE: f64 = 0.886_226_925_452_758;

/// The standard deviation of a rounded number over the step of rounding: sqrt(1/12).
pub(crate) const QUANTISATION: f64 = 0.288_675_134_594_812_9;

/// Share of the taxels with less noise than an estimate for a skin: noise is uneven, and a twentieth may be faulty.
pub(crate) const QUIETER_SHARE: f64 = 0.95;

/// Differences from which the noise is estimated: older ones fade.
const FRAMES: f64 = 200.0;

/// Differences over the known noise that count, at most.
const MOST_DIFFERENCE: f64 = 3.0;

/// An estimate of the standard deviation of a taxel's noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RunningNoise {
    /// The last reading; NaN before there is any.
    last: f64,
    /// The standard deviation; NaN before there are two readings.
    pub(crate) sigma: f64,
    differences: f64,
}

impl RunningNoise {
    pub(crate) const UNKNOWN: Self = Self { last: f64::NAN, sigma: f64::NAN, differences: 0.0 };

    /// Takes a finite reading and gives its difference from the one before, NaN for the first. A difference counts up to
    /// a multiple of the noise `known`, and whole where that is NaN.
    pub(crate) fn see(&mut self, reading: f64, known: f64) -> f64 {
        let difference = reading - self.last;
        self.last = reading;
        if difference.is_nan() {
            return difference;
        }
        self.differences += 1.0;
        let gain = self.differences.recip().max(FRAMES.recip());
        // `min` takes the other number for NaN.
        let size = (NOISE_OF_DIFFERENCE * difference.abs()).min(MOST_DIFFERENCE * known);
        let sigma = if self.sigma.is_nan() { size } else { self.sigma };
        self.sigma = sigma + gain * (size - sigma);
        difference
    }

    /// The reading before the next cannot be compared with it.
    pub(crate) fn interrupt(&mut self) {
        self.last = f64::NAN;
    }
}
