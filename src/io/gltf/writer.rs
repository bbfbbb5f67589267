//! A glTF document that grows object by object, and its file.

use std::{
    io::{self, Write as _},
    mem,
    path::Path,
};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use gltf::{
    binary::{Glb, Header},
    json::{
        self, Index, Root, Value,
        accessor::{Accessor, ComponentType, GenericComponentType, Type},
        buffer::{self, Buffer, Stride, View},
        extras::{Extras, RawValue},
        validation::{Checked, USize64},
    },
};

use crate::io::{
    IoError,
    file::{replace_file, unfit},
};

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
    ($type:ty, $component:ident) => {
        impl Stored for $type {
            const TYPE: ComponentType = ComponentType::$component;
            #[inline]
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    };
}

stored!(u8, U8);
stored!(u16, U16);
stored!(u32, U32);
stored!(f32, F32);

/// A document that grows object by object, each array in a view of its own.
#[derive(Debug)]
pub(super) struct SceneWriter {
    pub(super) root: Root,
    bytes: Vec<u8>,
}

impl SceneWriter {
    /// An empty document.
    pub(super) fn new() -> Self {
        let mut root = Root::default();
        root.asset.generator = Some(format!("dermatome {}", env!("CARGO_PKG_VERSION")));
        Self { root, bytes: Vec::new() }
    }

    /// One row per vertex; rows start at multiples of four bytes, as glTF wants it.
    pub(super) fn attribute<S: Stored, const N: usize>(
        &mut self,
        rows: impl ExactSizeIterator<Item = [S; N]>,
    ) -> Index<Accessor> {
        self.array(rows, Some(buffer::Target::ArrayBuffer))
    }

    /// Corners of triangles.
    pub(super) fn corners(&mut self, triangles: impl ExactSizeIterator<Item = [u32; 3]>) -> Index<Accessor> {
        let count = 3 * triangles.len();
        let accessor = self.array(triangles, Some(buffer::Target::ElementArrayBuffer));
        let json = &mut self.root.accessors[accessor.value()];
        json.count = USize64::from(count);
        json.type_ = Checked::Valid(Type::Scalar);
        accessor
    }

    /// Rows for readers of `extras`.
    pub(super) fn plain<S: Stored, const N: usize>(
        &mut self,
        rows: impl ExactSizeIterator<Item = [S; N]>,
    ) -> Index<Accessor> {
        self.array(rows, None)
    }

    fn array<S: Stored, const N: usize>(
        &mut self,
        rows: impl ExactSizeIterator<Item = [S; N]>,
        target: Option<buffer::Target>,
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
            type_: Checked::Valid([Type::Scalar, Type::Vec2, Type::Vec3, Type::Vec4][N - 1]),
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
        let accessor = self.attribute(positions.iter().copied());
        let [min, max] = bounds.map(|b| Some(Value::from(b.map(f64::from).to_vec())));
        let json = &mut self.root.accessors[accessor.value()];
        (json.min, json.max) = (min, max);
        accessor
    }

    /// Writes the document to `path`, whole or not at all.
    pub(super) fn finish(mut self, path: &Path, form: Form) -> Result<(), IoError> {
        let fail = |source| IoError::Write { path: path.into(), source };
        let bytes = mem::take(&mut self.bytes);
        let uri = match form {
            Form::Glb => None,
            Form::Text => Some(format!("data:application/octet-stream;base64,{}", STANDARD.encode(&bytes))),
        };
        self.root.push(Buffer {
            byte_length: USize64::from(bytes.len()),
            name: None,
            uri,
            extensions: None,
            extras: None,
        });
        let mut text = json::serialize::to_vec(&self.root).map_err(|e| fail(e.into()))?;
        if form == Form::Text {
            text.push(b'\n');
            return replace_file(path, |file| file.write_all(&text).map_err(fail));
        }
        // The crate lets the length of a larger file wrap around.
        let length = 12 + 8 + text.len() + 8 + bytes.len();
        if u32::try_from(length + 4).is_err() {
            return Err(unfit(path, "the document", format!("{length} bytes"), "less than 4 GiB in a GLB"));
        }
        let header = Header { magic: *b"glTF", version: 2, length: 0 };
        let glb = Glb { header, json: text.into(), bin: Some(bytes.into()) };
        replace_file(path, |file| {
            glb.to_writer(file).map_err(|e| match e {
                gltf::Error::Io(source) => fail(source),
                other => fail(io::Error::other(other)),
            })
        })
    }
}

/// `{"dermatome": content}` as the extras of an object.
pub(super) fn extras(path: &Path, content: &impl serde::Serialize) -> Result<Extras, IoError> {
    let fail = |e: serde_json::Error| IoError::Write { path: path.into(), source: e.into() };
    let text = serde_json::to_string(content).map_err(fail)?;
    Ok(Some(RawValue::from_string(format!("{{\"dermatome\":{text}}}")).map_err(fail)?))
}

/// The nearest `f32`: glTF stores no wider floats.
#[expect(clippy::cast_possible_truncation, reason = "the file format; callers check what rounding may break")]
pub(super) fn narrow(x: f64) -> f32 {
    x as f32
}
