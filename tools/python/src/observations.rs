//! `Observations`: what was observed of taxels.

use std::{io::Cursor, path::PathBuf, sync::Arc};

use dermatome::{
    calib::{
        ContactMeasurement, ContactObservation, Displacement, DisplacementMeasurement, Information,
        JointMotion, Model, Observations, Pose, PoseMeasurement, TaxelVariable, TouchJoint, TouchRow,
        TouchingBody,
    },
    id::VertexId,
    io::{ObservationRemark, observations_from_stream, read_observations, write_observations},
    skin::TaxelId,
};
use glam::{DQuat, DVec3};
use pyo3::prelude::*;

use crate::{
    arguments::arg,
    arrays::Reduced,
    errors::{bad, error},
    jobs::run,
    options::unit,
};

/// What was observed of taxels: displacements between them, and contacts at known places.
#[pyclass(frozen, module = "dermatome", name = "Observations")]
#[derive(Debug)]
pub(crate) struct PyObservations {
    pub(crate) observations: Arc<Observations>,
    /// list of str: What was assumed when they were read.
    #[pyo3(get)]
    remarks: Vec<String>,
    /// If their table gives no uncertainty: the remark that one was assumed, and whether that is not one in m, since lengths
    /// are in another unit.
    assumed: Option<(String, bool)>,
}

impl PyObservations {
    pub(crate) fn new(observations: Observations, remarks: Vec<String>) -> Self {
        Self { observations: Arc::new(observations), remarks, assumed: None }
    }

    /// What was read from a table or a graph, whose unit of length is so many metres.
    pub(crate) fn of_file(
        (mut observations, remarks): (Observations, Vec<ObservationRemark>),
        metres: f64,
    ) -> Self {
        observations.scale(metres);
        let is_assumed =
            |remark: &ObservationRemark| matches!(remark, ObservationRemark::AssumedSigma { .. });
        let said = remarks.iter().map(ToString::to_string).collect();
        let assumed = remarks.iter().find(|remark| is_assumed(remark));
        let assumed = assumed.map(|remark| (remark.to_string(), metres.to_bits() != 1.0_f64.to_bits()));
        Self { assumed, ..Self::new(observations, said) }
    }

    /// Whether their table gives no uncertainty, so that one was assumed.
    pub(crate) fn is_assumed(&self) -> bool {
        self.assumed.is_some()
    }

    /// Refuses an uncertainty that was assumed in another unit than m.
    pub(crate) fn check_uncertainty(&self) -> PyResult<()> {
        match &self.assumed {
            Some((_, true)) => Err(bad(
                "observations",
                "no uncertainty, and none is assumed in another unit than m",
                "a column sigma, in the unit of the lengths",
            )),
            _ => Ok(()),
        }
    }

    pub(crate) fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// What was said when they were read, if their noise is estimated next to a drawing.
    pub(crate) fn remarks_of_bodies(&self) -> Vec<String> {
        let assumed = self.assumed.as_ref().map(|(remark, _)| remark);
        let is_other = |remark: &&String| assumed != Some(*remark);
        let mut remarks: Vec<String> = self.remarks.iter().filter(is_other).cloned().collect();
        if self.is_assumed() {
            remarks.push("the table gives no uncertainty; it is estimated from the touches".to_owned());
        }
        remarks
    }
}

