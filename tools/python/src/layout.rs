//! `Layout` and `Decoder`: what the numbers of a recording mean, and what turns them into readings.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use dermatome::{
    io::{Decoder, IoError, Layout, Statement, StatementSource, StreamFacts, TimeUnit, Times},
    skin::TaxelId,
};
use numpy::{PyArray1, PyUntypedArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyDict, PyString, PyTuple},
};

use crate::{
    arguments::{arg, object_or_none, part},
    arrays::{
        Reals, Reduced, any_array, bad_shape, floats, integers, one_number_each, reals, shaped, vector,
    },
    errors::{bad, error},
    readings::kinds_of,
};

/// What the numbers of a recording mean, where its file does not state it: axes, time, channels with unit and sign, zero,
/// and which cell is which taxel. docs/files.md describes the keys.
///
/// Examples
/// --------
/// >>> import dermatome, numpy as np
/// >>> layout = dermatome.Layout.parse('''{"dermatome_layout": 1, "axes": ["frame", "row", "col"], "time": {"rate": 10},
/// ...     "channels": [{"name": "pressure", "unit": "count"}], "press": "lowers", "zero": 100,
/// ...     "taxels": {"shape": [1, 3], "first_id": 7}}''')
/// >>> decoder = layout.decoder("pad.npy", (1, 3))
/// >>> values, seconds = decoder.decode(np.array([[[90, 100, 100]], [[99, 100, 40]]], np.int16))
/// >>> (values[:, 0] + 0.0).tolist(), decoder.ids.tolist()
/// ([[10.0, 0.0, 0.0], [1.0, 0.0, 60.0]], [7, 8, 9])
#[pyclass(frozen, module = "dermatome", name = "Layout")]
#[derive(Debug)]
pub(crate) struct PyLayout {
    pub(crate) layout: Layout,
    /// What errors call it, in the folder of the table that it may name.
    path: PathBuf,
}

impl PyLayout {
    /// A layout that the command has read.
    pub(crate) fn of(layout: Layout) -> Self {
        let path = layout.name().into();
        Self { layout, path }
    }

    fn new(path: PathBuf, read: impl FnOnce(&Path) -> Result<Layout, IoError>) -> PyResult<Self> {
        Ok(Self { layout: read(&path).map_err(error)?, path })
    }
}

#[pymethods]
impl PyLayout {
    /// Read a layout, a JSON file; a table that it names is in the same folder.
    ///
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// DataError
    ///     If it is no layout: the message says which key.
    #[staticmethod]
    fn read(#[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<Self> {
        Self::new(path, Layout::read)
    }

    /// Read a layout of a text, which errors call `name`.
    ///
    /// Parameters
    /// ----------
    /// text : str
    ///     The JSON.
    /// name : str
    ///     What errors call it.
    /// folder : str or os.PathLike, optional
    ///     The folder of the table that it may name.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If it is no layout: the message says which key.
    #[staticmethod]
    #[pyo3(signature = (text, name="layout", folder=None))]
    fn parse(
        #[pyo3(from_py_with = arg)] text: &str,
        #[pyo3(from_py_with = arg)] name: &str,
        #[pyo3(from_py_with = arg)] folder: Option<PathBuf>,
    ) -> PyResult<Self> {
        let path = folder.map_or_else(|| PathBuf::from(name), |folder| folder.join(name));
        Self::new(path, |path| Layout::parse(path, text))
    }

