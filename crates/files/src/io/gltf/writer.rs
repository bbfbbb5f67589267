//! A glTF document that grows object by object, its links, and its file.

use std::{io, mem, path::Path};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use glam::{DAffine3, DMat4, DQuat};
use gltf::binary::{Glb, Header};
use gltf::json::accessor::{Accessor, ComponentType, GenericComponentType, Type};
use gltf::json::buffer::{Buffer, Stride, Target, View};
use gltf::json::extras::{Extras, RawValue};
use gltf::json::scene::UnitQuaternion;
use gltf::json::validation::{Checked, USize64};
use gltf::json::{Index, Node, Root, Scene, Skin, Value};

use crate::id::IdVec;
use crate::io::error::Result;
use crate::io::file::{cannot_write, unfit, write_to};
use crate::io::gltf::nodes::RIGID;
use crate::io::gltf::{GENERATOR, NodeExtras, SkinExtras};
use crate::mesh::rotation_defect;
use crate::numeric::narrow;
use crate::skin::{Link, LinkId, bind_of, world_pose};

/// Which of the two forms of glTF a file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// One file of JSON and binary data.
    Glb,
    /// JSON, with the binary data in a data URI.
    Text,
}

/// A component as it is stored.
pub(super) trait Stored: Copy {
    const TYPE: ComponentType;
    fn put(self, bytes: &mut Vec<u8>);
}

macro_rules! stored {
    ($($type:ty, $component:ident;)+) => {
        $(impl Stored for $type {
            const TYPE: ComponentType = ComponentType::$component;
            #[inline]
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        })+
    };
}

stored!(u8, U8; u16, U16; u32, U32; f32, F32;);

/// What rows of one number to four are; longer ones are matrices of 16.
const TYPES: [Type; 4] = [Type::Scalar, Type::Vec2, Type::Vec3, Type::Vec4];

/// A patch on its link.
pub(super) struct PatchNode {
    pub(super) link: LinkId,
    pub(super) node: Node,
    /// The links that its vertices follow, in the order of their numbers in `JOINTS_0`; none if it is
    /// rigid.
    pub(super) joints: Vec<LinkId>,
    /// As [`Taxels::binds`](crate::skin::Taxels::binds).
    pub(super) binds: Vec<(LinkId, DAffine3)>,
}

/// A document that grows object by object, each array in a view of its own.
pub(super) struct SceneWriter<'p> {
    pub(super) path: &'p Path,
    pub(super) root: Root,
    bytes: Vec<u8>,
    /// The nodes of each link, one for each scene that shows it.
    pub(super) link_nodes: Vec<(LinkId, Index<Node>)>,
}

impl<'p> SceneWriter<'p> {
    pub(super) fn new(path: &'p Path) -> Self {
        let mut root = Root::default();
        root.asset.generator = Some(format!("{GENERATOR} {}", env!("CARGO_PKG_VERSION")));
        Self { path, root, bytes: Vec::new(), link_nodes: Vec::new() }
    }

