//! The poses of the links: forward kinematics; and taxels that are given as links.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3};

use crate::id::IdVec;
use crate::numeric::argsort;
use crate::robot::{Joint, JointKind, Robot};
use crate::skin::{
    Link, LinkId, Motion, MotionFrame, Remark, RemarkKind, Sheet, SkinError, TaxelId, link_names,
};

/// Most rotation of a joint between two poses of its link, in rad: a rotation is interpolated on the shorter arc.
const MAX_TURN: f64 = std::f64::consts::FRAC_PI_2;

/// As [`MAX_TURN`], where the origin of the link moves on an arc: its positions are interpolated linearly, so
/// its path is a polygon that is 0.03 % of the radius off.
const MAX_TURN_ON_ARC: f64 = 0.05;

/// Most poses that are inserted between two rows for the sake of arcs; never so few that a step exceeds [`MAX_TURN`].
const MAX_STEPS_ON_ARC: f64 = 64.0;

/// Most turn of a joint between two rows, in rad: 16,000 turns, of which each takes four poses.
const MAX_TURN_OF_ROW: f64 = 1e5;

impl Joint {
    /// Its motion, in the frame of its link at value 0; a joint without a value does not move.
    pub fn moved(&self, value: f64) -> DAffine3 {
        match self.kind {
            JointKind::Revolute | JointKind::Continuous => {
                let turn = DMat3::from_axis_angle(self.axis, value);
                DAffine3::from_mat3_translation(turn, self.anchor - turn * self.anchor)
            }
            JointKind::Prismatic => DAffine3::from_translation(self.axis * value),
            JointKind::Fixed | JointKind::Floating | JointKind::Ball | JointKind::Planar => {
                DAffine3::IDENTITY
            }
        }
    }
}

impl Robot {
    /// Its links where every joint is at 0; joints that follow others have the values that result.
    pub fn rest(&self) -> IdVec<LinkId, Link> {
        let mut links = self.links.clone();
        for (joint, value) in self.joints.iter().zip(self.joint_values(&[])) {
            let pose = &mut links[joint.link].pose;
            *pose *= joint.moved(value);
        }
        links
    }

    /// Adds a remark on a link whose description is read only partly.
    #[doc(hidden)]
    pub fn pass_over(&mut self, link: LinkId, what: String) {
        let patch = self.links[link].name.clone();
        self.remarks.push(Remark { patch, kind: RemarkKind::PassedOver { what } });
    }

    /// The values of all joints, in rad or m, from given ones (index in [`Robot::joints`], value): the others
    /// are 0, and a joint that follows another has the value that results, even if one is given for it.
    ///
    /// # Panics
    /// If an index is not that of a joint.
    pub fn joint_values(&self, given: &[(usize, f64)]) -> Vec<f64> {
        let mut own = vec![0.0; self.joints.len()];
        given.iter().for_each(|&(joint, value)| own[joint] = value);
        let value = |joint: usize| {
            let (mut at, mut multiplier, mut offset) = (joint, 1.0, 0.0);
            // A chain of followers is no longer than there are joints, if it has an end.
            for _ in 0..self.joints.len() {
                let Some(mimic) = &self.joints[at].mimic else { break };
                offset += multiplier * mimic.offset;
                multiplier *= mimic.multiplier;
                at = mimic.joint;
            }
            multiplier * own[at] + offset
        };
        (0..self.joints.len()).map(value).collect()
    }

