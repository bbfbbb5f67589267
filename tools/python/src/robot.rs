//! `Robot`: where the links of a robot are.

use std::path::PathBuf;

use dermatome::{
    io::read_robot,
    robot::{Joint, JointKind, Mimic, Robot},
    skin::{Link, LinkId},
};
use glam::DVec3;
use pyo3::{
    prelude::*,
    types::{PyDict, PyTuple},
};

use crate::{
    arguments::{arg, object_or_none},
    arrays::Reduced,
    errors::{bad, error},
    index::{pose_array, pose_of},
    jobs::run,
};

/// A robot as its description (.urdf) has it: links that hang from each other by joints.
#[pyclass(frozen, module = "dermatome", name = "Robot")]
#[derive(Debug)]
pub(crate) struct PyRobot {
    robot: Robot,
}

/// Name, parent and pose of a link.
type LinkState<'py> = (String, Option<usize>, Bound<'py, PyAny>);

/// Name, link, kind, axis and anchor, limits of a joint, and the joint that it follows with factor and offset.
type JointState = (String, usize, String, [[f64; 3]; 2], Option<[f64; 2]>, Option<(usize, f64, f64)>);

const KINDS: [JointKind; 7] = [
    JointKind::Fixed,
    JointKind::Revolute,
    JointKind::Continuous,
    JointKind::Prismatic,
    JointKind::Floating,
    JointKind::Ball,
    JointKind::Planar,
];

/// Whether a joint has a value of its own.
pub(crate) fn is_free(joint: &Joint) -> bool {
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
    ///
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// DataError
    ///     If it is no description of a robot: the message says which line.
    #[staticmethod]
    fn read(py: Python<'_>, #[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<Self> {
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If a joint is unknown, or its value is not finite.
    #[pyo3(signature = (joints=None))]
    fn poses<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = object_or_none)] joints: Option<&Bound<'py, PyDict>>,
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

    #[staticmethod]
    fn _of(links: Vec<LinkState<'_>>, joints: Vec<JointState>) -> PyResult<Self> {
        let refuse = || bad("state", "links and joints that do not fit", "those of a Robot");
        let mut robot = Robot::default();
        for (name, parent, pose) in links {
            if parent.is_some_and(|parent| parent >= robot.links.len()) {
                return Err(refuse());
            }
            robot.links.push(Link { name, parent: parent.map(LinkId::new), pose: pose_of("state", &pose)? });
        }
        let count = joints.len();
        for (name, link, kind, [axis, anchor], limits, mimic) in joints {
            let kind = KINDS.into_iter().find(|known| known.name() == kind).ok_or_else(refuse)?;
            if link >= robot.links.len() || mimic.is_some_and(|(joint, ..)| joint >= count) {
                return Err(refuse());
            }
            let mimic = mimic.map(|(joint, multiplier, offset)| Mimic { joint, multiplier, offset });
            let (axis, anchor) = (DVec3::from(axis), DVec3::from(anchor));
            if !(axis.is_finite() && anchor.is_finite()) {
                return Err(refuse());
            }
            robot.joints.push(Joint { name, link: LinkId::new(link), kind, axis, anchor, limits, mimic });
        }
        Ok(Self { robot })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (py, robot) = (slf.py(), &slf.get().robot);
        let link = |link: &Link| {
            let pose = pose_array(py, &link.pose)?.into_any();
            Ok((link.name.clone(), link.parent.map(LinkId::index), pose))
        };
        let links: Vec<LinkState<'py>> = robot.links.iter().map(link).collect::<PyResult<_>>()?;
        let joint = |joint: &Joint| {
            let mimic = joint.mimic.as_ref().map(|mimic| (mimic.joint, mimic.multiplier, mimic.offset));
            let vectors = [joint.axis, joint.anchor].map(|vector| vector.to_array());
            (
                joint.name.clone(),
                joint.link.index(),
                joint.kind.name().to_owned(),
                vectors,
                joint.limits,
                mimic,
            )
        };
        let joints: Vec<JointState> = robot.joints.iter().map(joint).collect();
        Ok((py.get_type::<Self>().getattr("_of")?, (links, joints).into_pyobject(py)?))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
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
