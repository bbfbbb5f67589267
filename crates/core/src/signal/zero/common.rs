//! The drift that the zeros of a patch have in common.

/// Untouched taxels that have a common drift.
const COMMON: usize = 20;

/// Time constant with which the common drift is followed, in s. The mean of [`COMMON`] taxels is known four times as well as
/// the zero of one, so that it is followed faster.
const COMMON_S: f64 = 1.0;

/// The common drift in `sigma` a second, at most: what rises faster on the whole skin is a touch.
const COMMON_LIMIT: f64 = 0.6;

/// The common drift of some taxels: an offset and its velocity, by a fading memory of the excess of the untouched ones.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Common {
    /// Number of the taxels.
    pub(super) taxels: usize,
    /// The sum of the drift so far, and what it is in a second.
    pub(super) drift: f64,
    velocity: f64,
    /// Of the untouched taxels in this frame: sums of their excess, limited, of coefficients and of noise, and their number.
    excess: f64,
    coefficients: f64,
    sigma: f64,
    untouched: usize,
}

impl Common {
    /// Of this number of taxels.
    pub(super) fn of(taxels: usize) -> Self {
        Self { taxels, ..Self::default() }
    }

    /// Without taxels of this frame.
    pub(super) fn start(self) -> Self {
        Self { excess: 0.0, coefficients: 0.0, sigma: 0.0, untouched: 0, ..self }
    }

    /// Adds an untouched taxel.
    pub(super) fn take(&mut self, excess: f64, coefficient: f64, sigma: f64) {
        self.excess += excess;
        self.coefficients += coefficient;
        self.sigma += sigma;
        self.untouched += 1;
    }

    /// Adds the taxels of this frame of another one.
    pub(super) fn add(&mut self, other: &Self) {
        self.excess += other.excess;
        self.coefficients += other.coefficients;
        self.sigma += other.sigma;
        self.untouched += other.untouched;
    }

    /// How far the offset moves in a frame; `None` where too few taxels are untouched.
    pub(super) fn step(&mut self, interval: f64) -> Option<f64> {
        if self.untouched < COMMON || self.coefficients <= 0.0 {
            self.velocity = 0.0;
            return None;
        }
        // Before this frame the zeros have not moved by the velocity yet.
        let foreseen = interval * self.velocity;
        let beyond = self.excess / self.coefficients - foreseen;
        let limit = COMMON_LIMIT * self.sigma / self.untouched as f64;
        let kept = (-interval / COMMON_S).exp();
        let step = foreseen + (1.0 - kept * kept) * beyond;
        if interval > 0.0 {
            self.velocity = limited(self.velocity + (1.0 - kept).powi(2) / interval * beyond, limit);
        }
        Some(limited(step, interval * limit))
    }
}

/// A number brought to within `limit` of 0; as it is if the limit is not known.
pub(super) fn limited(x: f64, limit: f64) -> f64 {
    x.max(-limit).min(limit)
}
