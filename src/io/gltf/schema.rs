//! The part of the glTF 2.0 JSON that is read here; every other property is skipped without being stored.
//!
//! The `gltf` crate's own types serve for writing. They are not used for reading, because they wrap indices and
//! enumerations that do not fit into 32 bits, refuse a file for a fault in a material that no skin has, and keep
//! several hundred bytes for an object of two.

use std::{collections::BTreeMap, fmt, marker::PhantomData};

use serde::{
    Deserialize, Deserializer,
    de::{Error as _, IgnoredAny, SeqAccess, Unexpected, Visitor},
};

/// A count, size, offset or index: not negative and whole, also when written as `1.0` or `10e-1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct Whole(pub(super) u64);

impl Whole {
    /// As a position in memory; a number beyond the address space becomes one that no array has.
    pub(super) fn index(self) -> usize {
        usize::try_from(self.0).unwrap_or(usize::MAX)
    }
}

impl fmt::Display for Whole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct WholeVisitor;
        impl Visitor<'_> for WholeVisitor {
            type Value = Whole;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a whole number that is not negative")
            }
            fn visit_u64<E>(self, value: u64) -> Result<Whole, E> {
                Ok(Whole(value))
            }
            fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<Whole, E> {
                /// Beyond 2^53 a float no longer tells neighbouring integers apart.
                const EXACT: f64 = 9_007_199_254_740_992.0;
                if value.fract() != 0.0 || !(0.0..=EXACT).contains(&value) {
                    return Err(E::invalid_value(Unexpected::Float(value), &self));
                }
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "whole and in range, as just checked"
                )]
                let whole = value as u64;
                Ok(Whole(whole))
            }
        }
        deserializer.deserialize_any(WholeVisitor)
    }
}

/// What an element of a top-level array is called in error messages.
pub(super) trait Named {
    const NAME: &'static str;
}

/// A top-level array: glTF wants at least one element, and the reader wants to know which one is broken.
fn elements<'de, D: Deserializer<'de>, T: Deserialize<'de> + Named>(d: D) -> Result<Vec<T>, D::Error> {
    struct Elements<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de> + Named> Visitor<'de> for Elements<T> {
        type Value = Vec<T>;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "an array of {} objects", T::NAME)
        }
        fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Vec<T>, A::Error> {
            let mut all = Vec::new();
            loop {
                let which = |e: A::Error| A::Error::custom(format_args!("{} {}: {e}", T::NAME, all.len()));
                match seq.next_element().map_err(which)? {
                    Some(element) => all.push(element),
                    None if all.is_empty() => return Err(A::Error::invalid_length(0, &self)),
                    None => return Ok(all),
                }
            }
        }
    }
    d.deserialize_seq(Elements(PhantomData))
}

/// Names of the extensions an object carries.
pub(super) type Extensions = BTreeMap<String, IgnoredAny>;

/// The document.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Json {
    pub asset: Asset,
    #[serde(default)]
    pub extensions_used: Vec<String>,
    #[serde(default)]
    pub extensions_required: Vec<String>,
    #[serde(default, deserialize_with = "elements")]
    pub buffers: Vec<Buffer>,
    #[serde(default, deserialize_with = "elements")]
    pub buffer_views: Vec<BufferView>,
    #[serde(default, deserialize_with = "elements")]
    pub accessors: Vec<Accessor>,
    #[serde(default, deserialize_with = "elements")]
    pub meshes: Vec<Mesh>,
    #[serde(default, deserialize_with = "elements")]
    pub nodes: Vec<Node>,
    #[serde(default, deserialize_with = "elements")]
    pub scenes: Vec<Scene>,
    pub scene: Option<Whole>,
    #[serde(default)]
    pub materials: Vec<IgnoredAny>,
    #[serde(default)]
    pub skins: Vec<IgnoredAny>,
    #[serde(default)]
    pub cameras: Vec<IgnoredAny>,
}

/// Which glTF it is.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Asset {
    pub version: String,
    pub min_version: Option<String>,
}

/// Bytes: the binary chunk, a file beside, or a data URI.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub byte_length: Whole,
    pub uri: Option<String>,
}

impl Named for Buffer {
    const NAME: &'static str = "buffer";
}

/// A range of a buffer.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: Whole,
    #[serde(default)]
    pub byte_offset: Whole,
    pub byte_length: Whole,
    pub byte_stride: Option<Whole>,
    pub target: Option<Whole>,
}

impl Named for BufferView {
    const NAME: &'static str = "bufferView";
}

/// Typed rows in a view.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<Whole>,
    pub byte_offset: Option<Whole>,
    pub component_type: Whole,
    #[serde(default)]
    pub normalized: bool,
    pub count: Whole,
    #[serde(rename = "type")]
    pub kind: String,
    pub min: Option<Vec<f64>>,
    pub max: Option<Vec<f64>>,
    pub sparse: Option<Sparse>,
    #[serde(default)]
    pub extensions: Extensions,
}

impl Named for Accessor {
    const NAME: &'static str = "accessor";
}

/// Rows that differ from the view's, or from zero.
#[derive(Debug, Deserialize)]
pub(super) struct Sparse {
    pub count: Whole,
    pub indices: SparseIndices,
    pub values: SparseValues,
}

/// Which rows differ.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub buffer_view: Whole,
    #[serde(default)]
    pub byte_offset: Whole,
    pub component_type: Whole,
}

/// What they are instead.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub buffer_view: Whole,
    #[serde(default)]
    pub byte_offset: Whole,
}

/// Primitives that belong together.
#[derive(Debug, Deserialize)]
pub(super) struct Mesh {
    pub name: Option<String>,
    pub primitives: Vec<Primitive>,
    pub weights: Option<Vec<f64>>,
    pub extras: Option<serde_json::Value>,
}

impl Named for Mesh {
    const NAME: &'static str = "mesh";
}

/// Vertices and how they are joined.
#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    pub attributes: BTreeMap<String, Whole>,
    pub indices: Option<Whole>,
    pub mode: Option<Whole>,
    pub material: Option<Whole>,
    pub targets: Option<Vec<BTreeMap<String, Whole>>>,
    #[serde(default)]
    pub extensions: Extensions,
}

/// A frame, and what is fixed to it.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Node {
    pub name: Option<String>,
    pub children: Option<Vec<Whole>>,
    pub mesh: Option<Whole>,
    pub skin: Option<Whole>,
    pub camera: Option<Whole>,
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
    pub weights: Option<Vec<f64>>,
    #[serde(default)]
    pub extensions: Extensions,
}

impl Named for Node {
    const NAME: &'static str = "node";
}

/// Root nodes that are shown together.
#[derive(Debug, Deserialize)]
pub(super) struct Scene {
    pub nodes: Option<Vec<Whole>>,
}

impl Named for Scene {
    const NAME: &'static str = "scene";
}
