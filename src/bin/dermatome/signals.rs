//! What a run that is stopped by ^C, `kill` or a closed terminal leaves behind: none of its temporary files.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
    process,
    sync::{Mutex, Once, PoisonError},
    thread,
};

use dermatome::io::temporary_prefix;
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM},
    iterator::Signals,
};

/// What shells know a stopped run by: this and the number of the signal.
const STOPPED: i32 = 128;

/// New files may appear while others are removed; more often than this only if something is wrong.
const MOST_SWEEPS: usize = 10;

/// Where this run has temporary files, or may have.
static FOLDERS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Removes the temporary files that this run has in a folder, should it be stopped.
pub(crate) fn clean_when_stopped(folder: &Path) {
    static HANDLER: Once = Once::new();
    FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    HANDLER.call_once(|| {
        // Without handler a stopped run ends all the same, and leaves its files: no reason not to run.
        let Ok(mut signals) = Signals::new(signals()) else { return };
        thread::spawn(move || {
            let Some(signal) = signals.forever().next() else { return };
            for folder in FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).iter() {
                let _ = (0..MOST_SWEEPS).find(|_| sweep(folder).is_ok_and(|removed| removed == 0));
            }
            process::exit(STOPPED + signal);
        });
    });
}

/// The signals that stop a run, but for those that its caller wants ignored, as `nohup` does, or a shell for what runs in the
/// background.
fn signals() -> Vec<i32> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0).collect()
}

/// Removes what this run has left in a folder, and counts it.
fn sweep(folder: &Path) -> io::Result<usize> {
    let mut removed = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with(temporary_prefix()) {
            let path = entry.path();
            if entry.file_type()?.is_dir() {
                fs::remove_dir_all(path)?
            } else {
                fs::remove_file(path)?
            }
            removed += 1;
        }
    }
    Ok(removed)
}
