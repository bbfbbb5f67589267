//! Arguments of Python as numbers, words, paths and objects: `#[pyo3(from_py_with = arg)]` before an argument makes the error
//! about one of another type say its name, what was found and what is needed.

use std::{collections::BTreeMap, path::PathBuf};

use pyo3::{
    FromPyObject, PyTypeInfo,
    exceptions::PyException,
    prelude::*,
    types::{PyDict, PyString},
};

use crate::{
    errors::EXCEPTIONS, hits::PyHits, layout::PyLayout, map::PyMap, observations::PyObservations,
    options::PackArg, pool::LevelArg, response::PyResponse, skin::PySkin,
};

/// What Python can hand in.
pub(crate) trait Argument {
    /// What is needed, in words.
    fn needed() -> String;
}

macro_rules! needed {
    ($($words:literal: $($class:ty),+;)*) => {
        $($(impl Argument for $class {
            fn needed() -> String {
                $words.to_owned()
            }
        })+)*
    };
}

needed! {
    "a number": f64, f32;
    "a whole number of 64 bits": i64;
    "a whole number from 0 on": usize, u64, u32;
    "a whole number of 64 bits, or a str": LevelArg;
    "True or False": bool;
    "a str": &str, String;
    "a path": PathBuf;
    "a path, or a sequence of paths": Vec<PathBuf>;
    "a sequence of str": Vec<String>;
    "a sequence of numbers": Vec<f64>;
    "a sequence of whole numbers": Vec<i64>, Vec<usize>;
    "two numbers": [f64; 2];
    "two whole numbers from 0 on": [u32; 2];
    "True, \"tight\" or \"body\"": PackArg;
    "a sequence of (word, direction, link)": Vec<(String, [f64; 3], String)>;
    "a dict": PyDict;
    "a dict of ids of taxels to names of their modules": BTreeMap<u32, String>;
    "a Layout, as Layout.read or Layout.parse makes it": PyLayout;
    "a Response, as dermatome.response or Response.read makes it": PyResponse;
    "a sequence of Skin": Vec<Bound<'_, PySkin>>;
    "a Map, as dermatome.build or Map.read makes it": PyMap;
    "Hits, as Index.locate makes them": PyHits;
    "Observations, as Observations.read or from_columns makes them": PyObservations;
}

impl<T: Argument> Argument for Option<T> {
    fn needed() -> String {
        format!("{}, or None", T::needed())
    }
}

/// An argument as a value.
pub(crate) fn arg<'a, 'py, T>(value: &'a Bound<'py, PyAny>) -> PyResult<T>
where
    T: Argument + FromPyObject<'a, 'py>,
{
    value.extract().map_err(|cause: T::Error| of_another_type::<T>(value, cause.into()))
}

/// An argument as an object of a class of the package.
pub(crate) fn object<'a, 'py, T: Argument + PyTypeInfo>(
    value: &'a Bound<'py, PyAny>,
) -> PyResult<&'a Bound<'py, T>> {
    value.cast().map_err(|cause| of_another_type::<T>(value, cause.into()))
}

/// The same, or None.
pub(crate) fn object_or_none<'a, 'py, T: Argument + PyTypeInfo>(
    value: &'a Bound<'py, PyAny>,
) -> PyResult<Option<&'a Bound<'py, T>>> {
    if value.is_none() { Ok(None) } else { object(value).map(Some) }
}

/// What a part of an argument is, which has a name of its own.
pub(crate) fn part<'a, 'py, T>(name: &str, value: &'a Bound<'py, PyAny>) -> PyResult<T>
where
    T: Argument + FromPyObject<'a, 'py>,
{
    value.extract().map_err(|cause: T::Error| {
        let error = of_another_type::<T>(value, cause.into());
        let note = error.value(value.py()).call_method1("add_note", (format!("while processing '{name}'"),));
        note.map_or_else(|failed| failed, |_| error)
    })
}

/// The error of an argument, to which pyo3 adds the name.
fn of_another_type<T: Argument>(value: &Bound<'_, PyAny>, cause: PyErr) -> PyErr {
    let py = value.py();
    if !cause.is_instance_of::<PyException>(py) {
        return cause;
    }
    let make = || {
        let class = py.import(EXCEPTIONS)?.getattr("ArgumentError")?;
        class.call1((format!("found {}; needed: {}", found(value), T::needed()),))
    };
    let error = make().map_or_else(|failed| failed, PyErr::from_value);
    error.set_cause(py, Some(cause));
    error
}

/// Numbers and words are shown, up to this many characters; of anything else its class.
const SHOWN: usize = 40;

pub(crate) fn found(value: &Bound<'_, PyAny>) -> String {
    let class = || value.get_type().name().map_or_else(|_| "an object".to_owned(), |name| name.to_string());
    let is_short = value.is_instance_of::<PyString>() || value.hasattr("__index__").unwrap_or(false);
    let text = is_short.then(|| value.repr().map(|text| text.to_string()));
    match text {
        Some(Ok(text)) if text.chars().count() <= SHOWN => text,
        Some(Ok(text)) => format!("{}...", text.chars().take(SHOWN).collect::<String>()),
        _ => class(),
    }
}
