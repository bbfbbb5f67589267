//! Parts of files that a skin has no use for.

/// What of a file a skin has no use for, but a choice of faces or seams may have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ReadParts {
    /// [`Sheet::texture`](crate::skin::Sheet::texture), of OBJ and glTF.
    pub texture: bool,
    /// [`Sheet::materials`](crate::skin::Sheet::materials), of OBJ and glTF.
    pub materials: bool,
}
