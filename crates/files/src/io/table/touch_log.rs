//! Logs of touches, and the contacts that follow from them.

use std::path::Path;

use glam::{DQuat, DVec3};

use crate::calib::{JointMotion, Pose, TouchJoint};
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{OutPath, Source};
use crate::io::table::writer::{header_of, write_table};
use crate::io::table::{Columns, Row, Table, TimeColumn};
use crate::skin::TaxelId;
use crate::touches::{TouchBody, TouchContacts, TouchLog, TouchRow};

/// The rows of a table, and the names of columns that are not used.
pub type TouchRows = (Vec<TouchRow>, Vec<String>);

// Columns: the pose of the link, m and unit quaternion.
const POSITION: [&str; 3] = ["x", "y", "z"];
const ROTATION: [&str; 4] = ["qx", "qy", "qz", "qw"];
// The body that touches: the centre of a sphere or a point of a plane, its orientation, the normal of a plane.
const BODY: [&str; 3] = ["px", "py", "pz"];
const BODY_ROTATION: [&str; 4] = ["pqx", "pqy", "pqz", "pqw"];
const PLANE: [&str; 3] = ["pnx", "pny", "pnz"];

struct TouchColumns {
    time: Option<TimeColumn>,
    touch: Option<usize>,
    contact: Option<usize>,
    link: Option<usize>,
    position: Option<[usize; 3]>,
    rotation: Option<[usize; 4]>,
    body: [usize; 3],
    body_rotation: Option<[usize; 4]>,
    plane: Option<[usize; 3]>,
    radius: Option<usize>,
    body_link: Option<usize>,
    taxels: Option<usize>,
}

impl TouchColumns {
    fn new(columns: &Columns) -> Result<Self> {
        let this = Self {
            time: columns.find_time()?,
            touch: columns.find("touch"),
            contact: columns.find("contact"),
            link: columns.find("link"),
            position: columns.find_vector(POSITION)?,
            rotation: columns.find_vector(ROTATION)?,
            body: columns.need_vector(BODY)?,
            body_rotation: columns.find_vector(BODY_ROTATION)?,
            plane: columns.find_vector(PLANE)?,
            radius: columns.find("radius"),
            body_link: columns.find("probe_link"),
            taxels: columns.find("taxels"),
        };
        if this.position.is_some() != this.rotation.is_some() {
            let needed = "all of x,y,z,qx,qy,qz,qw, the pose of the link, or none of them";
            return Err(columns.at().invalid(columns.describe(), needed));
        }
        Ok(this)
    }
}

/// Reads a log of touches row by row; docs/files.md lists the columns.
///
/// # Errors
/// If the file cannot be read, has no row, the columns `px,py,pz` are missing, or a cell is not what its column
/// needs: errors name line and column.
pub fn read_touches(path: &Path) -> std::result::Result<TouchRows, IoError> {
    read_source(&Source::open(path)?)
}

/// Whether a file is a table with columns `px,py,pz` and `taxels`, as a log of touches by itself has them.
pub fn is_touch_log(path: &Path) -> bool {
    let Ok(source) = Source::open(path) else { return false };
    Table::of(&source).is_ok_and(|Table { columns, .. }| {
        columns.find("taxels").is_some() && matches!(columns.find_vector(BODY), Ok(Some(_)))
    })
}

/// As [`read_touches`], of the bytes of a table; errors call it `name`.
///
/// # Errors
/// As [`read_touches`].
pub fn touches_from_bytes(name: &Path, bytes: Vec<u8>) -> std::result::Result<TouchRows, IoError> {
    read_source(&Source::from_bytes(name, bytes)?)
}

fn read_source(source: &Source) -> Result<TouchRows> {
    let table = Table::of(source)?;
    let columns = TouchColumns::new(&table.columns)?;
    let known: Vec<&str> = ["time", "touch", "contact", "link", "radius", "probe_link", "taxels"]
        .into_iter()
        .chain(POSITION)
        .chain(ROTATION)
        .chain(BODY)
        .chain(BODY_ROTATION)
        .chain(PLANE)
        .collect();
    let unused = table.columns.unused(&known);
    Ok((table.some_rows("rows of touches", |row| read_row(row, &columns))?, unused))
}