#[pymethods]
impl PyObservations {
    /// Read observations from files.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     A graph .g2o or a table .csv.
    /// contacts : sequence of str or os.PathLike, optional
    ///     Contacts in files of their own.
    /// unit : {"m", "mm", "cm", "dm", "in"} or float
    ///     Unit of all lengths.
    /// clip_information : bool
    ///     Replace information that is not positive semi-definite by the nearest that is.
    ///
    /// Returns
    /// -------
    /// Observations
    ///
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// DataError
    ///     If a line cannot be used: the message says which, and what is needed.
    #[staticmethod]
    #[pyo3(signature = (path, *, contacts=None, unit=None, clip_information=false))]
    fn read(
        py: Python<'_>,
        #[pyo3(from_py_with = arg)] path: PathBuf,
        #[pyo3(from_py_with = arg)] contacts: Option<Vec<PathBuf>>,
        unit: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] clip_information: bool,
    ) -> PyResult<Self> {
        let metres = unit.map_or(Ok(1.0), self::unit)?;
        let read = run(py, 0, move |_| read_observations(&path, &contacts.unwrap_or_default()))?;
        let mut made = Self::of_file(read.map_err(error)?, metres);
        let observations = Arc::make_mut(&mut made.observations);
        let clipped = if clip_information { observations.clip_information() } else { 0 };
        if clipped > 0 {
            made.remarks.push(format!("{clipped} observations have information that was clipped"));
        }
        Ok(made)
    }

    /// Observations of arrays, which are the columns of a table (docs/files.md).
    ///
    /// Parameters
    /// ----------
    /// columns : mapping of str to (k,) array_like
    ///     Displacements have `i`, `j`, `dx`, `dy`, `dz`, contacts `i`, `x`, `y`, `z` and perhaps `nx`, `ny`, `nz`, `touch`,
    ///     `contact`, `weight`, `qx`, `qy`, `qz`, `qw`; then `sigma`, or `sx`, `sy`, `sz`, or `ixx`, `ixy`, `ixz`, `iyy`,
    ///     `iyz`, `izz`. Errors count the names of the columns as line 1.
    /// unit : {"m", "mm", "cm", "dm", "in"} or float
    ///     Unit of all lengths.
    ///
    /// Returns
    /// -------
    /// Observations
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If columns differ in length, are missing or unknown, or a row cannot be used.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> dermatome.Observations.from_columns({"i": [1, 2], "x": [0, 0.01], "y": [0, 0], "z": [0, 0], "sigma": [1e-3, 1e-3]})
    /// <dermatome.Observations: 2 taxels, 0 displacements, 2 contacts>
    #[staticmethod]
    #[pyo3(signature = (columns, *, unit=None))]
    fn from_columns(
        py: Python<'_>,
        columns: &Bound<'_, PyAny>,
        unit: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let metres = unit.map_or(Ok(1.0), self::unit)?;
        let text = py.import("dermatome._columns")?.call_method1("table", ("columns", columns))?;
        let text: String = text.extract()?;
        let read = move || observations_from_stream(Cursor::new(text), "columns".as_ref(), &[]);
        Ok(Self::of_file(run(py, 0, move |_| read())?.map_err(error)?, metres))
    }

    /// Write them to a graph .g2o or a table .csv.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     If it cannot be written.
    /// DataError
    ///     If the extension is another than .g2o or .csv.
    fn write(&self, py: Python<'_>, #[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<()> {
        let observations = Arc::clone(&self.observations);
        run(py, 0, move |_| write_observations(&path, &observations))?.map_err(error)
    }

    /// int: Number of taxels.
    #[getter]
    fn n_taxels(&self) -> usize {
        self.observations.taxels.len()
    }

    /// int: Number of displacements.
    #[getter]
    fn n_edges(&self) -> usize {
        self.observations.edges.len()
    }

    /// int: Number of contacts.
    #[getter]
    fn n_contacts(&self) -> usize {
        self.observations.contacts.len()
    }

    #[staticmethod]
    fn _of(
        is_poses: bool,
        taxels: Vec<TaxelState>,
        edges: Vec<EdgeState>,
        contacts: Vec<ContactState>,
        touches: (Vec<JointState>, Vec<TouchState>),
        remarks: Vec<String>,
        assumed: Option<(String, bool)>,
    ) -> PyResult<Self> {
        let (joints, touches) = touches;
        let count = taxels.len();
        let taxel = |number: u32| Some(VertexId::from(number)).filter(|taxel| taxel.index() < count);
        let variable = |(id, initial, fixed): TaxelState| TaxelVariable {
            id: TaxelId(id),
            initial: initial.map(|numbers| pose(&numbers)),
            fixed,
        };
        let edge = |([from, to], numbers): EdgeState| {
            let measurement = displacement(&numbers)?;
            Some(Displacement { from: taxel(from)?, to: taxel(to)?, measurement })
        };
        let contact = |(of, numbers): ContactState| {
            Some(ContactObservation { taxel: taxel(of)?, measurement: contact(&numbers)? })
        };
        let body = |[x, y, z, radius]: [f64; 4]| TouchingBody { centre: DVec3::new(x, y, z), radius };
        let touch =
            |((touch, contact, weight, probe), by, [outward, path, velocity], by_joints): TouchState| {
                TouchRow {
                    touch,
                    contact,
                    weight,
                    probe: probe.map(DQuat::from_array),
                    body: by.map(body),
                    outward: outward.map(DVec3::from_array),
                    path: path.map(DVec3::from_array),
                    velocity: velocity.map(DVec3::from_array),
                    by_joints: by_joints.into_iter().map(DVec3::from_array).collect(),
                }
            };
        let joint = |(name, slides): JointState| TouchJoint {
            name,
            motion: if slides { JointMotion::Slides } else { JointMotion::Turns },
        };
        let made = || {
            Some(Observations {
                model: if is_poses { Model::Poses } else { Model::Positions },
                taxels: taxels.into_iter().map(variable).collect(),
                edges: edges.into_iter().map(edge).collect::<Option<_>>()?,
                contacts: contacts.into_iter().map(contact).collect::<Option<_>>()?,
                touches: touches.into_iter().map(touch).collect(),
                joints: joints.into_iter().map(joint).collect(),
            })
        };
        let made =
            made().ok_or_else(|| bad("state", "observations that do not fit", "those of Observations"));
        Ok(Self { assumed, ..Self::new(made?, remarks) })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (py, Self { observations, remarks, assumed }) = (slf.py(), slf.get());
        let Observations { model, taxels, edges, contacts, touches, joints } = &**observations;
        let variable = |taxel: &TaxelVariable| (taxel.id.0, taxel.initial.as_ref().map(numbers), taxel.fixed);
        let taxels: Vec<TaxelState> = taxels.iter().map(variable).collect();
        let edge =
            |edge: &Displacement| ([edge.from.raw(), edge.to.raw()], of_displacement(&edge.measurement));
        let edges: Vec<EdgeState> = edges.iter().map(edge).collect();
        let contact = |of: &ContactObservation| (of.taxel.raw(), of_contact(&of.measurement));
        let contacts: Vec<ContactState> = contacts.iter().map(contact).collect();
        let body = |TouchingBody { centre, radius }: TouchingBody| [centre.x, centre.y, centre.z, radius];
        let touch = |row: &TouchRow| {
            let probe = row.probe.map(|q| q.to_array());
            let vectors = [row.outward, row.path, row.velocity].map(|vector| vector.map(|v| v.to_array()));
            let by_joints = row.by_joints.iter().map(|column| column.to_array()).collect();
            ((row.touch, row.contact, row.weight, probe), row.body.map(body), vectors, by_joints)
        };
        let joint = |joint: &TouchJoint| (joint.name.clone(), joint.motion == JointMotion::Slides);
        let joints: Vec<JointState> = joints.iter().map(joint).collect();
        let touches: Vec<TouchState> = touches.iter().map(touch).collect();
        let state = (
            *model == Model::Poses,
            taxels,
            edges,
            contacts,
            (joints, touches),
            remarks.clone(),
            assumed.clone(),
        );
        Ok((py.get_type::<Self>().getattr("_of")?, state.into_pyobject(py)?))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        let Observations { taxels, edges, contacts, .. } = &*self.observations;
        format!(
            "<dermatome.Observations: {} taxels, {} displacements, {} contacts>",
            taxels.len(),
            edges.len(),
            contacts.len()
        )
    }
}

