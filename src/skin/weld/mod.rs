//! Welding: the vertices of a sheet that are one taxel, and how its faces are joined.
//!
//! In reading order: [`Weld`] says which vertices are welded; `welded_mesh` makes the mesh that
//! assembling repairs and checking judges, with `opening` (which cuts of the file stay), `joined_faces`
//! (which faces are joined at an edge), `crowded` (at one of more than two) and `fans` (a vertex for
//! each fan of faces); `winding` orients its components.

pub(super) mod crowded;
pub(super) mod fans;
pub(super) mod joined_faces;
pub(super) mod opening;
pub(super) mod welded_mesh;
pub(super) mod winding;

/// Which vertices of a file that lie at exactly the same place are one taxel.
///
/// Vertices with different ids stay different, unless one face has both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Weld {
    /// Those that an index buffer splits for normals or texture coordinates; a surface that the file
    /// cuts open into a disk, closed or with handles or more boundary loops without the cut, stays
    /// cut, unless ids say that both sides are the same taxels.
    #[default]
    Auto,
    /// All of them.
    All,
    /// None: faces are joined where they have the same vertices in the file.
    None,
    /// All but where the texture coordinates of two faces differ at their edge.
    Texture,
}

#[derive(Debug, Clone, Copy)]
pub(in crate::skin) struct WeldOptions {
    /// Which vertices at one place are one.
    pub weld: Weld,
    /// Whether duplicate faces are dropped and edges of more than two faces split into sheets.
    pub repair: bool,
}
