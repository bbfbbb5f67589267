//! Writes animations as glTF: times, translations and rotations of the nodes of links.

use gltf::json::animation::{Channel, Interpolation, Property, Sampler, Target};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Animation, Index, Value};

use crate::{
    io::{error::Result, file::unfit, gltf::writer::SceneWriter},
    numeric::narrow,
    skin::{Curve, Motion, MotionFrame},
};

impl SceneWriter<'_> {
    /// Adds the animations of the links that have a node in some scene.
    pub(super) fn add_animations(&mut self, animations: &[Motion]) -> Result<()> {
        for motion in animations {
            let name = &motion.name;
            let (mut channels, mut samplers) = (Vec::new(), Vec::new());
            for (link, track) in motion.tracks() {
                let nodes: Vec<_> = self
                    .link_nodes
                    .iter()
                    .filter(|(other, _)| *other == link)
                    .map(|(_, node)| *node)
                    .collect();
                if nodes.is_empty() || track.translation.times.is_empty() {
                    continue;
                }
                let unfit = |found: &str, needed: &str| {
                    unfit(self.path, format!("animation {name:?}, {link}"), found, needed)
                };
                if track.frame != MotionFrame::Parent {
                    return Err(unfit("poses in the world", "poses relative to the link above"));
                }
                let (places, turns) = (&track.translation, &track.rotation);
                let no_f32 = || unfit("a time", "times within the range of f32");
                let input = self.add_times(&places.times).ok_or_else(no_f32)?;
                let places =
                    (input, self.add_values(places, |p| p.to_array().map(narrow)), interpolation(places));
                let input = match turns.times == track.translation.times {
                    true => input,
                    false => self.add_times(&turns.times).ok_or_else(no_f32)?,
                };
                let turns =
                    (input, self.add_values(turns, |q| q.to_array().map(narrow)), interpolation(turns));
                let parts = [(places, Property::Translation), (turns, Property::Rotation)];
                for ((input, output, interpolation), path) in parts {
                    #[expect(clippy::cast_possible_truncation, reason = "two for each link")]
                    let sampler = Index::new(samplers.len() as u32);
                    let interpolation = Checked::Valid(interpolation);
                    samplers.push(Sampler { input, output, interpolation, extensions: None, extras: None });
                    channels.extend(nodes.iter().map(|&node| {
                        let path = Checked::Valid(path);
                        let target = Target { node, path, extensions: None, extras: None };
                        Channel { sampler, target, extensions: None, extras: None }
                    }));
                }
            }
            // glTF has no empty lists.
            if !channels.is_empty() {
                let name = Some(name.clone());
                self.root.push(Animation { name, channels, samplers, extensions: None, extras: None });
            }
        }
        Ok(())
    }

    /// Adds times with their bounds; `None` if one is not an `f32`.
    fn add_times(&mut self, times: &[f64]) -> Option<Index<Accessor>> {
        let times = rising(times)?;
        let input = self.array(None, times.iter().map(|t| [*t]));
        let bound = |t: Option<&f32>| t.map(|t| Value::from(vec![f64::from(*t)]));
        let json = &mut self.root.accessors[input.value()];
        (json.min, json.max) = (bound(times.first()), bound(times.last()));
        Some(input)
    }

    /// Adds the values of a curve; those of a spline between the slopes before and after each.
    fn add_values<T: Copy, const N: usize>(
        &mut self,
        curve: &Curve<T>,
        row: impl Fn(T) -> [f32; N],
    ) -> Index<Accessor> {
        if curve.slopes.is_empty() {
            return self.array(None, curve.values.iter().map(|&value| row(value)));
        }
        let keys = curve.values.iter().zip(&curve.slopes);
        let rows: Vec<_> =
            keys.flat_map(|(&value, &[before, after])| [before, value, after].map(&row)).collect();
        self.array(None, rows.into_iter())
    }
}

fn interpolation<T>(curve: &Curve<T>) -> Interpolation {
    if curve.slopes.is_empty() { Interpolation::Linear } else { Interpolation::CubicSpline }
}

/// The times of a curve in `f32`, each after the one before it, as glTF has them: where a pose jumps,
/// the jump takes one step of `f32`. `None` if one is too large.
fn rising(times: &[f64]) -> Option<Vec<f32>> {
    let mut times: Vec<f32> = times.iter().map(|&t| narrow(t)).collect();
    let mut next = f32::INFINITY;
    for time in times.iter_mut().rev() {
        *time = time.min(next.next_down());
        next = *time;
    }
    times.iter().all(|t| t.is_finite() && t.abs() < f32::MAX).then_some(times)
}