/// Id, initial pose and whether it is fixed.
type TaxelState = (u32, Option<[f64; 7]>, bool);

/// Two taxels, and the numbers of the displacement between them.
type EdgeState = ([u32; 2], Vec<f64>);

/// A taxel, and the numbers of its contact.
type ContactState = (u32, Vec<f64>);

/// A touch: its number, that of its contact, its weight, the orientation of the probe, the centre and radius of what
/// touched, the direction in which its readings fell, its path, its velocity, and how it moves with each joint.
type TouchState = (
    (Option<u64>, Option<u64>, f64, Option<[f64; 4]>),
    Option<[f64; 4]>,
    [Option<[f64; 3]>; 3],
    Vec<[f64; 3]>,
);

/// The name of a joint, and whether it slides.
type JointState = (String, bool);

/// A pose as position and quaternion.
fn numbers(pose: &Pose) -> [f64; 7] {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.position.to_array(), pose.rotation.to_array());
    [x, y, z, qx, qy, qz, qw]
}

fn pose(&[x, y, z, qx, qy, qz, qw]: &[f64; 7]) -> Pose {
    Pose { position: DVec3::new(x, y, z), rotation: DQuat::from_xyzw(qx, qy, qz, qw) }
}

fn of_offset(at: DVec3, information: &Information<3>) -> Vec<f64> {
    at.to_array().iter().chain(information.0.as_flattened()).copied().collect()
}

