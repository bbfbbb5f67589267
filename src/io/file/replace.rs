//! Writing a file whole or not at all, and several files together.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::NamedTempFile;

use crate::io::IoError;
use crate::parallel::par_map;

/// Writes a file whole or not at all: into a temporary file next to it, then renamed.
///
/// An older file stays as it was until the new one is complete. A link is followed; a device or a
/// pipe is written to as it is, since it cannot be replaced.
///
/// # Errors
/// Whatever `write` returns, and what the system says about the folder or the disk.
pub fn replace_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), IoError>,
) -> Result<(), IoError> {
    let replacement = Replacement::open(path)?;
    let mut buffered = BufWriter::with_capacity(1 << 18, replacement.file());
    write(&mut buffered)?;
    buffered.flush().map_err(cannot_write(path))?;
    drop(buffered);
    replacement.finish()
}

/// [`replace_file`] where nothing but the disk can fail.
pub(crate) fn write_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), IoError> {
    replace_file(path, |file| write(file).map_err(cannot_write(path)))
}

/// Writes where nothing but the output can fail; errors call it `path`.
pub(crate) fn write_to(
    output: &mut dyn Write,
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), IoError> {
    write(output).map_err(cannot_write(path))
}

pub(crate) fn cannot_write(path: &Path) -> impl Fn(io::Error) -> IoError + '_ {
    |source| IoError::Write { path: path.into(), source }
}

/// Files that appear in their places together, after the last of them is complete.
///
/// Without [`StagedFiles::publish`] none of them appears.
#[derive(Default)]
pub struct StagedFiles {
    files: Vec<Replacement>,
}

thread_local! {
    /// Where files go that this thread completes within [`StagedFiles::stage`].
    static STAGE: RefCell<Option<Vec<Replacement>>> = const { RefCell::new(None) };
}

impl StagedFiles {
    /// Keeps the files that `write` completes, on this thread, under their temporary names.
    ///
    /// # Errors
    /// Whatever `write` returns.
    pub fn stage<T, E>(&mut self, write: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let outer = STAGE.replace(Some(Vec::new()));
        let written = write();
        self.files.extend(STAGE.replace(outer).unwrap_or_default());
        written
    }

    /// As [`Self::stage`], where several write side by side; files keep the order of `writers`.
    ///
    /// # Errors
    /// That of the first of `writers` that fails.
    pub fn stage_all<E: Send>(&mut self, writers: &[&(dyn Fn() -> Result<(), E> + Sync)]) -> Result<(), E> {
        let staged = par_map(writers, |write| {
            let mut files = Self::default();
            files.stage(write).map(|()| files.files)
        });
        staged.into_iter().try_for_each(|files| files.map(|files| self.files.extend(files)))
    }

    /// The places of the files, as they were named.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|file| file.path.as_path())
    }

    /// Puts all files in their places, or on the stage around this one.
    ///
    /// # Errors
    /// If a file cannot be renamed; those before it are in their places then.
    pub fn publish(self) -> Result<(), IoError> {
        self.files.into_iter().try_for_each(Replacement::finish)
    }
}

/// A file on its way to its place, where it appears when it is published and not before.
pub(crate) struct Replacement {
    path: PathBuf,
    target: PathBuf,
    file: Unpublished,
}

enum Unpublished {
    /// Next to its place, under another name.
    Temporary(NamedTempFile, Listed),
    /// A device or a pipe, which cannot be replaced.
    Device(File),
}

/// The temporary files of this process.
static TEMPORARY: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn temporary() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary file in the list of those to remove when the process is stopped.
struct Listed(PathBuf);

impl Drop for Listed {
    fn drop(&mut self) {
        temporary().remove(&self.0);
    }
}

/// Removes the temporary files of this process, which has to exit then: a thread that starts another
/// file waits forever.
pub fn abandon_files() {
    let files = temporary();
    for file in files.iter() {
        // A file that is gone is what is wanted.
        let _ = fs::remove_file(file);
    }
    mem::forget(files);
}

impl Replacement {
    /// Creates the temporary file, or opens the device that is there.
    pub(crate) fn open(path: &Path) -> Result<Self, IoError> {
        let target = follow_links(path);
        let fail = cannot_write(path);
        if target.is_dir() {
            return Err(fail(io::Error::from(io::ErrorKind::IsADirectory)));
        }
        let file = if target.exists() && !target.is_file() {
            Unpublished::Device(OpenOptions::new().write(true).open(&target).map_err(fail)?)
        } else {
            // As readable as any file the user makes: the system subtracts the umask.
            let new = |path: &Path| OpenOptions::new().read(true).write(true).create_new(true).open(path);
            let mut all = temporary();
            let file = tempfile::Builder::new().prefix(PREFIX).make_in(folder_of(&target), new);
            let file = file.map_err(|e| fail(without_path(&e)))?;
            all.insert(file.path().to_owned());
            let listed = Listed(file.path().to_owned());
            Unpublished::Temporary(file, listed)
        };
        Ok(Self { path: path.into(), target, file })
    }

    pub(crate) fn file(&self) -> &File {
        match &self.file {
            Unpublished::Temporary(file, _) => file.as_file(),
            Unpublished::Device(file) => file,
        }
    }

    /// Puts the file in its place, or on the stage of this thread if it has one.
    pub(crate) fn finish(self) -> Result<(), IoError> {
        STAGE.with_borrow_mut(|stage| match stage {
            Some(stage) => {
                stage.push(self);
                Ok(())
            }
            None => self.publish(),
        })
    }

    fn publish(self) -> Result<(), IoError> {
        let Unpublished::Temporary(temporary, _listed) = self.file else { return Ok(()) };
        let keep = fs::metadata(&self.target)
            .map_or(Ok(()), |older| temporary.as_file().set_permissions(older.permissions()));
        keep.and_then(|()| temporary.persist(&self.target).map(drop).map_err(|e| e.error))
            .map_err(cannot_write(&self.path))?;
        Ok(())
    }
}

impl Write for Replacement {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A file without a name on the disk of `path`, which vanishes when it is closed or the run stops.
pub(crate) fn spool_for(path: &Path) -> io::Result<File> {
    let target = follow_links(path);
    // No file is created in the folder of a device.
    if target.exists() && !target.is_file() {
        return tempfile::tempfile();
    }
    tempfile::tempfile_in(folder_of(&target))
}

/// A longer chain of links is a circle; systems give up after as many.
const MOST_LINKS: usize = 40;

/// The place that a name leads to: the target of a link, also of one whose target does not exist
/// yet.
fn follow_links(path: &Path) -> PathBuf {
    let mut target = path.to_owned();
    for _ in 0..MOST_LINKS {
        let Ok(next) = fs::read_link(&target) else { break };
        target = folder_of(&target).join(next);
    }
    fs::canonicalize(&target).unwrap_or(target)
}

fn folder_of(target: &Path) -> &Path {
    target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// How the names of temporary files begin.
const PREFIX: &str = ".dermatome-";

/// The system's words about a temporary file, without its name, which users do not know.
fn without_path(error: &io::Error) -> io::Error {
    let text = error.to_string();
    io::Error::new(error.kind(), text.split(" at path ").next().unwrap_or_default())
}
