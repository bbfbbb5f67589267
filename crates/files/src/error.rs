//! [`Error`]: the sum of the modules' errors.

/// Any error of the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum Error {
    #[error(transparent)]
    Cancelled(#[from] crate::run::Cancelled),
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    #[error(transparent)]
    Skin(#[from] crate::skin::SkinError),
    #[cfg(feature = "robots")]
    #[error(transparent)]
    Remesh(#[from] crate::remesh::RemeshError),
    #[error(transparent)]
    Design(#[from] crate::design::DesignError),
    #[error(transparent)]
    Calib(#[from] crate::calib::CalibError),
    #[error(transparent)]
    Cut(#[from] crate::cut::CutError),
    #[error(transparent)]
    Pyramid(#[from] crate::pyramid::PyramidError),
    #[error(transparent)]
    Flatten(#[from] crate::flatten::FlattenError),
    #[error(transparent)]
    Map(#[from] crate::map::MapError),
    #[error(transparent)]
    Registration(#[from] crate::registration::RegistrationError),
    #[error(transparent)]
    Signal(#[from] crate::signal::SignalError),
    #[error(transparent)]
    Order(#[from] crate::signal::OrderError),
    #[error(transparent)]
    Response(#[from] crate::response::ResponseError),
    #[error(transparent)]
    Diff(#[from] crate::diff::DiffError),
    #[error(transparent)]
    Touches(#[from] crate::touches::TouchesError),
    #[error(transparent)]
    Contact(#[from] crate::contact::ContactError),
    #[error(transparent)]
    Atlas(#[from] crate::atlas::AtlasError),
    #[error(transparent)]
    Image(#[from] crate::image::ImageError),
    #[error(transparent)]
    Io(#[from] crate::io::IoError),
    /// A patch that cannot be unfolded because its system does not fit into memory.
    #[error("it cannot be unfolded: {0}")]
    Unfold(#[from] crate::sparse::SparseError),
    #[cfg(feature = "plot")]
    #[error(transparent)]
    Plot(#[from] crate::plot::PlotError),
    #[cfg(feature = "plot")]
    #[error(transparent)]
    Pattern(#[from] crate::pattern::PatternError),
    /// Any of these errors, in one patch of a skin.
    #[error("patch {patch:?}: {source}")]
    Patch { patch: String, source: Box<Error> },
    /// Any of these errors, in one of the recordings.
    #[error("{recording}: {source}")]
    Recording { recording: String, source: Box<Error> },
    /// Errors of several patches of a skin, in the order of the patches.
    #[error("{} patches cannot be mapped: {}", .0.len(), .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Several(Vec<Error>),
}

macro_rules! kinds {
    ($($(#[$gate:meta])? $variant:ident($error:ty)),* $(,)?) => {
        impl Error {
            /// The kind of error as one word in snake case, for programs that distinguish errors.
            ///
            /// It is the name of the variant of the module's error: [`FlattenError::NotADisk`] is
            /// `not_a_disk`. Messages may change from version to version, kinds do not. An error in a patch has
            /// the kind of its source, and so has one in a recording; of several errors, that of the first.
            ///
            /// [`FlattenError::NotADisk`]: crate::flatten::FlattenError::NotADisk
            pub fn kind(&self) -> &'static str {
                match self {
                    $($(#[$gate])? Self::$variant(error) => error.kind(),)*
                    Self::Cancelled(_) => "cancelled",
                    Self::Unfold(_) => "unfold",
                    Self::Patch { source, .. } | Self::Recording { source, .. } => source.kind(),
                    Self::Several(errors) => errors.first().map_or("several", Self::kind),
                }
            }

            /// The error with the name of its patch.
            pub(crate) fn in_patch(self, patch: &str) -> Self {
                Self::Patch { patch: patch.to_owned(), source: Box::new(self) }
            }

            /// The error with the number of its recording, counted from 0, if there are several.
            pub(crate) fn in_recording(self, number: usize, recordings: usize) -> Self {
                if recordings < 2 {
                    return self;
                }
                Self::Recording { recording: format!("recording {}", number + 1), source: Box::new(self) }
            }
        }

    };
}

kinds!(
    Mesh(crate::mesh::MeshError),
    Skin(crate::skin::SkinError),
    #[cfg(feature = "robots")]
    Remesh(crate::remesh::RemeshError),
    Design(crate::design::DesignError),
    Calib(crate::calib::CalibError),
    Cut(crate::cut::CutError),
    Pyramid(crate::pyramid::PyramidError),
    Flatten(crate::flatten::FlattenError),
    Map(crate::map::MapError),
    Registration(crate::registration::RegistrationError),
    Signal(crate::signal::SignalError),
    Order(crate::signal::OrderError),
    Response(crate::response::ResponseError),
    Diff(crate::diff::DiffError),
    Touches(crate::touches::TouchesError),
    Contact(crate::contact::ContactError),
    Atlas(crate::atlas::AtlasError),
    Image(crate::image::ImageError),
    Io(crate::io::IoError),
    #[cfg(feature = "plot")]
    Plot(crate::plot::PlotError),
    #[cfg(feature = "plot")]
    Pattern(crate::pattern::PatternError),
);

dermatome_core::kinds!(
    crate::io::IoError,
    #[cfg(feature = "plot")]
    crate::plot::PlotError,
    #[cfg(feature = "plot")]
    crate::pattern::PatternError,
);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{calib::CalibError, skin::TaxelId};

    #[test]
    fn kinds_are_variants_in_snake_case() {
        let one = || Error::from(CalibError::Undetermined { id: TaxelId(3) });
        assert_eq!(one().kind(), "undetermined");
        assert_eq!(Error::from(CalibError::Empty { taxels: 0, observations: 0 }).kind(), "empty");
        let sparse = CalibError::Sparse(crate::sparse::SparseError::Singular { rows: 2 });
        assert_eq!(sparse.kind(), "sparse");
        assert_eq!(CalibError::NoInitialValue { id: TaxelId(3) }.kind(), "no_initial_value");
        assert_eq!(Error::Several(vec![one().in_patch("palm"), one()]).kind(), "undetermined");
    }
}