    /// The joints whose values are beyond their limits.
    pub fn beyond_limits<'a>(&'a self, values: &'a [f64]) -> impl Iterator<Item = (&'a Joint, f64)> {
        let joints = self.joints.iter().zip(values.iter().copied());
        joints.filter(|(joint, value)| joint.limits.is_some_and(|[low, high]| !(low..=high).contains(value)))
    }

    /// The poses of all links in the frame of the first, where each joint has its value (rad or m).
    ///
    /// # Panics
    /// If there are fewer values than joints.
    pub fn poses(&self, values: &[f64]) -> IdVec<LinkId, DAffine3> {
        let mut poses = IdVec::default();
        for (id, link) in self.links.enumerate() {
            let moved =
                self.joint_of(id).map_or(DAffine3::IDENTITY, |joint| self.joints[joint].moved(values[joint]));
            let above = link.parent.map_or(DAffine3::IDENTITY, |parent| poses[parent]);
            poses.push(above * link.pose * moved);
        }
        poses
    }

    /// The index of the joint between a link and its parent.
    fn joint_of(&self, link: LinkId) -> Option<usize> {
        let place = self.joints.partition_point(|joint| joint.link < link);
        self.joints.get(place).is_some_and(|joint| joint.link == link).then_some(place)
    }

    /// Adds a taxel for each link with a fixed joint whose name `is_taxel` accepts; robots without `<sensor>`
    /// describe taxels so. The taxel is at the origin of the link, with its z axis as the normal and its x
    /// axis as the tangent, on the nearest ancestor that is not a taxel. The taxels on a link are a sheet
    /// with its name; their ids count from 1 in the order of the links. Returns their number.
    pub fn add_taxels(&mut self, is_taxel: impl Fn(&str) -> bool) -> usize {
        // The link that carries each link, and its pose there.
        let mut carried: IdVec<LinkId, (LinkId, DAffine3)> = IdVec::default();
        let mut taxels: BTreeMap<LinkId, Vec<(TaxelId, DAffine3)>> = BTreeMap::new();
        let mut id = 0;
        for (own, link) in self.links.enumerate() {
            let is_fixed = self.joint_of(own).is_some_and(|k| self.joints[k].kind == JointKind::Fixed);
            let Some(parent) = link.parent.filter(|_| is_fixed && is_taxel(&link.name)) else {
                carried.push((own, DAffine3::IDENTITY));
                continue;
            };
            let (carrier, pose) = carried[parent];
            let pose = pose * link.pose;
            carried.push((carrier, pose));
            id += 1;
            taxels.entry(carrier).or_default().push((TaxelId(id), pose));
        }
        for (link, taxels) in taxels {
            self.sensors.push(taxel_sheet(self.links[link].name.clone(), link, &taxels));
        }
        id as usize
    }

    /// The motion of the links of a skin or a map, found by their names, from values of the joints at times
    /// (s). Between two times the values of joints are interpolated, not the poses: a joint from 0 to 4 rad
    /// turns by 4 rad. Poses are exact where a link has the same parent there and turns around its origin,
    /// else approximate.
    ///
    /// # Errors
    /// If a time or a value is not finite, or a joint turns by more than 1e5 rad between two rows.
    pub fn motion(&self, rows: &[(f64, Vec<f64>)], links: &IdVec<LinkId, Link>) -> Result<Motion, SkinError> {
        let known: std::collections::HashMap<&str, LinkId> =
            self.links.enumerate().map(|(id, link)| (&*link.name, id)).collect();
        let order = argsort(&rows.iter().map(|(time, _)| *time).collect::<Vec<_>>());
        let rows: Vec<&(f64, Vec<f64>)> = order.into_iter().map(|row| &rows[row]).collect();
        let names = link_names(links);
        let mut motion = Motion::default();
        for (id, link) in links.enumerate() {
            let Some(&own) = known.get(&*names[id]) else { continue };
            let parent = self.links[own].parent;
            let is_same =
                parent.map(|parent| &self.links[parent].name) == link.parent.map(|parent| &names[parent]);
            let frame = if is_same { MotionFrame::Parent } else { MotionFrame::World };
            // Around another point than its origin the link moves on an arc, too.
            let is_centred = self.joint_of(own).is_none_or(|joint| self.joints[joint].anchor == DVec3::ZERO);
            let max_turn = if is_same && is_centred { MAX_TURN } else { MAX_TURN_ON_ARC };
            // The links whose joints move it in that frame, from the root on.
            let mut chain: Vec<LinkId> =
                std::iter::successors(Some(own), |&link| self.links[link].parent.filter(|_| !is_same))
                    .collect();
            chain.reverse();
            let pose = |values: &[f64]| {
                chain.iter().fold(DAffine3::IDENTITY, |above, &link| {
                    let moved = self.joint_of(link).map(|joint| self.joints[joint].moved(values[joint]));
                    above * self.links[link].pose * moved.unwrap_or(DAffine3::IDENTITY)
                })
            };
            let mut keys: Vec<(f64, DAffine3)> = Vec::with_capacity(rows.len());
            for (k, (time, values)) in rows.iter().enumerate() {
                keys.push((*time, pose(values)));
                let Some((end, next)) = rows.get(k + 1) else { break };
                let turns = chain.iter().filter_map(|&link| self.joint_of(link)).filter(|&joint| {
                    matches!(self.joints[joint].kind, JointKind::Revolute | JointKind::Continuous)
                });
                let turn = turns.map(|joint| (next[joint] - values[joint]).abs()).fold(0.0, f64::max);
                if turn > MAX_TURN_OF_ROW && time < end {
                    return Err(SkinError::Turn { link: id, found: turn, most: MAX_TURN_OF_ROW });
                }
                let steps = (turn / max_turn).min(MAX_STEPS_ON_ARC).max(turn / MAX_TURN).ceil();
                let mut step = 1.0;
                while step < steps && time < end {
                    let share = step / steps;
                    let between = |(a, b): (&f64, &f64)| a + share * (b - a);
                    let values: Vec<f64> = values.iter().zip(next).map(between).collect();
                    keys.push((between((time, end)), pose(&values)));
                    step += 1.0;
                }
            }
            motion.set(id, frame, &keys)?;
        }
        Ok(motion)
    }
}

