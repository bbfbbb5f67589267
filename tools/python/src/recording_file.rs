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
    arguments::{arg, object_or_none},
    arrays::{shaped, vector},
    errors::{bad, error},
    layout::PyLayout,
    options::count,
    readings::{kinds_of, rest_of},
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
/// episode : int, optional
///     The one episode that is read, where the layout has an axis of them.
///
/// Raises
/// ------
/// MissingFileError, FileError
///     If it does not exist, or cannot be read.
/// DataError
///     If it has no such stream or episode, or the layout does not fit.
#[pyclass(frozen, module = "dermatome", name = "RecordingFile")]
pub(crate) struct PyRecordingFile {
    reader: Mutex<ReadingsReader>,
    /// The first frame of the episode that follows: its readings and time.
    ahead: Mutex<Option<(Vec<f64>, f64)>>,
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
    #[pyo3(signature = (path, stream=None, layout=None, episode=None))]
    fn new(
        #[pyo3(from_py_with = arg)] path: PathBuf,
        #[pyo3(from_py_with = arg)] stream: Option<String>,
        #[pyo3(from_py_with = object_or_none)] layout: Option<&Bound<'_, PyLayout>>,
        #[pyo3(from_py_with = arg)] episode: Option<u64>,
    ) -> PyResult<Self> {
        let layout = layout.map(|layout| layout.get().layout.clone());
        let options = ReadOptions { layout, stream: stream.clone(), episode, ..ReadOptions::default() };
        let reader = ReadingsReader::open(&path, options).map_err(error)?;
        Ok(Self { reader: Mutex::new(reader), ahead: Mutex::new(None), path, stream })
    }

    /// Whether the library knows a file by its content or its name.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If it is no path.
    #[staticmethod]
    fn is_known(#[pyo3(from_py_with = arg)] path: PathBuf) -> bool {
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
    ///     The number of the episode of these frames, values (T, C, N) and seconds (T,), float64; None after the last frame.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If a line or frame cannot be read: the message says which.
    #[expect(clippy::type_complexity, reason = "a number and two arrays")]
    fn next<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] frames: i64,
    ) -> PyResult<Option<(u64, Bound<'py, PyArray3<f64>>, Bound<'py, PyArray1<f64>>)>> {
        let frames = count("frames", frames)?;
        if frames == 0 {
            return Err(bad("frames", 0, "1 or more"));
        }
        let (mut values, mut seconds) = (Vec::new(), Vec::new());
        let (mut frame, mut time) = (Vec::new(), f64::NAN);
        let shape = self.with(|reader| [reader.channels.len(), reader.width]);
        let read = py.detach(|| {
            self.with(|reader| {
                let mut ahead = self.ahead.lock().unwrap_or_else(PoisonError::into_inner);
                let mut episode = reader.episode();
                if let Some((first, time)) = ahead.take() {
                    values.extend_from_slice(&first);
                    seconds.push(time);
                }
                while seconds.len() < frames && reader.read(&mut frame, &mut time)? {
                    if reader.episode() != episode && !seconds.is_empty() {
                        *ahead = Some((frame.clone(), time));
                        break;
                    }
                    episode = reader.episode();
                    values.extend_from_slice(&frame);
                    seconds.push(time);
                }
                Ok::<_, dermatome::io::IoError>(episode)
            })
        });
        let episode = read.map_err(error)?;
        if seconds.is_empty() {
            return Ok(None);
        }
        let values = shaped(py, [seconds.len(), shape[0], shape[1]], values)?;
        Ok(Some((episode, values, vector(py, seconds))))
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

    /// int: How many episodes are read, each of as many frames.
    #[getter]
    fn episodes(&self) -> u64 {
        self.with(|reader| reader.episodes())
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

    /// tuple of str or None: What each channel measures, "touch", "tangential" or "other"; None: as names and units tell.
    #[getter]
    fn kinds<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyTuple>>> {
        self.with(|reader| kinds_of(&reader.channels)).map(|kinds| PyTuple::new(py, kinds)).transpose()
    }

    /// tuple of list of bool and float or None: Of each channel whether readings are about 0 where nothing touches, and the threshold
    /// that is stated, in their unit.
    #[getter]
    fn rest(&self) -> (Vec<bool>, Option<f64>) {
        self.with(|reader| (rest_of(&reader.rest, &reader.channels), reader.rest.threshold))
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
