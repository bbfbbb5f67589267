//! Writing a file whole or not at all.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, Write as _},
    path::{Path, PathBuf},
    process,
    sync::LazyLock,
    time::UNIX_EPOCH,
};

use tempfile::NamedTempFile;

use crate::io::IoError;

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
    replacement.publish()
}

/// [`replace_file`] where nothing but the disk can fail.
pub(crate) fn write_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), IoError> {
    replace_file(path, |file| write(file).map_err(cannot_write(path)))
}

pub(crate) fn cannot_write(path: &Path) -> impl Fn(io::Error) -> IoError + '_ {
    |source| IoError::Write { path: path.into(), source }
}

/// A file on its way to its place, where it appears when it is published and not before.
pub(crate) struct Replacement {
    path: PathBuf,
    target: PathBuf,
    file: Unpublished,
}

enum Unpublished {
    /// Next to its place, under another name.
    Temporary(NamedTempFile),
    /// A device or a pipe, which cannot be replaced.
    Device(File),
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
            let temporary =
                tempfile::Builder::new().prefix(temporary_prefix()).make_in(folder_of(&target), new);
            Unpublished::Temporary(temporary.map_err(fail)?)
        };
        Ok(Self { path: path.into(), target, file })
    }

    pub(crate) fn file(&self) -> &File {
        match &self.file {
            Unpublished::Temporary(file) => file.as_file(),
            Unpublished::Device(file) => file,
        }
    }

    /// Puts the file in its place.
    pub(crate) fn publish(self) -> Result<(), IoError> {
        let Unpublished::Temporary(temporary) = self.file else { return Ok(()) };
        let keep = fs::metadata(&self.target)
            .map_or(Ok(()), |older| temporary.as_file().set_permissions(older.permissions()));
        keep.and_then(|()| temporary.persist(&self.target).map(drop).map_err(|e| e.error))
            .map_err(cannot_write(&self.path))?;
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

/// Prefix of the names of this run's temporary files, so that cleaning up removes only these.
#[must_use]
pub fn temporary_prefix() -> &'static str {
    static PREFIX: LazyLock<String> = LazyLock::new(|| {
        // Process ids are reused, and containers that share a folder may have the same one.
        let start = UNIX_EPOCH.elapsed().map_or(0, |since| since.as_nanos());
        format!(".dermatome-{}-{start:x}-", process::id())
    });
    &PREFIX
}
