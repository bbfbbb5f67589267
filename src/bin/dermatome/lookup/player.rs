//! The links of an index, posed for the times of rows.

use dermatome::{contact::ContactIndex, io::IoError, skin::Motion};

use crate::{console::notes::note, lookup::refusals::unanswered, options::Common};

/// How the links move, if they do.
pub(super) struct Player {
    motion: Option<Motion>,
    /// First and last time of the motion, in s, if poses depend on it.
    span: Option<[f64; 2]>,
    /// Rows without a time, or with one outside the motion, whose nearest pose is taken.
    held: u64,
}

impl Player {
    pub(super) fn new(motion: Option<Motion>) -> Self {
        let span = motion.as_ref().and_then(Motion::times).filter(|[first, last]| first < last);
        Self { motion, span, held: 0 }
    }

    /// Whether poses depend on the time.
    pub(super) fn is_timed(&self) -> bool {
        self.span.is_some()
    }

    /// Poses the links as in the beginning.
    pub(super) fn start(&self, index: &mut ContactIndex) -> Result<(), IoError> {
        let Some(motion) = &self.motion else { return Ok(()) };
        let first = motion.times().map_or(0.0, |[first, _]| first);
        index.set_motion(motion, first).map_err(unanswered)
    }

    /// Poses the links as at the time of some rows.
    pub(super) fn pose(
        &mut self,
        index: &mut ContactIndex,
        time: Option<f64>,
        rows: usize,
    ) -> Result<(), IoError> {
        let (Some(motion), Some([first, last])) = (&self.motion, self.span) else { return Ok(()) };
        if time.is_none_or(|t| t < first || t > last) {
            self.held += rows as u64;
        }
        index.set_motion(motion, time.unwrap_or(first)).map_err(unanswered)
    }

    /// Says how many of the `rows` had no pose of their own.
    pub(super) fn note(&self, rows: &str, common: &Common) {
        if self.held > 0 {
            let what = "without a time or outside the times of the poses: the first or last pose is taken";
            note(common, format_args!("{} {rows} {what}", self.held));
        }
    }
}
