//! How the body that touches moves, in the frame of the link with the skin, with the values of the joints between the two.

use glam::{DAffine3, DVec3};

use crate::calib::{JointMotion, TouchJoint};
use crate::numeric::argsort;
use crate::robot::{Joint, JointKind, Robot};
use crate::skin::LinkId;
use crate::touches::JointSource;

/// A value of a turning joint beyond this, in rad, may be one in degrees; one of a sliding joint, in m, one in mm.
const MOST_LIKELY: [f64; 2] = [std::f64::consts::TAU, 10.0];

/// The values of the joints of a robot over time, and how points move with them.
///
/// If the true value of each joint is that of the table and a constant offset, a point moves by the sum of the columns of [`at`](Self::at), each times
/// its offset, to first order.
#[derive(Debug, Clone)]
pub struct JointColumns<'r> {
    robot: &'r Robot,
    rows: Vec<&'r (f64, Vec<f64>)>,
}

impl<'r> JointColumns<'r> {
    /// Of rows of times, in s, and the values of [`Robot::joints`] in their order, in rad or m. Between two times values are
    /// interpolated; before the first and after the last they are constant.
    pub fn new(robot: &'r Robot, rows: &'r [(f64, Vec<f64>)]) -> Self {
        let order = argsort(&rows.iter().map(|(time, _)| *time).collect::<Vec<_>>());
        Self { robot, rows: order.into_iter().map(|row| &rows[row]).collect() }
    }

    /// What makes a log of rows, where these joints have values.
    pub fn source(&self, given: &[usize]) -> JointSource<'_> {
        let joints = self.joints();
        JointSource {
            given: (0..joints.len()).map(|joint| given.contains(&joint)).collect(),
            joints,
            by_joints: Box::new(|time, link, body, point| self.at(time, link, body, point)),
            times: self.times(),
        }
    }

    /// The joints of the robot.
    pub fn joints(&self) -> Vec<TouchJoint> {
        let joint = |joint: &Joint| {
            let slides = joint.kind == JointKind::Prismatic;
            let motion = if slides { JointMotion::Slides } else { JointMotion::Turns };
            TouchJoint { name: joint.name.clone(), motion }
        };
        self.robot.joints.iter().map(joint).collect()
    }

    /// The times of all rows, in s.
    pub fn all_times(&self) -> Vec<f64> {
        self.rows.iter().map(|row| row.0).collect()
    }

    /// The first and the last time, in s, where there are several.
    pub fn times(&self) -> Option<[f64; 2]> {
        let [first, last] = [self.rows.first()?.0, self.rows.last()?.0];
        (first < last).then_some([first, last])
    }

    /// The derivative of a point (m) in the frame of a link by the value of each joint of the robot, per rad or m, at a time (s). The
    /// point is on the link `body`, or without one in the world. `None` if the robot has no link of this name.
    ///
    /// It is zero for joints that move neither link, or both alike. What follows a joint moves with the joint.
    pub fn at(&self, time: f64, link: &str, body: Option<&str>, point: DVec3) -> Option<Vec<DVec3>> {
        let named = |name: &str| Some(self.robot.links.enumerate().find(|(_, link)| link.name == name)?.0);
        let link = named(link)?;
        let above_body = match body {
            Some(name) => self.chain(named(name)?),
            None => Vec::new(),
        };
        let above_link = self.chain(link);
        let poses = self.robot.poses(&self.values_at(time));
        let (place, into_link) = (poses[link].transform_point3(point), poses[link].matrix3.transpose());
        let mut columns = vec![DVec3::ZERO; self.robot.joints.len()];
        for (number, joint) in self.robot.joints.iter().enumerate() {
            let sign = match (above_link.contains(&joint.link), above_body.contains(&joint.link)) {
                (true, false) => -1.0,
                (false, true) => 1.0,
                _ => continue,
            };
            let (own, factor) = self.leader(number);
            columns[own] += sign * factor * (into_link * velocity(joint, &poses[joint.link], place));
        }
        Some(columns)
    }

    /// The joints with a value that may be in another unit: a turn of more than 360 degrees, or a motion of more than 10 m.
    pub fn unlikely(&self) -> Vec<TouchJoint> {
        let mut joints = self.joints();
        let mut number = 0;
        joints.retain(|joint| {
            let most = match joint.motion {
                JointMotion::Turns => MOST_LIKELY[0],
                JointMotion::Slides => MOST_LIKELY[1],
            };
            let beyond = self.rows.iter().any(|(_, values)| values[number].abs() > most);
            number += 1;
            beyond
        });
        joints
    }

    fn values_at(&self, time: f64) -> Vec<f64> {
        let after = self.rows.partition_point(|row| row.0 < time);
        let before = after.checked_sub(1).and_then(|k| self.rows.get(k));
        match (before, self.rows.get(after)) {
            (Some((start, a)), Some((end, b))) => {
                let share = (time - start) / (end - start);
                a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect()
            }
            (Some(row), None) | (None, Some(row)) => row.1.clone(),
            (None, None) => self.robot.joint_values(&[]),
        }
    }

    /// A link and those above it.
    fn chain(&self, link: LinkId) -> Vec<LinkId> {
        std::iter::successors(Some(link), |&link| self.robot.links[link].parent).collect()
    }

    /// The joint that a joint follows in the end, or itself, and how far it moves with it.
    fn leader(&self, joint: usize) -> (usize, f64) {
        let (mut at, mut factor) = (joint, 1.0);
        // A chain of followers is no longer than there are joints, if it has an end.
        for _ in 0..self.robot.joints.len() {
            let Some(mimic) = &self.robot.joints[at].mimic else { break };
            factor *= mimic.multiplier;
            at = mimic.joint;
        }
        (at, factor)
    }
}

