//! From the taxels of a robot's skin to flat, faithful, hierarchical maps of it, and back.
//!
//! ```text
//! observations ─ calibrate ─▶ skin ─ coarsen ─▶ pyramid ─ flatten ─▶ maps ─ rasterise ─▶ tactile images
//! (g2o, CSV)                  glTF   receptive fields   every level   └─ BVH ─ contact ─▶ map cell, every level
//! ```
//!
//! The most used items are at the root of the crate. The modules follow the order of this flow; each uses
//! only those before it:
//!
//! 1. [`io::read_draft`] reads a file as it was written; [`skin::assemble()`] turns it into a valid
//!    [`skin::Skin`], joins taxels without triangles and reports its changes. [`skin::check()`] lists the
//!    faults of the file. [`calib::calibrate()`] makes a skin from noisy observations, with a covariance per
//!    taxel.
//! 2. [`pyramid::coarsen`] makes every patch a [`pyramid::Pyramid`] of receptive fields, joined by
//!    [`pyramid::Prolongation`]s.
//! 3. [`flatten::flatten_pyramid`] maps every level to the plane, coarse to fine, without a flip.
//! 4. [`pipeline::build`] does both for all patches and returns a [`map::SkinMap`], which [`io::write_map`]
//!    writes.
//! 5. [`atlas::skin_images`] rasterises the maps for [`io::write_images`], an [`atlas::Atlas`] for
//!    images of readings; [`plot::plot_map`] draws them.
//! 6. [`io::ReadingsReader`] reads a recording or a stream; a [`recording::Recording`] finds its taxels,
//!    transfers each frame to every level, draws it and finds contact regions.
//! 7. [`contact::ContactIndex`] finds the cells under a contact on every level.
//!
//! [`least_squares`] has the limits of the minimiser that all fits share. Everything is `f64`, in metres and radians, right-handed, with outward normals; results do not
//! depend on the number of threads.
#![warn(missing_docs)]

#[doc(inline)]
pub use dermatome_files::*;

/// The README's example, run as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
