//! Writing a file whole or not at all.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, Write as _},
    path::{Path, PathBuf},
    process,
    sync::LazyLock,
    time::UNIX_EPOCH,
};

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
    let mut write = Some(write);
    replace(path, &mut |file| write.take().map_or(Ok(()), |write| write(file)))
}

/// Fills a file.
type Write<'a> = &'a mut dyn FnMut(&mut BufWriter<&File>) -> Result<(), IoError>;

/// [`replace_file`], compiled once for all writers.
fn replace(path: &Path, write: Write<'_>) -> Result<(), IoError> {
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
    // Users do not know the name of the temporary file, so only the kind of an error is passed on.
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

fn write_through(file: &File, write: Write<'_>, fail: impl Fn(io::Error) -> IoError) -> Result<(), IoError> {
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

/// Writes `value` as indented JSON with a newline at its end; the file is replaced whole or not at
/// all.
///
/// Numbers are the shortest decimals that read back as the same `f64`. JSON knows no NaN: it
/// becomes `null`.
///
/// # Errors
/// If the file cannot be written, or `value` has a map whose keys are not text.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), IoError> {
    replace_file(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value)
            .map_err(std::io::Error::from)
            .and_then(|()| file.write_all(b"\n"))
            .map_err(|source| IoError::Write { path: path.into(), source })
    })
}
