//! Motions of links: poses at given times, interpolated between them.

use std::collections::{BTreeMap, HashSet};
use std::ops::{Add, Mul};

use glam::{DAffine3, DQuat, DVec3, DVec4};

use crate::id::IdVec;
use crate::mesh::is_rigid;
use crate::numeric::argsort;
use crate::skin::{LinkId, SkinError};

/// The frame that the poses of a track are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionFrame {
    /// The world.
    World,
    /// The frame of the link's parent.
    Parent,
}

/// The poses of some links over time: translations are interpolated linearly, rotations on the
/// shortest arc, those of glTF files also by cubic splines; before the first time and after the last
/// one a link keeps its pose. Poses of links that do not exist have no effect.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Motion {
    /// Its name; may be empty.
    pub name: String,
    tracks: BTreeMap<LinkId, Track>,
}

#[derive(Debug, Clone, PartialEq)]
#[doc(hidden)]
pub struct Track {
    #[doc(hidden)]
    pub frame: MotionFrame,
    #[doc(hidden)]
    pub translation: Curve<DVec3>,
    #[doc(hidden)]
    pub rotation: Curve<DQuat>,
}

/// Values over time.
#[derive(Debug, Clone, PartialEq)]
#[doc(hidden)]
pub struct Curve<T> {
    /// Ascending, in s; of two equal ones the second applies from there on.
    #[doc(hidden)]
    pub times: Vec<f64>,
    #[doc(hidden)]
    pub values: Vec<T>,
    /// Slopes per s of a cubic spline before and after each time; empty: values are interpolated
    /// linearly.
    #[doc(hidden)]
    pub slopes: Vec<[T; 2]>,
}

impl Motion {
    /// Gives a link a pose at each of these times (s), instead of the poses it had. Times may be in any
    /// order; at a time with two poses the link jumps from the first to the second.
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
        let rotation = |pose: &DAffine3| DQuat::from_mat3(&pose.matrix3).normalize();
        let translation = Curve::linear(keys.iter().map(|(time, pose)| (*time, pose.translation)));
        let rotation = Curve::linear(keys.iter().map(|(time, pose)| (*time, rotation(pose))));
        self.insert(link, Track { frame, translation, rotation });
        Ok(())
    }

    /// The first and the last time of all poses, in s; `None` if there are no poses.
    pub fn times(&self) -> Option<[f64; 2]> {
        let times = self.tracks.values().flat_map(|track| [&track.translation.times, &track.rotation.times]);
        let ends = times.filter_map(|times| Some([*times.first()?, *times.last()?]));
        ends.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
    }

    /// The pose of a link at a time, in s, if it has poses.
    pub(crate) fn pose(&self, link: LinkId, time: f64) -> Option<(MotionFrame, DAffine3)> {
        let track = self.tracks.get(&link)?;
        Some((track.frame, track.at(time)?))
    }

    /// The links that move, with their tracks.
    #[doc(hidden)]
    pub fn tracks(&self) -> impl Iterator<Item = (LinkId, &Track)> {
        self.tracks.iter().map(|(&link, track)| (link, track))
    }

    /// The poses with each link replaced by its entry in `links`; links without an entry are left out.
    pub(super) fn of_links(&self, links: &IdVec<LinkId, LinkId>) -> Self {
        let mut motion = Self { name: self.name.clone(), ..Self::default() };
        let known = self.tracks().filter_map(|(link, track)| Some((*links.get(link)?, track)));
        known.for_each(|(link, track)| motion.insert(link, track.clone()));
        motion
    }

    /// Multiplies all lengths by `metres`.
    pub(super) fn scale(&mut self, metres: f64) {
        for track in self.tracks.values_mut() {
            let Curve { values, slopes, .. } = &mut track.translation;
            values.iter_mut().chain(slopes.as_flattened_mut()).for_each(|vector| *vector *= metres);
        }
    }

    /// Gives a link a track of finite values, with rotations of unit length at its times.
    #[doc(hidden)]
    pub fn insert(&mut self, link: LinkId, track: Track) {
        self.tracks.insert(link, track);
    }
}

/// The links that an animation moves.
pub(super) fn moved_links(animations: &[Motion]) -> HashSet<LinkId> {
    animations.iter().flat_map(Motion::tracks).map(|(link, _)| link).collect()
}

impl Track {
    /// The poses in the frame in which the frame of the track has this pose.
    #[doc(hidden)]
    pub fn seen_from(&self, pose: DAffine3) -> Self {
        let turn = DQuat::from_mat3(&pose.matrix3).normalize();
        let (translation, rotation) = (&self.translation, &self.rotation);
        Self {
            frame: self.frame,
            translation: translation.map(|x| pose.transform_point3(x), |x| pose.transform_vector3(x)),
            rotation: rotation.map(|q| turn * q, |q| turn * q),
        }
    }

    fn at(&self, time: f64) -> Option<DAffine3> {
        let rotation = self.rotation.at(time, DQuat::slerp)?;
        // A spline of rotations may pass through zero, where it has no direction.
        let unit = DVec4::from(rotation).try_normalize().map_or(DQuat::IDENTITY, DQuat::from_vec4);
        Some(DAffine3::from_rotation_translation(unit, self.translation.at(time, DVec3::lerp)?))
    }
}

impl<T: Copy> Curve<T> {
    #[doc(hidden)]
    pub fn linear(keys: impl Iterator<Item = (f64, T)>) -> Self {
        let (times, values) = keys.unzip();
        Self { times, values, slopes: Vec::new() }
    }

