//! Files that are written whole or not at all, and several files together ([`Outputs`]).

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::mem;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tempfile::NamedTempFile;

use crate::io::IoError;

/// Files that appear together, after the last of them is complete, and never replace an input.
///
/// Each is written under a temporary name next to its own. [`Outputs::publish`] renames them; without it none
/// of them appears, and the temporary files are removed with the last clone. Clones are the same transaction.
///
/// ```
/// use dermatome::{io::{Outputs, write_skin}, mesh::shapes, skin::Skin};
///
/// # let folder = tempfile::tempdir()?;
/// # let folder = folder.path();
/// let skin = Skin::from_mesh("palm", shapes::lattice(5, 4, 0.01));
/// let outputs = Outputs::default();
/// write_skin(outputs.file(folder.join("palm.ply")), &skin)?;
/// write_skin(outputs.file(folder.join("palm.obj")), &skin)?;
/// assert!(!folder.join("palm.ply").exists());
/// outputs.publish()?;
/// assert!(folder.join("palm.ply").exists() && folder.join("palm.obj").exists());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Outputs {
    staged: Arc<Mutex<Staged>>,
    known: Arc<Mutex<Known>>,
}

/// What [`Outputs::publish`] does.
#[derive(Debug, Default)]
struct Staged {
    complete: Vec<Complete>,
    stale: Vec<PathBuf>,
    /// Number of files that were named.
    named: u64,
}

/// What nested transactions share.
#[derive(Debug, Default)]
struct Known {
    /// Where they are, links followed, and as they were named.
    inputs: BTreeMap<PathBuf, PathBuf>,
    temporary: BTreeSet<PathBuf>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Outputs {
    /// A file of this transaction. Files are published in the order of these calls.
    pub fn file(&self, path: impl Into<PathBuf>) -> OutPath {
        let mut staged = lock(&self.staged);
        staged.named += 1;
        OutPath { path: path.into(), outputs: self.clone(), order: staged.named, is_own: false }
    }

    /// A transaction that is published by itself, with the inputs of this one; [`Outputs::discard`] of
    /// either removes the temporary files of both.
    pub fn nested(&self) -> Self {
        Self { staged: Arc::default(), known: Arc::clone(&self.known) }
    }

    /// Refuses from now on to replace this file.
    pub fn add_input(&self, path: &Path) {
        lock(&self.known).inputs.insert(follow_links(path), path.to_owned());
    }

    /// Refuses a file that would replace an input.
    ///
    /// # Errors
    /// [`IoError::ReplacesInput`].
    pub fn check(&self, path: &Path) -> Result<(), IoError> {
        lock(&self.known).check(&follow_links(path))
    }

    /// Removes a file when the others are published; a file that is published under its name stays.
    ///
    /// # Errors
    /// [`IoError::ReplacesInput`].
    pub fn remove(&self, path: &Path) -> Result<(), IoError> {
        self.check(path)?;
        lock(&self.staged).stale.push(path.to_owned());
        Ok(())
    }

    /// Whether a file was begun, complete or not, that is not published yet.
    pub fn has_files(&self) -> bool {
        !lock(&self.known).temporary.is_empty()
    }

    /// Gives all complete files their names; returns their paths.
    ///
    /// # Errors
    /// If a file cannot be renamed, or an older one removed: files before it have their names then, the
    /// others are dropped.
    pub fn publish(&self) -> Result<Vec<PathBuf>, IoError> {
        let (mut files, stale) = {
            let Staged { complete, stale, .. } = &mut *lock(&self.staged);
            complete.sort_by_key(|file| file.order);
            (mem::take(complete).into_iter(), mem::take(stale))
        };
        // Files remove themselves from the list of temporary ones, after this lock of it.
        let (mut done, mut listed) = (Vec::new(), Vec::new());
        // A signal waits until all have their names.
        let known = lock(&self.known);
        files.as_slice().iter().try_for_each(|file| known.check(&file.target))?;
        let mut targets = BTreeSet::new();
        for Complete { path, target, file, .. } in files.by_ref() {
            if let Unpublished::Temporary(temporary, entry) = file {
                listed.push(entry);
                let keep = fs::metadata(&target)
                    .map_or(Ok(()), |older| temporary.as_file().set_permissions(older.permissions()));
                keep.and_then(|()| temporary.persist(&target).map(drop).map_err(|e| e.error))
                    .map_err(cannot_write(&path))?;
            }
            targets.insert(target);
            done.push(path);
        }
        for path in stale.iter().filter(|path| !targets.contains(&follow_links(path))) {
            fs::remove_file(path).map_err(cannot_write(path))?;
        }
        Ok(done)
    }

    /// Removes the temporary files, and calls `then` before another file can be begun or published: a
    /// process that a signal stops exits there.
    pub fn discard(&self, then: impl FnOnce()) {
        let dropped = mem::take(&mut *lock(&self.staged));
        let known = lock(&self.known);
        for file in &known.temporary {
            // A file that is gone is what is wanted.
            let _ = fs::remove_file(file);
        }
        then();
        drop(known);
        drop(dropped);
    }
}

impl Known {
    fn check(&self, target: &Path) -> Result<(), IoError> {
        match self.inputs.get(target) {
            Some(path) => Err(IoError::ReplacesInput { path: path.clone() }),
            None => Ok(()),
        }
    }
}

/// Where a file is written: a path alone, where it appears when it is complete, or one of [`Outputs`].
#[derive(Debug, Clone)]
pub struct OutPath {
    path: PathBuf,
    outputs: Outputs,
    order: u64,
    /// Whether the transaction is that of this path alone.
    is_own: bool,
}

impl<P: AsRef<Path> + ?Sized> From<&P> for OutPath {
    fn from(path: &P) -> Self {
        Self { path: path.as_ref().to_owned(), outputs: Outputs::default(), order: 0, is_own: true }
    }
}

impl From<&OutPath> for OutPath {
    fn from(path: &OutPath) -> Self {
        path.clone()
    }
}

impl Deref for OutPath {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
}

impl AsRef<OsStr> for OutPath {
    fn as_ref(&self) -> &OsStr {
        self.path.as_os_str()
    }
}

impl OutPath {
    /// Another file of the same transaction.
    pub(crate) fn beside(&self, path: PathBuf) -> Self {
        Self { path, ..self.clone() }
    }

