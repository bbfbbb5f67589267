//! glTF 2.0, binary (`.glb`) and text (`.gltf`): skins in and out, maps out and in.
//!
//! The types of the `gltf` crate serve both directions, and its validation judges the JSON. Reading
//! never trusts a file: a [`document::Document`] hands out buffers and accessors only after it has
//! checked them against the bytes that are there, and keeps a budget so that a small file cannot use
//! for much memory; node trees, attributes and triangles are checked where they are read. What is not
//! read is not checked.
//!
//! What is wrong with a file but touches no triangle is noted where a skin is read and refused where a map
//! is ([`Notes`]). Faults of positions, indices, counts and buffers are never noted, always refused.
//!
//! To read: `json`, `document` (file to JSON and bytes), `accessor` (bytes to numbers), `nodes`,
//! `primitive`, then `read_skin` and `read_map`, and `animation` for how links move. To write:
//! `writer`, `write_skin`, `write_map`, `write_animations`. [`LevelExtras`] and [`NodeExtras`] are what our
//! files add to glTF, `extras.dermatome` of meshes and nodes: one schema for reading and writing.

mod accessor;
mod animation;
mod body;
mod document;
mod joints;
mod json;
mod nodes;
mod primitive;
mod read_map;
mod read_skin;
mod rows;
mod write_animations;
mod write_map;
mod write_skin;
mod writer;

use std::cell::{Cell, RefCell};

use gltf::json::{Mesh, Node, extras::Extras};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::io::{IoError, error::Result};
use crate::map::OnPatch;

pub(super) use animation::read_animation;
pub use read_map::{map_from_bytes, read_map};
pub(super) use read_skin::read_gltf;
pub(crate) use write_map::as_in_map_file;
pub use write_map::{map_hash, map_to_bytes, share_plane, write_map, write_pyramids};
pub use write_skin::rounding_in_gltf;
pub(super) use write_skin::write_skin;

/// What `asset.generator` of our files begins with.
const GENERATOR: &str = "dermatome";

/// Stands for all variances of a taxel whose covariance is not known, and for its `_SIGMA`: glTF has no empty cells.
const UNKNOWN_VARIANCE: f32 = -1.0;

/// The properties of a mesh besides its geometry: `extras.dermatome` of the mesh.
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
    /// On level 0 the names of the regions that `_REGION` counts from 1 on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<String>,
    /// On level 0 the texts of [`Modalities`](crate::skin::Modalities) that `_MODALITY` counts from 1 on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modalities: Vec<String>,
    /// On level 0 whether the ids only count the taxels.
    #[serde(default, skip_serializing_if = "is_false")]
    pub counted: bool,
    /// On level 0 of a map on that of another skin: the patch of that map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub atlas: Option<OnPatch>,
}

/// `extras.dermatome` of a mesh of a skin.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
struct SheetExtras {
    /// The names of the regions that `_REGION` counts from 1 on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    regions: Vec<String>,
    /// The texts of [`Modalities`](crate::skin::Modalities) that `_MODALITY` counts from 1 on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    modalities: Vec<String>,
    /// Whether the ids only count the taxels.
    #[serde(default, skip_serializing_if = "is_false")]
    counted: bool,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands out references")]
const fn is_false(value: &bool) -> bool {
    !*value
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

/// `extras.dermatome` of a skin of glTF.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct SkinExtras {
    /// [`Taxels::binds`](crate::skin::Taxels::binds) of each joint, as matrices in the order of their columns.
    pub binds: Vec<[f64; 16]>,
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
    /// The extras of a mesh; `None` without, or if they are those of a skin.
    pub(super) fn of(mesh: &Mesh) -> Option<Result<Self, serde_json::Error>> {
        let content = content(&mesh.extras)?;
        let is_of_skin = content.as_object().is_some_and(|keys| {
            keys.keys().all(|key| ["regions", "modalities", "counted"].contains(&&**key))
        });
        (!is_of_skin).then(|| Self::deserialize(content))
    }
}

impl SkinExtras {
    /// What a skin says; `None` if it says nothing, or nothing known.
    pub(super) fn of(extras: &Extras) -> Option<Self> {
        Self::deserialize(content(extras)?).ok()
    }
}

impl SheetExtras {
    /// The extras of a mesh of a skin, or of level 0 of a map.
    fn of(mesh: &Mesh) -> Option<Self> {
        Self::deserialize(content(&mesh.extras)?).ok()
    }
}

impl NodeExtras {
    /// The extras of a node; `None` without, or if none is known.
    pub(super) fn of(node: &Node) -> Option<Self> {
        Self::deserialize(content(&node.extras)?).ok()
    }
}

fn content(extras: &Extras) -> Option<Value> {
    let mut extras: Value = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    extras.get_mut("dermatome").map(Value::take)
}

/// More notes than this are only counted: a file may have one for every vertex.
const MOST_NOTES: usize = 12;

/// The faults of a file that were passed over.
#[derive(Debug, Default)]
pub(super) struct Notes {
    is_strict: bool,
    texts: RefCell<Vec<String>>,
    more: Cell<usize>,
}

impl Notes {
    /// Passes over nothing if `is_strict`.
    pub(super) fn new(is_strict: bool) -> Self {
        Self { is_strict, ..Self::default() }
    }

    /// Notes a fault and goes on without what has it; where maps are read it is an error.
    pub(super) fn pass(&self, fault: IoError) -> Result<()> {
        self.settle(fault, "it touches no triangle and was passed over")
    }

    /// Notes a fault and what was done about it; where maps are read it is an error.
    pub(super) fn settle(&self, fault: IoError, what: &str) -> Result<()> {
        if self.is_strict {
            return Err(fault);
        }
        let text = match fault {
            IoError::Invalid { element, found, needed, .. } => {
                format!("{element}: found {found}; needed: {needed}; {what}")
            }
            other => other.to_string(),
        };
        self.add(text);
        Ok(())
    }

    /// Notes what is not read and breaks no rule.
    pub(super) fn add(&self, text: String) {
        let mut texts = self.texts.borrow_mut();
        if texts.len() < MOST_NOTES && !texts.contains(&text) {
            texts.push(text);
        } else if !texts.contains(&text) {
            self.more.set(self.more.get() + 1);
        }
    }

    /// All notes, for the remarks of a draft.
    pub(super) fn texts(&self) -> Vec<String> {
        let more = match self.more.get() {
            0 => None,
            more => Some(format!("{more} more faults that touch no triangle")),
        };
        self.texts.borrow().iter().cloned().chain(more).collect()
    }
}
