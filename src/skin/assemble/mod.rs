//! Assembling: a draft becomes a skin, and every repair is reported.
//!
//! In reading order: `options`; `components` and `zero_area` (the faces of a sheet that hang
//! together), `patch` with `outward` (a patch of each), `names`; `assemble` takes these steps for every
//! sheet. `joining_gap` tries other options.

#[expect(clippy::module_inception, reason = "the file is named after what it does")]
mod assemble;
mod components;
mod joining_gap;
mod names;
mod options;
mod outward;
mod patch;
pub(in crate::skin) mod zero_area;

pub use self::assemble::assemble;
pub use joining_gap::joining_gap;
pub use options::{AssembleOptions, Assembled};
