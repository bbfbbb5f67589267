//! Files that a command writes together: all of them or none.

use std::{
    fs::{self, File},
    io::{self, ErrorKind},
    path::{Path, PathBuf},
};

use dermatome::{
    Error,
    io::{IoError, replace_file, temporary_prefix, triangles_path},
};
use tempfile::TempDir;

use crate::{
    console::{
        errors::advise,
        print::{line, say},
    },
    files::signals::clean_when_stopped,
    options::Common,
};

/// Standard input or output, where a command takes that in place of a file.
pub(crate) fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Refuses, before any work, outputs that cannot be written or would overwrite each other.
pub(crate) fn check<'a>(paths: impl IntoIterator<Item = &'a Path>) -> anyhow::Result<()> {
    let mut places: Vec<PathBuf> = Vec::new();
    for path in paths {
        let fail = |source| Error::from(IoError::Write { path: path.to_owned(), source });
        if path.is_dir() && !is_stream(path) {
            return Err(fail(ErrorKind::IsADirectory.into()).into());
        }
        if !folder(path).is_dir() {
            let why = format!("there is no folder {}", folder(path).display());
            return Err(fail(io::Error::new(ErrorKind::NotFound, why)).into());
        }
        let place = place(path);
        if places.contains(&place) {
            return Err(advise(
                format!("two outputs would be written to {}", name(path).display()),
                "give every output a name of its own",
            ));
        }
        if !is_stream(path) {
            // The temporary file is in the folder of the path, or of the link's target.
            clean_when_stopped(folder(path));
            clean_when_stopped(folder(&place));
        }
        places.push(place);
    }
    Ok(())
}

/// Refuses outputs that would take the place of an input.
pub(crate) fn check_inputs<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    let inputs: Vec<PathBuf> = inputs.into_iter().filter(|input| !is_stream(input)).flat_map(files).collect();
    let mut outputs = outputs.into_iter().filter(|out| !is_stream(out)).flat_map(files);
    match outputs.find_map(|out| inputs.iter().find(|input| is_same(input, &out))) {
        None => Ok(()),
        Some(input) => Err(advise(
            format!("the result would replace an input, {}", input.display()),
            "write to another file",
        )),
    }
}

/// The files that belong to a name: a table of taxels has one of triangles.
fn files(path: &Path) -> impl Iterator<Item = PathBuf> {
    let triangles = (kind(path) == "csv").then(|| triangles_path(path));
    [path.to_owned()].into_iter().chain(triangles)
}

pub(crate) fn is_same(a: &Path, b: &Path) -> bool {
    place(a) == place(b)
}

