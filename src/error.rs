//! The sum of the rooms' errors.

/// Any error of the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mesh that is no oriented manifold.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A draft that is no skin.
    #[error(transparent)]
    Skin(#[from] crate::skin::SkinError),
    /// Observations that give no skin.
    #[error(transparent)]
    Calib(#[from] crate::calib::CalibError),
    /// A patch without a pyramid.
    #[error(transparent)]
    Pyramid(#[from] crate::pyramid::PyramidError),
    /// A mesh without a map.
    #[error(transparent)]
    Flatten(#[from] crate::flatten::FlattenError),
    /// Data that is no map.
    #[error(transparent)]
    Map(#[from] crate::map::MapError),
    /// A map that cannot be searched, or a contact without an answer.
    #[error(transparent)]
    Contact(#[from] crate::contact::ContactError),
    /// A level without an image.
    #[error(transparent)]
    Atlas(#[from] crate::atlas::AtlasError),
    /// A file that cannot be read or written.
    #[error(transparent)]
    Io(#[from] crate::io::IoError),
    /// A map without a picture.
    #[error(transparent)]
    Plot(#[from] crate::plot::PlotError),
    /// Any of them, in one patch of a skin.
    #[error("patch {patch:?}: {source}")]
    Patch {
        /// Name of the patch.
        patch: String,
        /// What is wrong with it.
        source: Box<Error>,
    },
}

impl Error {
    /// The same error, saying which patch it is about.
    #[must_use]
    pub fn in_patch(self, patch: &str) -> Self {
        Self::Patch { patch: patch.to_owned(), source: Box::new(self) }
    }
}
