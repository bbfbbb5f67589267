//! Tables of the values of joints.

use std::path::Path;

use crate::{
    io::{
        IoError,
        error::Result,
        file::{OutPath, Source},
        table::{
            Table, TimeColumn,
            motion::{BEGINS_ANEW, ONE_CLOCK, begins_anew},
            writer::{header_of, write_table},
        },
    },
    robot::Robot,
};

/// The values of all joints of a robot, at some times.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTable {
    /// Times in s, and the values of [`Robot::joints`] in their order, in rad or m.
    pub rows: Vec<(f64, Vec<f64>)>,
    /// The joints that have a column, as indices in [`Robot::joints`]; the others are at 0, or follow another.
    pub given: Vec<usize>,
    /// Whether it has a column of times; the time of a row without one is 0.
    pub has_times: bool,
    /// Names of columns that are not used.
    pub unused: Vec<String>,
}

/// Reads a table of the values of joints: a column for each joint that is not at 0, by its name, in rad or m,
/// and, where there are several rows, `time` in s.
///
/// # Errors
/// If the file cannot be read, has no column of a joint or no row, a cell is not a finite number, or there are
/// several rows without times, or their times begin anew.
pub fn read_joint_values(path: &Path, robot: &Robot) -> Result<JointTable> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    // What follows another joint or does not move has no value of its own.
    let is_own = |k: &usize| robot.joints[*k].kind.has_value() && robot.joints[*k].mimic.is_none();
    let joints: Vec<usize> = (0..robot.joints.len()).filter(is_own).collect();
    let names = || joints.iter().map(|&k| &*robot.joints[k].name);
    let found = |k: &usize| {
        let name = &*robot.joints[*k].name;
        let column = table.columns.find(name)?;
        // A column in another case may be that of another joint, if names differ by case alone.
        let is_alike = |other: &str| other != name && other.eq_ignore_ascii_case(name);
        (table.columns.is_called(column, name) || !names().any(is_alike)).then_some((*k, column))
    };
    let columns: Vec<(usize, usize)> = joints.iter().filter_map(found).collect();
    // A joint may be called `t`.
    let is_no_joint = |time: &TimeColumn| columns.iter().all(|(_, column)| *column != time.column);
    let time = table.columns.find_time()?.filter(is_no_joint);
    if columns.is_empty() {
        let first = joints.first().map_or("none", |&k| &*robot.joints[k].name);
        let needed = format!("a column with the name of a joint that moves, as {first}");
        return Err(table.columns.at().invalid(table.columns.describe(), needed));
    }
    let mut known: Vec<&str> = columns.iter().map(|&(k, _)| &*robot.joints[k].name).collect();
    known.push("time");
    let unused = table.columns.unused(&known);
    let (mut count, mut lines) = (0, Vec::new());
    let rows = table.some_rows("the values of joints", |row| {
        let at = time.map_or(Ok(0.0), |time| row.time(time))?;
        let given = columns.iter().map(|&(k, column)| Ok((k, row.number(column)?)));
        let values = robot.joint_values(&given.collect::<Result<Vec<_>>>()?);
        count += 1;
        lines.push((at, row.at.line));
        if time.is_none() && count > 1 {
            return Err(row.at.invalid("a second row", "a column `time`, or one row"));
        }
        Ok((at, values))
    })?;
    if let Some(line) = begins_anew(&lines) {
        return Err(source.invalid((line, ""), BEGINS_ANEW, ONE_CLOCK));
    }
    let given = columns.iter().map(|&(k, _)| k).collect();
    Ok(JointTable { rows, given, has_times: time.is_some(), unused })
}

/// Writes values of joints at some times (s), as [`read_joint_values`] reads them: a column `time`, and one for each of `names`.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_joint_values<'v>(
    path: impl Into<OutPath>,
    names: &[&str],
    rows: impl IntoIterator<Item = (f64, &'v [f64])>,
) -> std::result::Result<(), IoError> {
    let header = header_of(["time"].into_iter().chain(names.iter().copied()));
    write_table(&path.into(), &header, |table| {
        for (time, values) in rows {
            table.decimals([time].into_iter().chain(values.iter().copied()));
            table.end_row()?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A column in another case is that of a joint unless another one is called so but for the case.
    #[test]
    fn joints_that_differ_by_case_have_columns_of_their_own() {
        let folder = tempfile::tempdir().unwrap();
        let [robot, table] = ["r.urdf", "j.csv"].map(|name| folder.path().join(name));
        let joint = |name: &str, parent: &str, child: &str| {
            format!(
                "<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/><axis xyz='0 0 1'/>\
                 <limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
            )
        };
        let links: String = ["a", "b", "c", "d"].map(|name| format!("<link name='{name}'/>")).concat();
        let joints = [joint("elbow", "a", "b"), joint("Elbow", "b", "c"), joint("Wrist", "c", "d")].concat();
        std::fs::write(&robot, format!("<robot name='r'>{links}{joints}</robot>")).unwrap();
        let robot = crate::io::read_robot(&robot).unwrap();
        let given = |text: &str| -> Option<Vec<String>> {
            std::fs::write(&table, text).unwrap();
            let table = read_joint_values(&table, &robot).ok()?;
            Some(table.given.iter().map(|&k| robot.joints[k].name.to_string()).collect())
        };
        assert_eq!(given("elbow\n1\n").unwrap(), ["elbow"]);
        let mut both = given("Elbow,elbow,WRIST\n1,2,3\n").unwrap();
        both.sort();
        assert_eq!(both, ["Elbow", "Wrist", "elbow"]);
        assert_eq!(given("ELBOW\n1\n"), None);
    }
}
