//! What a document must hold before the types of the `gltf` crate read it.
//!
//! The types of [`gltf::json`] serve reading and writing. They believe what they read, so every
//! count, index, code and name is checked in the JSON first, and these things stay ours:
//! - Indices and codes of 2^32 and more wrap around, unknown codes lose their number, and unknown
//!   names of attributes fall together: all are refused here, with what was found.
//! - `1.0` is a whole number in JSON, but not to the crate: it is rewritten.
//! - A scene needs no list of nodes: it gets an empty one.
//! - Transforms of nodes are `f32` there, which would move links given in decimals: [`Transform`]
//!   keeps `f64`.
//! - A fault in a material or a texture would refuse the file: materials, skins and cameras are
//!   only counted.

use std::path::Path;

use gltf::json::{Asset, Index, Root};
use serde::{Deserialize, de::DeserializeOwned};
use serde_json::{Map, Value};

use crate::io::{
    IoError,
    file::source::{excerpt, invalid},
};

/// The transform of a node as the file states it.
#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct Transform {
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
}

/// A top-level array that others refer to: its key, and what one element is called.
type Array = (&'static str, &'static str);

const BUFFERS: Array = ("buffers", "buffer");
const VIEWS: Array = ("bufferViews", "bufferView");
const ACCESSORS: Array = ("accessors", "accessor");
const MESHES: Array = ("meshes", "mesh");
const NODES: Array = ("nodes", "node");
const SCENES: Array = ("scenes", "scene");
const MATERIALS: Array = ("materials", "material");
const SKINS: Array = ("skins", "skin");
const CAMERAS: Array = ("cameras", "camera");

/// What a property must be, where it is there.
enum Rule {
    /// A count, size or offset.
    Uint,
    /// The place of an element.
    Index(Array),
    /// Places of elements, at least one.
    Indices(Array),
    /// One of these numbers.
    Code(&'static [u64]),
    /// One of these words.
    Word(&'static [&'static str]),
}

/// Properties of an object, and the rule of each.
type Rules = &'static [(&'static str, Rule)];

const OF_DOCUMENT: Rules = &[("scene", Rule::Index(SCENES))];
const OF_BUFFER: Rules = &[("byteLength", Rule::Uint)];
const OF_VIEW: Rules = &[
    ("buffer", Rule::Index(BUFFERS)),
    ("byteOffset", Rule::Uint),
    ("byteLength", Rule::Uint),
    ("byteStride", Rule::Uint),
    ("target", Rule::Code(&[34962, 34963])),
];
const OF_ACCESSOR: Rules = &[
    ("bufferView", Rule::Index(VIEWS)),
    ("byteOffset", Rule::Uint),
    ("componentType", Rule::Code(&[5120, 5121, 5122, 5123, 5125, 5126])),
    ("count", Rule::Uint),
    ("type", Rule::Word(&["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"])),
];
const OF_SPARSE: Rules = &[("count", Rule::Uint)];
const OF_SPARSE_INDICES: Rules = &[
    ("bufferView", Rule::Index(VIEWS)),
    ("byteOffset", Rule::Uint),
    ("componentType", Rule::Code(&[5121, 5123, 5125])),
];
const OF_SPARSE_VALUES: Rules = &[("bufferView", Rule::Index(VIEWS)), ("byteOffset", Rule::Uint)];
const OF_PRIMITIVE: Rules = &[
    ("indices", Rule::Index(ACCESSORS)),
    ("mode", Rule::Code(&[0, 1, 2, 3, 4, 5, 6])),
    ("material", Rule::Index(MATERIALS)),
];
const OF_NODE: Rules = &[
    ("children", Rule::Indices(NODES)),
    ("mesh", Rule::Index(MESHES)),
    ("skin", Rule::Index(SKINS)),
    ("camera", Rule::Index(CAMERAS)),
];
const OF_SCENE: Rules = &[("nodes", Rule::Indices(NODES))];

