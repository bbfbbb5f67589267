//! What our files add to glTF, `extras.dermatome` of meshes and nodes: one schema for reading and writing.

use gltf::json::{Mesh, Node, extras::Extras};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What a map says about a mesh beside its geometry: `extras.dermatome` of the mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct LevelExtras {
    /// Name of the patch.
    pub patch: String,
    /// Number of the level.
    pub level: usize,
    /// The rectangle of the map that the texture coordinates cover; absent where there is no map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<FrameExtras>,
    /// This level's vertices in terms of the next coarser one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<RowsExtras>,
    /// Level 0's vertices in terms of this level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direct: Option<RowsExtras>,
    /// Number of the accessor of the level-0 vertex that each vertex is; levels 1 and up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origins: Option<usize>,
    /// Where the map is cut: number of the accessor of the vertex of the uncut level that each vertex
    /// of the mesh is. All other numbers count those of uncut levels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unsplit: Option<usize>,
    /// How many of the last triangles of level 0 close pin-holes.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub filled: usize,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands out references")]
const fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// The rectangle of a [`crate::map::ImageFrame`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct FrameExtras {
    /// Lower left corner, in m.
    pub origin: [f64; 2],
    /// Width and height, in m.
    pub size: [f64; 2],
    /// Width and height of the image, in pixels.
    pub pixels: [u32; 2],
}

/// A prolongation, as numbers of two accessors with three components a row.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct RowsExtras {
    /// Vertex indices.
    pub indices: usize,
    /// Weights.
    pub weights: usize,
}

/// `extras.dermatome` of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum NodeExtras {
    /// The number of the node of the link that a skinned patch is given in.
    Link(usize),
    /// The node only joins links, since all joints of a skin must have one root.
    Root,
}

impl LevelExtras {
    /// What a mesh says; `None` if it says nothing.
    pub(super) fn of(mesh: &Mesh) -> Option<Result<Self, serde_json::Error>> {
        content(&mesh.extras).map(Self::deserialize)
    }
}

impl NodeExtras {
    /// What a node says; `None` if it says nothing, or nothing known.
    pub(super) fn of(node: &Node) -> Option<Self> {
        Self::deserialize(content(&node.extras)?).ok()
    }
}

fn content(extras: &Extras) -> Option<Value> {
    let mut extras: Value = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    extras.get_mut("dermatome").map(Value::take)
}
