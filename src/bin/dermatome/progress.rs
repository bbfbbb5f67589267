//! Progress on a terminal: one bar, named after the stage.

use std::{io::IsTerminal, time::Duration};

use dermatome::pipeline::{Progress, Stage};
use indicatif::{ProgressBar, ProgressStyle};

use crate::common::Common;

/// A bar on standard error; hidden unless that is a terminal.
pub(crate) fn bar(common: &Common) -> ProgressBar {
    if common.quiet || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{msg:>12} [{bar:32}] {pos}/{len} {elapsed}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

pub(crate) fn show(bar: &ProgressBar, progress: Progress) {
    bar.set_message(match progress.stage {
        Stage::Coarsen => "coarsening",
        Stage::Flatten => "flattening",
        Stage::Rasterise => "rasterising",
        Stage::Write => "writing",
    });
    bar.set_length(progress.total as u64);
    bar.set_position(progress.done as u64);
}

/// A bar for the frames of a recording, whose number may not be known; none for a live stream, whose
/// terminal belongs to others.
pub(crate) fn frames(common: &Common, total: Option<u64>, is_live: bool) -> ProgressBar {
    if is_live {
        return ProgressBar::hidden();
    }
    let bar = bar(common);
    match (total, ProgressStyle::with_template("{msg:>12} {pos} frames {elapsed}")) {
        (Some(total), _) => bar.set_length(total),
        (None, Ok(style)) => bar.set_style(style),
        (None, Err(_)) => {}
    }
    bar.set_message("rendering");
    bar
}
