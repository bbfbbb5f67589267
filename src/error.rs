//! [`Error`]: the sum of the modules' errors.

/// Any error of the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
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
    /// A patch that cannot be unfolded: its system does not fit into memory.
    #[error("it cannot be unfolded: {0}")]
    Unfold(#[from] crate::sparse::SparseError),
    /// A map that cannot be drawn.
    #[error(transparent)]
    Plot(#[from] crate::plot::PlotError),
    /// Any of them, in one patch of a skin.
    #[error("patch {patch:?}: {source}")]
    Patch { patch: String, source: Box<Error> },
    /// Errors of several patches of a skin, in the order of these.
    #[error("{} patches cannot be mapped: {}", .0.len(), .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Several(Vec<Error>),
}

impl Error {
    /// What went wrong as one word in snake case, for programs that tell errors apart.
    ///
    /// It is the name of the variant of the module's error: [`FlattenError::NotADisk`] is
    /// `not_a_disk`. Messages may change from version to version, kinds do not. An error in a patch has
    /// the kind of its source; of several errors, that of the first.
    ///
    /// [`FlattenError::NotADisk`]: crate::flatten::FlattenError::NotADisk
    #[must_use]
    pub fn kind(&self) -> String {
        match self {
            Self::Patch { source, .. } => source.kind(),
            Self::Several(errors) => errors.first().map_or_else(|| variant_name(self, 0), Self::kind),
            _ => variant_name(self, 1),
        }
    }

    /// The same error, saying which patch it is about.
    pub(crate) fn in_patch(self, patch: &str) -> Self {
        Self::Patch { patch: patch.to_owned(), source: Box::new(self) }
    }
}

macro_rules! kinds {
    ($($error:ty),* $(,)?) => {
        $(impl $error {
            /// What went wrong as one word in snake case, the name of the variant; see
            /// [`Error::kind`](crate::Error::kind).
            #[must_use]
            pub fn kind(&self) -> String {
                variant_name(self, 0)
            }
        })*
    };
}

kinds!(
    crate::mesh::MeshError,
    crate::skin::SkinError,
    crate::calib::CalibError,
    crate::cut::CutError,
    crate::pyramid::PyramidError,
    crate::flatten::FlattenError,
    crate::map::MapError,
    crate::signal::SignalError,
    crate::contact::ContactError,
    crate::atlas::AtlasError,
    crate::image::ImageError,
    crate::io::IoError,
    crate::plot::PlotError,
);

/// The name of the variant of an enum whose `Debug` is derived, at this depth, in snake case.
fn variant_name(error: &impl std::fmt::Debug, depth: usize) -> String {
    let text = format!("{error:?}");
    let name = text.split(|c: char| !c.is_alphanumeric()).nth(depth).unwrap_or_default();
    let mut words = String::new();
    for (k, c) in name.char_indices() {
        if c.is_uppercase() && k > 0 {
            words.push('_');
        }
        words.extend(c.to_lowercase());
    }
    words
}

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
