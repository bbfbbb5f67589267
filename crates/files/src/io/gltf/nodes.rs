//! The node tree: links with their rigid poses, and the meshes on them.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, DVec4};
use gltf::json::Node;

use crate::id::IdVec;
use crate::io::error::Result;
use crate::io::gltf::NodeExtras;
use crate::io::gltf::document::Document;
use crate::io::gltf::json::Transform;
use crate::skin::{Link, LinkId};

/// A matrix whose columns are orthonormal to this much is taken for a rotation: f32 rounding leaves
/// about 1e-7, and a quaternion is no more precise.
pub(super) const RIGID: f64 = 1e-6;
/// How far a quaternion may be from unit length; the Khronos validator allows as much.
const UNIT_ROTATION: f64 = 5e-5;
/// A quaternion written with two decimals is this far from unit length at most: it is normalised,
/// with a note.
const ROUNDED_ROTATION: f64 = 0.01;
/// Largest cosine between the axes of a node's matrix: more is shear, which glTF forbids.
const SHEAR: f64 = 1e-4;

/// One use of a mesh by a node of the scene.
#[derive(Debug)]
pub(super) struct Placement {
    pub(super) mesh: usize,
    /// Whether morph targets have a weight: that of the node, or else of the mesh.
    pub(super) is_morphed: bool,
    pub(super) link: LinkId,
    pub(super) name: String,
    /// What the node's transform has besides the link's rigid frame: scale, or a mirror.
    pub(super) stretch: Option<DMat3>,
    /// The skin that joins the mesh to its joints.
    pub(super) skin: Option<usize>,
    /// Whether the link of a skinned mesh has been made for it, at the pose of the skin.
    pub(super) is_free: bool,
}

#[derive(Debug, Default)]
pub(super) struct NodeTree {
    pub(super) links: IdVec<LinkId, Link>,
    pub(super) placements: Vec<Placement>,
    pub(super) nodes: Vec<Option<LinkId>>,
    /// What the transform of each node has besides the rigid pose of its link.
    pub(super) stretches: Vec<Option<DMat3>>,
    /// What the transforms above each node have besides the rigid frame of the link there.
    pub(super) stretches_above: Vec<Option<DMat3>>,
}

/// Reads the node tree of the scene.
///
/// Every node is a link, except those that only carry a patch: a node with a mesh, without children,
/// without a transform of its own and not animated belongs to the link above it. (Cameras and lights
/// at the ends are left out.) A link's pose is rigid; scale and mirrors go into the positions. A mesh that is
/// skinned to joints ignores its node's transform, as glTF has it, and lies in its bind pose on a
/// link of its own at the origin, unless [`Binding`](super::joints::Binding) has another pose, or
/// [`NodeExtras`] name its link; its node is a second link only if it has children, is animated or is a
/// joint.
///
/// The scene is the default scene, else the first. A file without scenes is a library: its root
/// nodes count as the scene, and meshes that no node carries lie on a link at the origin.
pub(super) fn read_node_tree(document: &Document) -> Result<NodeTree> {
    let parents = parents(document)?;
    let (shown, animated, joints) = (shown(document, &parents), animated(document), joints(document));
    let nodes = Nodes { document, parents, shown, animated, joints };
    let mut tree = NodeTree::default();
    let frames = nodes.read_links(&mut tree)?;
    nodes.read_placements(&frames, &mut tree);
    let above = |parent: &Option<usize>| parent.and_then(|parent| frames[parent]?.stretch);
    tree.stretches = frames.iter().map(|frame| frame.and_then(|frame| frame.stretch)).collect();
    tree.stretches_above = nodes.parents.iter().map(above).collect();
    tree.nodes = frames.into_iter().map(|frame| frame.map(|frame| frame.link)).collect();
    if document.root().scenes.is_empty() {
        place_library(document, &mut tree);
    }
    Ok(tree)
}

/// The nodes of a document, known to be a forest.
struct Nodes<'a> {
    document: &'a Document,
    parents: Vec<Option<usize>>,
    shown: Vec<bool>,
    animated: Vec<bool>,
    joints: Vec<bool>,
}