fn read_row(row: Row<'_>, columns: &TouchColumns) -> Result<TouchRow> {
    let text = |column: Option<usize>| column.map(|c| row.text(c)).filter(|text| !text.is_empty());
    let whole = |column: Option<usize>| {
        let Some(column) = column.filter(|&c| !row.text(c).is_empty()) else { return Ok(None) };
        let number = row.text(column).parse::<u64>();
        number.map(Some).map_err(|_| row.invalid(column, "a whole number from 0 on"))
    };
    let pose = match (columns.position, columns.rotation) {
        (Some(position), Some(rotation)) => match row.numbers_if_any(position)? {
            Some(position) => Some(Pose { position: position.into(), rotation: row.rotation(rotation)? }),
            None => None,
        },
        _ => None,
    };
    let radius = match columns.radius.map(|c| Ok::<_, IoError>((c, row.number_if_any(c)?))).transpose()? {
        Some((column, Some(radius))) if !(0.0..=1e3).contains(&radius) => {
            return Err(row.invalid(column, "a radius of 0 to 1000 m"));
        }
        Some((_, radius)) => radius.unwrap_or(0.0),
        None => 0.0,
    };
    let point = row.vector(columns.body)?;
    let plane = columns.plane.map_or(Ok(None), |c| row.numbers_if_any(c))?;
    let body = match plane.map(DVec3::from_array) {
        None => TouchBody::Sphere { centre: point, radius },
        Some(normal) => {
            let column = columns.plane.map_or(0, |c| c[2]);
            let normal =
                normal.try_normalize().ok_or_else(|| row.invalid(column, "a normal with a direction"))?;
            TouchBody::Plane { point, normal }
        }
    };
    Ok(TouchRow {
        row: row.at.line,
        time: row.time_if_any(columns.time)?,
        touch: whole(columns.touch)?,
        contact: whole(columns.contact)?,
        link: text(columns.link).unwrap_or_default().to_owned(),
        pose,
        body,
        body_rotation: columns.body_rotation.map_or(Ok(None), |c| row.rotation_if_any(c))?,
        body_link: text(columns.body_link).map(str::to_owned),
        felt: columns.taxels.map(|column| taxels(&row, column)).transpose()?,
    })
}

/// `id:value;id:value`, or `id;id`; empty: none.
fn taxels(row: &Row<'_>, column: usize) -> Result<Vec<(TaxelId, Option<f64>)>> {
    let parts = row.text(column).split([';', ' ']).map(str::trim).filter(|part| !part.is_empty());
    let one = |part: &str| {
        let (id, value) = part.split_once(':').map_or((part, None), |(id, value)| (id, Some(value)));
        let value = match value {
            None => None,
            Some(value) => Some(value.trim().parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0)?),
        };
        Some((TaxelId(id.trim().parse().ok()?), value))
    };
    let needed = "active taxels, as 7:0.12;9:0.3 with positive readings or 7;9";
    parts.map(|part| one(part).ok_or_else(|| row.invalid(column, needed))).collect()
}

/// Writes a log of touches of spheres, as [`read_touches`] reads it. Numbers are the shortest that read back as the same
/// `f64`.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_touch_log(
    path: impl Into<OutPath>,
    link: &str,
    log: &TouchLog,
) -> std::result::Result<(), IoError> {
    const HEADER: &str = "time,touch,link,x,y,z,qx,qy,qz,qw,px,py,pz,radius,pnx,pny,pnz,taxels";
    let has_planes = log.frames.iter().any(|frame| matches!(frame.body, TouchBody::Plane { .. }));
    let header = if has_planes { HEADER.to_owned() } else { HEADER.replace("pnx,pny,pnz,", "") };
    write_table(&path.into(), &header, |table| {
        for frame in &log.frames {
            table.number_if_any(frame.time);
            table.whole(frame.touch);
            table.cell(link);
            table.decimals(frame.link.position.to_array().into_iter().chain(frame.link.rotation.to_array()));
            match frame.body {
                TouchBody::Sphere { centre, radius } => {
                    table.decimals(centre.to_array().into_iter().chain([radius]));
                    table.empty(if has_planes { 3 } else { 0 });
                }
                TouchBody::Plane { point, normal } => {
                    table.decimals(point.to_array());
                    table.empty(1);
                    table.decimals(normal.to_array());
                }
            }
            let felt = frame.felt.iter().map(|(id, reading)| {
                if log.has_readings { format!("{id}:{reading}") } else { id.to_string() }
            });
            table.cell(&felt.collect::<Vec<_>>().join(";"));
            table.end_row()?;
        }
        Ok(())
    })
}

