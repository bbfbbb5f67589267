//! Simulated touch: a sphere of known place and force presses and rolls on a skin, and taxels feel
//! it on discs of their own (cannata: spheres on skins with taxels of 2 mm radius that read exact
//! forces). The recording feeds tests, examples and comparisons whose truth is known.
//!
//! In reading order: `options`, `sphere` (the contact model), `path` (where the sphere rolls),
//! `simulation` (frames and their truth); `spreader` turns contacts with a force into readings.
//!
//! Not modelled: friction, and that a skin is pressed in beside its contact.

mod options;
mod path;
mod simulation;
mod sphere;
mod spreader;

pub use options::TouchOptions;
pub use simulation::{Touch, TouchSimulation};
use sphere::Sphere;
pub use spreader::{Press, Spreader};