impl Nodes<'_> {
    /// Whether a node only carries a patch.
    fn is_patch(&self, i: usize) -> bool {
        let node = &self.document.root().nodes[i];
        let has_parent = self.parents[i].is_some_and(|parent| self.shown[parent]);
        let is_bare = is_end(node) && node.skin.is_none();
        let is_plain = is_bare && is_identity(&self.document.transforms[i]) && !self.animated[i];
        node.mesh.is_some() && has_parent && is_plain
    }

    /// Whether a node is a camera or a light at an end of the tree.
    fn is_ornament(&self, i: usize) -> bool {
        const LIGHTS: &str = "KHR_lights_punctual";
        let node = &self.document.root().nodes[i];
        let is_plain = is_end(node) && node.mesh.is_none();
        let is_light = node.extensions.as_ref().is_some_and(|e| e.others.contains_key(LIGHTS));
        is_plain && (node.camera.is_some() || is_light)
    }

    /// Whether a node only carries a mesh that follows joints, and so ignores the node's transform.
    fn is_bent(&self, i: usize) -> bool {
        let node = &self.document.root().nodes[i];
        let is_skinned = node.mesh.is_some() && node.skin.is_some();
        is_skinned && is_end(node) && !self.animated[i] && !self.joints[i]
    }

    /// The node whose link a skinned patch of our own files is given in.
    fn carrier(&self, i: usize) -> Option<usize> {
        let node = &self.document.root().nodes[i];
        let NodeExtras::Link(link) = NodeExtras::of(node)? else { return None };
        let is_patch = node.skin.is_some() && node.mesh.is_some() && is_end(node);
        let is_link = |link: &usize| {
            let other = self.document.root().nodes.get(*link);
            let is_rigid = other.is_some_and(|other| other.skin.is_none() && NodeExtras::of(other).is_none());
            is_rigid && self.shown[*link] && !self.is_patch(*link) && !self.is_ornament(*link)
        };
        Some(link).filter(|link| is_patch && is_link(link))
    }

    /// Whether a node only joins links.
    fn is_root(&self, i: usize) -> bool {
        let node = &self.document.root().nodes[i];
        let is_still = is_identity(&self.document.transforms[i]) && !self.animated[i];
        let is_bare = node.mesh.is_none() && is_still;
        self.parents[i].is_none() && is_bare && NodeExtras::of(node) == Some(NodeExtras::Root)
    }

    /// Adds the links of the scene, parents first; returns the frame of each node.
    fn read_links(&self, tree: &mut NodeTree) -> Result<Vec<Option<NodeFrame>>> {
        let nodes = &self.document.root().nodes;
        let mut frames: Vec<Option<NodeFrame>> = vec![None; nodes.len()];
        let roots = (0..nodes.len())
            .filter(|&i| self.shown[i] && self.parents[i].is_none_or(|parent| !self.shown[parent]));
        let mut ready: BinaryHeap<_> = roots.map(Reverse).collect();
        while let Some(Reverse(i)) = ready.pop() {
            if self.is_root(i) {
                ready.extend(children(&nodes[i]).map(Reverse));
                continue;
            }
            if self.is_patch(i) || self.is_ornament(i) || self.carrier(i).is_some() {
                continue;
            }
            let above = self.parents[i].and_then(|p| frames[p]);
            let (pose, stretch) = rigid_pose(self.document, i, above.and_then(|f| f.stretch))?;
            if self.is_bent(i) {
                continue;
            }
            let name = nodes[i].name.clone().unwrap_or_default();
            let link = tree.links.push(Link { name, parent: above.map(|f| f.link), pose });
            frames[i] = Some(NodeFrame { link, stretch });
            ready.extend(children(&nodes[i]).map(Reverse));
        }
        Ok(frames)
    }

    /// Adds the uses of meshes, in the order of the file.
    fn read_placements(&self, frames: &[Option<NodeFrame>], tree: &mut NodeTree) {
        let root = self.document.root();
        for (i, node) in root.nodes.iter().enumerate().filter(|(i, _)| self.shown[*i]) {
            let Some(mesh) = node.mesh.map(|mesh| mesh.value()) else { continue };
            let named = self.carrier(i);
            let carrier = if self.is_patch(i) { self.parents[i] } else { named.or(Some(i)) };
            let (name, is_free) = (self.patch_name(i, mesh), node.skin.is_some() && named.is_none());
            // A skinned mesh ignores the transform of its node.
            let frame = if is_free {
                Some(NodeFrame::at_origin(tree, node.name.clone()))
            } else {
                carrier.and_then(|i| frames[i])
            };
            let Some(frame) = frame else { continue };
            let (link, stretch, skin) = (frame.link, frame.stretch, node.skin.map(|skin| skin.value()));
            let weights = node.weights.as_ref().or(root.meshes[mesh].weights.as_ref());
            let is_morphed = is_moved(weights);
            tree.placements.push(Placement { mesh, is_morphed, link, name, stretch, skin, is_free });
        }
    }

    /// The name of a patch: of node `i` if it only carries the patch, else of the mesh.
    fn patch_name(&self, i: usize, mesh: usize) -> String {
        let (of_node, of_mesh) =
            (&self.document.root().nodes[i].name, &self.document.root().meshes[mesh].name);
        let names = if self.is_patch(i) { [of_node, of_mesh] } else { [of_mesh, of_node] };
        let name = names.into_iter().flatten().find(|name| !name.is_empty());
        name.cloned().unwrap_or_else(|| format!("mesh {mesh}"))
    }
}

