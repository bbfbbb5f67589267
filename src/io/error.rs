//! What can be wrong with a file.

use std::path::PathBuf;

use crate::map::MapError;

/// What reading and writing return.
pub(super) type Result<T, E = IoError> = std::result::Result<T, E>;

/// What is wrong with a file: which, where in it, what was found, what is needed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IoError {
    /// The file cannot be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file cannot be written; an older one is left as it was.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The content breaks a rule of its format.
    #[error("{}: {element}: found {found}; needed: {needed}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Which element of the file: `accessor 3`, `line 12`, `taxel 4`.
        element: String,
        /// What was found there.
        found: String,
        /// What is needed instead.
        needed: String,
    },
    /// The map that is to be written, or that was read, breaks a rule.
    #[error("{}: {source}", path.display())]
    Map {
        /// The file.
        path: PathBuf,
        /// The rule.
        source: Box<MapError>,
    },
    /// What is to be written does not fit the format; an older file is left as it was.
    #[error("cannot write {}: {element}: found {found}; needed: {needed}", path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// Which element: `palm/L0`.
        element: String,
        /// What was found there.
        found: String,
        /// What is needed instead.
        needed: String,
    },
    /// The file uses something that is valid but not read here.
    #[error("{}: {element} uses {feature}, which is not supported", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Which element of the file.
        element: String,
        /// What it uses: a glTF extension by its name, anything else in words.
        feature: String,
    },
    /// The file is not a map; it may be a skin.
    #[error("{}: found no mesh with extras.dermatome; needed: a map, as dermatome writes it", path.display())]
    NoMap {
        /// The file.
        path: PathBuf,
    },
    /// The extension is not one of a file that can be used here.
    #[error("{}: unknown kind of file; known here: {known}", path.display())]
    UnknownKind {
        /// The file.
        path: PathBuf,
        /// Extensions that are known.
        known: &'static str,
    },
}