/// The kind of a file: its extension in lower case, empty without one.
pub(crate) fn kind(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// A table is written to a .csv: under any other name it would be read as something else.
pub(crate) fn check_table(path: &Path) -> anyhow::Result<()> {
    if kind(path) == "csv" {
        return Ok(());
    }
    Err(Error::from(IoError::UnknownKind { path: path.to_owned(), known: ".csv" }).into())
}

fn name(path: &Path) -> &Path {
    if is_stream(path) { Path::new("standard output") } else { path }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The place that a name leads to, links followed as far as they lead.
fn place(path: &Path) -> PathBuf {
    if is_stream(path) {
        return path.to_owned();
    }
    fs::canonicalize(path).unwrap_or_else(|_| match (fs::canonicalize(folder(path)), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    })
}

/// Prints what was written where, on standard error.
pub(crate) fn wrote<'a>(paths: impl IntoIterator<Item = &'a Path>, common: &Common) {
    let files = paths.into_iter().filter(|path| !is_stream(path));
    let names: Vec<String> = files.map(|path| path.display().to_string()).collect();
    if !names.is_empty() && !common.quiet {
        say(line(&format!("wrote {}", names.join(", "))));
    }
}

/// Complete files on their way to the places they are meant for.
#[derive(Default)]
pub(crate) struct Outputs {
    staged: Vec<Staged>,
    /// Hidden folders with the staged files; they vanish with this.
    folders: Vec<TempDir>,
    /// Tables of triangles of the tables that are replaced.
    stale: Vec<PathBuf>,
}

/// A file that is complete but not in its place.
struct Staged {
    file: PathBuf,
    path: PathBuf,
}

impl Outputs {
    /// Writes a file that does not appear in its place before [`Self::publish`].
    pub(crate) fn stage(
        &mut self,
        path: &Path,
        write: impl FnOnce(&Path) -> Result<(), IoError>,
    ) -> Result<(), Error> {
        // Writers choose by extension, so the name stays.
        let name = path.file_name().unwrap_or_default();
        self.stage_in(folder(path), &[name], |folder| Ok(write(&folder.join(name))?)).map_err(
            |e| match e {
                Error::Io(e) => about(e, |_| path.to_owned()).into(),
                other => other,
            },
        )?;
        // As the user wrote it, without the folder `.` in front.
        self.staged.iter_mut().next_back().into_iter().for_each(|staged| path.clone_into(&mut staged.path));
        Ok(())
    }

    /// Writes a file of these bytes that does not appear in its place before [`Self::publish`].
    pub(crate) fn stage_bytes(&mut self, path: &Path, bytes: &[u8]) -> Result<(), Error> {
        let write = |staged: &Path| {
            fs::write(staged, bytes).map_err(|source| IoError::Write { path: staged.to_owned(), source })
        };
        self.stage(path, write)
    }

    /// Lets `write` write files of these names, which do not appear in `folder` before
    /// [`Self::publish`].
    pub(crate) fn stage_in<T>(
        &mut self,
        folder: &Path,
        names: &[impl AsRef<Path>],
        write: impl FnOnce(&Path) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let staging = tempfile::Builder::new()
            .prefix(temporary_prefix())
            .tempdir_in(folder)
            .map_err(|e| cannot_write(folder, without_path(&e)))?;
        let written = write(staging.path()).map_err(|e| match e {
            Error::Io(e) => about(e, |file| folder.join(file.file_name().unwrap_or_default())).into(),
            other => other,
        })?;
        for name in names {
            self.staged.push(Staged { file: staging.path().join(name), path: folder.join(name) });
        }
        self.folders.push(staging);
        Ok(written)
    }

    /// Removes, when all is published, the triangles of an older table at `path`: readers would join
    /// them to the new taxels. Triangles that are staged stay. Returns the name of those removed.
    pub(crate) fn drop_triangles(&mut self, path: &Path) -> Option<&Path> {
        let triangles = triangles_path(path);
        if !triangles.is_file() || self.staged.iter().any(|staged| is_same(&staged.path, &triangles)) {
            return None;
        }
        self.stale.push(triangles);
        self.stale.last().map(PathBuf::as_path)
    }

    /// Puts all files in their places, and prints which.
    pub(crate) fn publish(self, common: &Common) -> Result<(), Error> {
        for Staged { file, path } in &self.staged {
            let fail = |source| IoError::Write { path: path.clone(), source };
            match fs::symlink_metadata(path) {
                // A link is followed; a device or a pipe cannot be replaced.
                Ok(older) if !older.is_file() => {
                    let mut whole = File::open(file).map_err(fail)?;
                    replace_file(path, |out| io::copy(&mut whole, out).map(drop).map_err(fail))?;
                }
                older => {
                    let keep = older.map_or(Ok(()), |older| fs::set_permissions(file, older.permissions()));
                    keep.and_then(|()| fs::rename(file, path)).map_err(fail)?;
                }
            }
        }
        for path in &self.stale {
            fs::remove_file(path).map_err(|e| cannot_write(path, e))?;
        }
        wrote(self.staged.iter().map(|staged| staged.path.as_path()), common);
        Ok(())
    }
}

/// The same error about another file, named from its own: outputs are written to a temporary file
/// first.
fn about(mut error: IoError, name: impl FnOnce(&Path) -> PathBuf) -> IoError {
    if let IoError::Read { path, .. }
    | IoError::Write { path, .. }
    | IoError::Invalid { path, .. }
    | IoError::Unsupported { path, .. }
    | IoError::UnknownKind { path, .. }
    | IoError::NoMap { path }
    | IoError::Map { path, .. }
    | IoError::Unfit { path, .. } = &mut error
    {
        *path = name(path);
    }
    error
}

/// The system's words about a temporary file, without its name, which users do not know.
pub(crate) fn without_path(error: &io::Error) -> io::Error {
    let text = error.to_string();
    let words = text.split(" at path ").next().unwrap_or_default();
    io::Error::new(error.kind(), words)
}

/// An error about a place.
pub(crate) fn cannot_write(path: &Path, source: io::Error) -> Error {
    IoError::Write { path: path.to_owned(), source }.into()
}
