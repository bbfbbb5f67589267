//! Spatial search: trees over boxes in space or in the plane.
//!
//! | have | need | take |
//! |---|---|---|
//! | boxes | pairs that touch, those near a point or on a ray | [`BoxTree`] |
//!
//! Coordinates are `f64` of any size and any origin. Inside, boxes are `f32`, rounded outwards: they only
//! decide what is looked at. What is found is decided in `f64`, so answers are exact, and the same on
//! every processor.
//!
//! This is the only crate that uses obvhs: it builds the [`BoxTree`], whose walks are ours.

mod aabb;
mod box_tree;
mod error;
mod ray;
mod scaling;

pub use aabb::Aabb;
pub use box_tree::BoxTree;
pub use error::BvhError;
pub use ray::{Meeting, Ray, meet};

/// The same `cases` in every run.
#[cfg(test)]
fn fixed(cases: u32, seed: u64) -> proptest::prelude::ProptestConfig {
    let rng_seed = proptest::test_runner::RngSeed::Fixed(seed);
    proptest::prelude::ProptestConfig { cases, rng_seed, failure_persistence: None, ..Default::default() }
}