    /// Lets `write` complete several files, which appear together.
    pub(crate) fn together(
        &self,
        write: impl FnOnce(&OutPath) -> Result<(), IoError>,
    ) -> Result<(), IoError> {
        write(&Self { is_own: false, ..self.clone() })?;
        if self.is_own { self.outputs.publish().map(drop) } else { Ok(()) }
    }
}

/// Writes a file whole or not at all: into a temporary file next to it, then renamed.
///
/// An older file stays as it was until the new one is complete. A link is followed; a device or a
/// pipe is written to as it is, since it cannot be replaced.
///
/// # Errors
/// Errors of `write`, and of the folder or the disk.
pub fn replace_file(
    path: impl Into<OutPath>,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), IoError>,
) -> Result<(), IoError> {
    let path = &path.into();
    let replacement = Replacement::open(path)?;
    let mut buffered = BufWriter::with_capacity(1 << 18, replacement.file());
    write(&mut buffered)?;
    buffered.flush().map_err(cannot_write(path))?;
    drop(buffered);
    replacement.finish()
}

/// [`replace_file`] where nothing but the disk can fail.
pub(crate) fn write_file(
    path: &OutPath,
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

/// A file that is being written, and appears under its name when it is finished and published.
pub(crate) struct Replacement {
    to: OutPath,
    target: PathBuf,
    file: Unpublished,
}

/// A file that is written.
#[derive(Debug)]
struct Complete {
    path: PathBuf,
    target: PathBuf,
    file: Unpublished,
    order: u64,
}

#[derive(Debug)]
enum Unpublished {
    /// In the same folder, under another name.
    Temporary(NamedTempFile, Listed),
    /// A device or a pipe, which cannot be replaced.
    Device(File),
}

/// A temporary file in the list of those to remove when the process is stopped.
#[derive(Debug)]
struct Listed {
    path: PathBuf,
    known: Arc<Mutex<Known>>,
}

impl Drop for Listed {
    fn drop(&mut self) {
        lock(&self.known).temporary.remove(&self.path);
    }
}

impl Replacement {
    /// Creates the temporary file, or opens the device that is there.
    pub(crate) fn open(to: &OutPath) -> Result<Self, IoError> {
        let target = follow_links(to);
        let fail = cannot_write(to);
        if target.is_dir() {
            return Err(fail(io::ErrorKind::IsADirectory.into()));
        }
        // A name may be too long for the system, but not that of the temporary file.
        if let Err(error) = fs::symlink_metadata(&target)
            && error.kind() != io::ErrorKind::NotFound
        {
            return Err(fail(error));
        }
        let file = if target.exists() && !target.is_file() {
            Unpublished::Device(OpenOptions::new().write(true).open(&target).map_err(fail)?)
        } else {
            // As readable as any file the user makes: the system subtracts the umask.
            let new = |path: &Path| OpenOptions::new().read(true).write(true).create_new(true).open(path);
            let mut known = lock(&to.outputs.known);
            known.check(&target)?;
            let file = tempfile::Builder::new().prefix(PREFIX).make_in(folder_of(&target), new);
            let file = file.map_err(|e| fail(without_path(&e)))?;
            known.temporary.insert(file.path().to_owned());
            let listed = Listed { path: file.path().to_owned(), known: Arc::clone(&to.outputs.known) };
            Unpublished::Temporary(file, listed)
        };
        Ok(Self { to: to.clone(), target, file })
    }

    pub(crate) fn file(&self) -> &File {
        match &self.file {
            Unpublished::Temporary(file, _) => file.as_file(),
            Unpublished::Device(file) => file,
        }
    }

    /// Completes the file: it appears now, or when its transaction is published.
    pub(crate) fn finish(self) -> Result<(), IoError> {
        let Self { to: OutPath { path, outputs, order, is_own }, target, file } = self;
        lock(&outputs.staged).complete.push(Complete { path, target, file, order });
        if is_own { outputs.publish().map(drop) } else { Ok(()) }
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

/// Where a path leads: the target of a link, also of one whose target does not exist yet.
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

/// The message of the system about a temporary file, without its name, which users have not chosen.
fn without_path(error: &io::Error) -> io::Error {
    let text = error.to_string();
    io::Error::new(error.kind(), text.split(" at path ").next().unwrap_or_default())
}
