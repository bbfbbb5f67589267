//! How links move: poses at given times, and between them.

use glam::{DAffine3, DQuat, DVec3};

use crate::{
    id::IdVec,
    mesh::is_rigid,
    numeric::argsort,
    skin::{LinkId, SkinError},
};

/// The frame that the poses of a track are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionFrame {
    /// The world.
    World,
    /// The frame of the link's parent.
    Parent,
}

/// The poses of some links over time: translations are interpolated linearly, rotations on the
/// shortest arc; before the first time and after the last one a link keeps its pose. Poses of links
/// that do not exist have no effect.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Motion {
    /// What it is called; may be empty.
    pub name: String,
    tracks: IdVec<LinkId, Option<Track>>,
}

/// The poses of one link.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Track {
    pub(crate) frame: MotionFrame,
    /// Rising, in s; of two equal ones the second holds from there on.
    pub(crate) times: Vec<f64>,
    pub(crate) poses: Vec<(DVec3, DQuat)>,
}

impl Motion {
    /// Gives a link a pose at each of some times (s); poses it had before are forgotten. Times may be
    /// in any order; of two poses at one time the pose jumps from the first to the second.
    ///
    /// # Errors
    /// If a time is not finite or a pose not rigid.
    pub fn set(
        &mut self,
        link: LinkId,
        frame: MotionFrame,
        keys: &[(f64, DAffine3)],
    ) -> Result<(), SkinError> {
        let times: Vec<f64> = keys.iter().map(|key| key.0).collect();
        let keys: Vec<_> = argsort(&times).into_iter().map(|k| keys[k]).collect();
        if !keys.iter().all(|(time, pose)| time.is_finite() && is_rigid(pose)) {
            return Err(SkinError::Pose { link });
        }
        let pose = |pose: DAffine3| (pose.translation, DQuat::from_mat3(&pose.matrix3).normalize());
        let poses = keys.iter().map(|key| pose(key.1)).collect();
        let times = keys.into_iter().map(|(time, _)| time).collect();
        self.insert(link, Track { frame, times, poses });
        Ok(())
    }

    /// The first and the last time of all poses, in s; `None` if there are no poses.
    #[must_use]
    pub fn times(&self) -> Option<[f64; 2]> {
        let tracks = self.tracks.iter().flatten();
        let ends = tracks.filter_map(|track| Some([*track.times.first()?, *track.times.last()?]));
        ends.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
    }

    /// The pose of a link at a time, in s, if it has poses.
    pub(crate) fn pose(&self, link: LinkId, time: f64) -> Option<(MotionFrame, DAffine3)> {
        let track = self.tracks.get(link)?.as_ref()?;
        Some((track.frame, track.at(time)?))
    }

    /// The links that move, by what frame, and at what times (s) they have which poses.
    pub(crate) fn tracks(&self) -> impl Iterator<Item = (LinkId, &Track)> {
        self.tracks.enumerate().filter_map(|(link, track)| Some((link, track.as_ref()?)))
    }

    /// The same motion of links with other numbers, without those that have none.
    pub(crate) fn of_links(&self, other: impl Fn(LinkId) -> Option<LinkId>) -> Self {
        let mut motion = Self { name: self.name.clone(), ..Self::default() };
        for (link, track) in self.tracks() {
            if let Some(link) = other(link) {
                motion.insert(link, track.clone());
            }
        }
        motion
    }

    /// Multiplies all lengths by `metres`.
    pub(super) fn scale(&mut self, metres: f64) {
        for track in self.tracks.iter_mut().flatten() {
            track.poses.iter_mut().for_each(|(position, _)| *position *= metres);
        }
    }

    fn insert(&mut self, link: LinkId, track: Track) {
        while self.tracks.len() <= link.index() {
            self.tracks.push(None);
        }
        self.tracks[link] = Some(track);
    }
}

impl Track {
    fn at(&self, time: f64) -> Option<DAffine3> {
        let next = self.times.partition_point(|&t| t <= time);
        let last = self.poses.len().checked_sub(1)?;
        let (from, to) = (next.saturating_sub(1), next.min(last));
        let ((p, q), (p_next, q_next)) = (self.poses[from], self.poses[to]);
        let span = self.times[to] - self.times[from];
        let share = if span > 0.0 { ((time - self.times[from]) / span).clamp(0.0, 1.0) } else { 0.0 };
        let rotation = if share > 0.0 { q.slerp(q_next, share).normalize() } else { q };
        Some(DAffine3::from_rotation_translation(rotation, p.lerp(p_next, share)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, angle: f64) -> DAffine3 {
        DAffine3::from_rotation_translation(DQuat::from_rotation_z(angle), DVec3::X * x)
    }

    #[test]
    fn poses_between_times_are_interpolated_and_ends_are_held() {
        let mut motion = Motion::default();
        let link = LinkId::new(2);
        let keys =
            [(2.0, pose(1.0, 1.0)), (1.0, pose(0.0, 0.0)), (2.0, pose(5.0, 0.0)), (4.0, pose(7.0, 0.5))];
        motion.set(link, MotionFrame::World, &keys).unwrap();
        assert_eq!(motion.times(), Some([1.0, 4.0]));
        let track = motion.tracks[link].as_ref().unwrap();
        for (time, expected) in [
            (0.0, pose(0.0, 0.0)),
            (1.0, pose(0.0, 0.0)),
            (1.25, pose(0.25, 0.25)),
            (2.0, pose(5.0, 0.0)),
            (3.0, pose(6.0, 0.25)),
            (9.0, pose(7.0, 0.5)),
        ] {
            assert!(track.at(time).unwrap().abs_diff_eq(expected, 1e-12), "at {time}");
        }
        assert!(motion.set(link, MotionFrame::World, &[(f64::NAN, pose(0.0, 0.0))]).is_err());
        assert!(motion.set(link, MotionFrame::World, &[(0.0, DAffine3::ZERO)]).is_err());
    }
}