    /// The text of a layout of what a file states, with null where it states nothing; `read` refuses null.
    ///
    /// Parameters
    /// ----------
    /// file : Recording, RecordingFile, str or os.PathLike
    ///     A recording; or with `cells` the name of any file.
    /// cells : sequence of int, optional
    ///     The shape of one frame.
    /// stream : str
    ///     The name of the stream; with `cells`.
    /// says : dict, optional
    ///     What the file states, as `decoder` takes it; with `cells`.
    ///
    /// Returns
    /// -------
    /// str
    ///     The JSON; that of a `Recording` has a method `write(path)`.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the recording has no stream to draft a layout of.
    #[staticmethod]
    #[pyo3(signature = (file, cells=None, *, stream="", says=None))]
    fn draft<'py>(
        file: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = arg)] cells: Option<Vec<usize>>,
        #[pyo3(from_py_with = arg)] stream: &str,
        #[pyo3(from_py_with = object_or_none)] says: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let Some(cells) = cells else {
            if file.hasattr("draft")? {
                return file.call_method0("draft");
            }
            let needed = "the shape of one frame, or a recording of Readings.open";
            return Err(bad("cells", format!("none for {file}"), needed));
        };
        let path: PathBuf = part("file", file)?;
        let text = Layout::draft(&path, &facts(cells, stream, says)?);
        Ok(PyString::new(file.py(), &text).into_any())
    }

    /// The text of a layout of columns whose names differ by a number; None if there are none.
    ///
    /// Parameters
    /// ----------
    /// file : str or os.PathLike
    ///     The file, for its name.
    /// names : sequence of str
    ///     The names of columns.
    /// says : dict, optional
    ///     What the file states, as `decoder` takes it.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If what the file says is of another type.
    #[staticmethod]
    #[pyo3(signature = (file, names, *, says=None))]
    fn draft_columns(
        #[pyo3(from_py_with = arg)] file: PathBuf,
        #[pyo3(from_py_with = arg)] names: Vec<String>,
        #[pyo3(from_py_with = object_or_none)] says: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Option<String>> {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let said = facts(Vec::new(), "", says)?;
        let columns = StreamFacts::of_columns(&names);
        let facts =
            columns.map(|columns| StreamFacts { rate_hz: said.rate_hz, notes: said.notes, ..columns });
        Ok(facts.map(|facts| Layout::draft(&file, &facts)))
    }

    /// Which columns are readings, where the layout joins columns to taxels by their names.
    ///
    /// Parameters
    /// ----------
    /// file : str or os.PathLike
    ///     The file, for messages.
    /// names : sequence of str
    ///     The names of its columns.
    ///
    /// Returns
    /// -------
    /// tuple or None
    ///     Ids in ascending order, the number of components, and for each column its component and the place of its
    ///     taxel among the ids, None where it is not read; None if the layout does not join columns by their names.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If no column fits a name, or two are of one taxel.
    #[expect(clippy::type_complexity, reason = "of each column, if it is read")]
    fn named_columns(
        &self,
        #[pyo3(from_py_with = arg)] file: PathBuf,
        #[pyo3(from_py_with = arg)] names: Vec<String>,
    ) -> PyResult<Option<(Vec<u32>, usize, Vec<Option<[usize; 2]>>)>> {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let found = self.layout.named_columns(&file, &names).map_err(error)?;
        Ok(found.map(|found| (found.ids.iter().map(|id| id.0).collect(), found.components, found.places)))
    }

    /// What turns the numbers of a stream of a file into readings.
    ///
    /// Parameters
    /// ----------
    /// file : str or os.PathLike
    ///     The file, for messages.
    /// cells : sequence of int
    ///     The shape of one frame as the file has it, without the axis of frames.
    /// stream : str
    ///     The name of the stream.
    /// says : dict, optional
    ///     What the file states. `unit` (a word, or one for each channel), `rate` in Hz, `axes`, `ids` (of each cell) and
    ///     `time_unit` are compared with the layout; everything else is a statement about the recording.
    /// zero : array_like, optional
    ///     The level of each number of a frame at rest, if `zero_stream` is not None.
    ///
    /// Returns
    /// -------
    /// Decoder
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the layout does not fit the shape of the stream or what the file says.
    #[pyo3(signature = (file, cells, *, stream="", says=None, zero=None))]
    fn decoder(
        &self,
        #[pyo3(from_py_with = arg)] file: PathBuf,
        #[pyo3(from_py_with = arg)] cells: Vec<usize>,
        #[pyo3(from_py_with = arg)] stream: &str,
        #[pyo3(from_py_with = object_or_none)] says: Option<&Bound<'_, PyDict>>,
        zero: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyDecoder> {
        let mut facts = facts(cells, stream, says)?;
        if let Some(zero) = zero {
            let zero = floats("zero", zero)?;
            if zero.shape() != facts.cells {
                return Err(bad_shape("zero", zero.shape(), format!("shape {:?}", facts.cells)));
            }
            facts.zero = Some(zero.as_slice()?.to_vec());
        }
        let decoder = Decoder::new(&self.layout, &file, &facts).map_err(error)?;
        let time_unit = self.layout.time_unit().map_or("ns", TimeUnit::name);
        Ok(PyDecoder { decoder: Mutex::new(decoder), cells: facts.cells, time_unit, first: Mutex::new(None) })
    }

    /// str or None: The stream that it is of, a name or a pattern.
    #[getter]
    fn stream(&self) -> Option<&str> {
        self.layout.stream()
    }

    /// tuple of str: The axes of the array, in its order.
    #[getter]
    fn axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.layout.axes())
    }

    /// int: Which axis is that of the frames.
    #[getter]
    fn frame_axis(&self) -> usize {
        self.layout.frame_axis()
    }

    /// tuple of str: The names of the channels.
    #[getter]
    fn channels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.layout.channels().iter().map(|channel| channel.name.as_str()))
    }

    /// tuple of str: Their units.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.layout.channels().iter().map(|channel| channel.unit.as_str()))
    }

    /// dict: When frames were taken, as in the file of the layout: `rate`, or `stream`, `unit` and `between`.
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("json")?.getattr("loads")?.call1((self.text(),))?.get_item("time")
    }

    /// str or None: The stream from which the zero is taken.
    #[getter]
    fn zero_stream(&self) -> Option<&str> {
        self.layout.zero_stream()
    }

    /// str: The JSON that it was read from.
    #[getter]
    fn text(&self) -> &str {
        self.layout.text()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let state = (self.text(), name, self.path.parent()).into_pyobject(py)?;
        Ok((py.get_type::<Self>().getattr("parse")?, state))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        let names: Vec<&str> = self.layout.channels().iter().map(|channel| channel.name.as_str()).collect();
        format!("<dermatome.Layout: {}; {}>", self.layout.axes().join(", "), names.join(", "))
    }
}