/// Puts the meshes that no node carries onto one link at the origin.
fn place_library(document: &Document, tree: &mut NodeTree) {
    let root = document.root();
    let carried: HashSet<_> = root.nodes.iter().filter_map(|node| node.mesh).map(|m| m.value()).collect();
    let mut origin = None;
    for (mesh, json) in root.meshes.iter().enumerate().filter(|(i, _)| !carried.contains(i)) {
        let frame = *origin.get_or_insert_with(|| NodeFrame::at_origin(tree, None));
        let name = json.name.clone().unwrap_or_else(|| format!("mesh {mesh}"));
        let link = frame.link;
        let (is_morphed, stretch, skin, is_free) = (is_moved(json.weights.as_ref()), None, None, false);
        tree.placements.push(Placement { mesh, is_morphed, link, name, stretch, skin, is_free });
    }
}

/// Whether a weight of morph targets is not 0.
fn is_moved(weights: Option<&Vec<f32>>) -> bool {
    weights.into_iter().flatten().any(|&weight| weight != 0.0)
}

/// A node's link, and what its transform has besides the link's rigid pose.
#[derive(Debug, Clone, Copy)]
struct NodeFrame {
    link: LinkId,
    stretch: Option<DMat3>,
}

impl NodeFrame {
    /// A new link at the origin of the world.
    fn at_origin(tree: &mut NodeTree, name: Option<String>) -> Self {
        let link = Link { name: name.unwrap_or_default(), parent: None, pose: DAffine3::IDENTITY };
        Self { link: tree.links.push(link), stretch: None }
    }
}

fn children(node: &Node) -> impl Iterator<Item = usize> + '_ {
    node.children.iter().flatten().map(|child| child.value())
}

fn is_end(node: &Node) -> bool {
    children(node).next().is_none()
}

/// The parent of every node, at most one. The crate would follow a circle for ever.
fn parents(document: &Document) -> Result<Vec<Option<usize>>> {
    let nodes = &document.root().nodes;
    let mut parents = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for child in children(node) {
            if let Some(first) = parents[child].replace(i) {
                let found = format!("a child of node {first} and again of node {i}");
                return Err(document.invalid(format!("node {child}"), found, "one parent"));
            }
        }
    }
    // What cannot be reached from the roots runs in a circle.
    let reached = reach(nodes, (0..nodes.len()).filter(|&i| parents[i].is_none()).collect());
    match reached.iter().position(|r| !r) {
        None => Ok(parents),
        Some(i) => Err(document.invalid(format!("node {i}"), "a node above itself", "a tree")),
    }
}

/// Which nodes are `roots` or below one.
fn reach(nodes: &[Node], roots: Vec<usize>) -> Vec<bool> {
    let mut reached = vec![false; nodes.len()];
    let mut stack = roots;
    while let Some(i) = stack.pop() {
        if !std::mem::replace(&mut reached[i], true) {
            stack.extend(children(&nodes[i]));
        }
    }
    reached
}

/// Which nodes some animation moves, turns or scales; animations are not checked here.
fn animated(document: &Document) -> Vec<bool> {
    let mut animated = vec![false; document.root().nodes.len()];
    let animations = document.animations.as_array().into_iter().flatten();
    let channels = animations.filter_map(|animation| animation.get("channels")?.as_array()).flatten();
    for target in channels.filter_map(|channel| channel.get("target")) {
        let node = target.get("node").and_then(|node| usize::try_from(node.as_u64()?).ok());
        let has_weights = target.get("path").is_some_and(|path| path == "weights");
        if let Some(animated) = node.and_then(|node| animated.get_mut(node)) {
            *animated |= !has_weights;
        }
    }
    animated
}

