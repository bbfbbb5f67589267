//! Files that a command writes: never over an input, never two to one place, all of them or none.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use clap::ArgMatches;
use dermatome::Error;
use dermatome::io::{IoError, OutPath, Outputs, replace_file, triangles_path};

use crate::console::errors::advise;
use crate::console::notes::note_dropped;
use crate::console::print::{line, say};
use crate::files::paths::GivenPaths;
use crate::options::Common;

/// Standard input or output, where a command takes that in place of a file.
pub(crate) fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Whether an input can be read once only: standard input, or a pipe with a name.
pub(crate) fn is_read_once(path: &Path) -> bool {
    is_stream(path) || path.metadata().is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// Refuses, before any work, outputs that cannot be written, or that would replace an input or each
/// other; adds the inputs to `files`.
pub(crate) fn check_command_line(given: &ArgMatches, files: &Outputs) -> anyhow::Result<()> {
    let GivenPaths { inputs, files: mut outputs, folders } = GivenPaths::of(given);
    outputs.iter().try_for_each(|path| check_file(path))?;
    outputs.extend(folders);
    let prints = given.try_get_one::<bool>("json").ok().flatten() == Some(&true);
    outputs.extend(prints.then(|| "-".into()));
    let places: Vec<PathBuf> = outputs.iter().map(|path| place(path)).collect();
    let twice = (1..places.len()).find(|&k| places[..k].contains(&places[k]));
    if let Some(path) = twice.map(|k| &outputs[k]) {
        let name = if is_stream(path) { Path::new("standard output") } else { path };
        return Err(advise(
            format!("two outputs would be written to {}", name.display()),
            "give every output a name of its own",
        ));
    }
    add_inputs(&inputs, files);
    // A folder is not replaced; its files are checked by who writes them.
    outputs.retain(|path| !path.is_dir());
    Ok(guard(&outputs, files)?)
}

/// Refuses a place where no file can be written.
pub(crate) fn check_file(path: &Path) -> Result<(), Error> {
    if is_stream(path) {
        Ok(())
    } else if path.is_dir() {
        Err(cannot_write(path, ErrorKind::IsADirectory.into()))
    } else if !folder(path).is_dir() {
        let why = format!("there is no folder {}", folder(path).display());
        Err(cannot_write(path, io::Error::new(ErrorKind::NotFound, why)))
    } else {
        Ok(())
    }
}

/// Refuses a file where a folder is to be made.
pub(crate) fn check_folder(path: &Path) -> Result<(), Error> {
    if path.exists() && !path.is_dir() {
        return Err(cannot_write(path, ErrorKind::NotADirectory.into()));
    }
    Ok(())
}

pub(crate) fn make_folder(path: &Path) -> Result<(), Error> {
    check_folder(path)?;
    fs::create_dir_all(path).map_err(|source| cannot_write(path, source))
}

/// From now on these files are not replaced.
pub(crate) fn add_inputs(inputs: &[PathBuf], outputs: &Outputs) {
    inputs.iter().filter(|path| !is_stream(path)).flat_map(files).for_each(|path| outputs.add_input(&path));
}

/// Refuses files that would take the place of an input.
pub(crate) fn guard(files_to_write: &[PathBuf], outputs: &Outputs) -> Result<(), Error> {
    let mut files = files_to_write.iter().filter(|path| !is_stream(path)).flat_map(files);
    Ok(files.try_for_each(|path| outputs.check(&path))?)
}

/// The files that belong to a name: a table of taxels has one of triangles.
fn files(path: impl AsRef<Path>) -> impl Iterator<Item = PathBuf> {
    let path = path.as_ref();
    let triangles = (kind(path) == "csv").then(|| triangles_path(path));
    [path.to_owned()].into_iter().chain(triangles)
}

pub(crate) fn is_same(a: &Path, b: &Path) -> bool {
    place(a) == place(b)
}

pub(crate) use dermatome::io::file_kind as kind;

/// A table is written to a .csv: under any other name it would be read as something else.
pub(crate) fn check_table(path: &Path) -> anyhow::Result<()> {
    if kind(path) == "csv" || is_device(path) {
        return Ok(());
    }
    Err(Error::from(IoError::UnknownKind { path: path.to_owned(), known: ".csv" }).into())
}

/// Whether a path names a device or a pipe, such as `/dev/null`.
fn is_device(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir())
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
pub(crate) fn wrote(files: &[PathBuf], common: &Common) {
    let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    if !names.is_empty() && !common.quiet {
        say(line(&format!("wrote {}", names.join(", "))));
    }
}

/// Removes, when all is published, the triangles of an older table at `path`: readers would join
/// them to the new taxels. Triangles that are written too stay.
pub(crate) fn drop_triangles(path: &Path, common: &Common) -> Result<(), Error> {
    let triangles = triangles_path(path);
    if triangles.is_file() {
        common.outputs.remove(&triangles)?;
        note_dropped(&triangles, common);
    }
    Ok(())
}

/// Puts all files in their places, and prints which.
pub(crate) fn publish(common: &Common) -> Result<(), Error> {
    wrote(&common.outputs.publish()?, common);
    Ok(())
}

/// Writes a file whole or not at all.
pub(crate) fn write_bytes(path: &OutPath, bytes: &[u8]) -> Result<(), IoError> {
    let fail = |source| IoError::Write { path: path.to_path_buf(), source };
    replace_file(path, |file| io::Write::write_all(file, bytes).map_err(fail))
}

pub(crate) fn cannot_write(path: &Path, source: io::Error) -> Error {
    IoError::Write { path: path.to_owned(), source }.into()
}
