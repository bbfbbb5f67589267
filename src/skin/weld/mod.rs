//! Welding: the vertices of a sheet that are one taxel, and how its faces hang together after that.
//!
//! In reading order: `options` says which vertices are welded; `welded_mesh` makes the mesh that
//! assembling repairs and checking judges, with `opening` (which cuts of the file stay), `sheets`
//! (which faces hang together at an edge) and `fans` (a vertex for each fan of faces); `winding`
//! orients its components.

pub(super) mod fans;
pub(super) mod opening;
pub(super) mod options;
pub(super) mod sheets;
pub(super) mod welded_mesh;
pub(super) mod winding;
