use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    process,
    sync::LazyLock,
    time::UNIX_EPOCH,
};

use crate::io::IoError;

/// Writes a file whole or not at all: into a temporary file beside it, then renamed.
///
/// An older file stays as it was until the new one is complete. A link is followed; a device or a pipe is written to as it
/// is, since it cannot be replaced.
///
/// # Errors
/// Whatever `write` returns, and what the system says about the folder or the disk.
pub fn replace_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), IoError>,
) -> Result<(), IoError> {
    let fail = |source: io::Error| IoError::Write { path: PathBuf::from(path), source };
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if target.is_dir() {
        return Err(fail(io::Error::from(io::ErrorKind::IsADirectory)));
    }
    if target.exists() && !target.is_file() {
        let device = OpenOptions::new().write(true).open(&target).map_err(fail)?;
        return write_through(&device, write, fail);
    }
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    // The name of the temporary file would tell a user nothing, so only the kind of an error is passed on.
    let temporary = tempfile::Builder::new()
        .prefix(temporary_prefix())
        .tempfile_in(folder)
        .map_err(|e| fail(e.kind().into()))?;
    write_through(temporary.as_file(), write, fail)?;
    match fs::metadata(&target) {
        Ok(older) => temporary.as_file().set_permissions(older.permissions()),
        Err(_) => share_like_a_new_file(temporary.as_file()),
    }
    .map_err(fail)?;
    temporary.persist(&target).map_err(|e| fail(e.error))?;
    Ok(())
}

/// What the names of this run's temporary files begin with: whoever stops a run can tell its files from those of others.
#[must_use]
pub fn temporary_prefix() -> &'static str {
    static PREFIX: LazyLock<String> = LazyLock::new(|| {
        // Numbers of processes come again; in containers that share a folder even at the same time.
        let start = UNIX_EPOCH.elapsed().map_or(0, |since| since.as_nanos());
        format!(".dermatome-{}-{start:x}-", process::id())
    });
    &PREFIX
}

fn write_through(
    file: &File,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), IoError>,
    fail: impl Fn(io::Error) -> IoError,
) -> Result<(), IoError> {
    let mut buffered = BufWriter::with_capacity(1 << 18, file);
    write(&mut buffered)?;
    buffered.flush().map_err(fail)
}

/// Temporary files are private; an output is as readable as any file the user makes.
#[cfg(unix)]
fn share_like_a_new_file(file: &File) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn share_like_a_new_file(_: &File) -> io::Result<()> {
    Ok(())
}
