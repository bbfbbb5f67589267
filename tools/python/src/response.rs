//! `Response`: how readings become pressures, which taxels can be trusted, and which column is of which taxel.

use std::{path::PathBuf, sync::Arc};

use dermatome::{
    SkinMap,
    io::{Readings, ReadingsReader, read_response, write_response},
    recording::{Recording, RecordingOptions, Reference, examine, find_order, respond},
    signal::{ConditionOptions, HealthOptions, OrderedColumn, Response, TaxelResponse, TaxelState, Zero},
    skin::TaxelId,
};
use numpy::PyArray1;
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arguments::{arg, object},
    arrays::{Reduced, places, vector},
    errors::{bad, error},
    jobs::run,
    map::PyMap,
    readings::{RecordingArrays, readings_of},
};

/// How the readings of taxels become pressures, and which taxels can be trusted: what `dermatome response` writes.
///
/// The reading `c` of a taxel is the pressure `|gain| * max(s * (c - zero), 0)**exponent`, with `s` the sign of `gain`.
/// Arrays have a number for each taxel, in the order of `ids`; NaN is not known.
#[pyclass(frozen, module = "dermatome", name = "Response")]
#[derive(Debug)]
pub(crate) struct PyResponse {
    pub(crate) response: Arc<Response>,
}

type Row = (u32, [Option<f64>; 5], String, Option<u32>);

#[pymethods]
impl PyResponse {
    /// Read a response.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     A table .csv with a column `taxel_id`; others are `zero`, `gain`, `exponent`, `drift`, `sigma` and `state`.
    ///
    /// Returns
    /// -------
    /// Response
    ///
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// DataError
    ///     If a line cannot be used: the message says which.
    #[staticmethod]
    fn read(py: Python<'_>, #[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<Self> {
        let (response, _) = run(py, 0, move |_| read_response(&path))?.map_err(error)?;
        Ok(Self { response: Arc::new(response) })
    }

    /// Write a table .csv.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     If it cannot be written.
    fn write(&self, py: Python<'_>, #[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<()> {
        let response = Arc::clone(&self.response);
        run(py, 0, move |_| write_response(&path, &response))?.map_err(error)
    }

    /// (N,) ndarray of int64: The taxels.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        vector(py, self.response.taxels.iter().map(|taxel| i64::from(taxel.taxel.0)))
    }

    /// (N,) ndarray: The reading where nothing touches.
    #[getter]
    fn zero<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |taxel| taxel.zero)
    }

    /// (N,) ndarray: Pressure over reading to the exponent; negative where pressure lowers readings.
    #[getter]
    fn gain<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |taxel| taxel.gain)
    }

    /// (N,) ndarray: The exponent, without a unit.
    #[getter]
    fn exponent<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |taxel| taxel.exponent)
    }

    /// (N,) ndarray: Standard deviation of the gain over the gain.
    #[getter]
    fn sigma<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.numbers(py, |taxel| taxel.sigma)
    }

    /// list of str: "ok", "untested", or the fault of each taxel.
    #[getter]
    fn states(&self) -> Vec<String> {
        self.response.taxels.iter().map(|taxel| taxel.state.to_string()).collect()
    }

    /// str: Unit of the readings; empty if it is not known.
    #[getter]
    fn unit(&self) -> &str {
        &self.response.unit
    }

    /// str: The channel of the readings that it is of; empty if it is not known. Of readings that have it no other becomes a pressure.
    #[getter]
    fn channel(&self) -> &str {
        &self.response.channel
    }

    /// str or None: "relative" (pressures have no unit) or "Pa"; None without gains.
    #[getter]
    fn scale(&self) -> Option<String> {
        self.response.scale.map(|scale| scale.to_string())
    }

    /// str: How it was found, in words.
    #[getter]
    fn method(&self) -> &str {
        &self.response.method
    }

    fn __repr__(&self) -> String {
        let scale = self.scale().unwrap_or_else(|| "none".into());
        let gains = self.response.taxels.iter().filter(|taxel| taxel.gain.is_some()).count();
        format!("Response of {} taxels: {gains} gains, scale {scale}", self.response.taxels.len())
    }

    #[staticmethod]
    #[pyo3(signature = (unit, scale, method, rows, channel=String::new()))]
    fn _of(
        unit: String,
        scale: Option<&str>,
        method: String,
        rows: Vec<Row>,
        channel: String,
    ) -> PyResult<Self> {
        let scale =
            scale.map(|word| word.parse().map_err(|_| bad("scale", word, "relative or Pa"))).transpose()?;
        let taxel = |(id, [zero, gain, exponent, drift, sigma], state, other): Row| {
            let state: TaxelState = state.parse().map_err(|_| bad("state", &state, "a state of a taxel"))?;
            let taxel = TaxelId(id);
            Ok(TaxelResponse { taxel, zero, gain, exponent, drift, sigma, state, other: other.map(TaxelId) })
        };
        let taxels = rows.into_iter().map(taxel).collect::<PyResult<_>>()?;
        Ok(Self { response: Arc::new(Response { unit, channel, scale, method, taxels }) })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (py, this) = (slf.py(), slf.get());
        let row = |taxel: &TaxelResponse| {
            let TaxelResponse { taxel, zero, gain, exponent, drift, sigma, state, other } = *taxel;
            (taxel.0, [zero, gain, exponent, drift, sigma], state.to_string(), other.map(|id| id.0))
        };
        let rows: Vec<Row> = this.response.taxels.iter().map(row).collect();
        let state = (this.unit(), this.scale(), this.method(), rows, this.channel());
        Ok((py.get_type::<Self>().getattr("_of")?, state.into_pyobject(py)?))
    }
}

