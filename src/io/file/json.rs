use std::{io::Write, path::Path};

use crate::io::{IoError, file::replace::replace_file};

/// Writes `value` as indented JSON with a newline at its end; the file is replaced whole or not at all.
///
/// Numbers are the shortest decimals that read back as the same `f64`. JSON knows no NaN: it becomes `null`.
///
/// # Errors
/// If the file cannot be written, or `value` has a map whose keys are no text.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), IoError> {
    replace_file(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value)
            .map_err(std::io::Error::from)
            .and_then(|()| file.write_all(b"\n"))
            .map_err(|source| IoError::Write { path: path.into(), source })
    })
}