    /// Applies one function to the values and another to their slopes.
    fn map(&self, value: impl Fn(T) -> T, slope: impl Fn(T) -> T) -> Self {
        Self {
            times: self.times.clone(),
            values: self.values.iter().map(|&x| value(x)).collect(),
            slopes: self.slopes.iter().map(|pair| pair.map(&slope)).collect(),
        }
    }

    /// The value at a time; `mix` interpolates between two times without a spline.
    fn at(&self, time: f64, mix: impl Fn(T, T, f64) -> T) -> Option<T>
    where
        T: Add<Output = T> + Mul<f64, Output = T>,
    {
        let next = self.times.partition_point(|&t| t <= time);
        let last = self.values.len().checked_sub(1)?;
        let (from, to) = (next.saturating_sub(1), next.min(last));
        let span = self.times[to] - self.times[from];
        let share = if span > 0.0 { ((time - self.times[from]) / span).clamp(0.0, 1.0) } else { 0.0 };
        let (a, b) = (self.values[from], self.values[to]);
        Some(match (self.slopes.get(from), self.slopes.get(to)) {
            _ if share == 0.0 => a,
            (Some([_, leaving]), Some([arriving, _])) => {
                hermite([a, b], [*leaving * span, *arriving * span], share)
            }
            _ => mix(a, b, share),
        })
    }
}

/// The cubic between two values whose slopes are per unit of `share`, 0 to 1 (glTF 2.0, appendix C.5).
fn hermite<T: Add<Output = T> + Mul<f64, Output = T>>(
    [a, b]: [T; 2],
    [leaving, arriving]: [T; 2],
    share: f64,
) -> T {
    let (square, cube) = (share * share, share * share * share);
    a * (2.0 * cube - 3.0 * square + 1.0)
        + leaving * (cube - 2.0 * square + share)
        + b * (3.0 * square - 2.0 * cube)
        + arriving * (cube - square)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, angle: f64) -> DAffine3 {
        DAffine3::from_rotation_translation(DQuat::from_rotation_z(angle), DVec3::X * x)
    }

    #[test]
    fn poses_are_interpolated_and_constant_beyond_the_ends() {
        let mut motion = Motion::default();
        // Allocates nothing for the links before it.
        let link = LinkId::from(4_000_000_000);
        let keys =
            [(2.0, pose(1.0, 1.0)), (1.0, pose(0.0, 0.0)), (2.0, pose(5.0, 0.0)), (4.0, pose(7.0, 0.5))];
        motion.set(link, MotionFrame::World, &keys).unwrap();
        assert_eq!(motion.times(), Some([1.0, 4.0]));
        let track = &motion.tracks[&link];
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

    fn spline<T>(keys: [(f64, T, [T; 2]); 2]) -> Curve<T> {
        let (mut times, mut values, mut slopes) = (Vec::new(), Vec::new(), Vec::new());
        for (time, value, slope) in keys {
            times.push(time);
            values.push(value);
            slopes.push(slope);
        }
        Curve { times, values, slopes }
    }

    /// A cubic is its own Hermite interpolant, so a spline with the slopes of a line is that line.
    #[test]
    fn splines_reproduce_lines_and_cubics() {
        let line = |t: f64| DVec3::new(1.0 + 2.0 * t, -t, 0.5);
        let cubic = |t: f64| DVec3::splat(t * t * t - 2.0 * t);
        let no = DVec3::splat(f64::MAX);
        let along = spline([
            (2.0, line(2.0), [no, line(1.0) - line(0.0)]),
            (6.0, line(6.0), [line(1.0) - line(0.0), no]),
        ]);
        let slope = |t: f64| DVec3::splat(3.0 * t * t - 2.0);
        let bent = spline([(2.0, cubic(2.0), [no, slope(2.0)]), (6.0, cubic(6.0), [slope(6.0), no])]);
        for time in [2.0, 2.5, 4.0, 5.75, 6.0] {
            for (curve, expected) in [(&along, line(time)), (&bent, cubic(time))] {
                let found = curve.at(time, DVec3::lerp).unwrap();
                assert!(found.distance(expected) < 1e-11, "{found}, not {expected}, at {time} s");
            }
        }
        for (time, held) in [(0.0, 2.0), (9.0, 6.0)] {
            assert_eq!(bent.at(time, DVec3::lerp), Some(cubic(held)), "the end is held at {time} s");
        }
    }

    /// Halfway the weights are 1/2, 1/2, 1/8 and -1/8 of the interval, 4 s.
    #[test]
    fn rotations_of_splines_have_unit_length() {
        let (z, none) = (DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0), DQuat::from_xyzw(0.0, 0.0, 0.0, 1.0));
        let zero = z * 0.0;
        let leaving = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
        let translation = Curve::linear([(0.0, DVec3::ZERO)].into_iter());
        let rotation = spline([(1.0, none, [zero, leaving]), (5.0, z, [zero, zero])]);
        let mut track = Track { frame: MotionFrame::World, translation, rotation };
        let expected = DQuat::from_xyzw(0.5, 0.0, 0.5, 0.5).normalize();
        let found = track.at(3.0).unwrap();
        assert!(found.abs_diff_eq(DAffine3::from_quat(expected), 1e-12), "{found}");
        track.rotation = spline([(1.0, none, [zero; 2]), (5.0, -none, [zero; 2])]);
        assert!(is_rigid(&track.at(3.0).unwrap()), "where the spline is zero");
    }
}
