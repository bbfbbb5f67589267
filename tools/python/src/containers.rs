//! Recordings that Python reads, for the command: a function that opens them, and blocks of their frames.

use std::{
    ffi::OsString,
    io,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
};

use dermatome::{
    io::{Block, IoError, KnownRest, ReadOptions, Readings, ReadingsReader, Statement, StatementSource},
    skin::TaxelId,
};
use dermatome_command::{Containers, DraftContainer, OpenContainer};
use numpy::{PyReadonlyArray1, PyReadonlyArray3};
use pyo3::{exceptions::PyStopIteration, prelude::*};

use crate::{layout::PyLayout, readings::channels_of};

/// Run the command.
///
/// Output goes to the standard streams of the process, and a signal that stops the run ends the process.
///
/// Parameters
/// ----------
/// args : sequence of str
///     The arguments, the first of which is the command's own name.
/// open : callable, optional
///     `open(path, stream, layout, episode)` opens a recording that the library does not read: the number of frames of each
///     episode, and an iterator of blocks; None if it is none. A block is episode, ids, channels, units, times, values,
///     of each channel whether readings are about 0 at rest, threshold, statements, and the kinds of the channels or None.
/// draft : callable, optional
///     `draft(path, stream)` is the text of a layout of such a recording; None if it is none.
///
/// Returns
/// -------
/// int
///     The exit code.
#[pyfunction]
#[pyo3(signature = (args, open=None, draft=None))]
pub(crate) fn run_command(
    py: Python<'_>,
    args: Vec<OsString>,
    open: Option<Py<PyAny>>,
    draft: Option<Py<PyAny>>,
) -> u8 {
    let containers = Containers {
        open: open.map(|open| {
            let opens: Arc<OpenContainer> =
                Arc::new(move |path, options| Python::attach(|py| opened(py, &open, path, options)));
            opens
        }),
        draft: draft.map(|draft| {
            let drafts: Arc<DraftContainer> =
                Arc::new(move |path, stream| Python::attach(|py| drafted(py, &draft, path, stream)));
            drafts
        }),
    };
    let code = py.detach(|| dermatome_command::run_with(args, containers));
    (0..=u8::MAX).find(|&number| ExitCode::from(number) == code).unwrap_or(u8::MAX)
}

/// The recording at a path, if `open` knows it.
fn opened(
    py: Python<'_>,
    open: &Py<PyAny>,
    path: &Path,
    options: &ReadOptions,
) -> Option<Result<ReadingsReader, IoError>> {
    let call = || -> PyResult<Option<(Vec<u64>, Py<PyAny>)>> {
        let layout = options.layout.clone().map(|layout| Py::new(py, PyLayout::of(layout))).transpose()?;
        let found = open.call1(py, (path, options.stream.as_deref(), layout, options.episode))?;
        found.extract(py)
    };
    match call() {
        Ok(found) => found.map(|(lengths, blocks)| {
            ReadingsReader::blocks(path, &lengths, Blocks { path: path.into(), blocks })
        }),
        Err(error) => Some(Err(unreadable(py, path, &error))),
    }
}

/// The draft of a layout of the recording at a path, if `draft` knows it.
fn drafted(
    py: Python<'_>,
    draft: &Py<PyAny>,
    path: &Path,
    stream: Option<&str>,
) -> Option<Result<String, IoError>> {
    let made = draft.call1(py, (path, stream)).and_then(|made| made.extract::<Option<String>>(py));
    made.map_err(|error| unreadable(py, path, &error)).transpose()
}

/// An exception as an error of the library; its message names the path already.
fn unreadable(py: Python<'_>, path: &Path, error: &PyErr) -> IoError {
    let message = error.value(py).to_string();
    let message = message.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&message);
    IoError::Read { path: path.into(), source: io::Error::other(message.to_owned()) }
}

/// An iterator of Python.
struct Blocks {
    path: PathBuf,
    blocks: Py<PyAny>,
}

impl Iterator for Blocks {
    type Item = Result<Block, IoError>;

    fn next(&mut self) -> Option<Self::Item> {
        Python::attach(|py| match self.blocks.call_method0(py, "__next__") {
            Ok(made) => Some(block(made.bind(py)).map_err(|error| unreadable(py, &self.path, &error))),
            Err(error) if error.is_instance_of::<PyStopIteration>(py) => None,
            Err(error) => Some(Err(unreadable(py, &self.path, &error))),
        })
    }
}

/// What is known, its value, and who says so.
type Said = Vec<(String, String, String)>;

fn block(made: &Bound<'_, PyAny>) -> PyResult<Block> {
    let item = |k: usize| made.get_item(k);
    let (names, units): (Vec<String>, Vec<String>) = (item(2)?.extract()?, item(3)?.extract()?);
    let kinds: Option<Vec<String>> = item(9)?.extract()?;
    let ids: PyReadonlyArray1<'_, u32> = item(1)?.extract()?;
    let times: PyReadonlyArray1<'_, f64> = item(4)?.extract()?;
    let values: PyReadonlyArray3<'_, f64> = item(5)?.extract()?;
    let said: Said = item(8)?.extract()?;
    let source = |word: &str| match word {
        "file" => StatementSource::File,
        "argument" => StatementSource::Argument,
        "checked" => StatementSource::Checked,
        _ => StatementSource::Layout,
    };
    let statement = |(what, value, by): (String, String, String)| Statement::new(what, value, source(&by));
    Ok(Block {
        episode: item(0)?.extract()?,
        readings: Readings {
            width: ids.as_array().len(),
            ids: Some(ids.as_array().iter().map(|&id| TaxelId(id)).collect()),
            channels: channels_of(&names, &units, kinds.as_deref())?,
            times: times.as_array().to_vec(),
            values: values.as_slice()?.to_vec(),
            rest: KnownRest { is_zero: item(6)?.extract()?, threshold: item(7)?.extract()? },
        },
        statements: said.into_iter().map(statement).collect(),
    })
}