/// How fast a point (m, in the world) moves that a joint carries, where its value grows by one; `pose` is that of the link of the joint.
fn velocity(joint: &Joint, pose: &DAffine3, point: DVec3) -> DVec3 {
    let axis = pose.matrix3 * joint.axis;
    match joint.kind {
        JointKind::Revolute | JointKind::Continuous => {
            axis.cross(point - pose.transform_point3(joint.anchor))
        }
        JointKind::Prismatic => axis,
        JointKind::Fixed | JointKind::Floating | JointKind::Ball | JointKind::Planar => DVec3::ZERO,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::id::IdVec;
    use crate::robot::Mimic;
    use crate::skin::Link;

    /// A base with a lift, a shoulder, an elbow that a wrist follows, and a head beside them.
    fn robot() -> Robot {
        let joint = |name: &str, link: u32, kind, axis: DVec3, mimic| Joint {
            name: name.into(),
            link: LinkId::from(link),
            kind,
            axis,
            anchor: DVec3::new(0.01, 0.02, 0.0),
            limits: None,
            mimic,
        };
        let link = |name: &str, parent: Option<u32>, at: [f64; 3]| Link {
            name: name.into(),
            parent: parent.map(LinkId::from),
            pose: DAffine3::from_rotation_translation(
                glam::DQuat::from_rotation_x(0.3),
                DVec3::from_array(at),
            ),
        };
        let links: IdVec<LinkId, Link> = vec![
            link("base", None, [0.0; 3]),
            link("lift", Some(0), [0.0, 0.0, 0.2]),
            link("arm", Some(1), [0.1, 0.0, 0.2]),
            link("forearm", Some(2), [0.3, 0.0, 0.0]),
            link("hand", Some(3), [0.2, 0.1, 0.0]),
            link("head", Some(1), [0.0, 0.2, 0.3]),
        ]
        .into();
        let follows = Some(Mimic { joint: 2, multiplier: -0.5, offset: 0.1 });
        let joints = vec![
            joint("lift", 1, JointKind::Prismatic, DVec3::Z, None),
            joint("shoulder", 2, JointKind::Revolute, DVec3::Y, None),
            joint("elbow", 3, JointKind::Continuous, DVec3::Z, None),
            joint("wrist", 4, JointKind::Revolute, DVec3::X, follows),
            joint("neck", 5, JointKind::Revolute, DVec3::X, None),
        ];
        Robot { links, joints, ..Robot::default() }
    }

    /// The columns are the differences of positions in the frame of the link, of a body in the world, on a link of the same arm and on
    /// another branch; a joint that carries both moves neither.
    #[test]
    fn columns_are_those_of_small_offsets() {
        let robot = robot();
        let given = [(0, 0.1), (1, 0.7), (2, -1.1), (4, 0.4)];
        let rows = [(0.0, robot.joint_values(&[])), (2.0, robot.joint_values(&given))];
        let columns = JointColumns::new(&robot, &rows);
        let half = given.map(|(joint, value)| (joint, 0.5 * value));
        let id = |name: &str| robot.links.enumerate().find(|(_, link)| link.name == name).unwrap().0;
        let point = DVec3::new(0.03, -0.05, 0.11);
        for (link, body) in
            [("hand", None), ("hand", Some("head")), ("head", Some("hand")), ("arm", Some("forearm"))]
        {
            let place = |joint: usize, more: f64| {
                let moved = half.map(|(own, value)| (own, if own == joint { value + more } else { value }));
                let poses = robot.poses(&robot.joint_values(&moved));
                let poses_before = robot.poses(&robot.joint_values(&half));
                let world = poses_before[id(link)].transform_point3(point);
                let carried = body.map_or(world, |body| {
                    let on_body = poses_before[id(body)].inverse().transform_point3(world);
                    poses[id(body)].transform_point3(on_body)
                });
                poses[id(link)].inverse().transform_point3(carried)
            };
            let found = columns.at(1.0, link, body, point).unwrap();
            for (joint, column) in found.iter().enumerate() {
                let step = 1e-6;
                let needed = (place(joint, step) - place(joint, -step)) / (2.0 * step);
                assert!(column.distance(needed) < 1e-8, "{link}, {body:?}, {joint}: {column} for {needed}");
            }
            assert_eq!(found[0] == DVec3::ZERO, body.is_some(), "the lift carries both");
        }
        assert_eq!(columns.at(1.0, "tail", None, point), None);
        assert_eq!(columns.at(1.0, "hand", Some("tail"), point), None);
        assert_eq!((columns.times(), columns.joints()[0].motion), (Some([0.0, 2.0]), JointMotion::Slides));
    }

    /// Degrees and millimetres are named.
    #[test]
    fn values_of_other_units_are_unlikely() {
        let robot = robot();
        let names = |values: &[(usize, f64)]| {
            let rows = [(0.0, robot.joint_values(values))];
            let unlikely = JointColumns::new(&robot, &rows).unlikely();
            unlikely.into_iter().map(|joint| joint.name).collect::<Vec<_>>()
        };
        assert!(names(&[(0, 0.8), (1, -3.0), (2, 6.2)]).is_empty());
        assert_eq!(names(&[(0, 120.0), (1, -90.0), (2, 1.0)]), ["lift", "shoulder"]);
    }
}