/// What a file states, from the arguments of a call.
fn facts(cells: Vec<usize>, stream: &str, says: Option<&Bound<'_, PyDict>>) -> PyResult<StreamFacts> {
    let mut facts = StreamFacts { stream: stream.into(), cells, ..StreamFacts::default() };
    for (key, value) in says.iter().flat_map(|says| says.iter()) {
        let key: String = part("says", &key)?;
        let name = format!("says[{key:?}]");
        match key.as_str() {
            "unit" => {
                let one = value.extract::<String>().map(|unit| vec![unit]);
                facts.units = one.or_else(|_| part(&name, &value))?;
            }
            "rate" => facts.rate_hz = Some(part(&name, &value)?),
            "axes" => facts.axes = part(&name, &value)?,
            "ids" => {
                let ids = integers(&name, &value)?;
                let ids = one_number_each(&name, &value, ids.len())?;
                facts.ids = Some(ids.into_iter().map(TaxelId).collect());
            }
            "named_columns" => facts.has_named_columns = part(&name, &value)?,
            "time_unit" => {
                let word: String = part(&name, &value)?;
                let unit = TimeUnit::named(&word);
                facts.time_unit = Some(unit.ok_or_else(|| bad("time_unit", word, "s, ms, us or ns"))?);
            }
            _ => facts.notes.push(Statement::new(key, value.str()?.to_string(), StatementSource::File)),
        }
    }
    Ok(facts)
}

/// Turns the numbers of one stream into readings, some frames at a time. Made by `Layout.decoder`.
#[pyclass(frozen, module = "dermatome", name = "Decoder")]
#[derive(Debug)]
pub(crate) struct PyDecoder {
    decoder: Mutex<Decoder>,
    cells: Vec<usize>,
    time_unit: &'static str,
    /// The episode whose dates are being read, and its first one in ns.
    first: Mutex<Option<(u64, i64)>>,
}