fn of_pose(seen: &PoseMeasurement) -> Vec<f64> {
    numbers(&seen.pose).iter().chain(seen.information.0.as_flattened()).copied().collect()
}

fn information<const N: usize>(numbers: &[f64]) -> Option<Information<N>> {
    Some(Information(numbers.as_chunks().0.try_into().ok()?))
}

fn offset(numbers: &[f64]) -> Option<(DVec3, Information<3>)> {
    let (at, rest) = numbers.split_first_chunk()?;
    Some((DVec3::from_array(*at), information(rest)?))
}

fn seen(numbers: &[f64]) -> Option<Box<PoseMeasurement>> {
    let (at, rest) = numbers.split_first_chunk()?;
    Some(Box::new(PoseMeasurement { pose: pose(at), information: information(rest)? }))
}

/// The numbers of a displacement: those of an offset and of a pose are not as many.
fn of_displacement(measurement: &DisplacementMeasurement) -> Vec<f64> {
    match measurement {
        DisplacementMeasurement::Offset { offset, information } => of_offset(*offset, information),
        DisplacementMeasurement::Relative(seen) => of_pose(seen),
    }
}

fn displacement(numbers: &[f64]) -> Option<DisplacementMeasurement> {
    match numbers.len() {
        12 => offset(numbers)
            .map(|(offset, information)| DisplacementMeasurement::Offset { offset, information }),
        43 => seen(numbers).map(DisplacementMeasurement::Relative),
        _ => None,
    }
}

/// The numbers of a contact, as many as only its kind has.
fn of_contact(measurement: &ContactMeasurement) -> Vec<f64> {
    match measurement {
        ContactMeasurement::Position { position, information } => of_offset(*position, information),
        ContactMeasurement::PositionNormal { position, information, normal, normal_information } => {
            let [x, y, z] = normal.to_array();
            [of_offset(*position, information), vec![x, y, z, *normal_information]].concat()
        }
        ContactMeasurement::Pose { offset, seen } => [numbers(offset).to_vec(), of_pose(seen)].concat(),
    }
}

fn contact(numbers: &[f64]) -> Option<ContactMeasurement> {
    match numbers.len() {
        12 => offset(numbers)
            .map(|(position, information)| ContactMeasurement::Position { position, information }),
        16 => {
            let (rest, &[x, y, z, normal_information]) = numbers.split_last_chunk()?;
            let (position, information) = offset(rest)?;
            let normal = DVec3::new(x, y, z);
            Some(ContactMeasurement::PositionNormal { position, information, normal, normal_information })
        }
        50 => {
            let (offset, rest) = numbers.split_first_chunk()?;
            Some(ContactMeasurement::Pose { offset: pose(offset), seen: seen(rest)? })
        }
        _ => None,
    }
}
