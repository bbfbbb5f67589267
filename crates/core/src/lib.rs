//! What dermatome computes, without a file or a picture: the modules of the crate `dermatome` from ids to contacts.
//!
//! Use the crate `dermatome`, which has them under the same names. What is hidden here is shared with that crate alone.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

pub mod id;
#[doc(hidden)]
pub mod parallel;
pub mod run;
#[doc(hidden)]
pub mod numeric;
pub mod least_squares;
pub mod mesh;
mod nearest;
pub mod skin;
#[cfg(feature = "robots")]
pub mod robot;
#[cfg(feature = "robots")]
pub mod remesh;
pub mod design;
pub mod calib;
pub mod diff;
pub mod cut;
pub mod pyramid;
pub mod flatten;
pub mod body;
pub mod map;
pub mod registration;
pub mod atlas;
pub mod unfold;
pub mod signal;
pub mod response;
pub mod touches;
pub mod image;
pub mod contact;

use dermatome_bvh as bvh;
#[doc(hidden)]
pub use dermatome_delaunay as delaunay;
#[doc(hidden)]
pub use dermatome_sparse as sparse;

/// The kinds of errors: the name of the variant in snake case, for programs that distinguish errors.
#[doc(hidden)]
#[macro_export]
macro_rules! kinds {
    ($($(#[$gate:meta])? $error:ty),* $(,)?) => {
        $($(#[$gate])? impl $error {
            /// The name of the variant in snake case, as `Error::kind` returns it.
            pub fn kind(&self) -> &'static str {
                self.into()
            }
        })*
    };
}

kinds!(
    mesh::MeshError,
    skin::SkinError,
    #[cfg(feature = "robots")]
    remesh::RemeshError,
    design::DesignError,
    calib::CalibError,
    cut::CutError,
    pyramid::PyramidError,
    flatten::FlattenError,
    map::MapError,
    registration::RegistrationError,
    signal::SignalError,
    signal::OrderError,
    response::ResponseError,
    diff::DiffError,
    touches::TouchesError,
    contact::ContactError,
    atlas::AtlasError,
    image::ImageError,
);
