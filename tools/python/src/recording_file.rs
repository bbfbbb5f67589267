//! `RecordingFile`: a recording that the library reads itself, some frames at a time.

use std::{
    path::PathBuf,
    sync::{Mutex, PoisonError},
};

use dermatome::io::{ReadOptions, ReadingsReader, Statement};
use numpy::{PyArray1, PyArray3};
use pyo3::{
    prelude::*,
    types::{PyDict, PyTuple},
};

use crate::{
    arrays::{shaped, vector},
    errors::{bad, error},
    layout::PyLayout,
    options::count,
};

/// A recording of text or numpy that is read some frames at a time.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
///     The file: text, .npy, .npz, or one of Tekscan, XSENSOR, novel, Stappone, XELA or YARP.
/// stream : str, optional
///     One of several arrays or sensors.
/// layout : Layout, optional
///     What the numbers mean, where the file does not state it.
#[pyclass(frozen, module = "dermatome", name = "RecordingFile")]
pub(crate) struct PyRecordingFile {
    reader: Mutex<ReadingsReader>,
    path: PathBuf,
    stream: Option<String>,
}

impl PyRecordingFile {
    fn with<T>(&self, read: impl FnOnce(&mut ReadingsReader) -> T) -> T {
        read(&mut self.reader.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[pymethods]
impl PyRecordingFile {
    #[new]
    #[pyo3(signature = (path, stream=None, layout=None))]
    fn new(path: PathBuf, stream: Option<String>, layout: Option<&Bound<'_, PyLayout>>) -> PyResult<Self> {
        let layout = layout.map(|layout| layout.get().layout.clone());
        let options = ReadOptions { layout, stream: stream.clone(), ..ReadOptions::default() };
        let reader = ReadingsReader::open(&path, options).map_err(error)?;
        Ok(Self { reader: Mutex::new(reader), path, stream })
    }

    /// Whether the library knows a file by its content or its name.
    #[staticmethod]
    fn is_known(path: PathBuf) -> bool {
        ReadingsReader::is_known(&path)
    }

    /// Read the next frames.
    ///
    /// Parameters
    /// ----------
    /// frames : int
    ///     How many at most.
    ///
    /// Returns
    /// -------
    /// tuple or None
    ///     Values (T, C, N) and seconds (T,), float64; None after the last frame.
    #[expect(clippy::type_complexity, reason = "two arrays")]
    fn next<'py>(
        &self,
        py: Python<'py>,
        frames: i64,
    ) -> PyResult<Option<(Bound<'py, PyArray3<f64>>, Bound<'py, PyArray1<f64>>)>> {
        let frames = count("frames", frames)?;
        if frames == 0 {
            return Err(bad("frames", 0, "1 or more"));
        }
        let (mut values, mut seconds) = (Vec::new(), Vec::new());
        let (mut frame, mut time) = (Vec::new(), f64::NAN);
        let shape = self.with(|reader| [reader.channels.len(), reader.width]);
        let read = py.detach(|| {
            self.with(|reader| {
                while seconds.len() < frames && reader.read(&mut frame, &mut time)? {
                    values.extend_from_slice(&frame);
                    seconds.push(time);
                }
                Ok::<_, dermatome::io::IoError>(())
            })
        });
        read.map_err(error)?;
        if seconds.is_empty() {
            return Ok(None);
        }
        let values = shaped(py, [seconds.len(), shape[0], shape[1]], values)?;
        Ok(Some((values, vector(py, seconds))))
    }

    /// The text of a layout of what the file states, with null where it states nothing.
    fn draft(&self) -> PyResult<String> {
        ReadingsReader::draft_layout(&self.path, self.stream.as_deref()).map_err(error)
    }

    /// (N,) uint32 array or None: Ids of the taxels; None: they are in the order of the map.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<u32>>> {
        let ids = self.with(|reader| reader.ids.clone());
        ids.map(|ids| vector(py, ids.into_iter().map(|id| id.0)))
    }

    /// tuple of str: The names of the channels.
    #[getter]
    fn channels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.with(|r| r.channels.iter().map(|c| c.name.clone()).collect::<Vec<_>>()))
    }

    /// tuple of str: Their units.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.with(|r| r.channels.iter().map(|c| c.unit.clone()).collect::<Vec<_>>()))
    }

    /// int or None: How many frames there are, if that is known.
    #[getter]
    fn frames(&self) -> Option<u64> {
        self.with(|reader| reader.frames)
    }

    /// dict of str to tuple of int: The stream that is read, and its shape, the number of frames first if it is known.
    #[getter]
    fn streams<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (name, shape) = self.with(|reader| {
            let (name, cells) = match reader.facts() {
                Some(facts) => (facts.stream.clone(), facts.cells.clone()),
                None => (String::new(), vec![reader.channels.len(), reader.width]),
            };
            (name, reader.frames.into_iter().chain(cells.into_iter().map(|n| n as u64)).collect::<Vec<u64>>())
        });
        let streams = PyDict::new(py);
        streams.set_item(name, PyTuple::new(py, shape)?)?;
        Ok(streams)
    }

    /// tuple of bool and float or None: Whether readings are about 0 where nothing touches, and the threshold that is stated.
    #[getter]
    fn rest(&self) -> (bool, Option<f64>) {
        self.with(|reader| (reader.rest.is_zero, reader.rest.threshold))
    }

    /// dict: What the file states of the stream: unit, rate in Hz, sensor, pitch and what else it has.
    #[getter]
    fn says<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let facts = self.with(|reader| reader.facts().cloned());
        let says = PyDict::new(py);
        for facts in facts.iter() {
            if let Some(unit) = facts.units.first() {
                says.set_item("unit", unit)?;
            }
            if let Some(rate) = facts.rate_hz {
                says.set_item("rate", rate)?;
            }
            for note in &facts.notes {
                says.set_item(&note.what, &note.value)?;
            }
        }
        Ok(says)
    }

    /// list of tuple of str: What is known about the readings: what, its value, and who states it (file, layout, argument
    /// or checked). Reading adds to it.
    #[getter]
    fn statements(&self) -> Vec<(String, String, &'static str)> {
        let all = self.with(|reader| reader.statements());
        all.into_iter().map(|Statement { what, value, source }| (what, value, source.into())).collect()
    }

    fn __repr__(&self) -> String {
        format!("<dermatome.RecordingFile: {}>", self.path.display())
    }
}
