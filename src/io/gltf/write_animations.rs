//! Writes animations as glTF: times, translations and rotations of the nodes of links.

use gltf::json::{
    Animation, Index, Value,
    animation::{Channel, Interpolation, Property, Sampler, Target},
    validation::Checked,
};

use crate::{
    io::{
        error::Result,
        file::unfit,
        gltf::writer::{SceneWriter, narrow},
    },
    skin::{Motion, MotionFrame, Track},
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
                if nodes.is_empty() || track.times.is_empty() {
                    continue;
                }
                let unfit = |found: &str, needed: &str| {
                    unfit(self.path, format!("animation {name:?}, {link}"), found, needed)
                };
                if track.frame != MotionFrame::Parent {
                    return Err(unfit("poses in the world", "poses relative to the link above"));
                }
                let times = rising(track).ok_or_else(|| unfit("a time", "times that f32 can hold"))?;
                let input = self.array(None, times.iter().map(|t| [*t]));
                let bound = |t: Option<&f32>| t.map(|t| Value::from(vec![f64::from(*t)]));
                let json = &mut self.root.accessors[input.value()];
                (json.min, json.max) = (bound(times.first()), bound(times.last()));
                let places = self.array(None, track.poses.iter().map(|(p, _)| p.to_array().map(narrow)));
                let turns = self.array(None, track.poses.iter().map(|(_, q)| q.to_array().map(narrow)));
                for (output, path) in [(places, Property::Translation), (turns, Property::Rotation)] {
                    #[expect(clippy::cast_possible_truncation, reason = "two for each link")]
                    let sampler = Index::new(samplers.len() as u32);
                    let interpolation = Checked::Valid(Interpolation::Linear);
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
}

/// The times of a track in `f32`, each after the one before it, as glTF has them: where a pose jumps,
/// the jump takes one step of `f32`. `None` if one is too large.
fn rising(track: &Track) -> Option<Vec<f32>> {
    let mut times: Vec<f32> = track.times.iter().map(|&t| narrow(t)).collect();
    let mut next = f32::INFINITY;
    for time in times.iter_mut().rev() {
        *time = time.min(next.next_down());
        next = *time;
    }
    times.iter().all(|t| t.is_finite() && t.abs() < f32::MAX).then_some(times)
}
