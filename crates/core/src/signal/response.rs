//! What is known about each taxel: how its readings become pressures, and whether they can be trusted.

use crate::skin::TaxelId;

/// The taxels of a skin, as a file of them (`io::read_response`) holds them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Response {
    /// Unit of the readings that it is of, as `count`; empty if unknown.
    pub unit: String,
    /// The channel of the readings that it is of; empty if unknown. Of readings that have it no other one becomes a pressure.
    pub channel: String,
    /// What its gains are relative to; `None` where no gain is estimated, or nothing is stated.
    pub scale: Option<Scale>,
    /// How it was found, in words; empty if unknown.
    pub method: String,
    /// One entry for each taxel, in any order; no taxel has two.
    pub taxels: Vec<TaxelResponse>,
}

impl Response {
    /// Whether the gain of any taxel is known.
    pub fn has_gains(&self) -> bool {
        self.taxels.iter().any(|taxel| taxel.gain.is_some())
    }

    /// It with lines for curves: that of each taxel with an exponent goes through its reading at this pressure, in Pa or
    /// relative. So readings less any zero, or none, are proportional to those of the line.
    #[must_use]
    pub fn linear_at(&self, pressure: f64) -> Self {
        let line = |taxel: &TaxelResponse| {
            let (Some(gain), Some(exponent)) = (taxel.gain, taxel.exponent) else { return *taxel };
            let slope = pressure * (gain.abs() / pressure).powf(exponent.recip());
            TaxelResponse { gain: Some(slope * gain.signum()), exponent: None, ..*taxel }
        };
        Self { taxels: self.taxels.iter().map(line).collect(), ..self.clone() }
    }
}

/// What gains are relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display, strum::EnumString)]
pub enum Scale {
    /// To each other: pressures have no unit.
    #[strum(serialize = "relative")]
    Relative,
    /// Nothing: pressures are in Pa.
    #[strum(serialize = "Pa")]
    Pascals,
}

/// One taxel: its reading `c` is the pressure `|gain| max(s (c - zero), 0)^exponent`, with `s` the sign of
/// `gain`. `None` is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaxelResponse {
    /// The taxel.
    pub taxel: TaxelId,
    /// Its reading where nothing touches.
    pub zero: Option<f64>,
    /// Pressure over reading to the exponent; not 0, negative where pressure lowers readings.
    pub gain: Option<f64>,
    /// The exponent, positive.
    pub exponent: Option<f64>,
    /// How its zero drifts over the mean drift of the skin, as [`ZeroTracker`](crate::signal::ZeroTracker) finds it.
    pub drift: Option<f64>,
    /// Standard deviation of the gain over the gain.
    pub sigma: Option<f64>,
    /// Whether it can be trusted.
    pub state: TaxelState,
    /// The taxel that the state names: the one whose place fits the signals of a swapped one, or the one whose signals
    /// leak into it.
    pub other: Option<TaxelId>,
}

impl TaxelResponse {
    /// An entry in which nothing is known.
    pub fn unknown(taxel: TaxelId) -> Self {
        let state = TaxelState::Untested;
        Self { taxel, zero: None, gain: None, exponent: None, drift: None, sigma: None, state, other: None }
    }

    /// Adds what is known of another taxel with its id: numbers that differ are not known, and the heavier state counts.
    pub(in crate::signal) fn join(&mut self, other: &Self) {
        let same = |a: Option<f64>, b: Option<f64>| a.filter(|_| a == b);
        self.zero = same(self.zero, other.zero);
        self.gain = same(self.gain, other.gain);
        self.exponent = same(self.exponent, other.exponent);
        self.drift = same(self.drift, other.drift);
        self.sigma = same(self.sigma, other.sigma);
        if other.state > self.state {
            (self.state, self.other) = (other.state, other.other);
        }
    }
}

/// Whether the readings of a taxel can be trusted, and otherwise its fault; in the order of their weight.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, strum::Display, strum::EnumString,
)]
#[strum(serialize_all = "kebab-case")]
#[non_exhaustive]
pub enum TaxelState {
    /// Nothing shows whether it can.
    #[default]
    Untested,
    /// It can.
    Ok,
    /// Its readings end at a largest value, below those of touches.
    Saturated,
    /// Its readings follow those of another taxel, far away, and have its own besides.
    Crosstalk,
    /// It jumps alone from one frame to the next, back and forth.
    Chattering,
    /// Contacts of its own begin with a jump, and nothing touches around it.
    Jumping,
    /// Its noise is much larger than that of the others.
    Noisy,
    /// All taxels of its module are offset.
    ModuleStep,
    /// Its module is turned: the signals fit the places of the other taxels of the module.
    Turned,
    /// Its signals belong to another place.
    Swapped,
    /// It does not react where all around it do.
    Silent,
    /// It repeats one reading for some time, and changes at others.
    Stuck,
    /// It has no reading, or always the same.
    Dead,
}

impl TaxelState {
    /// Whether its readings must not be used.
    pub fn is_fault(self) -> bool {
        self > Self::Ok
    }
}
