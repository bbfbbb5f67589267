//! The experiment of the source paper's section IV (cannata): a skin whose truth is known,
//! its displacements and its contacts with a sphere.

mod attribution_errors;
mod layout;
mod options;
#[expect(clippy::module_inception, reason = "the file is named after what it does")]
mod simulate;

pub use self::simulate::{Simulation, simulate};
pub use options::SimulateOptions;
