//! Arrays in and out: whatever numpy takes for an array of numbers becomes `f64` or `i64` in C order, and
//! results become arrays that own their numbers.

use std::fmt::Display;

use dermatome::map::ImageFrame;
use glam::{DVec2, DVec3};
use numpy::{
    Element, PyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn,
    PyUntypedArrayMethods, ndarray::Dimension,
};
use pyo3::{
    PyClass,
    prelude::*,
    types::{PyDict, PyMemoryView, PyTuple},
};

use crate::errors::bad;

/// The bytes of `bytes`, a `bytearray`, a `memoryview` or any other contiguous buffer.
pub(crate) fn bytes_of(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<u8>> {
    let view = PyMemoryView::from(value).map_err(|_| {
        let class = value.get_type().name().map_or_else(|_| "an object".to_owned(), |name| name.to_string());
        bad(name, class, "bytes, or another buffer of bytes")
    })?;
    view.call_method0("tobytes")?.extract()
}

/// An argument as an array of anything.
pub(crate) fn any_array<'py>(
    name: &str,
    value: &Bound<'py, PyAny>,
    needed: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let numpy = value.py().import("numpy")?;
    if numpy.getattr("ma")?.call_method1("is_masked", (value,))?.is_truthy()? {
        return Err(bad(name, "masked numbers", format!("{needed}: .filled(numpy.nan) makes one")));
    }
    numpy.call_method1("asarray", (value,)).map_err(|cause| {
        let class = value.get_type().name().map_or_else(|_| "an object".to_owned(), |name| name.to_string());
        let is_tensor = value.hasattr("detach").unwrap_or(false);
        let how = if is_tensor { ": .detach().cpu().float() is one" } else { "" };
        let error = bad(name, class, format!("{needed}{how}"));
        error.set_cause(value.py(), Some(cause));
        error
    })
}

/// An argument as an array in C order of numbers of one kind.
fn array_of<'py, T: Element>(
    name: &str,
    value: &Bound<'py, PyAny>,
    [kinds, dtype, needed]: [&str; 3],
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let numpy = value.py().import("numpy")?;
    let array = any_array(name, value, needed)?;
    let found = array.getattr("dtype")?;
    let kind: String = found.getattr("kind")?.extract()?;
    let is_empty = array.getattr("size")?.extract::<usize>()? == 0;
    if !(kinds.contains(&kind) || is_empty && kind == "f") {
        return Err(bad(name, format!("dtype {found}"), needed));
    }
    // In C order, and aligned.
    numpy.call_method1("require", (array, dtype, "CA"))?.extract()
}

/// Numbers of any shape.
pub(crate) fn floats<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    array_of(name, value, ["iuf", "f8", "an array of real numbers"])
}

/// Real numbers of any shape, of one of the two widths.
pub(crate) enum Reals<'py> {
    Single(PyReadonlyArrayDyn<'py, f32>),
    Double(PyReadonlyArrayDyn<'py, f64>),
}

/// Numbers of any shape, those of 32 bits as they are.
pub(crate) fn reals<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Reals<'py>> {
    let is_single = value.getattr("dtype").and_then(|dtype| dtype.eq("f4")).unwrap_or(false);
    Ok(if is_single {
        Reals::Single(array_of(name, value, ["f", "f4", "an array of real numbers"])?)
    } else {
        Reals::Double(floats(name, value)?)
    })
}

impl Reals<'_> {
    pub(crate) fn shape(&self) -> &[usize] {
        match self {
            Self::Single(array) => array.shape(),
            Self::Double(array) => array.shape(),
        }
    }
}