/// A sheet of taxels without triangles from their poses: z axis the normal, x axis the tangent.
#[doc(hidden)]
pub fn taxel_sheet(name: String, link: LinkId, taxels: &[(TaxelId, DAffine3)]) -> Sheet {
    Sheet {
        name,
        link: Some(link),
        ids: Some(taxels.iter().map(|(id, _)| *id).collect()),
        positions: taxels.iter().map(|(_, pose)| pose.translation).collect(),
        normals: Some(taxels.iter().map(|(_, pose)| pose.matrix3.z_axis).collect()),
        tangents: Some(taxels.iter().map(|(_, pose)| pose.matrix3.x_axis).collect()),
        ..Sheet::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(name: &str, parent: Option<LinkId>) -> Link {
        Link { name: name.into(), parent, pose: DAffine3::IDENTITY }
    }

    /// A joint from 0 to 4 rad turns by 4 rad, not by the shorter arc back; exactly in the frame of its parent,
    /// approximately in the world.
    #[test]
    fn joints_move_evenly_between_rows() {
        let root = LinkId::new(0);
        let wheel = LinkId::new(1);
        let mut robot =
            Robot { links: vec![link("base", None), link("wheel", Some(root))].into(), ..Robot::default() };
        robot.joints.push(Joint {
            name: "axle".into(),
            link: wheel,
            kind: JointKind::Continuous,
            axis: DVec3::Z,
            anchor: DVec3::ZERO,
            limits: None,
            mimic: None,
        });
        // More than 64 steps of a quarter turn between two rows.
        let far = robot.motion(&[(0.0, vec![0.0]), (1.0, vec![300.0])], &robot.links).unwrap();
        for time in [0.25, 0.5, 0.75] {
            let (_, pose) = far.pose(wheel, time).unwrap();
            assert!(pose.abs_diff_eq(DAffine3::from_rotation_z(300.0 * time), 1e-9), "{pose} at {time} s");
        }
        let too_far = robot.motion(&[(0.0, vec![0.0]), (1.0, vec![1e9])], &robot.links);
        assert!(matches!(too_far, Err(SkinError::Turn { most: MAX_TURN_OF_ROW, .. })));
        let rows = [(1.0, vec![4.0]), (0.0, vec![0.0])];
        let alone = vec![link("other", None), link("wheel", None)].into();
        for (links, frame, tolerance) in
            [(&robot.links, MotionFrame::Parent, 1e-12), (&alone, MotionFrame::World, 1e-3)]
        {
            let motion = robot.motion(&rows, links).unwrap();
            for time in [0.0, 0.2, 0.5, 0.77, 1.0] {
                let (found_frame, pose) = motion.pose(wheel, time).unwrap();
                let expected = DAffine3::from_rotation_z(4.0 * time);
                assert_eq!(found_frame, frame);
                assert!(pose.abs_diff_eq(expected, tolerance), "{frame:?} at {time} s: {pose}");
            }
        }
    }
}