/// Checks a document and hands it to the types of the crate; with the transform of each node.
///
/// # Errors
/// The first element that breaks the schema of glTF 2.0.
pub(super) fn parse(path: &Path, text: &[u8]) -> Result<(Root, Vec<Transform>), IoError> {
    let mut document: Value =
        serde_json::from_slice(text).map_err(|e| invalid(path, "JSON", e.to_string(), NEEDED))?;
    let guard = Guard::new(path, &document)?;
    guard.check("the file", &mut document, OF_DOCUMENT)?;
    let Value::Object(mut document) = document else {
        return Err(invalid(path, "JSON", "no object", NEEDED));
    };
    let asset: Asset = guard.typed("asset", document.remove("asset").unwrap_or_default())?;
    let scene: Option<Index<_>> = guard.typed("scene", document.remove("scene").unwrap_or_default())?;
    let mut names = |key: &str| match document.remove(key) {
        None => Ok(Vec::new()),
        Some(list) => guard.typed(key, list),
    };
    let (extensions_used, extensions_required) = (names("extensionsUsed")?, names("extensionsRequired")?);
    let mut transforms = Vec::new();
    let root = Root {
        asset,
        scene,
        extensions_used,
        extensions_required,
        buffers: guard.elements(&mut document, BUFFERS, |name, json| guard.check(name, json, OF_BUFFER))?,
        buffer_views: guard.elements(&mut document, VIEWS, |name, json| guard.check(name, json, OF_VIEW))?,
        accessors: guard.elements(&mut document, ACCESSORS, |name, json| guard.check_accessor(name, json))?,
        meshes: guard.elements(&mut document, MESHES, |name, json| guard.check_mesh(name, json))?,
        nodes: guard.elements(&mut document, NODES, |name, json| {
            guard.check(name, json, OF_NODE)?;
            let transform = Transform::deserialize(&*json);
            transforms.push(transform.map_err(|e| invalid(path, name, e.to_string(), NEEDED))?);
            Ok(())
        })?,
        scenes: guard.elements(&mut document, SCENES, |name, json| {
            guard.check(name, json, OF_SCENE)?;
            if let Value::Object(scene) = json {
                scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
            }
            Ok(())
        })?,
        ..Root::default()
    };
    Ok((root, transforms))
}

const NEEDED: &str = "an object as glTF 2.0 describes it";

/// The lengths of the arrays that indices point into.
struct Guard<'a> {
    path: &'a Path,
    lengths: Vec<(&'static str, usize)>,
}

impl<'a> Guard<'a> {
    fn new(path: &'a Path, document: &Value) -> Result<Self, IoError> {
        let mut lengths = Vec::new();
        for (key, name) in [BUFFERS, VIEWS, ACCESSORS, MESHES, NODES, SCENES, MATERIALS, SKINS, CAMERAS] {
            let length = match document.get(key) {
                None => 0,
                Some(Value::Array(elements)) => elements.len(),
                Some(_) => return Err(invalid(path, key, "no array", format!("an array of {name} objects"))),
            };
            lengths.push((key, length));
        }
        Ok(Self { path, lengths })
    }

    /// The elements of a top-level array, each checked, then read. An array that is there is not
    /// empty.
    fn elements<T: DeserializeOwned>(
        &self,
        document: &mut Map<String, Value>,
        (key, name): Array,
        mut check: impl FnMut(&str, &mut Value) -> Result<(), IoError>,
    ) -> Result<Vec<T>, IoError> {
        let Some(Value::Array(elements)) = document.remove(key) else { return Ok(Vec::new()) };
        if elements.is_empty() {
            return Err(invalid(self.path, key, "an empty list", format!("a {name}, or no list")));
        }
        let mut read = Vec::with_capacity(elements.len());
        for (i, mut json) in elements.into_iter().enumerate() {
            let name = format!("{name} {i}");
            check(&name, &mut json)?;
            read.push(self.typed(&name, json)?);
        }
        Ok(read)
    }

    /// A checked object as a type of the crate.
    fn typed<T: DeserializeOwned>(&self, element: &str, json: Value) -> Result<T, IoError> {
        serde_json::from_value(json).map_err(|e| invalid(self.path, element, e.to_string(), NEEDED))
    }

    /// Checks the properties of one object, and rewrites whole numbers as integers.
    fn check(&self, element: &str, object: &mut Value, rules: Rules) -> Result<(), IoError> {
        for (key, rule) in rules {
            let Some(value) = object.get_mut(key).filter(|value| !value.is_null()) else { continue };
            let refuse = |value: &Value, needed: String| {
                let found = format!("{key} {}", excerpt(&value.to_string()).trim_matches('"'));
                Err(invalid(self.path, element, found, needed))
            };
            match rule {
                Rule::Uint if uint(value).is_none() => return refuse(value, UINT.into()),
                Rule::Uint => {}
                Rule::Index(array) => self.check_index(&format!("{element} {key}"), value, *array)?,
                Rule::Indices(array) => match value {
                    Value::Array(all) if all.is_empty() => {
                        return Err(invalid(
                            self.path,
                            format!("{element} {key}"),
                            "an empty list",
                            NOT_EMPTY,
                        ));
                    }
                    Value::Array(all) => {
                        let element = format!("{element} {key}");
                        all.iter_mut().try_for_each(|value| self.check_index(&element, value, *array))?;
                    }
                    _ => return refuse(value, format!("a list of {}", array.0)),
                },
                Rule::Code(codes) if !uint(value).is_some_and(|code| codes.contains(&code)) => {
                    return refuse(value, format!("one of {codes:?}"));
                }
                Rule::Word(words) if !value.as_str().is_some_and(|word| words.contains(&word)) => {
                    return refuse(value, format!("one of {}", words.join(", ")));
                }
                Rule::Code(_) | Rule::Word(_) => {}
            }
        }
        Ok(())
    }