impl PyResponse {
    fn numbers<'py>(
        &self,
        py: Python<'py>,
        of: fn(&TaxelResponse) -> Option<f64>,
    ) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.response.taxels.iter().map(move |taxel| of(taxel).unwrap_or(f64::NAN)))
    }
}

/// Opens recordings that are in memory, with a zero and a response.
fn opened(
    map: &Arc<SkinMap>,
    readings: &Readings,
    zero: Zero,
    response: Option<&Response>,
) -> Result<Recording, dermatome::Error> {
    let condition = ConditionOptions { zero, response: response.cloned(), ..ConditionOptions::default() };
    let options = RecordingOptions { condition, ..RecordingOptions::default() };
    Ok(Recording::open(map, ReadingsReader::memory(readings.clone())?, &options)?)
}

fn all_readings(recordings: Vec<Bound<'_, PyAny>>) -> PyResult<Vec<Readings>> {
    let one = |recording: Bound<'_, PyAny>| readings_of(recording.extract::<RecordingArrays<'_>>()?);
    recordings.into_iter().map(one).collect()
}

const fn zero_of(zero: Option<f64>) -> Zero {
    match zero {
        None => Zero::Follow,
        Some(zero) => Zero::At(zero),
    }
}

/// How the readings of recordings, as `condition_readings` takes them, become pressures; without `zero` it is followed.
#[pyfunction]
#[pyo3(signature = (map, recordings, *, pressure=None, force=None, relative=None, zero=None))]
pub(crate) fn estimate_response(
    py: Python<'_>,
    #[pyo3(from_py_with = object)] map: &Bound<'_, PyMap>,
    recordings: Vec<Bound<'_, PyAny>>,
    pressure: Option<&Bound<'_, PyAny>>,
    force: Option<&Bound<'_, PyAny>>,
    relative: Option<&Bound<'_, PyResponse>>,
    #[pyo3(from_py_with = arg)] zero: Option<f64>,
) -> PyResult<PyResponse> {
    let rows = |name: &str, value: &Bound<'_, PyAny>| -> PyResult<Vec<[f64; 2]>> {
        Ok(places(name, value)?.into_iter().map(|row| row.to_array()).collect())
    };
    let readings = all_readings(recordings)?;
    let pressure = pressure.map(|value| rows("pressure", value)).transpose()?;
    let force = force.map(|value| rows("force", value)).transpose()?;
    let mut relative = relative.map(|response| Arc::clone(&response.get().response));
    let map = Arc::clone(&map.get().map);
    let made = run(py, 0, move |stop| -> Result<Response, dermatome::Error> {
        let estimate = |reference: Reference<'_>| {
            let open = |number: usize, response: Option<&Response>| {
                stop.check();
                opened(&map, &readings[number], zero_of(zero), response)
            };
            respond(&map, reference, readings.len(), open, |_| stop.check(), stop.run())
        };
        if let Some(rows) = &pressure {
            return Ok(estimate(Reference::Pressure(rows))?.0);
        }
        let Some(rows) = &force else { return Ok(estimate(Reference::Touches)?.0) };
        if relative.is_none() {
            relative = Some(Arc::new(estimate(Reference::Touches)?.0));
        }
        Ok(estimate(Reference::Force(rows, relative.as_deref().unwrap_or(&Response::default())))?.0)
    })?;
    Ok(PyResponse { response: Arc::new(made.map_err(error)?) })
}

