//! What changed: options, kinds and results.

use glam::DVec3;

use crate::calib::Pose;
use crate::skin::{SkinError, TaxelId};

/// What is known in addition to the two files.
#[derive(Debug, Clone, PartialEq)]
pub struct DiffOptions {
    /// The module of taxels of the first and of the second file, where these do not have it.
    pub modules: [Vec<(TaxelId, String)>; 2],
    /// Standard deviation of the difference of one taxel along each axis, in m, from 1e-9 to 1; `None`: estimated for each
    /// link, with at least 0.03 mm.
    pub sigma: Option<f64>,
    /// Chance that anything is reported if nothing changed, above 0 and below 1.
    pub chance: f64,
}

impl Default for DiffOptions {
    fn default() -> Self {
        Self { modules: Default::default(), sigma: None, chance: 1e-2 }
    }
}

/// Why two files cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum DiffError {
    #[error(
        "the files share no taxel: found {before} and {after} taxels, matched by {by}; needed: the same ids, or none and the same names of patches"
    )]
    NothingShared { before: usize, after: usize, by: MatchedBy },
    #[error(transparent)]
    Skin(#[from] SkinError),
    #[error("{name}: found {found}; needed: a number {needed}")]
    Option { name: &'static str, found: f64, needed: &'static str },
}

/// How taxels of two files were matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "snake_case")]
pub enum MatchedBy {
    /// By their ids.
    Id,
    /// By patch and row: a file has no ids.
    Row,
}

/// The kind of a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "snake_case")]
pub enum ChangeKind {
    /// A link moved as a whole: its frame in the world, or its skin.
    Frame,
    /// It is on another link.
    Relinked,
    /// The ids run the other way round.
    Mirrored,
    /// It is at another place.
    Moved,
    /// It is at its place, but turned.
    Turned,
    /// Two have exchanged their places.
    Swapped,
    /// Other taxels are where these were.
    Renumbered,
    /// Taxels of the first file alone.
    Missing,
    /// Taxels of the second file alone.
    New,
    /// Its normals point elsewhere.
    Tilted,
    /// Its areas are others.
    Resized,
    /// It belongs to another module.
    Regrouped,
    /// It senses something else.
    Modality,
    /// It is in another region.
    Region,
}

/// What a change is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "snake_case")]
pub enum Subject {
    /// A link.
    Link,
    /// A rigid module.
    Module,
    /// A part of a patch.
    Patch,
    /// A single taxel.
    Taxel,
}

/// A change from the first file to the second.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Its kind.
    pub kind: ChangeKind,
    /// What changed.
    pub subject: Subject,
    /// The name of the link, module or patch, or the id of the taxel.
    pub name: String,
    /// The name of that with which it was exchanged, at whose place it is, or which it belongs to: a link or module; what it senses in the
    /// second file, or its region there.
    pub other: Option<String>,
    /// The link, by its name in the first file, or in the second for what is new.
    pub link: String,
    /// The patch of the first of the taxels.
    pub patch: String,
    /// The taxels, in the order of their file.
    pub taxels: Vec<TaxelId>,
    /// The new ids of renumbered taxels, one for each.
    pub others: Vec<TaxelId>,
    /// Where the taxels are in the first file, in the frame of their link, in m; none of what is new.
    pub before: Vec<DVec3>,
    /// Where they are in the second file, moved back by the motion of their link; none of what is missing.
    pub after: Vec<DVec3>,
    /// How far it moved, in m; for a module and a taxel relative to its neighbours.
    pub distance: f64,
    /// By what angle it turned, in rad.
    pub angle: f64,
    /// How many standard deviations that is: the root of the larger chi-square of shift and turn; NaN where nothing was
    /// measured.
    pub sigmas: f64,
    /// Chance of that if nothing changed, of this test alone; NaN as above.
    pub p: f64,
}

/// The alignment of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignedLink {
    /// Its name in the first file.
    pub name: String,
    /// Taxels of both files on it.
    pub taxels: usize,
    /// The motion from the first file to the second that most of them follow.
    pub motion: Pose,
    /// Those that follow it, apart from noise.
    pub unchanged: usize,
}

/// What changed between two files.
#[derive(Debug, Clone, PartialEq)]
pub struct Diff {
    /// How taxels were matched.
    pub by: MatchedBy,
    /// Matched taxels.
    pub matched: usize,
    /// Taxels that were left out in the first and in the second file: their id is not unique in a file, nor on the links and patches whose
    /// names both files have.
    pub ambiguous: [usize; 2],
    /// Each link with matched taxels, in the order of the first file.
    pub links: Vec<AlignedLink>,
    /// The changes: link by link, of whole links, modules, taxels; then what is in one file alone.
    pub changes: Vec<Change>,
}
