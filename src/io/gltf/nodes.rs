use std::{cmp::Reverse, collections::BinaryHeap};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::{
    id::IdVec,
    io::{
        IoError,
        gltf::{
            document::Document,
            schema::{Node, Whole},
        },
    },
    skin::{Link, LinkId},
};

/// A matrix whose columns are orthonormal to this much is taken for a rotation: f32 rounding leaves about 1e-7.
const RIGID: f64 = 1e-6;
/// How far a quaternion may be from unit length; the Khronos validator allows as much.
const UNIT_ROTATION: f64 = 5e-5;
/// Largest cosine between the axes of a node's matrix: more is shear, which glTF forbids.
const SHEAR: f64 = 1e-4;

/// One use of a mesh by a node of the scene.
#[derive(Debug, Clone)]
pub(super) struct Placement {
    /// The mesh, an index that exists.
    pub(super) mesh: usize,
    /// The link it is fixed to.
    pub(super) link: LinkId,
    /// Name for the patch.
    pub(super) name: String,
    /// What is left of the node's transform beside the link's rigid frame: scale, or a mirror. `None`: nothing.
    pub(super) stretch: Option<DMat3>,
}

/// The links of a scene and the meshes on them.
#[derive(Debug, Default)]
pub(super) struct Tree {
    pub(super) links: IdVec<LinkId, Link>,
    pub(super) placements: Vec<Placement>,
}

/// Reads the node tree of the scene.
///
/// Every node is a link, except those that are only a place to hang a patch on: a node with a mesh, without children
/// and without a transform of its own belongs to the link above it. (Cameras and lights at the ends are left out.) A link's pose is
/// rigid; scale and mirrors go into the positions. A mesh that is skinned to joints ignores its node's transform,
/// as glTF has it, and lies in its bind pose on a link at the origin.
///
/// The scene is the default scene, else the first. A file without scenes is a library: its root nodes count as the
/// scene, and meshes that no node carries lie on a link at the origin.
pub(super) fn place(document: &Document) -> Result<Tree, IoError> {
    let nodes = &document.json.nodes;
    let parents = parents(document)?;
    check_references(document)?;
    let shown = shown(document, &parents)?;
    let is_patch = |i: usize| {
        let node = &nodes[i];
        let bare = node.children.is_none() && node.skin.is_none() && Local::is_identity(node);
        node.mesh.is_some() && parents[i].is_some() && bare
    };
    let is_ornament = |node: &Node| {
        let plain = node.children.is_none() && node.mesh.is_none();
        plain && (node.camera.is_some() || node.extensions.contains_key("KHR_lights_punctual"))
    };
    let mut tree = Tree::default();
    let mut frames: Vec<Option<Frame>> = vec![None; nodes.len()];
    // Parents first, otherwise in the order of the file.
    let mut ready: BinaryHeap<_> =
        (0..nodes.len()).filter(|&i| shown[i] && parents[i].is_none()).map(Reverse).collect();
    while let Some(Reverse(i)) = ready.pop() {
        if is_patch(i) || is_ornament(&nodes[i]) {
            continue;
        }
        let above = parents[i].and_then(|p| frames[p]);
        let (pose, stretch) =
            Local::of(document, i)?.below(above.and_then(|f| f.stretch)).ok_or_else(|| {
                document.invalid(format!("node {i}"), "a scale that makes it flat", "a scale other than zero")
            })?;
        let name = nodes[i].name.clone().unwrap_or_default();
        let link = tree.links.push(Link { name, parent: above.map(|f| f.link), pose });
        frames[i] = Some(Frame { link, stretch });
        ready.extend(children(&nodes[i]).map(|c| Reverse(c.index())));
    }
    for (i, node) in nodes.iter().enumerate().filter(|(i, _)| shown[*i]) {
        let Some(mesh) = node.mesh.map(Whole::index) else { continue };
        let of_mesh = document.json.meshes[mesh].name.clone();
        let names = if is_patch(i) { [node.name.clone(), of_mesh] } else { [of_mesh, node.name.clone()] };
        let name =
            names.into_iter().flatten().find(|n| !n.is_empty()).unwrap_or_else(|| format!("mesh {mesh}"));
        let above = if is_patch(i) { parents[i] } else { Some(i) };
        let Some(frame) = above.and_then(|i| frames[i]) else { continue };
        let frame = if node.skin.is_none() { frame } else { Frame::at_origin(&mut tree, node.name.clone()) };
        tree.placements.push(Placement { mesh, link: frame.link, name, stretch: frame.stretch });
    }
    if document.json.scenes.is_empty() {
        place_library(document, &mut tree);
    }
    Ok(tree)
}

