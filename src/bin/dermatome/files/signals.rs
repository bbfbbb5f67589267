//! Removes the temporary files of a run that is stopped by ^C, `kill` or a closed terminal.

use std::{fs, process, sync::Arc, thread};

use dermatome::io::abandon_files;
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ},
    iterator::Signals,
};

/// Exit code of a stopped run, less the number of the signal; as shells have it.
const STOPPED: i32 = 128;

/// From now on a signal that stops this run removes its temporary files.
pub(crate) fn clean_when_stopped() {
    // Without a handler a stopped run only leaves its files, so go on.
    // A file beyond the limit of its size is then an error of its writer.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
    let Ok(mut signals) = Signals::new(signals()) else { return };
    thread::spawn(move || {
        let Some(signal) = signals.forever().next() else { return };
        abandon_files();
        process::exit(STOPPED + signal);
    });
}

/// The signals that stop a run. A hangup that the caller ignores stays ignored: `nohup` says so, and
/// a handler would undo it.
fn signals() -> Vec<i32> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0).collect()
}
