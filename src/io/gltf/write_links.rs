//! The links of a skin as a scene.

use std::path::Path;

use glam::DQuat;
use gltf::json::{Index, Node, Scene, scene::UnitQuaternion};

use crate::{
    id::IdVec,
    io::{
        IoError,
        file::unfit,
        gltf::{
            transform::RIGID,
            writer::{SceneWriter, narrow},
        },
    },
    mesh::rotation_defect,
    skin::{Link, LinkId},
};

/// Adds a scene with a node for each link that `wanted` names, and `patches` (links and the nodes
/// of what hangs on them) under their links.
pub(super) fn add_scene(
    path: &Path,
    writer: &mut SceneWriter,
    name: Option<String>,
    links: &IdVec<LinkId, Link>,
    wanted: &IdVec<LinkId, bool>,
    patches: Vec<(LinkId, Node)>,
) -> Result<(), IoError> {
    let mut nodes = IdVec::<LinkId, Option<Index<Node>>>::filled(None, links.len());
    let mut roots = Vec::new();
    for (link, description) in links.enumerate().filter(|(link, _)| wanted[*link]) {
        let node = writer.root.push(node_of(path, link, description)?);
        nodes[link] = Some(node);
        match description.parent.and_then(|p| nodes.get(p).copied().flatten()) {
            Some(parent) => writer.root.nodes[parent.value()].children.get_or_insert_default().push(node),
            None if description.parent.is_some() => {
                return refuse(path, link, "a parent after it", "a parent before it");
            }
            None => roots.push(node),
        }
    }
    for (link, patch) in patches {
        let Some(parent) = nodes.get(link).copied().flatten() else {
            return refuse(path, link, "a patch, but no link of this number", "one of the skin's links");
        };
        let node = writer.root.push(patch);
        writer.root.nodes[parent.value()].children.get_or_insert_default().push(node);
    }
    writer.root.push(Scene { extensions: None, extras: None, name, nodes: roots });
    Ok(())
}

fn refuse<T>(path: &Path, link: LinkId, found: &str, needed: &str) -> Result<T, IoError> {
    Err(unfit(path, format!("link {link}"), found, needed))
}

/// The node of a link: name, translation and rotation, each left out where it says nothing.
fn node_of(path: &Path, link: LinkId, description: &Link) -> Result<Node, IoError> {
    let Link { name, pose, .. } = description;
    let axes = pose.matrix3;
    if !pose.is_finite() || rotation_defect(&axes) > RIGID || axes.determinant() < 0.0 {
        return refuse(path, link, "a pose that is not rigid", "rotation and translation");
    }
    let translation = pose.translation.to_array().map(narrow);
    let rotation = DQuat::from_mat3(&axes).normalize().to_array().map(narrow);
    Ok(Node {
        name: (!name.is_empty()).then(|| name.clone()),
        translation: (translation != [0.0; 3]).then_some(translation),
        rotation: (rotation != [0.0, 0.0, 0.0, 1.0]).then_some(UnitQuaternion(rotation)),
        ..Node::default()
    })
}
