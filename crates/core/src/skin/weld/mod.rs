//! Welding: the vertices of a sheet that are one taxel, and how its faces are joined.

pub(super) mod crowded;
pub(super) mod fans;
pub(super) mod joined_faces;
pub(super) mod opening;
pub(super) mod welded_mesh;
pub(super) mod winding;

/// Which vertices of a file at exactly the same position are one taxel.
///
/// Vertices with different ids stay different, unless one face has both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Weld {
    /// Those that an index buffer splits for normals or texture coordinates. A surface that the file cuts
    /// open into a disk, and that welding would close or give handles or more boundary loops, stays cut,
    /// unless both sides have the same ids.
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
    /// Which coincident vertices are one.
    pub weld: Weld,
    /// Whether duplicate faces are dropped and edges of more than two faces split into sheets.
    pub repair: bool,
}
