//! [`Error`]: the sum of the modules' errors.

/// Any error of the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mesh that is not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A draft that is not a valid skin.
    #[error(transparent)]
    Skin(#[from] crate::skin::SkinError),
    /// Observations that do not determine a skin.
    #[error(transparent)]
    Calib(#[from] crate::calib::CalibError),
    /// A surface that cannot be cut as asked.
    #[error(transparent)]
    Cut(#[from] crate::cut::CutError),
    /// A patch that cannot be coarsened.
    #[error(transparent)]
    Pyramid(#[from] crate::pyramid::PyramidError),
    /// A mesh that cannot be flattened.
    #[error(transparent)]
    Flatten(#[from] crate::flatten::FlattenError),
    /// Data that is not a valid map.
    #[error(transparent)]
    Map(#[from] crate::map::MapError),
    /// Readings that cannot be used with a map, or not be simulated.
    #[error(transparent)]
    Signal(#[from] crate::signal::SignalError),
    /// A map that cannot be searched, or a query that cannot be answered.
    #[error(transparent)]
    Contact(#[from] crate::contact::ContactError),
    /// A level that cannot be rasterised.
    #[error(transparent)]
    Atlas(#[from] crate::atlas::AtlasError),
    /// Values and pixels that do not fit.
    #[error(transparent)]
    Image(#[from] crate::image::ImageError),
    /// A file that cannot be read or written.
    #[error(transparent)]
    Io(#[from] crate::io::IoError),
    /// A map that cannot be drawn.
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
    /// Errors of several patches of a skin, in the order of these.
    #[error("{} patches cannot be mapped: {}", .0.len(), .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Several(Vec<Error>),
}

impl Error {
    /// The same error, saying which patch it is about.
    pub(crate) fn in_patch(self, patch: &str) -> Self {
        Self::Patch { patch: patch.to_owned(), source: Box::new(self) }
    }
}
