//! `follow`: observations that come touch by touch.

use std::{
    io::{BufRead, Read},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use dermatome::{
    calib::{BodyFollower, CalibError, Calibration, FollowedSolve, FollowedTouch, Follower, Observations},
    io::{IoError, TouchStream, touches_from_stream},
    run::Run,
};
use pyo3::{prelude::*, types::PyIterator};

use crate::{
    arguments::arg,
    bodies::{BodyArgs, Drawing, ModulesArg},
    calib::{CalibArgs, PyCalibration},
    errors::{bad, error},
    jobs::run_here,
    observations::PyObservations,
    options::{count, unit},
};

/// Lines of Python as a stream of bytes.
struct PyLines {
    lines: Py<PyIterator>,
    line: Vec<u8>,
    at: usize,
    /// Whether lines have ends; one without is then half a line.
    has_ends: Option<bool>,
    raised: Raised,
}

/// What the lines raised.
#[derive(Clone, Default)]
struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// That, or else the error to which it led.
    fn or(&self, other: IoError) -> PyErr {
        unpoisoned(&self.0).take().unwrap_or_else(|| error(other))
    }
}

fn unpoisoned<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PyLines {
    fn next(&mut self) -> PyResult<Option<Vec<u8>>> {
        let line = Python::attach(|py| {
            let next = self.lines.bind(py).clone().next();
            next.map(|line| line.and_then(|line| line.extract::<String>())).transpose()
        })?;
        Ok(line.map(|line| {
            let has_ends = *self.has_ends.get_or_insert(line.ends_with('\n'));
            let mut bytes = line.into_bytes();
            if !has_ends {
                bytes.push(b'\n');
            }
            bytes
        }))
    }
}

impl Read for PyLines {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for PyLines {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        while self.at == self.line.len() {
            match self.next() {
                Ok(Some(line)) => (self.line, self.at) = (line, 0),
                Ok(None) => break,
                Err(exception) => {
                    *unpoisoned(&self.raised.0) = Some(exception);
                    return Err(std::io::Error::other("the lines raised an exception"));
                }
            }
        }
        Ok(&self.line[self.at..])
    }

    fn consume(&mut self, amount: usize) {
        self.at += amount;
    }
}

/// The touches of the lines of a table.
#[pyclass(frozen, module = "dermatome._dermatome", name = "TouchLines")]
pub(crate) struct PyTouchLines {
    stream: Mutex<TouchStream>,
    metres: f64,
    raised: Raised,
}

#[pymethods]
impl PyTouchLines {
    #[new]
    #[pyo3(signature = (lines, unit=None))]
    fn new(lines: &Bound<'_, PyAny>, unit: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let metres = unit.map_or(Ok(1.0), self::unit)?;
        let raised = Raised::default();
        let input = PyLines {
            lines: lines.try_iter()?.unbind(),
            line: Vec::new(),
            at: 0,
            has_ends: None,
            raised: raised.clone(),
        };
        let stream = touches_from_stream(input, "rows".as_ref());
        let stream = Mutex::new(stream.map_err(|e| raised.or(e))?);
        Ok(Self { stream, metres, raised })
    }

    /// The next touch and its time, or None at the end.
    fn next(&self) -> PyResult<Option<(PyObservations, Option<f64>)>> {
        // Lines of Python run other threads meanwhile, which must not wait for this one.
        let busy = || bad("rows", "another thread that reads them", "one thread");
        let mut stream = self.stream.try_lock().map_err(|_| busy())?;
        let Some(read) = stream.next() else { return Ok(None) };
        let read = read.map_err(|e| self.raised.or(e))?;
        Ok(Some((PyObservations::of_file(read, self.metres), stream.time())))
    }

    /// The line on which the lines ended within a row.
    #[getter]
    fn half_row(&self) -> Option<usize> {
        self.stream.try_lock().ok()?.half_row()
    }
}

enum Solver {
    Taxels(Box<Follower>, CalibArgs),
    Bodies(Box<BodyFollower>, Box<Drawing>),
}

/// Solves observations that come touch by touch.
#[pyclass(module = "dermatome._dermatome", name = "TouchFollower")]
pub(crate) struct PyTouchFollower {
    solver: Solver,
    threads: usize,
}

