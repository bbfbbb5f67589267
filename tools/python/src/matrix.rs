//! `Matrix`: sparse rows, as scipy and torch take them.

use numpy::{PyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{Reduced, reduced, vector};

/// A sparse matrix by compressed rows (CSR).
///
/// Row `i` has the entries `data[indptr[i]:indptr[i + 1]]` in the columns `indices[indptr[i]:indptr[i + 1]]`. It can be
/// pickled and copied.
#[pyclass(frozen, get_all, module = "dermatome", name = "Matrix")]
#[derive(Debug, FromPyObject)]
pub(crate) struct PyMatrix {
    /// (rows + 1,) int64 array: Where each row begins, and the end of the last.
    indptr: Py<PyArray1<i64>>,
    /// (nnz,) int64 array: Columns of the entries.
    indices: Py<PyArray1<i64>>,
    /// (nnz,) float64 array: The entries: weights, per m^2 where a matrix draws amounts.
    data: Py<PyArray1<f64>>,
    /// tuple of int: Number of rows and of columns.
    shape: (usize, usize),
}

/// Rows that are collected one after the other.
#[derive(Debug)]
pub(crate) struct Rows {
    ends: Vec<i64>,
    columns: Vec<i64>,
    weights: Vec<f64>,
}

impl Rows {
    pub(crate) fn new() -> Self {
        Self { ends: vec![0], columns: Vec::new(), weights: Vec::new() }
    }

    pub(crate) fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>) {
        for (column, weight) in entries {
            self.columns.push(column as i64);
            self.weights.push(weight);
        }
        self.ends.push(self.columns.len() as i64);
    }

    pub(crate) fn into_matrix(self, py: Python<'_>, columns: usize) -> PyMatrix {
        PyMatrix {
            shape: (self.ends.len() - 1, columns),
            indptr: vector(py, self.ends).unbind(),
            indices: vector(py, self.columns).unbind(),
            data: vector(py, self.weights).unbind(),
        }
    }
}

#[pymethods]
impl PyMatrix {
    /// The matrix for scipy.
    ///
    /// Returns
    /// -------
    /// scipy.sparse.csr_array
    fn scipy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let entries = (self.data.bind(py), self.indices.bind(py), self.indptr.bind(py));
        py.import("dermatome._adapter")?
            .call_method1("need", ("scipy.sparse", "scipy"))?
            .getattr("csr_array")?
            .call1((entries, self.shape))
    }

    #[staticmethod]
    fn _of(state: Self) -> Self {
        state
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        reduced(slf, &["indptr", "indices", "data", "shape"])
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (rows, columns) = self.shape;
        format!("<dermatome.Matrix: {rows} x {columns}, {} entries>", self.data.bind(py).len())
    }
}