/// Before the name of a joint: how the body moves with it; and after the name of one that slides, whose values are in m.
const BY_JOINT: [&str; 3] = ["dx:", "dy:", "dz:"];
const SLIDES: &str = "[m]";

/// The names of the columns of a joint.
pub(in crate::io) fn names_of_joint(joint: &TouchJoint) -> [String; 3] {
    let unit = if joint.motion == JointMotion::Slides { SLIDES } else { "" };
    BY_JOINT.map(|before| format!("{before}{}{unit}", joint.name))
}

/// Whether a column is one of a joint.
pub(in crate::io) fn is_of_joint(name: &str) -> bool {
    BY_JOINT.iter().any(|before| name.starts_with(before))
}

/// The joint of a column.
pub(in crate::io) fn joint_of(name: &str) -> Option<TouchJoint> {
    let name = BY_JOINT.iter().find_map(|before| name.strip_prefix(before))?;
    Some(match name.strip_suffix(SLIDES) {
        Some(name) => TouchJoint { name: name.to_owned(), motion: JointMotion::Slides },
        None => TouchJoint { name: name.to_owned(), motion: JointMotion::Turns },
    })
}

/// Writes contacts: `i,x,y,z,touch[,contact],weight[,qx,qy,qz,qw][,px,py,pz,radius][,outx,outy,outz,pathx,pathy,pathz][,vx,vy,vz][,dx:NAME,dy:NAME,dz:NAME],ixx,ixy,ixz,iyy,iyz,izz`, metres and
/// 1/m^2. `contact` and the orientation of the body stand there if the log has them, the body if no touch is of a plane; three columns
/// for each of the joints with which touches move, `dx:NAME[m]` and so on where it slides.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_touch_contacts(
    path: impl Into<OutPath>,
    found: &TouchContacts,
) -> std::result::Result<(), IoError> {
    let TouchContacts { contacts, joints, .. } = found;
    let has_contacts = contacts.iter().any(|contact| contact.contact.is_some());
    let has_times = contacts.iter().all(|contact| contact.time.is_some());
    let has_rotations = contacts.iter().any(|contact| contact.body_rotation.is_some());
    let mut header = "i,x,y,z,touch".to_owned();
    header += if has_contacts { ",contact" } else { "" };
    header += if has_times { ",time,weight" } else { ",weight" };
    header += if has_rotations { ",qx,qy,qz,qw" } else { "" };
    let has_bodies = contacts.iter().all(|contact| contact.body.is_some());
    header += if has_bodies { ",px,py,pz,radius" } else { "" };
    let has_outward = contacts.iter().all(|contact| contact.outward.is_some());
    header += if has_outward { ",outx,outy,outz" } else { "" };
    let has_path = contacts.iter().all(|contact| contact.path.is_some());
    header += if has_path { ",pathx,pathy,pathz" } else { "" };
    let has_velocity = contacts.iter().all(|contact| contact.velocity.is_some());
    header += if has_velocity { ",vx,vy,vz" } else { "" };
    let names: Vec<String> = joints.iter().flat_map(names_of_joint).collect();
    if !names.is_empty() {
        header = format!("{header},{}", header_of(names.iter().map(String::as_str)));
    }
    header += ",ixx,ixy,ixz,iyy,iyz,izz";
    write_table(&path.into(), &header, |table| {
        for contact in contacts {
            table.whole(contact.taxel.0);
            table.decimals(contact.position.to_array());
            table.whole(contact.touch);
            match contact.contact {
                Some(number) => table.whole(number),
                None => table.empty(usize::from(has_contacts)),
            }
            table.decimals(contact.time.filter(|_| has_times).into_iter().chain([contact.weight]));
            match contact.body_rotation {
                Some(q) => table.decimals(DQuat::to_array(&q)),
                None => table.empty(if has_rotations { 4 } else { 0 }),
            }
            let body = contact.body.filter(|_| has_bodies).into_iter();
            table.decimals(body.flat_map(|body| [body.centre.x, body.centre.y, body.centre.z, body.radius]));
            let outward = contact.outward.filter(|_| has_outward).into_iter();
            table.decimals(outward.flat_map(|outward| outward.to_array()));
            let path = contact.path.filter(|_| has_path).into_iter();
            let velocity = contact.velocity.filter(|_| has_velocity);
            table.decimals(path.chain(velocity).flat_map(|vector| vector.to_array()));
            table.decimals(contact.by_joints.iter().flat_map(|column| column.to_array()));
            table.decimals(contact.information.upper());
            table.end_row()?;
        }
        Ok(())
    })
}
