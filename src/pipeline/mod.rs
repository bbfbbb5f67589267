//! The whole flow, from a skin to its map.
//!
//! [`build`] coarsens every patch into a pyramid ([`coarsen`](crate::pyramid::coarsen())), cut open
//! where it needs a seam ([`cut_open`]), maps every level of it to the plane
//! ([`flatten_pyramid`](crate::flatten::flatten_pyramid)) and returns the
//! [`SkinMap`](crate::map::SkinMap).
//!
//! Where no cut within one chart keeps the area ratio asked for, a patch is divided into several
//! (`charts`). Every map is measured as `map.glb` holds it (`written`).
//!
//! Patches are independent: they are built in parallel, and the result does not depend on the
//! number of threads. Before it, [`read_draft`](crate::io::read_draft) and
//! [`assemble`](crate::skin::assemble()) make the skin; after it,
//! [`measure`](crate::report::measure) says how faithful the map is,
//! [`write_map`](crate::io::write_map) keeps it, and [`skin_images`](crate::atlas::skin_images)
//! rasterises its levels.
//!
//! ```
//! use dermatome::{mesh::shapes, pipeline, skin::Skin};
//!
//! let skin = Skin::from_mesh("cap", shapes::cap(500, 0.1, 0.6));
//! let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
//! assert!(map.patches.iter().all(|patch| patch.levels.len() > 1));
//! # Ok::<_, dermatome::Error>(())
//! ```

mod build;
mod charts;
mod choose_cut;
mod open;
mod written;

pub use build::{BuildOptions, Built, Enlarged, Progress, Stage, build, build_with_progress};
pub use open::{FlatMesh, cut_open, flatten_patch};