fn joints(document: &Document) -> Vec<bool> {
    let root = document.root();
    let mut joints = vec![false; root.nodes.len()];
    for joint in root.skins.iter().flat_map(|skin| &skin.joints) {
        if let Some(is_joint) = joints.get_mut(joint.value()) {
            *is_joint = true;
        }
    }
    joints
}

/// Which nodes the default scene shows, else the first, else all.
fn shown(document: &Document, parents: &[Option<usize>]) -> Vec<bool> {
    let root = document.root();
    let roots = match root.scene.and_then(|scene| root.scenes.get(scene.value())).or(root.scenes.first()) {
        Some(scene) => scene.nodes.iter().map(|node| node.value()).collect(),
        None => (0..root.nodes.len()).filter(|&i| parents[i].is_none()).collect(),
    };
    reach(&root.nodes, roots)
}

fn is_identity(node: &Transform) -> bool {
    node.matrix.as_deref().is_none_or(|m| DMat4::from_cols_array(m) == DMat4::IDENTITY)
        && node.translation.is_none_or(|t| t == [0.0; 3])
        && node.rotation.is_none_or(|r| r == [0.0, 0.0, 0.0, 1.0])
        && node.scale.is_none_or(|s| s == [1.0; 3])
}

/// The rigid pose of node `i` in the frame of the link above it, which is stretched by `above`, and
/// the stretch that is left for positions (`None`: nothing).
fn rigid_pose(document: &Document, i: usize, above: Option<DMat3>) -> Result<(DAffine3, Option<DMat3>)> {
    let invalid = |found: String, needed: &str| document.invalid(format!("node {i}"), found, needed);
    let flat = || invalid("a scale that makes it flat".into(), "a scale other than zero");
    let node = &document.transforms[i];
    let (translation, rotation, stretch) = if let Some(m) = &node.matrix {
        if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
            let found = "a matrix next to translation, rotation or scale".into();
            return Err(invalid(found, "one or the other"));
        }
        let matrix = DMat4::from_cols_array(m);
        let linear = DMat3::from_mat4(matrix);
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::normalize_or_zero);
        let skew = [x.dot(y), y.dot(z), z.dot(x)].into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        if matrix.row(3) != DVec4::W || skew > SHEAR {
            let needed = "one made of translation, rotation and scale";
            return Err(invalid(format!("the matrix {m:?}"), needed));
        }
        let (rotation, stretch) = split(linear).ok_or_else(flat)?;
        (matrix.w_axis.truncate(), rotation, stretch)
    } else {
        let quaternion = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        let off = (quaternion.length() - 1.0).abs();
        if off > UNIT_ROTATION {
            let found = format!("a rotation of length {}", quaternion.length());
            let fault = invalid(found, "a unit quaternion");
            if off > ROUNDED_ROTATION {
                return Err(fault);
            }
            document.notes.pass(fault)?;
        }
        let scale = DVec3::from_array(node.scale.unwrap_or([1.0; 3]));
        if scale.cmpeq(DVec3::ZERO).any() {
            return Err(flat());
        }
        let stretch = (scale != DVec3::ONE).then(|| DMat3::from_diagonal(scale));
        let translation = DVec3::from_array(node.translation.unwrap_or_default());
        (translation, DMat3::from_quat(quaternion.normalize()), stretch)
    };
    let Some(above) = above else {
        return Ok((DAffine3::from_mat3_translation(rotation, translation), stretch));
    };
    let linear = above * rotation * stretch.unwrap_or(DMat3::IDENTITY);
    let (rotation, stretch) = split(linear).ok_or_else(flat)?;
    Ok((DAffine3::from_mat3_translation(rotation, above * translation), stretch))
}

/// Splits a linear map into a rotation and what remains to be done before it (`None`: nothing). A
/// mirror stays in the remainder. By Gram-Schmidt, so the axes of a scaled frame keep their
/// directions.
fn split(linear: DMat3) -> Option<(DMat3, Option<DMat3>)> {
    let x = linear.x_axis.try_normalize()?;
    let y = linear.y_axis.reject_from_normalized(x).try_normalize()?;
    let rotation = DMat3::from_cols(x, y, x.cross(y));
    let stretch = rotation.transpose() * linear;
    let determinant = stretch.determinant();
    if determinant == 0.0 || !determinant.is_finite() {
        return None;
    }
    Some((rotation, (!stretch.abs_diff_eq(DMat3::IDENTITY, RIGID)).then_some(stretch)))
}
