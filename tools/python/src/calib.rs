//! `simulate` and `calibrate`: from noisy contacts to a skin.

use std::sync::Arc;

use dermatome::{
    Error,
    calib::{
        CalibOptions, Calibration, Initialization, Loss, Model, ObservationDiagnostics, ResidualConvention,
        SimulateOptions, calibrate_with, calibrated_skin, simulate_with,
    },
    id::VertexId,
    least_squares::Options,
};
use glam::{DQuat, DVec3};
use numpy::{PyArray1, PyArray2};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arguments::{arg, object},
    arrays::{Reduced, made_by, matrix, triangles, vector},
    errors::error,
    jobs::run,
    observations::PyObservations,
    options::{count, word},
    skin::PySkin,
};

/// Where taxels are, and how well the observations agree. It is pickled as its observations and options, and found
/// again.
#[pyclass(frozen, module = "dermatome", name = "Calibration")]
#[derive(Debug)]
pub(crate) struct PyCalibration {
    found: Arc<Calibration>,
    observations: Py<PyObservations>,
    options: CalibArgs,
}

impl PyCalibration {
    pub(crate) fn new(found: Calibration, observations: Py<PyObservations>, options: CalibArgs) -> Self {
        Self { found: Arc::new(found), observations, options }
    }
}

#[pymethods]
impl PyCalibration {
    /// (n,) uint32 array: Ids of the taxels.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.found.ids.iter().map(|id| id.0))
    }

    /// (n, 3) float64 array: Positions, in m.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.found.poses.iter().map(|pose| pose.position.to_array()))
    }

    /// (n, 4) float64 array: Orientations as unit quaternions x, y, z, w.
    #[getter]
    fn rotations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.found.poses.iter().map(|pose| DQuat::to_array(&pose.rotation)))
    }

    /// (n, 6) float64 array or None: Covariances of the positions, xx, xy, xz, yy, yz, zz, in m^2.
    #[getter]
    fn covariances<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let marginals = self.found.marginals.as_ref();
        marginals.map(|m| matrix(py, m.positions.iter().map(|&c| <[f64; 6]>::from(c)))).transpose()
    }

    /// float: Half of the sum of the losses of all squared whitened residuals, without a unit.
    #[getter]
    fn cost(&self) -> f64 {
        self.found.cost
    }

    /// float: Sum of the squared whitened residuals of the inliers, without a unit.
    #[getter]
    fn chi2(&self) -> f64 {
        self.found.fit.chi2
    }

    /// int: Degrees of freedom of `chi2`.
    #[getter]
    fn dof(&self) -> usize {
        self.found.fit.degrees_of_freedom
    }

    /// bool: Whether it is a minimum.
    #[getter]
    fn converged(&self) -> bool {
        self.found.termination.is_converged()
    }

    /// tuple of two (k,) uint32 arrays: Numbers of the displacements and of the contacts that were rejected as outliers.
    #[getter]
    fn rejected<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>) {
        let (edges, contacts) = self.found.rejected();
        (vector(py, edges.iter().map(|id| id.raw())), vector(py, contacts.iter().map(|id| id.raw())))
    }

    /// list of two (k, 2) float64 arrays: Of each displacement and of each contact the length of its whitened residual, and how
    /// much it counts, its weight.
    #[getter]
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<[Bound<'py, PyArray2<f64>>; 2]> {
        let of = |found: &ObservationDiagnostics| [found.chi2.sqrt(), found.weight];
        let all = &self.found.diagnostics;
        Ok([matrix(py, all.edges.iter().map(of))?, matrix(py, all.contacts.iter().map(of))?])
    }

    /// The skin of the calibrated taxels.
    ///
    /// Parameters
    /// ----------
    /// faces : (m, 3) array_like of int, optional
    ///     Its triangles, which count the taxels of `positions`; by default those that the displacements form.
    ///
    /// Returns
    /// -------
    /// Skin
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If a corner is no taxel, or the triangles are no surface.
    #[pyo3(signature = (faces=None))]
    fn skin(&self, py: Python<'_>, faces: Option<&Bound<'_, PyAny>>) -> PyResult<PySkin> {
        let (found, observations) =
            (Arc::clone(&self.found), Arc::clone(&self.observations.get().observations));
        let faces = faces.map(|faces| triangles("faces", faces, found.ids.len())).transpose()?;
        let faces: Option<Vec<_>> =
            faces.map(|faces| faces.into_iter().map(|face| face.map(VertexId::from)).collect());
        let made =
            run(py, 0, move |_| calibrated_skin(&found, &observations, faces.as_deref()))?.map_err(error)?;
        Ok(PySkin::new(made.skin, &made.remarks))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let CalibArgs { robust, residual, initial, iterations, covariances } = self.options.clone();
        let options = (robust, residual, initial, iterations, covariances);
        made_by(py, "calibration", (self.observations.clone_ref(py), options))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!("<dermatome.Calibration: {} taxels, {}>", self.found.ids.len(), self.found.termination)
    }
}

/// Options of `calibrate` without a drawing, as a dict has them.
#[derive(Debug, Clone, FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CalibArgs {
    robust: String,
    residual: String,
    initial: String,
    iterations: i64,
    covariances: bool,
}

