//! How work runs: its cancellation and its progress. It never changes the result.
//!
//! Options determine the result; a [`Run`] is a separate parameter. The number of threads is that of the
//! rayon pool in which the work runs.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// How a computation runs. The default is never cancelled and does not report progress.
///
/// ```
/// use std::sync::atomic::AtomicBool;
/// use dermatome::{flatten::{FlattenOptions, flatten}, mesh::shapes, run::Run};
///
/// let cancelled = AtomicBool::new(true);
/// let run = Run::default().cancelled_by(&cancelled);
/// let error = flatten(&shapes::cap(500, 0.1, 1.9), None, &FlattenOptions::default(), run).unwrap_err();
/// assert_eq!(error.kind(), "cancelled");
/// ```
#[derive(Clone, Copy, Default)]
pub struct Run<'a> {
    cancelled: Option<&'a AtomicBool>,
    progress: Option<&'a (dyn Fn(Progress) + Sync)>,
    steps: Option<&'a AtomicU64>,
}

impl<'a> Run<'a> {
    /// Work ends soon after `flag` is set, with [`Cancelled`] as its error: it is checked in iterations of
    /// solvers and between levels.
    #[must_use]
    pub fn cancelled_by(self, flag: &'a AtomicBool) -> Self {
        Self { cancelled: Some(flag), ..self }
    }

    /// `progress` is called from any thread at the start of a stage and after each of its items.
    #[must_use]
    pub fn telling(self, progress: &'a (dyn Fn(Progress) + Sync)) -> Self {
        Self { progress: Some(progress), ..self }
    }

    /// `steps` grows with each step of an iteration: one large patch may take minutes.
    #[must_use]
    pub fn counting(self, steps: &'a AtomicU64) -> Self {
        Self { steps: Some(steps), ..self }
    }

    /// Whether the work is cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }

    /// An error if the work is cancelled.
    #[doc(hidden)]
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }

    /// As [`Self::check`], at a step of an iteration, which is counted.
    pub(crate) fn step(&self) -> Result<(), Cancelled> {
        self.steps.map(|steps| steps.fetch_add(1, Ordering::Relaxed));
        self.check()
    }

    #[doc(hidden)]
    pub fn tell(&self, progress: Progress) {
        if let Some(tell) = self.progress {
            tell(progress);
        }
    }
}

impl std::fmt::Debug for Run<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Run").field("is_cancelled", &self.is_cancelled()).finish_non_exhaustive()
    }
}

/// The work was cancelled; see [`Run::cancelled_by`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled before it was done")]
pub struct Cancelled;

/// A step of the flow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Making the pyramids.
    Coarsen,
    /// Making the maps of every level.
    Flatten,
}

/// The progress of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// The stage.
    pub stage: Stage,
    /// Patches that are done.
    pub done: usize,
    /// Patches in all.
    pub total: usize,
}
