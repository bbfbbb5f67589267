//! Contacts: from a point near the skin to the nearest map cell, on every level, and back.
//!
//! # Algorithm
//!
//! 1. [`ContactIndex::new`] builds one tree per patch over the triangles of level 0, in the frame
//!    of the patch's link: nodes of eight boxes along the mean normal of the skin in them, over
//!    packets of eight triangles. Moving links ([`ContactIndex::set_motion`]) only updates the boxes
//!    of the patches in the world.
//! 2. [`ContactIndex::locate`] searches the patches, the one with the nearest box first. In a patch it
//!    descends the tree, nearest box first, and skips everything beyond a bound. Boxes and triangles are
//!    compared in `f32`, eight at a time; everything within the bound is measured in `f64` on the vertices of
//!    the map.
//! 3. The nearest point gives the [`Hit`]. Its sign is the side of the angle-weighted pseudo-normal
//!    `(baerentzen2005)`.
//! 4. [`ContactIndex::cell`] computes the position of a hit on the map of any level in constant time: the
//!    mean of the corners of its face by its barycentric coordinates. Its fields are the corners on level 0,
//!    and on a coarser level those of the corners in the direct prolongation.
//!
//! Besides the nearest point:
//! - [`ContactIndex::reactive`] gives an interval of the distance, the side and a face in constant time, from an octree
//!   of each link. [`ContactIndex::hit_of`] gives the point, which has cells on all levels like any hit.
//! - [`ContactIndex::nearest_fields`] and [`ContactIndex::fields_within`] find taxels and receptive
//!   fields near a point or in a sphere; [`ContactIndex::first_hit`] follows a ray.
//! - The vertices of a patch with [joints](crate::skin::Taxels::joints) follow several links.
//! - [`ContactIndex::set_motion`] poses the links by a [`Motion`](crate::skin::Motion) over time.
//! - A query is in the world or in the frame of any [link](Query::link), and searches all patches or those of
//!   [one link](Query::only_link).
//! - [`FieldCells`] are the fields of the whole body, or of a modality, that a contact lies in.
//! - [`LiveTaxels`] gives the nearest working taxel.
//! - [`MapIndex`] is the inverse lookup: from a point of the map of any level to the surface.
//! - [`Spreader`](crate::signal::Spreader) computes readings of taxels from the forces of contacts.
//!
//! The bound: with `r` the radius of a patch and `d` the distance of the point from its centre, an `f32`
//! distance differs from the true one by at most `slack = 48 * 2^-24 (r + d)`. If the nearest triangle found
//! so far seems to be `D` away, nothing that seems to be farther than `D + 2 slack` can be nearer. From more
//! than 16 radii away `slack` is larger than the differences between the distances of a flat patch's faces,
//! so boxes are compared in `f64` there. A face far from all others makes the radius large and every search
//! slow: a patch should be connected, as those of a [`Skin`](crate::skin::Skin) that is read from a file.
//!
//! # Guarantees
//!
//! - The answer is the nearest point in `f64`, for any set of triangles: slivers, points and
//!   non-manifold meshes too.
//! - Of equally near faces the first face of the first patch is the answer, one without area only where none
//!   has area. It depends neither on the order of the search nor on earlier queries: alone and in a batch
//!   ([`ContactIndex::locate_all`]) it is the same, with any number of threads.
//! - Queries do not change the index; threads can share it.
//!
//! Not guaranteed: the sign of the distance beyond the boundary of an open patch is the side of its
//! continuation.
//!
//! # Files in reading order
//!
//! `query` (queries and answers), `posed_links` (poses of the links), `patch_bvh` (a mesh in a tree; the
//! trees are those of `crate::bvh`), `patch` (the data of a patch in an index), `index` (the nearest point,
//! rays), `fields`; `coarse` (octrees, and the proof of their intervals) and `reactive` (answers in constant
//! time); `cell` (from a hit to the map), `field_cells` (from a
//! hit to fields without a map), `map_index` (from the map to the skin), `live_taxels` (the nearest
//! working taxel); `measure` (costs of answers on each level).
//!
//! # Example
//!
//! ```
//! use dermatome::contact::{ContactIndex, Query};
//! use dermatome::{mesh::shapes, pipeline, pyramid::LevelId, run::Run, skin::{LinkId, Skin}};
//! use glam::DVec3;
//!
//! // A cap of a sphere around the origin, open at the top.
//! let skin = Skin::from_mesh("cap", shapes::cap(500, 0.1, 0.6));
//! let map = pipeline::build(&skin, &pipeline::BuildOptions::default())?;
//! let index = ContactIndex::new(&map)?;
//!
//! let below = DVec3::new(0.0, 0.0, -0.103);
//! let hit = index.locate(below)?;
//! assert!((hit.distance - 0.003).abs() < 1e-4, "3 mm outside of the skin");
//! let cell = index.cell(&hit, LevelId::new(0)).expect("level 0 has all of the skin");
//! println!("field {} around taxel {} at {} of the map", cell.field, cell.taxel, cell.uv);
//!
//! // In the frame of a link, where a sensor is mounted; and many at once.
//! let query = Query::in_link(LinkId::new(0), below);
//! assert_eq!(index.locate_all(&[query], Run::default())?.get(0), Some(index.locate(query)?));
//! # Ok::<_, dermatome::Error>(())
//! ```

mod cell;
mod coarse;
mod error;
mod field_cells;
mod fields;
mod index;
mod posed_links;
mod live_taxels;
mod map_index;
mod patch;
mod patch_bvh;
mod query;
mod reactive;
#[cfg(test)]
#[path = "../../../bvh/src/soup.rs"]
#[allow(dead_code, reason = "its sheets are for the crate of trees alone")]
mod soup;

pub use cell::{Cell, FieldWeights};
pub use error::ContactError;
pub use field_cells::FieldCells;
pub use index::{ContactIndex, ON_SKIN_SPACINGS};
pub use live_taxels::LiveTaxels;
pub use map_index::{MapIndex, MapPlace};
pub use query::{FieldHit, Found, Hit, Hits, IndexOptions, Query, Reactive, Refine};