/// Which taxels can be trusted, as recordings show that `condition_readings` would take; without `zero` it is followed.
#[pyfunction]
#[pyo3(signature = (map, recordings, *, threshold=None, modules=Vec::new(), zero=None))]
pub(crate) fn examine_taxels<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = object)] map: &Bound<'py, PyMap>,
    recordings: Vec<Bound<'py, PyAny>>,
    #[pyo3(from_py_with = arg)] threshold: Option<f64>,
    modules: Vec<(u32, String)>,
    #[pyo3(from_py_with = arg)] zero: Option<f64>,
) -> PyResult<(Vec<Bound<'py, PyDict>>, PyResponse)> {
    let readings = all_readings(recordings)?;
    let modules = modules.into_iter().map(|(id, module)| (TaxelId(id), module)).collect();
    let options = HealthOptions { threshold, modules, zero: zero_of(zero) };
    let map = Arc::clone(&map.get().map);
    let known = Arc::clone(&map);
    let made = run(py, 0, move |stop| {
        examine(&known, &options, readings.len(), |number, zero| {
            stop.check();
            opened(&known, &readings[number], zero, None)
        })
    })?;
    let report = made.map_err(error)?;
    let sentences = report.sentences(map.patches.iter().map(|patch| (&*patch.name, &patch.taxels)));
    let mut all = Vec::new();
    for (finding, sentence) in report.findings.iter().zip(sentences) {
        let object = PyDict::new(py);
        object.set_item("kind", finding.kind.to_string())?;
        object.set_item("patch", &map.patches[finding.patch].name)?;
        object.set_item("taxels", finding.taxels.iter().map(|id| id.0).collect::<Vec<_>>())?;
        object.set_item("other", finding.other.map(|id| id.0))?;
        let evidence = PyDict::new(py);
        finding.evidence.iter().try_for_each(|(name, x)| evidence.set_item(name, x))?;
        object.set_item("evidence", evidence)?;
        object.set_item("message", sentence)?;
        all.push(object);
    }
    Ok((all, PyResponse { response: Arc::new(report.response) }))
}

/// Which column of recordings is of which taxel: its id, or -1, its support, and how well the order fits. `known` are
/// columns, counted from 0, with the ids of their taxels; without `zero` it is followed.
#[pyfunction]
#[pyo3(signature = (map, recordings, *, known=Vec::new(), threshold=None, zero=None))]
pub(crate) fn order_columns<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = object)] map: &Bound<'py, PyMap>,
    recordings: Vec<Bound<'py, PyAny>>,
    known: Vec<(usize, u32)>,
    #[pyo3(from_py_with = arg)] threshold: Option<f64>,
    #[pyo3(from_py_with = arg)] zero: Option<f64>,
) -> PyResult<(Bound<'py, PyArray1<i64>>, Bound<'py, PyDict>)> {
    let readings = all_readings(recordings)?;
    let known: Vec<(usize, TaxelId)> = known.into_iter().map(|(column, id)| (column, TaxelId(id))).collect();
    let condition = ConditionOptions { zero: zero_of(zero), ..ConditionOptions::default() };
    let options = RecordingOptions { condition, ..RecordingOptions::default() };
    let map = Arc::clone(&map.get().map);
    let made = run(py, 0, move |stop| {
        let open = |number: usize| {
            stop.check();
            Ok::<_, dermatome::Error>(ReadingsReader::memory(readings[number].clone())?)
        };
        find_order(&map, &known, threshold, &options, readings.len(), open, stop.run())
    })?;
    let order = made.map_err(error)?;
    let id = |column: &OrderedColumn| column.taxel.map_or(-1, |(.., id)| i64::from(id.0));
    let report = PyDict::new(py);
    report.set_item("support", vector(py, order.columns.iter().map(|column| column.support)))?;
    report.set_item("objective", order.objective)?;
    report.set_item("runner_up", order.runner_up)?;
    report.set_item("touches", order.touches)?;
    report.set_item("without_column", order.without_column)?;
    report.set_item("threshold", order.threshold)?;
    Ok((vector(py, order.columns.iter().map(id)), report))
}