    /// Checks that an index names an element that is there.
    fn check_index(&self, element: &str, value: &mut Value, (key, name): Array) -> Result<(), IoError> {
        let length = self.lengths.iter().find(|(k, _)| *k == key).map_or(0, |(_, length)| *length);
        match uint(value) {
            None => Err(invalid(self.path, element, excerpt(&value.to_string()), UINT)),
            Some(index) if usize::try_from(index).is_ok_and(|index| index < length) => Ok(()),
            Some(index) => Err(invalid(
                self.path,
                element,
                format!("{name} {index}"),
                format!("one of the file's {length}"),
            )),
        }
    }

    fn check_accessor(&self, element: &str, json: &mut Value) -> Result<(), IoError> {
        self.check(element, json, OF_ACCESSOR)?;
        let Some(sparse) = json.get_mut("sparse") else { return Ok(()) };
        self.check(&format!("{element} sparse"), sparse, OF_SPARSE)?;
        for (key, rules) in [("indices", OF_SPARSE_INDICES), ("values", OF_SPARSE_VALUES)] {
            if let Some(part) = sparse.get_mut(key) {
                self.check(&format!("{element} sparse {key}"), part, rules)?;
            }
        }
        Ok(())
    }

    fn check_mesh(&self, element: &str, json: &mut Value) -> Result<(), IoError> {
        let Some(Value::Array(primitives)) = json.get_mut("primitives") else { return Ok(()) };
        if primitives.is_empty() {
            return Err(invalid(self.path, element, "no primitives", "at least one"));
        }
        for (p, primitive) in primitives.iter_mut().enumerate() {
            let element = format!("{element} primitive {p}");
            self.check(&element, primitive, OF_PRIMITIVE)?;
            if let Some(attributes) = primitive.get_mut("attributes") {
                self.check_attributes(&element, attributes)?;
            }
            let Some(Value::Array(targets)) = primitive.get_mut("targets") else { continue };
            for (t, target) in targets.iter_mut().enumerate() {
                self.check_attributes(&format!("{element} target {t}"), target)?;
            }
        }
        Ok(())
    }

    /// Names and accessors of attributes.
    fn check_attributes(&self, element: &str, attributes: &mut Value) -> Result<(), IoError> {
        let Value::Object(attributes) = attributes else {
            return Err(invalid(self.path, element, "attributes that are not an object", NEEDED));
        };
        for (name, accessor) in attributes {
            let element = format!("{element} {}", excerpt(name).trim_matches('"'));
            if !is_attribute(name) {
                let needed = "a name of glTF 2.0, or one that starts with _";
                return Err(invalid(self.path, element, "an unknown attribute", needed));
            }
            self.check_index(&element, accessor, ACCESSORS)?;
        }
        Ok(())
    }
}

const UINT: &str = "a whole number that is not negative";
const NOT_EMPTY: &str = "an element, or no list";

/// A whole number that is not negative, also when written as `1.0` or `10e-1`; it is rewritten as
/// an integer.
fn uint(value: &mut Value) -> Option<u64> {
    /// Beyond 2^53 a float cannot tell neighbouring integers apart.
    const EXACT: f64 = 9_007_199_254_740_992.0;
    if let Some(whole) = value.as_u64() {
        return Some(whole);
    }
    let float = value.as_f64().filter(|x| x.fract() == 0.0 && (0.0..=EXACT).contains(x))?;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole and in range, as just checked"
    )]
    let whole = float as u64;
    *value = whole.into();
    Some(whole)
}

/// Splits `JOINTS_0`; the number is written without leading zeros.
pub(super) fn numbered(name: &str) -> Option<(&str, u32)> {
    let (base, digits) = name.rsplit_once('_')?;
    let known = ["TEXCOORD", "COLOR", "JOINTS", "WEIGHTS"].contains(&base);
    let set = digits.parse::<u32>().ok().filter(|n| n.to_string() == digits)?;
    known.then_some((base, set))
}

fn is_attribute(name: &str) -> bool {
    matches!(name, "POSITION" | "NORMAL" | "TANGENT") || name.starts_with('_') || numbered(name).is_some()
}