/// The times of frames as the file has them.
enum FileTimes {
    None,
    Whole(Vec<i64>),
    Real(Vec<f64>),
}

impl PyDecoder {
    fn with<T>(&self, read: impl FnOnce(&mut Decoder) -> T) -> T {
        read(&mut self.decoder.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// How many ns the unit of time has, if more than one.
    fn nanoseconds(&self) -> Option<f64> {
        match self.time_unit {
            "s" => Some(1e9),
            "ms" => Some(1e6),
            "us" => Some(1e3),
            _ => None,
        }
    }

    fn times(&self, times: Option<&Bound<'_, PyAny>>, episode: u64) -> PyResult<FileTimes> {
        let Some(times) = times else { return Ok(FileTimes::None) };
        let numpy = times.py().import("numpy")?;
        let mut times = any_array("times", times, "a time for each frame")?;
        let mut kind: String = times.getattr("dtype")?.getattr("kind")?.extract()?;
        if kind == "M" || kind == "m" {
            if numpy.call_method1("isnat", (&times,))?.call_method0("any")?.is_truthy()? {
                return Err(bad("times", "NaT", "a time for each frame"));
            }
            let word = if kind == "M" { "datetime64" } else { "timedelta64" };
            times =
                times.call_method1("astype", (format!("{word}[ns]"),))?.call_method1("astype", ("i8",))?;
            kind = "i".into();
            if let Some(nanoseconds) = self.nanoseconds() {
                let times = integers("times", &times)?;
                let times = times.as_slice()?;
                // From the first one on, so that no digit is lost. Python does not run while this is locked.
                let mut first = self.first.lock().unwrap_or_else(PoisonError::into_inner);
                let begins = first.as_ref().is_none_or(|(of, _)| *of != episode);
                if let Some(time) = times.first().filter(|_| begins) {
                    *first = Some((episode, *time));
                }
                let begin = first.as_ref().map_or(0, |(_, begin)| *begin);
                let since = |time: &i64| time.wrapping_sub(begin) as f64 / nanoseconds;
                return Ok(FileTimes::Real(times.iter().map(since).collect()));
            }
        }
        Ok(match kind.as_str() {
            "i" | "u" => FileTimes::Whole(integers("times", &times)?.as_slice()?.to_vec()),
            _ => FileTimes::Real(floats("times", &times)?.as_slice()?.to_vec()),
        })
    }
}

#[pymethods]
impl PyDecoder {
    /// Turn frames into readings.
    ///
    /// The first call learns the zero and checks sign and axes: it gets at least `learn_frames` frames, or all.
    ///
    /// Parameters
    /// ----------
    /// raw : (T, ...) array_like
    ///     Numbers of frames of the shape of `cells`, of any type; NaN where there is none.
    /// times : (T,) array_like, optional
    ///     When each was taken, in the unit of the layout: whole numbers, floats or `datetime64`.
    /// episode : int
    ///     The number of the episode of all these frames; in a later one times may begin again.
    /// zero : array_like, optional
    ///     The numbers at rest, if `zero_stream` is not None: of the shape of a frame, or one beside each frame; NaN, and numbers that
    ///     stand for none, where a cell has none. By default that of `Layout.decoder`.
    ///
    /// Returns
    /// -------
    /// values : (T, C, N) array
    ///     float32; float64 if `raw` has numbers that need it.
    /// seconds : (T,) float64 array
    ///     Times in s; from whole numbers and `datetime64`, of which ns count, from the first one of the episode on.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the shape or the number of times is another, or times go back.
    #[pyo3(signature = (raw, times=None, episode=0, zero=None))]
    fn decode<'py>(
        &self,
        py: Python<'py>,
        raw: &Bound<'py, PyAny>,
        times: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = arg)] episode: u64,
        zero: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyArray1<f64>>)> {
        let times = self.times(times, episode)?;
        let raw = any_array("raw", raw, "an array of real numbers")?;
        let dtype = raw.getattr("dtype")?;
        let (kind, size): (String, usize) =
            (dtype.getattr("kind")?.extract()?, dtype.getattr("itemsize")?.extract()?);
        if kind == "f" && size == 2 {
            self.with(Decoder::take_halves);
        }
        // Numbers of 16 bits are exact in 32.
        let is_single = size <= 2 && "biuf".contains(&kind) || size == 4 && kind == "f";
        let raw = if is_single { raw.call_method1("astype", ("f4",))? } else { raw };
        let raw = reals("raw", &raw)?;
        let &[frames, ref cells @ ..] = raw.shape() else {
            return Err(bad_shape("raw", raw.shape(), "frames"));
        };
        if *cells != *self.cells {
            return Err(bad_shape(
                "raw",
                raw.shape(),
                format!("shape (T, ...) with frames of {:?}", self.cells),
            ));
        }
        let zeros = zero.map(|zero| floats("zero", zero)).transpose()?;
        if let Some(zeros) = &zeros
            && *zeros.shape() != *self.cells
            && zeros.shape() != raw.shape()
        {
            let needed = format!("shape {:?} of a frame, or {:?}", self.cells, raw.shape());
            return Err(bad_shape("zero", zeros.shape(), needed));
        }
        let zeros = zeros.as_ref().map_or(Ok(&[][..]), |zeros| zeros.as_slice())?;
        let mut seconds = Vec::with_capacity(frames);
        let times = match &times {
            FileTimes::None => Times::None,
            FileTimes::Whole(times) => Times::Whole(times),
            FileTimes::Real(times) => Times::Real(times),
        };
        let shape = self.with(|decoder| [frames, decoder.channels().len(), decoder.ids().len()]);
        let values = match &raw {
            Reals::Single(raw) => {
                let (raw, mut values) = (raw.as_slice()?, Vec::new());
                let decode =
                    || self.with(|d| d.decode_beside(raw, zeros, times, episode, &mut values, &mut seconds));
                py.detach(decode).map_err(error)?;
                shaped(py, shape, values)?.into_any()
            }
            Reals::Double(raw) => {
                let (raw, mut values) = (raw.as_slice()?, Vec::new());
                let decode =
                    || self.with(|d| d.decode_beside(raw, zeros, times, episode, &mut values, &mut seconds));
                py.detach(decode).map_err(error)?;
                shaped(py, shape, values)?.into_any()
            }
        };
        Ok((values, vector(py, seconds)))
    }

    /// (N,) uint32 array: The taxels, in ascending order of their ids.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.with(|decoder| decoder.ids().iter().map(|id| id.0).collect::<Vec<_>>()))
    }

    /// tuple of str: The names of the channels.
    #[getter]
    fn channels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.with(|d| d.channels().iter().map(|c| c.name.clone()).collect::<Vec<_>>()))
    }

    /// tuple of str: Their units.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.with(|d| d.channels().iter().map(|c| c.unit.clone()).collect::<Vec<_>>()))
    }

    /// int: How many frames the first call of `decode` gets at least, if there are so many.
    #[getter]
    fn learn_frames(&self) -> usize {
        self.with(|decoder| decoder.frames_to_learn())
    }

    /// tuple of str or None: What each channel measures, "touch", "tangential" or "other"; None: as names and units tell.
    #[getter]
    fn kinds<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyTuple>>> {
        self.with(|decoder| kinds_of(decoder.channels())).map(|kinds| PyTuple::new(py, kinds)).transpose()
    }

    /// tuple of list of bool and float or None: Of each channel whether readings are about 0 where nothing touches, and the threshold
    /// that is stated, in their unit.
    #[getter]
    fn rest(&self) -> (Vec<bool>, Option<f64>) {
        let rest = self.with(|decoder| decoder.rest(&StreamFacts::default()));
        (rest.is_zero, rest.threshold)
    }

    /// list of tuple of str: What is known about the readings: what, its value, and who states it (file, layout, argument
    /// or checked). Frames add to it.
    #[getter]
    fn statements(&self) -> Vec<(String, String, &'static str)> {
        let all = self.with(|decoder| decoder.statements());
        all.into_iter().map(|Statement { what, value, source }| (what, value, source.into())).collect()
    }
}
