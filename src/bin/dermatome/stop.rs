//! What a run that is stopped by ^C, `kill` or a closed terminal leaves behind: none of its temporary files.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
    process,
    sync::{Mutex, Once, PoisonError},
};

use dermatome::io::temporary_prefix;

/// What shells know a stopped run by.
const STOPPED: i32 = 130;

/// New files may appear while others are removed; more often than this only if something is wrong.
const MOST_SWEEPS: usize = 10;

/// Where this run has temporary files, or may have.
static FOLDERS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Removes the temporary files that this run has in a folder, should it be stopped.
pub(crate) fn clean_when_stopped(folder: &Path) {
    static HANDLER: Once = Once::new();
    FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    HANDLER.call_once(|| {
        // Signals that the caller ignores, as `nohup` does, stay ignored: that is the only way in which this fails.
        let _ = ctrlc::try_set_handler(|| {
            for folder in FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).iter() {
                let _ = (0..MOST_SWEEPS).find(|_| sweep(folder).is_ok_and(|removed| removed == 0));
            }
            process::exit(STOPPED);
        });
    });
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
