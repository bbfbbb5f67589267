//! Welding: the vertices of a sheet that are one taxel, and how its faces are joined.
//!
//! In reading order: `options` says which vertices are welded; `welded_mesh` makes the mesh that
//! assembling repairs and checking judges, with `opening` (which cuts of the file stay), `joined_faces`
//! (which faces are joined at an edge), `crowded` (at one of more than two) and `fans` (a vertex for
//! each fan of faces); `winding` orients its components.

pub(super) mod crowded;
pub(super) mod fans;
pub(super) mod joined_faces;
pub(super) mod opening;
pub(super) mod options;
pub(super) mod welded_mesh;
pub(super) mod winding;