/// Puts the meshes that no node carries onto one link at the origin.
fn place_library(document: &Document, tree: &mut Tree) {
    let mut carried = vec![false; document.json.meshes.len()];
    for mesh in document.json.nodes.iter().filter_map(|n| n.mesh) {
        carried[mesh.index()] = true;
    }
    let mut origin = None;
    for (mesh, json) in document.json.meshes.iter().enumerate().filter(|(i, _)| !carried[*i]) {
        let frame = *origin.get_or_insert_with(|| Frame::at_origin(tree, None));
        let name = json.name.clone().unwrap_or_else(|| format!("mesh {mesh}"));
        tree.placements.push(Placement { mesh, link: frame.link, name, stretch: None });
    }
}

/// A node's link, and what its transform has beside the link's rigid pose.
#[derive(Debug, Clone, Copy)]
struct Frame {
    link: LinkId,
    stretch: Option<DMat3>,
}

impl Frame {
    /// A new link at the origin of the world.
    fn at_origin(tree: &mut Tree, name: Option<String>) -> Self {
        let link = Link { name: name.unwrap_or_default(), parent: None, pose: DAffine3::IDENTITY };
        Self { link: tree.links.push(link), stretch: None }
    }
}

/// A node's own transform: `translation * rotation * stretch`.
#[derive(Debug, Clone, Copy)]
struct Local {
    translation: DVec3,
    rotation: DMat3,
    /// `None`: none.
    stretch: Option<DMat3>,
    /// Whether nothing is squeezed to zero.
    invertible: bool,
}

impl Local {
    fn is_identity(node: &Node) -> bool {
        let no_matrix = node.matrix.as_deref().is_none_or(|m| *m == IDENTITY);
        no_matrix
            && node.translation.is_none_or(|t| t == [0.0; 3])
            && node.rotation.is_none_or(|r| r == [0.0, 0.0, 0.0, 1.0])
            && node.scale.is_none_or(|s| s == [1.0; 3])
    }

    /// Reads and checks the transform of node `i`.
    fn of(document: &Document, i: usize) -> Result<Self, IoError> {
        let node = &document.json.nodes[i];
        let refuse = |found: String, needed: &str| Err(document.invalid(format!("node {i}"), found, needed));
        if let Some(m) = &node.matrix {
            if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
                return refuse("a matrix beside translation, rotation or scale".into(), "one or the other");
            }
            let linear = DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]);
            let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::normalize_or_zero);
            let skew = [x.dot(y), y.dot(z), z.dot(x)].into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] || skew > SHEAR {
                return refuse(format!("the matrix {m:?}"), "one made of translation, rotation and scale");
            }
            let (rotation, stretch, invertible) = match split(linear) {
                Some((rotation, stretch)) => (rotation, stretch, true),
                None => (DMat3::IDENTITY, Some(linear), false),
            };
            return Ok(Self { translation: DVec3::new(m[12], m[13], m[14]), rotation, stretch, invertible });
        }
        let quaternion = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        if (quaternion.length() - 1.0).abs() > UNIT_ROTATION {
            return refuse(format!("a rotation of length {}", quaternion.length()), "a unit quaternion");
        }
        let scale = DVec3::from_array(node.scale.unwrap_or([1.0; 3]));
        Ok(Self {
            translation: DVec3::from_array(node.translation.unwrap_or_default()),
            rotation: DMat3::from_quat(quaternion.normalize()),
            stretch: (scale != DVec3::ONE).then(|| DMat3::from_diagonal(scale)),
            invertible: scale.cmpne(DVec3::ZERO).all(),
        })
    }

    /// Rigid pose and remaining stretch below a link that is stretched itself; `None` if something becomes flat.
    fn below(self, above: Option<DMat3>) -> Option<(DAffine3, Option<DMat3>)> {
        if !self.invertible {
            return None;
        }
        let Some(above) = above else {
            return Some((DAffine3::from_mat3_translation(self.rotation, self.translation), self.stretch));
        };
        let (rotation, stretch) = split(above * self.rotation * self.stretch.unwrap_or(DMat3::IDENTITY))?;
        Some((DAffine3::from_mat3_translation(rotation, above * self.translation), stretch))
    }
}

