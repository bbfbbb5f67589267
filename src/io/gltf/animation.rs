//! Animations: how the links of a robot move.

use std::path::Path;

use glam::{DAffine3, DQuat, DVec3};
use serde::Deserialize;

use crate::{
    id::IdVec,
    io::{
        IoError,
        file::source::Source,
        gltf::{
            document::{Document, Role},
            nodes::{Tree, read_node_tree},
            notes::Notes,
        },
    },
    skin::{LinkId, Motion, MotionFrame, link_names},
};

/// What is read of an animation.
#[derive(Deserialize)]
struct AnimationJson {
    channels: Vec<Channel>,
    samplers: Vec<Sampler>,
}

#[derive(Deserialize)]
struct Channel {
    sampler: usize,
    target: Target,
}

#[derive(Deserialize)]
struct Target {
    node: Option<usize>,
    path: String,
}

#[derive(Deserialize)]
struct Sampler {
    input: usize,
    output: usize,
    #[serde(default)]
    interpolation: Interpolation,
}

#[derive(Deserialize, Default, Clone, Copy, PartialEq)]
#[serde(rename_all = "UPPERCASE")]
enum Interpolation {
    #[default]
    Linear,
    Step,
    CubicSpline,
}

/// Values of a channel at its times, in s.
type Keys<T> = Vec<(f64, T)>;

/// The animated parts of a link's pose.
#[derive(Default, Clone)]
struct Moving {
    translation: Keys<DVec3>,
    rotation: Keys<DQuat>,
}

/// Reads the animation called `name` of a glTF file, or its only one, as a motion of the links that
/// `link_named` knows: nodes are found by their names. Nodes that are not known are left out.
pub(in crate::io) fn read_animation(
    path: &Path,
    name: Option<&str>,
    link_named: &dyn Fn(&str) -> Option<LinkId>,
) -> Result<Motion, IoError> {
    let document = Document::new(Source::open(path)?, Notes::new(true))?;
    let tree = read_node_tree(&document)?;
    let all = listed(&document);
    let at = match name {
        Some(name) => all.iter().position(|(other, _)| other == name),
        None => (all.len() == 1).then_some(0),
    };
    let Some(at) = at else {
        let names: Vec<_> = all.iter().map(|(name, _)| name).collect();
        let found = if names.is_empty() { "none".into() } else { format!("those called {names:?}") };
        let needed = name
            .map_or("exactly one, or the name of one of them".into(), |name| format!("one called {name:?}"));
        return Err(document.invalid("animations", found, needed));
    };
    let names = link_names(&tree.links);
    let known = |link: LinkId| link_named(names.get(link)?);
    Ok(motion(&document, &tree, at, all[at].1)?.of_links(known))
}

/// All animations, and those that do more than move links with the reason.
pub(super) fn read_animations(document: &Document, tree: &Tree) -> (Vec<Motion>, Vec<(String, IoError)>) {
    let (mut animations, mut others) = (Vec::new(), Vec::new());
    for (at, (name, json)) in listed(document).into_iter().enumerate() {
        match motion(document, tree, at, json) {
            Ok(mut motion) => {
                motion.name = name;
                animations.push(motion);
            }
            Err(error) => others.push((name, error)),
        }
    }
    (animations, others)
}

/// The animations of a document with their names; one without a name has its number.
fn listed(document: &Document) -> Vec<(String, &serde_json::Value)> {
    let all = document.animations.as_array().map_or(&[][..], Vec::as_slice);
    let named = |(k, json): (usize, &serde_json::Value)| {
        let name = json.get("name").and_then(|name| name.as_str()).filter(|name| !name.is_empty());
        name.map_or_else(|| format!("animation{k}"), str::to_owned)
    };
    all.iter().enumerate().map(|(k, json)| (named((k, json)), json)).collect()
}