    /// Adds rows for vertices, for triangles, or without a target for readers of `extras`. Rows of
    /// vertices start at multiples of four bytes, as glTF requires.
    pub(super) fn array<S: Stored, const N: usize>(
        &mut self,
        target: Option<Target>,
        rows: impl ExactSizeIterator<Item = [S; N]>,
    ) -> Index<Accessor> {
        const PADDING: [u8; 4] = [0; 4];
        let size = N * size_of::<S>();
        let padding = if target.is_some() { size.next_multiple_of(4) - size } else { 0 };
        let (start, count) = (self.bytes.len(), rows.len());
        self.bytes.reserve(count * (size + padding) + 4);
        for row in rows {
            row.into_iter().for_each(|x| x.put(&mut self.bytes));
            self.bytes.extend_from_slice(&PADDING[..padding]);
        }
        let length = self.bytes.len() - start;
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = self.root.push(View {
            buffer: Index::new(0),
            byte_length: USize64::from(length),
            byte_offset: (start > 0).then(|| USize64::from(start)),
            byte_stride: (padding > 0).then_some(Stride(size + padding)),
            name: None,
            target: target.map(Checked::Valid),
            extensions: None,
            extras: None,
        });
        self.root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Checked::Valid(GenericComponentType(S::TYPE)),
            extensions: None,
            extras: None,
            type_: Checked::Valid(*TYPES.get(N - 1).unwrap_or(&Type::Mat4)),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
        })
    }

    /// Positions, with the bounds that glTF demands of them.
    pub(super) fn positions(&mut self, positions: &[[f32; 3]]) -> Index<Accessor> {
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for p in positions {
            for k in 0..3 {
                bounds[0][k] = bounds[0][k].min(p[k]);
                bounds[1][k] = bounds[1][k].max(p[k]);
            }
        }
        let accessor = self.array(Some(Target::ArrayBuffer), positions.iter().copied());
        let [min, max] = bounds.map(|b| Some(Value::from(b.map(f64::from).to_vec())));
        let json = &mut self.root.accessors[accessor.value()];
        (json.min, json.max) = (min, max);
        accessor
    }

    /// Adds a scene with a node for each link that `wanted` names, and `patches` under their links; those
    /// that follow several links next to them.
    pub(super) fn add_scene(
        &mut self,
        name: Option<String>,
        links: &IdVec<LinkId, Link>,
        wanted: &IdVec<LinkId, bool>,
        patches: Vec<PatchNode>,
    ) -> Result<()> {
        let mut nodes = IdVec::<LinkId, Option<Index<Node>>>::filled(None, links.len());
        let mut roots = Vec::new();
        for (link, description) in links.enumerate().filter(|(link, _)| wanted[*link]) {
            let node = self.node_of(link, description)?;
            let node = self.root.push(node);
            nodes[link] = Some(node);
            self.link_nodes.push((link, node));
            match description.parent.and_then(|p| nodes.get(p).copied().flatten()) {
                Some(parent) => self.adopt(parent, node),
                None if description.parent.is_some() => {
                    return Err(unfit(
                        self.path,
                        format!("link {link}"),
                        "a parent after it",
                        "a parent before it",
                    ));
                }
                None => roots.push(node),
            }
        }
        let node_of = |link: LinkId| {
            nodes.get(link).copied().flatten().ok_or_else(|| {
                let found = "a patch, but no link of this number";
                unfit(self.path, format!("link {link}"), found, "one of the skin's links")
            })
        };
        let patches: Vec<_> =
            patches.into_iter().map(|patch| Ok((node_of(patch.link)?, patch))).collect::<Result<_>>()?;
        // All joints of a skin have one root.
        let top = |mut link: LinkId| {
            while let Some(parent) = links[link].parent {
                link = parent;
            }
            link
        };
        let is_split =
            |patch: &PatchNode| patch.joints.iter().any(|&joint| top(joint) != top(patch.joints[0]));
        if patches.iter().any(|(_, patch)| is_split(patch)) {
            let extras = self.extras(&NodeExtras::Root)?;
            let children = Some(std::mem::take(&mut roots));
            roots.push(self.root.push(Node { children, extras, ..Node::default() }));
        }
        for (parent, PatchNode { link, mut node, joints, binds }) in patches {
            if joints.is_empty() {
                let node = self.root.push(node);
                self.adopt(parent, node);
                continue;
            }
            node.skin = Some(self.skin(links, link, &nodes, &joints, &binds)?);
            node.extras = self.extras(&NodeExtras::Link(parent.value()))?;
            roots.push(self.root.push(node));
        }
        self.root.push(Scene { extensions: None, extras: None, name, nodes: roots });
        Ok(())
    }

    /// A skin for vertices in the frame of a link as it stands.
    fn skin(
        &mut self,
        links: &IdVec<LinkId, Link>,
        own: LinkId,
        nodes: &IdVec<LinkId, Option<Index<Node>>>,
        joints: &[LinkId],
        binds: &[(LinkId, DAffine3)],
    ) -> Result<Index<Skin>> {
        let bind = |&joint: &LinkId| DMat4::from(bind_of(binds, joint)).to_cols_array();
        let extras = if binds.is_empty() {
            None
        } else {
            self.extras(&SkinExtras { binds: joints.iter().map(bind).collect() })?
        };
        let pose = world_pose(links, own);
        let inverse = joints.iter().map(|&joint| {
            let to_joint =
                if joint == own { DAffine3::IDENTITY } else { world_pose(links, joint).inverse() * pose };
            DMat4::from(to_joint).to_cols_array().map(narrow)
        });
        let inverse = self.array(None, inverse);
        let joints = joints.iter().filter_map(|&joint| nodes[joint]).collect();
        Ok(self.root.push(Skin {
            joints,
            inverse_bind_matrices: Some(inverse),
            skeleton: None,
            name: None,
            extensions: None,
            extras,
        }))
    }

    fn adopt(&mut self, parent: Index<Node>, child: Index<Node>) {
        self.root.nodes[parent.value()].children.get_or_insert_default().push(child);
    }

    /// The node of a link: name, translation and rotation, each left out where it is the default.
    fn node_of(&self, link: LinkId, Link { name, pose, .. }: &Link) -> Result<Node> {
        let axes = pose.matrix3;
        if !pose.is_finite() || rotation_defect(&axes) > RIGID || axes.determinant() < 0.0 {
            let found = "a pose that is not rigid";
            return Err(unfit(self.path, format!("link {link}"), found, "rotation and translation"));
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

    /// `{"dermatome": content}` as the extras of an object.
    pub(super) fn extras(&self, content: &impl serde::Serialize) -> Result<Extras> {
        let text = serde_json::to_string(content).map(|text| format!("{{\"dermatome\":{text}}}"));
        let raw = text.and_then(RawValue::from_string);
        raw.map(Some).map_err(|e| cannot_write(self.path)(e.into()))
    }

    /// Writes the document. Scene 0 is the default.
    pub(super) fn finish(mut self, output: &mut dyn io::Write, form: Form) -> Result<()> {
        self.root.scene = Some(Index::new(0));
        let bytes = mem::take(&mut self.bytes);
        let uri = match form {
            Form::Glb => None,
            Form::Text => Some(format!("data:application/octet-stream;base64,{}", STANDARD.encode(&bytes))),
        };
        let byte_length = USize64::from(bytes.len());
        self.root.push(Buffer { byte_length, name: None, uri, extensions: None, extras: None });
        let text = self.root.to_vec().map_err(|e| cannot_write(self.path)(e.into()))?;
        // The crate lets the length of a larger file wrap around.
        let length = 12 + 8 + text.len() + 8 + bytes.len();
        if form == Form::Glb && u32::try_from(length + 4).is_err() {
            return Err(unfit(
                self.path,
                "the document",
                format!("{length} bytes"),
                "less than 4 GiB in a GLB",
            ));
        }
        write_to(output, self.path, |file| {
            if form == Form::Text {
                file.write_all(&text)?;
                return file.write_all(b"\n");
            }
            let header = Header { magic: *b"glTF", version: 2, length: 0 };
            let glb = Glb { header, json: text.into(), bin: Some(bytes.into()) };
            glb.to_writer(file).map_err(|e| match e {
                gltf::Error::Io(source) => source,
                other => io::Error::other(other),
            })
        })
    }
}
