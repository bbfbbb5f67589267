//! Paths of the command line. The type of an argument says whether its file is read or written, so that no input can be
//! replaced.

use std::ffi::OsString;
use std::ops::Deref;
use std::path::{Path, PathBuf};

macro_rules! paths {
    ($($(#[$doc:meta])* $name:ident),*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq)]
        pub(crate) struct $name(PathBuf);

        impl From<OsString> for $name {
            fn from(text: OsString) -> Self {
                Self(text.into())
            }
        }

        impl Deref for $name {
            type Target = Path;

            fn deref(&self) -> &Path {
                &self.0
            }
        }

        impl From<&$name> for PathBuf {
            fn from(path: &$name) -> Self {
                path.0.clone()
            }
        }

        impl AsRef<Path> for $name {
            fn as_ref(&self) -> &Path {
                &self.0
            }
        }
    )*};
}

paths!(
    /// A file or folder that is read.
    InPath,
    /// A file that is written, in a folder that exists.
    OutFile,
    /// A folder that is written, or a file where its name says so; what may be there is known to the subcommand.
    OutFolder
);

/// An argument that is a word or the name of a file that is read.
pub(crate) trait MayRead: Clone + Send + Sync + 'static {
    /// The file, if it is one.
    fn file(&self) -> Option<&Path>;
}