impl CalibArgs {
    pub(crate) fn options(&self) -> PyResult<CalibOptions> {
        let losses = [
            ("auto", None),
            ("none", Some(Loss::Squared)),
            ("huber", Some(Loss::Huber)),
            ("tukey", Some(Loss::Tukey)),
            ("gnc", Some(Loss::Truncated)),
        ];
        let residuals = [
            ("split", ResidualConvention::Split),
            ("log", ResidualConvention::Log),
            ("quaternion", ResidualConvention::Quaternion),
        ];
        let starts = [("chordal", Initialization::Chordal), ("file", Initialization::InitialValues)];
        Ok(CalibOptions {
            robust: word("robust", &self.robust, &losses)?,
            residual: word("residual", &self.residual, &residuals)?,
            initialization: word("initial", &self.initial, &starts)?,
            limits: Options { max_iterations: count("iterations", self.iterations)?, ..Options::default() },
            covariances: self.covariances,
        })
    }
}

/// Find where taxels are.
#[pyfunction]
pub(crate) fn calibrate_taxels(
    py: Python<'_>,
    #[pyo3(from_py_with = object)] observations: &Bound<'_, PyObservations>,
    options: CalibArgs,
    #[pyo3(from_py_with = arg)] threads: i64,
) -> PyResult<PyCalibration> {
    observations.get().check_uncertainty()?;
    let (of, with) = (Arc::clone(&observations.get().observations), options.options()?);
    let found = run(py, count("threads", threads)?, move |stop| calibrate_with(&of, &with, stop.run()))?;
    Ok(PyCalibration::new(found.map_err(error)?, observations.clone().unbind(), options))
}

/// Simulate observations of a skin on a sphere whose truth is known.
///
/// Parameters
/// ----------
/// taxels : int
///     Number of taxels.
/// model : {"positions", "poses"}
///     What is unknown of every taxel.
/// spacing, radius : float
///     Distance of neighbours, and radius of the sphere, in m.
/// noise, rotation_noise : float
///     Noise of displacements, in m, and of relative rotations, in rad, per axis.
/// anchors : int
///     Number of taxels with a contact at a known place.
/// anchor_noise, normal_noise : float
///     Noise of these contacts, in m per axis, and of their normals, in rad; without the latter they have no normals.
/// indentation : float
///     How deep the skin is pressed in at contacts, in m.
/// arm_noise, arm_rotation_noise : float
///     Noise of the place and the orientation of the arm that holds the skin, in m and rad per axis.
/// outliers : float
///     Chance that a displacement is attributed to a wrong taxel nearby.
/// seed : int
///     Seed of everything that is drawn at random.
///
/// Returns
/// -------
/// observations : Observations
/// truth : dict
///     `positions` (n, 3) in m, `rotations` (n, 4), `faces` (m, 3), and `outliers`, numbers of displacements.
///
/// Raises
/// ------
/// DataError
///     If a number is out of its range.
#[pyfunction]
#[pyo3(signature = (*, taxels=500, model="positions", spacing=5e-3, radius=0.1, noise=1e-3, rotation_noise=None,
    anchors=0, anchor_noise=1e-3, normal_noise=None, indentation=0.0, arm_noise=0.0, arm_rotation_noise=0.0, outliers=0.0,
    seed=0))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = arg)] taxels: i64,
    #[pyo3(from_py_with = arg)] model: &str,
    #[pyo3(from_py_with = arg)] spacing: f64,
    #[pyo3(from_py_with = arg)] radius: f64,
    #[pyo3(from_py_with = arg)] noise: f64,
    #[pyo3(from_py_with = arg)] rotation_noise: Option<f64>,
    #[pyo3(from_py_with = arg)] anchors: i64,
    #[pyo3(from_py_with = arg)] anchor_noise: f64,
    #[pyo3(from_py_with = arg)] normal_noise: Option<f64>,
    #[pyo3(from_py_with = arg)] indentation: f64,
    #[pyo3(from_py_with = arg)] arm_noise: f64,
    #[pyo3(from_py_with = arg)] arm_rotation_noise: f64,
    #[pyo3(from_py_with = arg)] outliers: f64,
    #[pyo3(from_py_with = arg)] seed: u64,
) -> PyResult<(PyObservations, Bound<'py, PyDict>)> {
    let options = SimulateOptions {
        taxels: count("taxels", taxels)?,
        model: word("model", model, &[("positions", Model::Positions), ("poses", Model::Poses)])?,
        spacing,
        radius,
        noise,
        rotation_noise: rotation_noise.unwrap_or(SimulateOptions::default().rotation_noise),
        anchors: count("anchors", anchors)?,
        anchor_noise,
        normal_noise,
        indentation,
        arm_noise,
        arm_rotation_noise,
        outliers,
        seed,
    };
    let made =
        run(py, 0, move |stop| simulate_with(&options, stop.run()))?.map_err(|e| error(Error::from(e)))?;
    let truth = PyDict::new(py);
    truth
        .set_item("positions", matrix(py, made.truth.iter().map(|pose| DVec3::to_array(&pose.position)))?)?;
    truth
        .set_item("rotations", matrix(py, made.truth.iter().map(|pose| DQuat::to_array(&pose.rotation)))?)?;
    truth.set_item(
        "faces",
        matrix(py, made.mesh.triangles.iter().map(|corners| corners.map(VertexId::raw)))?,
    )?;
    truth.set_item("outliers", vector(py, made.outliers.iter().map(|id| id.raw())))?;
    Ok((PyObservations::new(made.observations, Vec::new()), truth))
}