/// A touch as Python has it: its number, its taxels, length and dimensions of the innovation, whether it fits, the largest
/// motion, the least certain taxel, and a taxel that is not determined.
type Followed =
    (usize, Vec<u32>, Option<f64>, Option<usize>, Option<bool>, Option<f64>, Option<(u32, f64)>, Option<u32>);

impl Solver {
    fn push(&mut self, touch: &Observations, run: Run<'_>) -> Result<FollowedTouch, CalibError> {
        match self {
            Self::Taxels(follower, _) => follower.push(touch, run),
            Self::Bodies(follower, _) => follower.push(touch, run),
        }
    }
}

#[pymethods]
impl PyTouchFollower {
    /// One that solves taxels.
    #[staticmethod]
    fn of_taxels(
        options: CalibArgs,
        #[pyo3(from_py_with = arg)] every: i64,
        #[pyo3(from_py_with = arg)] threads: i64,
    ) -> PyResult<Self> {
        let follower = Calibration::follow(&options.options()?, count("every", every)?);
        let threads = count("threads", threads)?;
        Ok(Self { solver: Solver::Taxels(Box::new(follower), options), threads })
    }

    /// One that fits the bodies of a drawing.
    #[staticmethod]
    fn of_bodies(
        py: Python<'_>,
        cad: &Bound<'_, PyAny>,
        modules: Option<ModulesArg>,
        options: BodyArgs,
        #[pyo3(from_py_with = arg)] every: i64,
        #[pyo3(from_py_with = arg)] threads: i64,
    ) -> PyResult<Self> {
        let (options, every) = (options.options()?, count("every", every)?);
        let drawing = Drawing::read(py, cad, modules)?;
        let follower = BodyFollower::new(drawing.cad.clone(), &options, every).map_err(error)?;
        let threads = count("threads", threads)?;
        Ok(Self { solver: Solver::Bodies(Box::new(follower), Box::new(drawing)), threads })
    }

    /// What was assumed when a touch was read.
    fn remarks_of(&self, touch: &Bound<'_, PyObservations>) -> Vec<String> {
        match self.solver {
            Solver::Taxels(..) => touch.get().remarks().to_vec(),
            Solver::Bodies(..) => touch.get().remarks_of_bodies(),
        }
    }

    /// Add a touch.
    fn push(&mut self, py: Python<'_>, touch: &Bound<'_, PyObservations>) -> PyResult<Followed> {
        let (observations, Self { solver, threads }) = (touch.get(), self);
        match solver {
            Solver::Bodies(..) => {}
            Solver::Taxels(..) => observations.check_uncertainty()?,
        }
        let touch = &*observations.observations;
        let followed = run_here(py, *threads, |stop| solver.push(touch, stop.run()))?.map_err(error)?;
        let (moved, worst, undetermined) = match followed.solved {
            None => (None, None, None),
            Some(FollowedSolve::Solved { moved, worst }) => (Some(moved), worst, None),
            Some(FollowedSolve::Undetermined(id)) => (None, None, Some(id.0)),
        };
        let innovation = followed.innovation;
        Ok((
            followed.touch,
            followed.taxels.iter().map(|id| id.0).collect(),
            innovation.map(|i| i.chi2.max(0.0).sqrt()),
            innovation.map(|i| i.degrees_of_freedom),
            innovation.map(|i| i.fits()),
            moved,
            worst.map(|(id, sigma)| (id.0, sigma)),
            undetermined,
        ))
    }

    /// The calibration of all touches: a `Calibration`, or what a `BodyCalibration` is made of.
    fn finish(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        match &self.solver {
            Solver::Taxels(follower, options) => {
                let (observations, found) =
                    run_here(py, self.threads, |stop| follower.finish(stop.run()))?.map_err(error)?;
                let observations = Py::new(py, PyObservations::new(observations, Vec::new()))?;
                let made = PyCalibration::new(found, observations, options.clone());
                Ok(Py::new(py, made)?.into_any())
            }
            Solver::Bodies(follower, drawing) => {
                let found = run_here(py, self.threads, |stop| follower.clone().finish(stop.run()))?;
                Ok(drawing.result(py, &found.map_err(error)?)?.into_any().unbind())
            }
        }
    }
}
