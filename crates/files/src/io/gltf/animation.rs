//! Animations: how the links of a robot move.

use std::{collections::BTreeSet, path::Path};

use glam::{DAffine3, DMat3, DQuat, DVec3, DVec4};
use serde::Deserialize;

use crate::id::IdVec;
use crate::io::IoError;
use crate::io::file::Source;
use crate::io::gltf::Notes;
use crate::io::gltf::document::Document;
use crate::io::gltf::nodes::{NodeTree, RIGID, read_node_tree};
use crate::skin::{Curve, Link, LinkId, Motion, MotionFrame, Track, link_names};

#[derive(Deserialize)]
struct AnimationJson {
    channels: Vec<Channel>,
    samplers: Vec<Sampler>,
}

#[derive(Deserialize)]
struct Channel {
    sampler: usize,
    target: TrackTarget,
}

#[derive(Deserialize)]
struct TrackTarget {
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

/// The animated parts of a link's pose.
#[derive(Default, Clone)]
struct Moving {
    translation: Option<Curve<DVec3>>,
    rotation: Option<Curve<DQuat>>,
}

/// Reads the animation called `name` of a glTF file, or its only one, as a motion of the `links` of a
/// map: nodes are found by their names. Returns the names of the nodes that it moves and that are not
/// among them, too.
pub(in crate::io) fn read_animation(
    path: &Path,
    name: Option<&str>,
    links: &IdVec<LinkId, Link>,
) -> Result<(Motion, Vec<String>), IoError> {
    let document = Document::new(Source::open(path)?, Notes::new(true))?;
    let tree = read_node_tree(&document)?;
    let all = listed(&document);
    let at = match name {
        Some(name) => all.iter().position(|(other, _)| other == name),
        None => (all.len() == 1).then_some(0),
    };
    let Some(at) = at else {
        let known = all.iter().map(|(name, _)| name.clone()).collect();
        return Err(IoError::Animation { path: path.into(), wanted: name.map(str::to_owned), known });
    };
    let (moved, others) = motion(&document, &tree, at, all[at].1)?;
    let nodes = &document.root().nodes;
    let name = |node: usize| nodes[node].name.clone().unwrap_or_else(|| format!("node {node}"));
    let mut unknown: Vec<String> = others.into_iter().map(name).collect();
    let (names, map_names) = (link_names(&tree.links), link_names(links));
    let mut motion = Motion::default();
    for (link, track) in moved.tracks() {
        let name = &names[link];
        let invalid = |found: String, needed| Err(document.invalid(format!("node {name:?}"), found, needed));
        match map_names.ids().filter(|&other| map_names[other] == *name).collect::<Vec<_>>()[..] {
            [] => unknown.push(name.clone()),
            [other] if motion.tracks().any(|(known, _)| known == other) => {
                return invalid("another animated node of this name".into(), "a name of its own");
            }
            [other] => {
                let parent = links[other].parent.map(|parent| map_names[parent].as_str());
                let parent = pose_of_parent(
                    &tree,
                    link,
                    &|other| parent == other.map(|other| names[other].as_str()),
                    &moved,
                );
                motion.insert(other, parent.map_or_else(|| track.clone(), |pose| track.seen_from(pose)));
            }
            ref several => {
                return invalid(format!("{} links of this name in the map", several.len()), "one link");
            }
        }
    }
    Ok((motion, unknown))
}

/// The pose of a link's parent in the frame of the one that it has in the map, a link farther above or
/// the world: the map may lack those between them. `None` if that is not above the link, or if one
/// between them moves.
fn pose_of_parent(
    tree: &NodeTree,
    link: LinkId,
    is_parent: &dyn Fn(Option<LinkId>) -> bool,
    moved: &Motion,
) -> Option<DAffine3> {
    let (mut pose, mut above) = (DAffine3::IDENTITY, tree.links[link].parent);
    while !is_parent(above) {
        let between = above.filter(|&between| moved.tracks().all(|(link, _)| link != between))?;
        pose = tree.links[between].pose * pose;
        above = tree.links[between].parent;
    }
    Some(pose)
}

/// All animations, and those that do more than move links with the reason.
pub(super) fn read_animations(document: &Document, tree: &NodeTree) -> (Vec<Motion>, Vec<(String, IoError)>) {
    let (mut animations, mut others) = (Vec::new(), Vec::new());
    for (at, (name, json)) in listed(document).into_iter().enumerate() {
        match motion(document, tree, at, json) {
            Ok((motion, _)) if motion.times().is_none() => {
                let needed = "translations or rotations of nodes of the scene";
                others.push((
                    name,
                    document.invalid(format!("animation {at}"), "nothing that moves a link", needed),
                ));
            }
            Ok((mut motion, _)) => {
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

/// How an animation moves the links of a document, and which nodes it moves that are none: they carry
/// no skin, or do not pose it.
fn motion(
    document: &Document,
    tree: &NodeTree,
    at: usize,
    json: &serde_json::Value,
) -> Result<(Motion, BTreeSet<usize>), IoError> {
    let element = format!("animation {at}");
    let animation = AnimationJson::deserialize(json);
    let animation =
        animation.map_err(|e| document.invalid(&element, e.to_string(), "channels and samplers"))?;
    let mut moving = IdVec::<LinkId, Moving>::filled(Moving::default(), tree.links.len());
    let mut others = BTreeSet::new();
    let twice = |node: usize| {
        document.invalid(&element, format!("two channels for one part of node {node}"), "one for each part")
    };
    // Morph targets are no pose.
    for channel in animation.channels.iter().filter(|channel| channel.target.path != "weights") {
        let Some(node) = channel.target.node else { continue };
        let link = tree.nodes.get(node).ok_or_else(|| {
            let needed = format!("one of the file's {} nodes", tree.nodes.len());
            document.invalid(&element, format!("a channel for node {node}"), needed)
        })?;
        let Some(link) = *link else {
            others.insert(node);
            continue;
        };
        let stretch = tree.stretches_above[node];
        let sampler = animation.samplers.get(channel.sampler);
        let sampler =
            sampler.ok_or_else(|| document.invalid(&element, "a sampler that is not there", "its own"))?;
        match channel.target.path.as_str() {
            "translation" if moving[link].translation.is_some() => return Err(twice(node)),
            "translation" => {
                let build =
                    |t| stretch.map_or(DVec3::from_array(t), |stretch| stretch * DVec3::from_array(t));
                moving[link].translation = Some(curve(document, &element, sampler, build)?);
            }
            "rotation" if moving[link].rotation.is_some() => return Err(twice(node)),
            "rotation" if stretch.is_some_and(|stretch| !is_uniform(stretch)) => {
                return Err(document.unsupported(&element, "animated rotation below an uneven scale"));
            }
            "rotation" => moving[link].rotation = Some(rotations(document, &element, sampler)?),
            other => return Err(document.unsupported(&element, format!("animated {other}").as_str())),
        }
    }
    let mut motion = Motion::default();
    for (link, moving) in moving.enumerate() {
        if let Some(track) = moving.track(tree.links[link].pose) {
            motion.insert(link, track);
        }
    }
    Ok((motion, others))
}

/// Whether a matrix only scales, by the same factor along all axes.
fn is_uniform(stretch: DMat3) -> bool {
    let scale = stretch.x_axis.x;
    scale > 0.0 && stretch.abs_diff_eq(DMat3::IDENTITY * scale, scale * RIGID)
}

/// The rotations of a channel, at its times of unit length.
fn rotations(document: &Document, element: &str, sampler: &Sampler) -> Result<Curve<DQuat>, IoError> {
    let mut curve = curve(document, element, sampler, DQuat::from_array)?;
    for rotation in &mut curve.values {
        let unit = DVec4::from(*rotation).try_normalize();
        let unit =
            unit.ok_or_else(|| document.invalid(element, "a rotation of length 0", "unit quaternions"))?;
        *rotation = DQuat::from_vec4(unit);
    }
    Ok(curve)
}

fn curve<const N: usize, T: Copy>(
    document: &Document,
    element: &str,
    sampler: &Sampler,
    value: impl Fn([f64; N]) -> T,
) -> Result<Curve<T>, IoError> {
    let is_spline = sampler.interpolation == Interpolation::CubicSpline;
    let times = document.accessor(sampler.input, element)?.reals(|[t]: [f64; 1]| t)?;
    let values = document.accessor(sampler.output, element)?.reals(value)?;
    let (each, least) = if is_spline { (3, 2) } else { (1, 1) };
    if values.len() != each * times.len() || times.len() < least || !times.is_sorted_by(|a, b| a < b) {
        let found = format!("{} values at {} times", values.len(), times.len());
        let needed = match is_spline {
            true => "in-tangent, value and out-tangent for each of two or more rising times",
            false => "one value for each of the rising times",
        };
        return Err(document.invalid(element, found, needed));
    }
    Ok(match sampler.interpolation {
        Interpolation::CubicSpline => {
            let (keys, _) = values.as_chunks();
            let (values, slopes) =
                keys.iter().map(|&[arriving, value, leaving]| (value, [arriving, leaving])).unzip();
            Curve { times, values, slopes }
        }
        Interpolation::Step => steps(&times, &values),
        Interpolation::Linear => Curve { times, values, slopes: Vec::new() },
    })
}

/// Each value stays until the next time, where it jumps.
fn steps<T: Copy>(times: &[f64], values: &[T]) -> Curve<T> {
    let starts = times.iter().copied().zip(values.iter().copied());
    let ends = times.iter().copied().skip(1).zip(values.iter().copied());
    Curve::linear(
        starts.zip(ends.map(Some).chain([None])).flat_map(|(start, end)| [Some(start), end]).flatten(),
    )
}

impl Moving {
    /// How a link moves, if it does; the part that is not animated is that of `rest`.
    fn track(&self, rest: DAffine3) -> Option<Track> {
        let starts = self.translation.iter().map(|curve| curve.times[0]);
        let start = starts.chain(self.rotation.iter().map(|curve| curve.times[0])).next()?;
        let rotation = DQuat::from_mat3(&rest.matrix3).normalize();
        let translation = self.translation.clone();
        Some(Track {
            frame: MotionFrame::Parent,
            translation: translation
                .unwrap_or_else(|| Curve::linear([(start, rest.translation)].into_iter())),
            rotation: self.rotation.clone().unwrap_or_else(|| Curve::linear([(start, rotation)].into_iter())),
        })
    }
}