/// One code for each of `count` things: whole numbers, or a mask of bool as 0 and 1.
pub(crate) fn one_code_each(name: &str, value: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<u32>> {
    let array = any_array(name, value, "an array of integers or of bool")?;
    if array.getattr("dtype")?.getattr("kind")?.eq("b")? {
        return one_number_each(name, &array.call_method1("astype", ("u1",))?, count);
    }
    one_number_each(name, value, count)
}

/// Whole numbers of any shape.
pub(crate) fn integers<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, i64>> {
    array_of(name, value, ["iu", "i8", "an array of integers"])
}

/// A shape as Python writes it.
fn shape_text(shape: &[usize]) -> String {
    match shape {
        [one] => format!("shape ({one},)"),
        many => format!("shape ({})", many.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Refuses an array of another shape.
pub(crate) fn bad_shape(name: &str, shape: &[usize], needed: impl Display) -> PyErr {
    bad(name, shape_text(shape), needed)
}

/// The rows of an array of the shape `(k, N)`.
pub(crate) fn rows<'a, T: Element, const N: usize>(
    name: &str,
    array: &'a PyReadonlyArrayDyn<'_, T>,
) -> PyResult<&'a [[T; N]]> {
    match array.shape() {
        &[_, columns] if columns == N => Ok(array.as_slice()?.as_chunks().0),
        shape => Err(bad_shape(name, shape, format!("shape (k, {N})"))),
    }
}

/// Points or directions of space, `(k, 3)`.
pub(crate) fn points(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<DVec3>> {
    Ok(rows(name, &floats(name, value)?)?.iter().copied().map(DVec3::from_array).collect())
}

/// Points of the plane, `(k, 2)`.
pub(crate) fn places(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<DVec2>> {
    Ok(rows(name, &floats(name, value)?)?.iter().copied().map(DVec2::from_array).collect())
}

/// Triangles, `(m, 3)`, whose corners are of `count` points.
pub(crate) fn triangles(name: &str, value: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<[u32; 3]>> {
    let array = integers(name, value)?;
    let rows: &[[i64; 3]] = rows(name, &array)?;
    let corner = |row: usize, found: i64| {
        let known = u32::try_from(found).ok().filter(|&v| (v as usize) < count);
        known
            .ok_or_else(|| bad(&format!("{name}[{row}]"), found, format!("0 to {}", count.saturating_sub(1))))
    };
    let triangle =
        |(row, &[a, b, c]): (usize, &[i64; 3])| Ok([corner(row, a)?, corner(row, b)?, corner(row, c)?]);
    rows.iter().enumerate().map(triangle).collect()
}

/// Pairs of whole numbers from 0 on, `(k, 2)`.
pub(crate) fn pairs(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 2]>> {
    let array = integers(name, value)?;
    let rows: &[[i64; 2]] = rows(name, &array)?;
    let pair = |(row, &[a, b]): (usize, &[i64; 2])| Ok([number(name, row, a)?, number(name, row, b)?]);
    rows.iter().enumerate().map(pair).collect()
}

/// A whole number from 0 on at a place of an array.
fn number(name: &str, place: usize, found: i64) -> PyResult<u32> {
    u32::try_from(found).map_err(|_| bad(&format!("{name}[{place}]"), found, format!("0 to {}", u32::MAX)))
}

/// One number for each of `count` things.
pub(crate) fn one_each(name: &str, value: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<f64>> {
    let array = floats(name, value)?;
    if array.shape() != [count] {
        return Err(bad_shape(name, array.shape(), shape_text(&[count])));
    }
    Ok(array.as_slice()?.to_vec())
}

/// One whole number from 0 on for each of `count` things.
pub(crate) fn one_number_each(name: &str, value: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<u32>> {
    let array = integers(name, value)?;
    if array.shape() != [count] {
        return Err(bad_shape(name, array.shape(), shape_text(&[count])));
    }
    array.as_slice()?.iter().enumerate().map(|(k, &found)| number(name, k, found)).collect()
}

/// A rectangle of a map, as a `MapFrame`.
pub(crate) fn map_frame<'py>(py: Python<'py>, frame: &ImageFrame) -> PyResult<Bound<'py, PyAny>> {
    let ImageFrame { origin, size, size_px: [columns, rows] } = *frame;
    let class = py.import("dermatome._frame")?.getattr("MapFrame")?;
    class.call1((origin.x, origin.y, size.x, size.y, (rows, columns)))
}

/// A vector.
pub(crate) fn vector<T: Element>(
    py: Python<'_>,
    values: impl IntoIterator<Item = T>,
) -> Bound<'_, PyArray1<T>> {
    PyArray1::from_vec(py, values.into_iter().collect())
}

/// A matrix of these rows.
pub(crate) fn matrix<T: Element, const N: usize>(
    py: Python<'_>,
    rows: impl IntoIterator<Item = [T; N]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let rows: Vec<[T; N]> = rows.into_iter().collect();
    shaped(py, [rows.len(), N], rows.into_flattened())
}

/// An array of zeros, in 32 bits, of any shape.
pub(crate) fn zeros<'py>(py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let zeros = py.import("numpy")?.call_method1("zeros", (PyTuple::new(py, shape)?, "f4"))?;
    Ok(zeros.cast_into()?)
}

/// An array of any shape.
pub(crate) fn shaped<T: Element, const D: usize>(
    py: Python<'_>,
    shape: [usize; D],
    values: Vec<T>,
) -> PyResult<Bound<'_, PyArray<T, <[usize; D] as numpy::ndarray::IntoDimension>::Dim>>>
where
    [usize; D]: numpy::ndarray::IntoDimension<Dim: Dimension>,
{
    PyArray1::from_vec(py, values).reshape(shape)
}

/// How an object of arrays is pickled: its class takes a namespace of them.
pub(crate) fn reduced<'py, T: PyClass>(slf: &Bound<'py, T>, names: &[&str]) -> PyResult<Reduced<'py>> {
    let py = slf.py();
    let state = PyDict::new(py);
    for name in names {
        state.set_item(name, slf.as_any().getattr(*name)?)?;
    }
    let namespace = py.import("types")?.getattr("SimpleNamespace")?.call((), Some(&state))?;
    Ok((py.get_type::<T>().getattr("_of")?, PyTuple::new(py, [namespace])?))
}

/// How an object that a map makes is pickled: a function of `dermatome._made` takes these.
pub(crate) fn made_by<'py>(
    py: Python<'py>,
    function: &str,
    arguments: impl IntoPyObject<'py, Target = PyTuple, Output = Bound<'py, PyTuple>, Error = PyErr>,
) -> PyResult<Reduced<'py>> {
    Ok((py.import("dermatome._made")?.getattr(function)?, arguments.into_pyobject(py)?))
}

/// A function, and its arguments.
pub(crate) type Reduced<'py> = (Bound<'py, PyAny>, Bound<'py, PyTuple>);
