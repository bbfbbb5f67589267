//! What can be wrong with a file.

use std::{fmt, path::PathBuf};

use crate::map::MapError;

/// What reading and writing return.
pub(super) type Result<T, E = IoError> = std::result::Result<T, E>;

/// What is wrong with a file: which, where in it, what was found, what is needed.
#[derive(Debug, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages explain the fields")]
pub enum IoError {
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// The file cannot be written; an older one is left as it was.
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    #[error("the result would replace an input, {}", path.display())]
    ReplacesInput { path: PathBuf },
    /// The content breaks a rule of its format.
    #[error("{}: {element}: found {found}; needed: {needed}", path.display())]
    Invalid { path: PathBuf, element: FileElement, found: String, needed: String },
    /// The file has several streams, and none or an unknown one is chosen.
    #[error("{}: streams: found {found}; needed: one of {}", path.display(), known.join(", "))]
    Streams {
        path: PathBuf,
        found: String,
        /// The name and the shape of each.
        known: Vec<String>,
    },
    #[error("{}: {element}: found no file for {url:?}, looked for in: {}", path.display(), listed(searched))]
    MeshFile {
        /// The file.
        path: PathBuf,
        /// Which element of the file: `line 12, <mesh>`.
        element: Box<str>,
        /// What it names.
        url: String,
        /// The package that it names, if it does.
        package: Option<String>,
        /// Where it was looked for: folders of the package, or the file itself.
        searched: Vec<PathBuf>,
        /// Whether the shapes that collide are there, where those that are seen are not.
        has_collision: bool,
    },
    /// The map that is to be written, or that was read, breaks a rule.
    #[error("{}: {source}", path.display())]
    Map { path: PathBuf, source: Box<MapError> },
    /// What is to be written does not fit the format; an older file is left as it was.
    #[error("cannot write {}: {element}: found {found}; needed: {needed}", path.display())]
    Unfit {
        path: PathBuf,
        /// Which element: `palm/L0`.
        element: String,
        found: String,
        needed: String,
    },
    /// The file uses something that is valid but not read here.
    #[error("{}: {element} uses {feature}, which is not supported", path.display())]
    Unsupported { path: PathBuf, element: FileElement, feature: Feature },
    #[error("{}: animations: found {known:?}; needed: {}", path.display(), wanted.as_ref().map_or_else(
        || "exactly one, or the name of one of them".to_owned(),
        |name| format!("one called {name:?}"),
    ))]
    Animation { path: PathBuf, wanted: Option<String>, known: Vec<String> },
    #[error("{}: found no mesh with extras.dermatome; needed: a map, as dermatome writes it", path.display())]
    NoMap { path: PathBuf },
    #[error(
        "{}: another program, {generator}, rewrote this map and broke it: {fault}; \
         needed: the file as dermatome wrote it",
        path.display()
    )]
    Rewritten { path: PathBuf, generator: String, fault: String },
    #[error("{}: unknown kind of file; known here: {known}", path.display())]
    UnknownKind { path: PathBuf, known: &'static str },
}

/// An element of a file: its line, its name, or both; `Display` is `line 12, column x`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileElement {
    /// The line that it begins on, in a file of text; counted from 1.
    pub line: Option<u64>,
    /// What it is: `accessor 3`, `column x`; empty where it is the line itself.
    pub name: String,
}

impl fmt::Display for FileElement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            Some(line) if self.name.is_empty() => write!(f, "line {line}"),
            Some(line) => write!(f, "line {line}, {}", self.name),
            None => f.write_str(&self.name),
        }
    }
}

impl From<String> for FileElement {
    fn from(name: String) -> Self {
        Self { line: None, name }
    }
}

impl<N: AsRef<str> + ?Sized> From<&N> for FileElement {
    fn from(name: &N) -> Self {
        name.as_ref().to_owned().into()
    }
}

impl<L: TryInto<u64>, N: Into<String>> From<(L, N)> for FileElement {
    fn from((line, name): (L, N)) -> Self {
        Self { line: line.try_into().ok(), name: name.into() }
    }
}

/// Something that is valid in a file, but not read here.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Feature {
    /// An extension of glTF, by its name.
    #[error("{0}")]
    Extension(String),
    /// Anything else, in words.
    #[error("{0}")]
    Other(String),
}

impl From<&str> for Feature {
    fn from(feature: &str) -> Self {
        Self::Other(feature.to_owned())
    }
}

/// Paths as an error lists them.
fn listed(paths: &[PathBuf]) -> String {
    let all: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    if all.is_empty() { "no folder of that name".to_owned() } else { all.join(", ") }
}
