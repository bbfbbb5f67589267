//! Simulated touch: a sphere of known position and force presses and rolls on a skin, and taxels sense it on
//! discs around them (`(cannata)`: spheres on skins with taxels of 2 mm radius that read exact forces). The
//! recording, whose truth is known, is for tests, examples and comparisons.
//!
//! Not modelled: friction, and the deformation of the skin next to its contact, but for the blur.

mod faults;
mod integral;
mod path;
mod probe;
mod readout;
mod simulation;
mod sphere;
mod spreader;
mod surface;

use crate::signal::{Quantity, SignalError};

pub use faults::FaultCounts;
pub use readout::ReadoutOptions;
pub use simulation::{Touch, TouchSimulation};
pub(crate) use sphere::Sphere;
pub use spreader::{Press, Spreader};

/// What presses on the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TouchShape {
    /// A sphere, or an ellipsoid ([`TouchOptions::aspect`]).
    #[default]
    Sphere,
    /// A laid finger: the points within the radius of a straight segment ([`TouchOptions::length`]) along the skin.
    Finger,
    /// A soft palm that follows the skin: a disc of this diameter ([`TouchOptions::length`]), pressed in evenly but for
    /// its rim, over which the depth falls to 0.
    Palm,
}

/// Spheres that press and roll on a skin, and the taxels that sense them.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchOptions {
    /// Radii of the spheres, in m: each press is that of a sphere with one of them, chosen at random.
    pub radii: Vec<f64>,
    /// What presses.
    pub shape: TouchShape,
    /// Length of the segment of a finger, or diameter of a palm, in m.
    pub length: f64,
    /// Distance along the skin between the bodies that press at once, in m; they roll in one direction. `None`: at random
    /// positions, at least a diameter apart.
    pub apart: Option<f64>,
    /// The smallest and the largest depth of a press, in m; less than the radii.
    pub depths: [f64; 2],
    /// Most ratio of the two radii of curvature where an ellipsoid touches; 1: spheres. Each press has a ratio from 1
    /// on, evenly, and another direction. The smaller radius is that of [`Self::radii`].
    pub aspect: f64,
    /// How unsteady depths are within a press: the standard deviation of their logarithm.
    pub wobble: f64,
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
    /// A cover spreads pressures before they reach the taxels: the standard deviation of a normal distribution along
    /// each axis, in m.
    pub blur: f64,
    /// Response curve: the pressure is the reading to the power of this, both relative to the pressure of a press of
    /// middle depth.
    pub exponent: f64,
    /// Width of the loop that readings describe as pressure rises and falls, relative to the reading.
    pub hysteresis: f64,
    /// Instead of spheres, a bag presses on all taxels with these pressures (Pa), up and down again, in each press;
    /// empty: spheres.
    pub steps: Vec<f64>,
    /// How uneven the pressure of the bag is: the standard deviation between taxels, relative; new with each press.
    pub uneven: f64,
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
            radii: vec![0.015],
            shape: TouchShape::Sphere,
            length: 0.04,
            apart: None,
            depths: [0.002; 2],
            aspect: 1.0,
            wobble: 0.0,
            stiffness: 2e7,
            presses: 5,
            touches: 1,
            roll: 0.02,
            duration: 1.0,
            pause: 0.25,
            rate: 100.0,
            taxel_radius: 0.002,
            blur: 0.0,
            exponent: 1.0,
            hysteresis: 0.0,
            steps: Vec::new(),
            uneven: 0.0,
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
        let [shallow, deep] = self.depths;
        let depths = [("the depth in m", shallow), ("the depth in m", deep)];
        let radii = self.radii.iter().map(|&radius| ("the radius of the sphere in m", radius));
        let taxel = ("the radius of a taxel in m", self.taxel_radius);
        for (option, metres) in radii.clone().chain(depths).chain([taxel]) {
            if !(1e-6..=1e3).contains(&metres) {
                return bad(option, metres, "1e-6 to 1000");
            }
        }
        let smallest = self.radii.iter().copied().fold(f64::INFINITY, f64::min);
        if smallest == f64::INFINITY {
            return bad("the number of radii of spheres", 0.0, "1 or more");
        }
        if deep < shallow {
            return bad("the largest depth in m", deep, "no less than the smallest");
        }
        if deep >= smallest {
            return bad("the depth in m", deep, "less than the radius of the sphere");
        }
        for (option, number, range) in [
            ("the ratio of the radii of an ellipsoid", self.aspect, 1.0..=100.0),
            ("the exponent", self.exponent, 0.2..=5.0),
            ("the wobble", self.wobble, 0.0..=0.5),
            ("the hysteresis", self.hysteresis, 0.0..=0.5),
            ("the unevenness of the bag", self.uneven, 0.0..=0.3),
            ("the blur in m", self.blur, 0.0..=0.1),
        ] {
            if !range.contains(&number) {
                return bad(option, number, &format!("{} to {}", range.start(), range.end()));
            }
        }
        if let Some(&step) = self.steps.iter().find(|&&step| !(1e-3..=1e9).contains(&step)) {
            return bad("the pressure of a bag in Pa", step, "0.001 to 1e9");
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
        if !(0.0..=1.0).contains(&self.readout.leak) {
            return bad("the share of the pressure that leaks", self.readout.leak, "0 to 1");
        }
        if !(-1e9..=1e9).contains(&self.readout.warming) {
            return bad("the drift with temperature in Pa/s", self.readout.warming, "-1e9 to 1e9");
        }
        if !(0.0..=10.0).contains(&self.length) || (self.shape == TouchShape::Palm && self.length == 0.0) {
            return bad("the length of what presses in m", self.length, "0 to 10, and above 0 for a palm");
        }
        if self.shape != TouchShape::Sphere && self.aspect > 1.0 {
            return bad("the ratio of the radii of a finger or a palm", self.aspect, "1, or a sphere,");
        }
        if let Some(apart) = self.apart.filter(|apart| !(1e-6..=1e3).contains(apart)) {
            return bad("the distance between bodies in m", apart, "1e-6 to 1000");
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
