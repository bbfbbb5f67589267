//! Progress on standard error: on a terminal one bar, named after the stage, elsewhere a line every
//! ten seconds.

use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::{io::IsTerminal, thread, time::Duration};

use dermatome::run::{Progress, Stage};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use crate::{console::print::say, options::Common};

/// Time between two lines where standard error is not a terminal.
const EVERY: Duration = Duration::from_secs(10);

/// A bar on standard error, or lines where that is not a terminal; nothing in a quiet run.
pub(crate) fn bar(common: &Common) -> ProgressBar {
    if common.quiet {
        return ProgressBar::hidden();
    }
    if !std::io::stderr().is_terminal() {
        let bar = ProgressBar::hidden();
        print_lines(&bar, common.steps.clone());
        return bar;
    }
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{msg:>12} [{bar:32}] {pos}/{len} {steps}{elapsed}") {
        let steps = common.steps.clone();
        let shown = move |_: &ProgressState, text: &mut dyn Write| {
            let _ = text.write_str(&steps_so_far(&steps));
        };
        bar.set_style(style.with_key("steps", shown));
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// Prints how far `bar` is every ten seconds, until it is finished or dropped.
fn print_lines(bar: &ProgressBar, steps: Arc<AtomicU64>) {
    let bar = bar.downgrade();
    thread::spawn(move || {
        loop {
            thread::sleep(EVERY);
            let Some(bar) = bar.upgrade().filter(|bar| !bar.is_finished()) else { break };
            let (message, seconds, done) = (bar.message(), bar.elapsed().as_secs(), bar.position());
            let steps = steps_so_far(&steps);
            match bar.length().filter(|&total| total > 0) {
                Some(total) => say(format_args!("{message}: {done} of {total}, {steps}{seconds} s")),
                None => say(format_args!("{message}: {steps}{seconds} s")),
            }
        }
    });
}

/// What moves while one large patch is made.
fn steps_so_far(steps: &AtomicU64) -> String {
    match steps.load(Ordering::Relaxed) {
        0 => String::new(),
        steps => format!("step {steps}, "),
    }
}

pub(crate) fn show(bar: &ProgressBar, Progress { stage, done, total }: Progress) {
    let name = match stage {
        Stage::Coarsen => "coarsening",
        Stage::Flatten => "flattening",
    };
    step(bar, name, done, total);
}

/// Shows how many patches of how many a stage has done.
pub(crate) fn step(bar: &ProgressBar, stage: &'static str, done: usize, total: usize) {
    bar.set_message(stage);
    bar.set_length(total as u64);
    bar.set_position(done as u64);
}

/// A bar for the frames of a recording, whose number may not be known; none for a live stream, whose
/// terminal belongs to others.
pub(crate) fn frames(common: &Common, total: Option<u64>, is_live: bool) -> ProgressBar {
    if is_live {
        return ProgressBar::hidden();
    }
    let bar = bar(common);
    match (total, ProgressStyle::with_template("{msg:>12} {pos} {elapsed}")) {
        (Some(total), _) => bar.set_length(total),
        (None, Ok(style)) => bar.set_style(style),
        (None, Err(_)) => {}
    }
    bar.set_message("frames");
    bar
}
