//! The sum of the rooms' errors.

use crate::{flatten::FlattenError, skin::SkinError};

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

    /// What a user can do about it, as a sentence.
    #[must_use]
    pub fn help(&self) -> String {
        match self {
            Self::Skin(
                SkinError::TooFewPlaces { .. } | SkinError::NoSurface { .. } | SkinError::NoFace { .. },
            ) => "give the taxels triangles, or normals that tell the sides of thin parts apart; check for mixed units".into(),
            Self::Skin(SkinError::Gap { .. }) => "change the option".into(),
            Self::Mesh(_) | Self::Skin(_) | Self::Pyramid(_) => {
                "run `dermatome check` on the file: it lists every such element".into()
            }
            Self::Flatten(e) => flatten_help(e).into(),
            Self::Calib(e) => e.help(),
            Self::Map(_) => "make the map again with `dermatome build`".into(),
            Self::Contact(e) => e.help().into(),
            Self::Atlas(e) => e.help(),
            Self::Io(e) => e.help(),
            Self::Plot(e) => e.help(),
            Self::Patch { source, .. } => source.help(),
        }
    }
}

/// What a user can do about a mesh without a map.
const fn flatten_help(error: &FlattenError) -> &'static str {
    match error {
        FlattenError::NotADisk { .. } => "cut the mesh open, or give each piece a file of its own",
        FlattenError::Mesh(_) | FlattenError::Pyramid(_) | FlattenError::PointFace { .. } => {
            "run `dermatome check` on the file: it lists every such element"
        }
        FlattenError::Option { .. } => "change the option: `dermatome help flatten` tells what each takes",
        FlattenError::Size { .. } => "give positions in metres",
        FlattenError::Density { .. } | FlattenError::Densities { .. } => {
            "mend the densities in the file, or leave them out"
        }
        _ => "remesh the thin part, cut it into shorter pieces, or try another --method",
    }
}
