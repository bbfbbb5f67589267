//! Errors of the library, and of arguments, as exceptions of `dermatome._errors`.

use std::{ffi::CString, fmt::Display};

use dermatome::{Error, io::IoError};
use pyo3::{prelude::*, types::PyDict};

/// The module of the exceptions.
pub(crate) const EXCEPTIONS: &str = "dermatome._errors";

/// An error of the library as an exception.
pub(crate) fn error(error: impl Into<Error>) -> PyErr {
    let error = error.into();
    let class = match &error {
        Error::Io(IoError::Read { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
            "MissingFileError"
        }
        Error::Io(IoError::Read { .. } | IoError::Write { .. }) => "FileError",
        _ => "DataError",
    };
    exception(class, &error.to_string(), error.kind())
}

/// An argument that cannot be used.
pub(crate) fn bad(argument: &str, found: impl Display, needed: impl Display) -> PyErr {
    exception("DataError", &format!("{argument}: found {found}; needed: {needed}"), "argument")
}

/// Says something that a program should hear, as a `DermatomeWarning`; an error if warnings are errors.
pub(crate) fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    let class = py.import(EXCEPTIONS)?.getattr("DermatomeWarning")?;
    let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
    PyErr::warn(py, &class, &text, 1)
}

fn exception(class: &str, message: &str, kind: &str) -> PyErr {
    Python::attach(|py| {
        let make = || {
            let kinds = PyDict::new(py);
            kinds.set_item("kind", kind)?;
            py.import(EXCEPTIONS)?.getattr(class)?.call((message,), Some(&kinds))
        };
        make().map_or_else(|failed| failed, PyErr::from_value)
    })
}
