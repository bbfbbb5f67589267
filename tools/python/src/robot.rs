//! `Robot`: where the links of a robot are.

use std::path::PathBuf;

use dermatome::{
    io::read_robot,
    robot::{Joint, Robot},
};
use pyo3::{
    prelude::*,
    types::{PyDict, PyTuple},
};

use crate::{
    errors::{bad, error},
    index::pose_array,
    jobs::run,
};

/// A robot as its description (.urdf) has it: links that hang from each other by joints.
#[pyclass(frozen, module = "dermatome", name = "Robot")]
#[derive(Debug)]
pub(crate) struct PyRobot {
    robot: Robot,
}

/// Whether a joint has a value of its own.
fn is_free(joint: &Joint) -> bool {
    joint.kind.has_value() && joint.mimic.is_none()
}

#[pymethods]
impl PyRobot {
    /// Read a robot description; its mesh files are not opened.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     A .urdf file without macros.
    ///
    /// Returns
    /// -------
    /// Robot
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let robot = run(py, 0, move |_| read_robot(&path))?.map_err(error)?;
        Ok(Self { robot })
    }

    /// Compute where the links are, as `Index.posed` takes it.
    ///
    /// Parameters
    /// ----------
    /// joints : dict of str to float, optional
    ///     Values of joints, in rad or m; the others are at 0, and those that follow another where that puts them.
    ///     Limits are not checked.
    ///
    /// Returns
    /// -------
    /// dict of str to (4, 4) float64 array
    ///     The frame of each link in that of the first.
    #[pyo3(signature = (joints=None))]
    fn poses<'py>(
        &self,
        py: Python<'py>,
        joints: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut given = Vec::new();
        for (name, value) in joints.into_iter().flatten() {
            let name: String =
                name.extract().map_err(|_| bad("joints", "a key that is no str", "the name of a joint"))?;
            let place = self.robot.joints.iter().position(|joint| is_free(joint) && joint.name == name);
            let unknown = || bad("joints", format!("{name:?}"), "the names of Robot.joints");
            let place = place.ok_or_else(unknown)?;
            let number = value.extract().ok().filter(|value: &f64| value.is_finite());
            let refuse = || bad(&format!("joints[{name:?}]"), &value, "a finite number, in rad or m");
            given.push((place, number.ok_or_else(refuse)?));
        }
        let poses = PyDict::new(py);
        for (link, pose) in self.robot.links.iter().zip(&self.robot.poses(&self.robot.joint_values(&given))) {
            poses.set_item(&link.name, pose_array(py, pose)?)?;
        }
        Ok(poses)
    }

    /// tuple of str: The links, each after the one it hangs from.
    #[getter]
    fn links<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.robot.links.iter().map(|link| &link.name).collect::<Vec<_>>())
    }

    /// tuple of str: The joints that have a value of their own.
    #[getter]
    fn joints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let free = self.robot.joints.iter().filter(|joint| is_free(joint));
        PyTuple::new(py, free.map(|joint| &joint.name).collect::<Vec<_>>())
    }

    fn __repr__(&self) -> String {
        format!("<dermatome.Robot: {} links>", self.robot.links.len())
    }
}
