//! Removes the temporary files of a run that is stopped by ^C, `kill` or a closed terminal.

use std::{
    collections::BTreeSet,
    fs::{self, Metadata},
    io,
    path::{Path, PathBuf},
    process,
    sync::{Arc, Mutex, Once, PoisonError},
    thread,
    time::Duration,
};

use dermatome::io::temporary_prefix;
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ},
    iterator::Signals,
};

/// Exit code of a stopped run, less the number of the signal; as shells have it.
const STOPPED: i32 = 128;

/// New files may appear while others are removed; more often than this only if something is wrong.
const MOST_SWEEPS: usize = 10;

/// Where this run has temporary files, or may have.
static FOLDERS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Registers a folder: if this run is stopped, its temporary files there are removed.
pub(crate) fn clean_when_stopped(folder: &Path) {
    static HANDLER: Once = Once::new();
    if FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned()) {
        // What cannot be listed or removed is not an error of this run.
        let _ = sweep(folder, is_abandoned);
    }
    HANDLER.call_once(|| {
        // Without a handler a stopped run only leaves its files, so go on.
        // A file beyond the limit of its size is then an error of its writer.
        let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
        let Ok(mut signals) = Signals::new(signals()) else { return };
        thread::spawn(move || {
            let Some(signal) = signals.forever().next() else { return };
            for folder in FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).iter() {
                let _ = (0..MOST_SWEEPS).find(|_| sweep(folder, is_ours).is_ok_and(|removed| removed == 0));
            }
            process::exit(STOPPED + signal);
        });
    });
}

/// Terminating signals, except those that the parent process set to ignored (`nohup`, background
/// jobs).
fn signals() -> Vec<i32> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0).collect()
}

/// Removes the temporary files in a folder that `goes` chooses; returns how many there were.
fn sweep(folder: &Path, goes: fn(&str, &Metadata) -> bool) -> io::Result<usize> {
    let mut removed = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(ANY_PREFIX) && goes(&name, &entry.metadata()?) {
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

/// How the names of the temporary files of all runs begin; a number of the process follows.
const ANY_PREFIX: &str = ".dermatome-";

fn is_ours(name: &str, _: &Metadata) -> bool {
    name.starts_with(temporary_prefix())
}

/// A machine or container that shares a folder may have other processes, so that a number says
/// nothing of a young file.
const OLD: Duration = Duration::from_secs(24 * 60 * 60);

/// Whether a file is old and of a process that does not exist: one that was killed.
fn is_abandoned(name: &str, about: &Metadata) -> bool {
    let process = name.strip_prefix(ANY_PREFIX).and_then(|rest| rest.split('-').next());
    let process = process.and_then(|number| number.parse::<u32>().ok());
    let is_old = about.modified().is_ok_and(|at| at.elapsed().is_ok_and(|age| age > OLD));
    is_old
        && process
            .is_some_and(|id| Path::new("/proc/self").exists() && !Path::new(&format!("/proc/{id}")).exists())
}
