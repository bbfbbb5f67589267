//! The links of an index, posed for the times of rows.

use std::path::{Path, PathBuf};

use dermatome::contact::{ContactError, ContactIndex};
use dermatome::io::IoError;
use dermatome::skin::Motion;

use crate::{console::notes::note_count, options::Common};

/// How the links move, if they do.
pub(super) struct Player {
    path: PathBuf,
    motion: Option<Motion>,
    /// First and last time of the motion, in s, if poses depend on it.
    span: Option<[f64; 2]>,
    /// Rows without a time, or with one outside the motion, whose nearest pose is taken.
    held: u64,
}

impl Player {
    pub(super) fn new(path: &Path, motion: Option<Motion>) -> Self {
        let span = motion.as_ref().and_then(Motion::times).filter(|[first, last]| first < last);
        Self { path: path.to_owned(), motion, span, held: 0 }
    }

    pub(super) fn is_timed(&self) -> bool {
        self.span.is_some()
    }

    /// Poses the links as in the beginning.
    pub(super) fn start(&self, index: &mut ContactIndex) -> Result<(), IoError> {
        let first = self.motion.as_ref().and_then(Motion::times).map_or(0.0, |[first, _]| first);
        self.set(index, first)
    }

    /// Fails if a pose at this time (s) is too far away.
    fn set(&self, index: &mut ContactIndex, time: f64) -> Result<(), IoError> {
        let Some(motion) = &self.motion else { return Ok(()) };
        index.set_motion(motion, time).map_err(|error| {
            let held = self.span.map_or(time, |[first, last]| time.clamp(first, last));
            let (found, needed) = match error {
                ContactError::NotRigid { name } => {
                    let found = format!("a pose of link {name:?} that is not rigid or too far away");
                    (found, "a rotation and a translation of at most 1e12 m")
                }
                other => (other.to_string(), "poses that the map can take"),
            };
            let element = format!("the poses at {held} s").into();
            IoError::Invalid { path: self.path.clone(), element, found, needed: needed.into() }
        })
    }

    /// Poses the links as at the time of some rows.
    pub(super) fn pose(
        &mut self,
        index: &mut ContactIndex,
        time: Option<f64>,
        rows: usize,
    ) -> Result<(), IoError> {
        let Some([first, last]) = self.span else { return Ok(()) };
        if time.is_none_or(|t| t < first || t > last) {
            self.held += rows as u64;
        }
        self.set(index, time.unwrap_or(first))
    }

    /// Says how many of the `rows` had no pose of their own.
    pub(super) fn note(&self, rows: &str, common: &Common) {
        let how = "without a time or outside the times of the poses: the first or last pose is taken";
        note_count(common, self.held, rows, how);
    }
}