/// How an animation moves the links of a document.
fn motion(document: &Document, tree: &Tree, at: usize, json: &serde_json::Value) -> Result<Motion, IoError> {
    let element = format!("animation {at}");
    let animation = AnimationJson::deserialize(json);
    let animation =
        animation.map_err(|e| document.invalid(&element, e.to_string(), "channels and samplers"))?;
    let mut moving = IdVec::<LinkId, Moving>::filled(Moving::default(), tree.links.len());
    for channel in &animation.channels {
        let Some(link) = channel.target.node.and_then(|node| *tree.nodes.get(node)?) else { continue };
        let sampler = animation.samplers.get(channel.sampler);
        let sampler =
            sampler.ok_or_else(|| document.invalid(&element, "a sampler that is not there", "its own"))?;
        match channel.target.path.as_str() {
            "translation" => {
                moving[link].translation = keys(document, &element, sampler, DVec3::from_array)?;
            }
            "rotation" => moving[link].rotation = keys(document, &element, sampler, DQuat::from_array)?,
            // Morph targets are no pose.
            "weights" => {}
            other => {
                return Err(document.unsupported(&element, format!("animated {other}")));
            }
        }
    }
    let mut motion = Motion::default();
    for (link, moving) in
        moving.enumerate().filter(|(_, m)| !m.translation.is_empty() || !m.rotation.is_empty())
    {
        let invalid = |error| document.invalid(&element, format!("{error}"), "rigid poses at finite times");
        motion.set(link, MotionFrame::Parent, &moving.poses(tree.links[link].pose)).map_err(invalid)?;
    }
    Ok(motion)
}

fn keys<const N: usize, T: Copy>(
    document: &Document,
    element: &str,
    sampler: &Sampler,
    value: impl Fn([f64; N]) -> T,
) -> Result<Keys<T>, IoError> {
    if sampler.interpolation == Interpolation::CubicSpline {
        return Err(document.unsupported(element, "cubic splines"));
    }
    let times = document.accessor(sampler.input, Role::Plain, element)?.reals(|[t]: [f64; 1]| t)?;
    let values = document.accessor(sampler.output, Role::Plain, element)?.reals(value)?;
    if times.len() != values.len() || times.is_empty() || !times.is_sorted_by(|a, b| a < b) {
        let found = format!("{} values at {} times", values.len(), times.len());
        return Err(document.invalid(element, found, "one value for each of the rising times"));
    }
    let keys: Keys<T> = times.into_iter().zip(values).collect();
    Ok(match sampler.interpolation {
        // Each value holds until the next time, where it jumps.
        Interpolation::Step => {
            let ends = keys.windows(2).map(|pair| (pair[1].0, pair[0].1));
            keys.iter()
                .copied()
                .zip(ends.map(Some).chain([None]))
                .flat_map(|(a, b)| [Some(a), b])
                .flatten()
                .collect()
        }
        _ => keys,
    })
}

impl Moving {
    /// The poses at the times of both parts; what is not animated is that of `rest`.
    fn poses(&self, rest: DAffine3) -> Vec<(f64, DAffine3)> {
        let mut times: Vec<f64> = self.translation.iter().map(|key| key.0).collect();
        times.extend(self.rotation.iter().map(|key| key.0));
        times.sort_unstable_by(f64::total_cmp);
        // Two of one time are kept where a part jumps.
        let jumps = |t: f64| {
            self.translation.iter().filter(|key| key.0 == t).count() > 1
                || self.rotation.iter().filter(|key| key.0 == t).count() > 1
        };
        times.dedup();
        let rotation = DQuat::from_mat3(&rest.matrix3).normalize();
        let at = |t: f64, is_after: bool| {
            let lerp = |a: DVec3, b: DVec3, s| a.lerp(b, s);
            let slerp = |a: DQuat, b: DQuat, s| a.normalize().slerp(b.normalize(), s).normalize();
            let place = sample(&self.translation, t, is_after, lerp).unwrap_or(rest.translation);
            let turn = sample(&self.rotation, t, is_after, slerp).unwrap_or(rotation);
            (t, DAffine3::from_rotation_translation(turn, place))
        };
        times.iter().flat_map(|&t| jumps(t).then(|| at(t, false)).into_iter().chain([at(t, true)])).collect()
    }
}

/// The value at a time; where it jumps, before the jump or after it.
fn sample<T: Copy>(keys: &Keys<T>, time: f64, is_after: bool, mix: impl Fn(T, T, f64) -> T) -> Option<T> {
    let next = keys.partition_point(|key| key.0 < time || (is_after && key.0 == time));
    let (first, last) = (keys.first()?, keys.last()?);
    let Some(from) = next.checked_sub(1).map(|k| keys[k]) else { return Some(first.1) };
    let Some(to) = keys.get(next) else { return Some(last.1) };
    let span = to.0 - from.0;
    Some(if span > 0.0 { mix(from.1, to.1, (time - from.0) / span) } else { to.1 })
}
