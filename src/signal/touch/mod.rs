//! Simulated touch: a sphere of known position and force presses and rolls on a skin, and taxels sense it on
//! discs around them (`(cannata)`: spheres on skins with taxels of 2 mm radius that read exact forces). The
//! recording, whose truth is known, is for tests, examples and comparisons.
//!
//! In reading order: [`TouchOptions`], `sphere` (the contact model), `path` (where the sphere rolls),
//! `simulation` (frames and their truth), `readout` (how taxels are read, and faults); `spreader` turns contacts with a force into readings.
//!
//! Not modelled: friction, and the deformation of the skin next to its contact.

mod path;
mod readout;
mod simulation;
mod sphere;
mod spreader;

use crate::signal::{Quantity, SignalError};

pub use readout::{FaultCounts, ReadoutOptions};
pub use simulation::{Touch, TouchSimulation};
pub use spreader::{Press, Spreader};

/// Spheres that press and roll on a skin, and the taxels that sense them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchOptions {
    /// Radius of the sphere, in m.
    pub radius: f64,
    /// Its depth, in m; less than its radius.
    pub depth: f64,
    /// Stiffness of the skin: pressure over depth, in Pa/m.
    pub stiffness: f64,
    /// Number of presses, one after the other, each at another position.
    pub presses: usize,
    /// Number of spheres that press at once, 1 to 100: at different positions, on one link at least a
    /// diameter apart. Spheres without room are left out.
    pub touches: usize,
    /// How far the sphere rolls on the skin during a press, in m.
    pub roll: f64,
    /// Duration of a press, in s. The sphere goes down for a fifth of it, rolls for three fifths, and goes up
    /// for a fifth.
    pub duration: f64,
    /// Time without touch before each press and after the last, in s.
    pub pause: f64,
    /// Frames per second, in Hz.
    pub rate: f64,
    /// Radius of the disc on which a taxel senses, in m.
    pub taxel_radius: f64,
    /// The reading of a taxel: the force on its disc in N (extensive) or the mean pressure on it in Pa
    /// (intensive).
    pub quantity: Quantity,
    /// Noise of each reading: the standard deviation of the mean pressure, in Pa.
    pub noise: f64,
    /// Drift: every taxel's pressure grows at a rate of its own, with this standard deviation, in
    /// Pa/s.
    pub drift: f64,
    /// Share of the taxels that are dead: they read NaN.
    pub dead: f64,
    /// How the readings of the taxels differ, and their faults.
    pub readout: ReadoutOptions,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for TouchOptions {
    /// Taxels of 2 mm radius under a skin of 20 kPa per mm, and a sphere of 15 mm radius: 3.6 N
    /// where the skin is flat.
    fn default() -> Self {
        Self {
            radius: 0.015,
            depth: 0.002,
            stiffness: 2e7,
            presses: 5,
            touches: 1,
            roll: 0.02,
            duration: 1.0,
            pause: 0.25,
            rate: 100.0,
            taxel_radius: 0.002,
            quantity: Quantity::Extensive,
            noise: 0.0,
            drift: 0.0,
            dead: 0.0,
            readout: ReadoutOptions::default(),
            seed: 0,
        }
    }
}

/// Most frames of a recording.
const MOST_FRAMES: f64 = 1e7;

impl TouchOptions {
    /// Checks every number.
    pub(super) fn validate(&self) -> Result<(), SignalError> {
        let bad = |option: &str, found: f64, needed: &str| Err(SignalError::option(option, found, needed));
        for (option, metres) in [
            ("the radius of the sphere in m", self.radius),
            ("the depth in m", self.depth),
            ("the radius of a taxel in m", self.taxel_radius),
        ] {
            if !(1e-6..=1e3).contains(&metres) {
                return bad(option, metres, "1e-6 to 1000");
            }
        }
        if self.depth >= self.radius {
            return bad("the depth in m", self.depth, "less than the radius of the sphere");
        }
        for (option, number) in [
            ("the stiffness in Pa/m", self.stiffness),
            ("the rate in Hz", self.rate),
            ("the duration of a press in s", self.duration),
        ] {
            if !(1e-6..=1e15).contains(&number) {
                return bad(option, number, "a positive number up to 1e15");
            }
        }
        for (option, number) in [
            ("the distance rolled in m", self.roll),
            ("the pause in s", self.pause),
            ("the noise in Pa", self.noise),
            ("the drift in Pa/s", self.drift),
            ("the 1/f noise in Pa", self.readout.flicker),
        ] {
            if !(0.0..=1e9).contains(&number) {
                return bad(option, number, "0 to 1e9");
            }
        }
        if !(0.0..1.0).contains(&self.dead) {
            return bad("the share of dead taxels", self.dead, "0 to less than 1");
        }
        let spreads = [("gains", self.readout.gain_spread), ("exponents", self.readout.exponent_spread)];
        for (what, spread) in spreads {
            if !(0.0..=3.0).contains(&spread) {
                return bad(&format!("the spread of the {what}"), spread, "0 to 3");
            }
        }
        if !(-1e9..=1e9).contains(&self.readout.warming) {
            return bad("the drift with temperature in Pa/s", self.readout.warming, "-1e9 to 1e9");
        }
        if !(1..=100).contains(&self.touches) {
            return bad("the number of spheres at once", self.touches as f64, "1 to 100");
        }
        let frames = self.seconds() * self.rate;
        if frames > MOST_FRAMES {
            return bad("the number of frames", frames.floor(), "at most 1e7");
        }
        Ok(())
    }

    /// Length of the recording, in s.
    pub(super) fn seconds(&self) -> f64 {
        self.presses as f64 * (self.duration + self.pause) + self.pause
    }

    /// Area of the disc on which a taxel senses, in m^2.
    pub(super) fn taxel_area(&self) -> f64 {
        std::f64::consts::PI * self.taxel_radius * self.taxel_radius
    }
}
