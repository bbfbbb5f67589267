//! The columns of a table of contacts about touches: `touch`, `contact`, `weight`, `qx,qy,qz,qw`, `px,py,pz,radius`, `outx,outy,outz`,
//! `pathx,pathy,pathz`, `vx,vy,vz`, and `dx:NAME,dy:NAME,dz:NAME` for each joint NAME, `dx:NAME[m]` and so on for one that slides.

use std::io::Write;

use glam::DVec3;

use crate::calib::{Observations, TouchJoint, TouchRow, TouchingBody};
use crate::io::error::Result;
use crate::io::table::touch_log::{is_of_joint, joint_of, names_of_joint};
use crate::io::table::writer::TableWriter;
use crate::io::table::{Columns, Row};

/// The number of a touch.
pub(super) const TOUCH: &str = "touch";
const CONTACT: &str = "contact";
const WEIGHT: &str = "weight";
const PROBE: [&str; 4] = ["qx", "qy", "qz", "qw"];
const BODY: [&str; 4] = ["px", "py", "pz", "radius"];
const OUTWARD: [&str; 3] = ["outx", "outy", "outz"];
const PATH: [&str; 3] = ["pathx", "pathy", "pathz"];
const VELOCITY: [&str; 3] = ["vx", "vy", "vz"];

/// All of them.
pub(super) const TOUCH_COLUMNS: [&str; 20] = [
    TOUCH, CONTACT, WEIGHT, "qx", "qy", "qz", "qw", "px", "py", "pz", "radius", "outx", "outy", "outz",
    "pathx", "pathy", "pathz", "vx", "vy", "vz",
];

/// The columns that a table has.
#[derive(Debug, Clone)]
pub(super) struct TouchColumns {
    touch: Option<usize>,
    contact: Option<usize>,
    weight: Option<usize>,
    probe: Option<[usize; 4]>,
    body: Option<[usize; 4]>,
    outward: Option<[usize; 3]>,
    path: Option<[usize; 3]>,
    velocity: Option<[usize; 3]>,
    /// The joints, and their columns.
    pub(super) joints: Vec<TouchJoint>,
    by_joints: Vec<[usize; 3]>,
}

impl TouchColumns {
    /// `None` if the table has none of them.
    pub(super) fn find(columns: &Columns) -> Result<Option<Self>> {
        let [touch, contact, weight] = [TOUCH, CONTACT, WEIGHT].map(|name| columns.find(name));
        let (probe, body) = (columns.find_vector(PROBE)?, columns.find_vector(BODY)?);
        let (outward, path) = (columns.find_vector(OUTWARD)?, columns.find_vector(PATH)?);
        let velocity = columns.find_vector(VELOCITY)?;
        let has_vector = probe.or(body).is_some() || outward.or(path).or(velocity).is_some();
        let mut joints: Vec<TouchJoint> = Vec::new();
        for joint in columns.names().filter_map(joint_of) {
            if !joints.contains(&joint) {
                joints.push(joint);
            }
        }
        let of_joint =
            |joint: &TouchJoint| columns.need_vector(names_of_joint(joint).each_ref().map(|name| &**name));
        let by_joints: Vec<[usize; 3]> = joints.iter().map(of_joint).collect::<Result<_>>()?;
        let has_any = touch.or(contact).or(weight).is_some() || has_vector || !joints.is_empty();
        Ok(has_any.then_some(Self {
            touch,
            contact,
            weight,
            probe,
            body,
            outward,
            path,
            velocity,
            joints,
            by_joints,
        }))
    }

    pub(super) fn read(&self, row: Row<'_>) -> Result<TouchRow> {
        let whole = |column: usize| {
            row.text(column).parse::<u64>().map_err(|_| row.invalid(column, "a whole number, 0 or more"))
        };
        let body = |columns: [usize; 4]| -> Result<TouchingBody> {
            let [x, y, z, radius] = columns.map(|column| row.number(column));
            Ok(TouchingBody { centre: DVec3::new(x?, y?, z?), radius: radius? })
        };
        let vector = |columns: [usize; 3]| -> Result<DVec3> {
            let [x, y, z] = columns.map(|column| row.number(column));
            Ok(DVec3::new(x?, y?, z?))
        };
        let weight = self.weight.map(|column| match row.number(column)? {
            x if x > 0.0 => Ok(x),
            _ => Err(row.invalid(column, "a weight above 0")),
        });
        Ok(TouchRow {
            touch: self.touch.map(whole).transpose()?,
            contact: self.contact.filter(|&column| !row.text(column).is_empty()).map(whole).transpose()?,
            weight: weight.transpose()?.unwrap_or(1.0),
            probe: self.probe.map_or(Ok(None), |columns| row.rotation_if_any(columns))?,
            body: self.body.map(body).transpose()?,
            outward: self.outward.map(vector).transpose()?,
            path: self.path.map(vector).transpose()?,
            velocity: self.velocity.map(vector).transpose()?,
            by_joints: self.by_joints.iter().map(|&columns| vector(columns)).collect::<Result<_>>()?,
        })
    }
}

/// The columns that a table of these observations has: those of its first contact.
pub(super) fn written(observations: &Observations) -> Vec<String> {
    let Some(first) = observations.touches.iter().next() else { return Vec::new() };
    let touch = first.touch.map(|_| TOUCH);
    let contact = first.contact.map(|_| CONTACT);
    let (probe, body) = (first.probe.map(|_| PROBE), first.body.map(|_| BODY));
    let directions =
        [first.outward.map(|_| OUTWARD), first.path.map(|_| PATH), first.velocity.map(|_| VELOCITY)];
    let vectors = [probe, body].into_iter().flatten().flatten();
    let vectors = vectors.chain(directions.into_iter().flatten().flatten());
    let names = touch.into_iter().chain(contact).chain([WEIGHT]).chain(vectors).map(str::to_owned);
    let joints = observations.joints.iter().filter(|_| !first.by_joints.is_empty());
    names.chain(joints.flat_map(names_of_joint)).collect()
}

/// Writes the cells of a touch under `columns`; false if it lacks one of them, or has another.
pub(super) fn write(columns: &[String], row: &TouchRow, table: &mut TableWriter<impl Write>) -> bool {
    if columns.is_empty() {
        return true;
    }
    let fits = |name: &str, is_there: bool| columns.iter().any(|column| column == name) == is_there;
    let has_joints = columns.iter().any(|column| is_of_joint(column));
    if !(fits(TOUCH, row.touch.is_some())
        && fits(CONTACT, row.contact.is_some())
        && fits(PROBE[0], row.probe.is_some())
        && fits(BODY[0], row.body.is_some())
        && fits(OUTWARD[0], row.outward.is_some())
        && fits(PATH[0], row.path.is_some())
        && fits(VELOCITY[0], row.velocity.is_some())
        && has_joints != row.by_joints.is_empty())
    {
        return false;
    }
    [row.touch, row.contact].into_iter().flatten().for_each(|number| table.whole(number));
    table.decimals([row.weight]);
    table.decimals(row.probe.into_iter().flat_map(|q| q.to_array()));
    table.decimals(row.body.into_iter().flat_map(|b| [b.centre.x, b.centre.y, b.centre.z, b.radius]));
    table.decimals(
        row.outward.into_iter().chain(row.path).chain(row.velocity).flat_map(|vector| vector.to_array()),
    );
    table.decimals(row.by_joints.iter().flat_map(|column| column.to_array()));
    true
}