/// The matrix that does nothing, by columns.
const IDENTITY: [f64; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Splits a linear map into a rotation and what remains to be done before it (`None`: nothing). A mirror stays in the
/// remainder. By Gram-Schmidt, so the axes of a scaled frame keep their directions.
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

fn children(node: &Node) -> impl Iterator<Item = Whole> + '_ {
    node.children.iter().flatten().copied()
}

/// The parent of every node: at most one, and no node above itself.
fn parents(document: &Document) -> Result<Vec<Option<usize>>, IoError> {
    let nodes = &document.json.nodes;
    let mut parents = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        if node.children.as_ref().is_some_and(Vec::is_empty) {
            return Err(document.invalid(
                format!("node {i}"),
                "an empty list of children",
                "no list, or a child",
            ));
        }
        for child in children(node) {
            document.get(nodes, child, "node", || format!("node {i} children"))?;
            if let Some(first) = parents[child.index()].replace(i) {
                let found = format!("a child of node {first} and again of node {i}");
                return Err(document.invalid(format!("node {child}"), found, "one parent"));
            }
        }
    }
    // What cannot be reached from the roots runs in a circle.
    let mut reached = vec![false; nodes.len()];
    let mut stack: Vec<_> = (0..nodes.len()).filter(|&i| parents[i].is_none()).collect();
    while let Some(i) = stack.pop() {
        reached[i] = true;
        stack.extend(children(&nodes[i]).map(Whole::index));
    }
    match reached.iter().position(|r| !r) {
        None => Ok(parents),
        Some(i) => Err(document.invalid(format!("node {i}"), "a node above itself", "a tree")),
    }
}

/// Checks what nodes name beside their children.
fn check_references(document: &Document) -> Result<(), IoError> {
    let json = &document.json;
    for (i, node) in json.nodes.iter().enumerate() {
        let element = || format!("node {i}");
        if let Some(camera) = node.camera {
            document.get(&json.cameras, camera, "camera", element)?;
        }
        let Some(mesh) = node.mesh else {
            if node.skin.is_some() || node.weights.is_some() {
                return Err(document.invalid(element(), "a skin or weights without a mesh", "a mesh"));
            }
            continue;
        };
        let mesh = document.get(&json.meshes, mesh, "mesh", element)?;
        if let Some(skin) = node.skin {
            document.get(&json.skins, skin, "skin", element)?;
            if mesh.primitives.iter().any(|p| !p.attributes.contains_key("JOINTS_0")) {
                return Err(document.invalid(
                    element(),
                    "a skin on a mesh without JOINTS_0",
                    "JOINTS_0 and WEIGHTS_0",
                ));
            }
        }
        if let Some(weights) = &node.weights {
            let targets = mesh.primitives.first().and_then(|p| p.targets.as_ref()).map_or(0, Vec::len);
            if weights.len() != targets {
                let found = format!("{} weights for {targets} morph targets", weights.len());
                return Err(document.invalid(element(), found, "one weight per target"));
            }
        }
    }
    Ok(())
}

/// Which nodes belong to the scene.
fn shown(document: &Document, parents: &[Option<usize>]) -> Result<Vec<bool>, IoError> {
    let json = &document.json;
    let mut listed_by = vec![None; json.nodes.len()];
    for (s, scene) in json.scenes.iter().enumerate() {
        if scene.nodes.as_ref().is_some_and(Vec::is_empty) {
            return Err(document.invalid(
                format!("scene {s}"),
                "an empty list of nodes",
                "no list, or a node",
            ));
        }
        for &root in scene.nodes.iter().flatten() {
            document.get(&json.nodes, root, "node", || format!("scene {s}"))?;
            let again = listed_by[root.index()].replace(s) == Some(s);
            if again || parents[root.index()].is_some() {
                let found = format!("node {root}, which is listed twice or has a parent");
                return Err(document.invalid(format!("scene {s}"), found, "root nodes, once each"));
            }
        }
    }
    let scene = match json.scene {
        Some(index) => Some(document.get(&json.scenes, index, "scene", || "the default scene".into())?),
        None => json.scenes.first(),
    };
    let mut shown = vec![false; json.nodes.len()];
    let mut stack: Vec<usize> = match scene {
        Some(scene) => scene.nodes.iter().flatten().copied().map(Whole::index).collect(),
        None => (0..json.nodes.len()).filter(|&i| parents[i].is_none()).collect(),
    };
    while let Some(i) = stack.pop() {
        shown[i] = true;
        stack.extend(children(&json.nodes[i]).map(Whole::index));
    }
    Ok(shown)
}
