//! Everything that is wrong with a draft, found without changing it.

#[expect(clippy::module_inception, reason = "the file is named after what it does")]
mod check;
mod finding;
mod gaps;
mod report;
mod shape;
mod taxels;
mod topology;

pub use self::check::check;
pub use finding::{Finding, FindingKind};
