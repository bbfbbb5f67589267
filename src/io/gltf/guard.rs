//! What a document must hold before the types of the `gltf` crate read it.
//!
//! They serve reading and writing, and believe what they read, so every index, code and name is
//! checked in the JSON first, and these things stay ours:
//! - Indices and codes of 2^32 and more wrap around, unknown codes lose their number, and unknown
//!   names of attributes fall together: all are refused here, with what was found.
//! - `1.0` is a whole number in JSON, but not to the crate: it is rewritten.
//! - A scene needs no list of nodes: it gets an empty one.
//! - Transforms of nodes are `f32` there, which would move links given in decimals: [`Transform`]
//!   keeps `f64`.
//! - A fault in a material or a texture would refuse the file: materials and cameras are
//!   only counted, animations and skins checked where they are read.
//! - An accessor, view, buffer or mesh that is broken is an error when it is used, not before; what
//!   touches no triangle is noted ([`Notes`]).

use std::collections::{BTreeMap, BTreeSet};

use gltf::json::{Asset, Index, Root};
use serde::{Deserialize, de::DeserializeOwned};
use serde_json::{Map, Value, json};

use crate::io::{
    error::Result,
    file::{Source, excerpt},
    gltf::notes::Notes,
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

/// What a property must be, where it is there; counts, sizes and offsets are checked by their type.
enum Rule {
    /// The place of an element.
    Index(Array),
    /// Places of elements, at least one.
    Indices(Array),
    /// One of these numbers.
    Code(&'static [u64]),
    /// One of these words.
    Word(&'static [&'static str]),
}

type Rules = &'static [(&'static str, Rule)];

const OF_DOCUMENT: Rules = &[("scene", Rule::Index(SCENES))];
const OF_VIEW: Rules = &[("buffer", Rule::Index(BUFFERS)), ("target", Rule::Code(&[34962, 34963]))];
const OF_ACCESSOR: Rules = &[
    ("bufferView", Rule::Index(VIEWS)),
    ("componentType", Rule::Code(&[5120, 5121, 5122, 5123, 5125, 5126])),
    ("type", Rule::Word(&["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"])),
];
const OF_SPARSE_INDICES: Rules =
    &[("bufferView", Rule::Index(VIEWS)), ("componentType", Rule::Code(&[5121, 5123, 5125]))];
const OF_SPARSE_VALUES: Rules = &[("bufferView", Rule::Index(VIEWS))];
const OF_PRIMITIVE: Rules =
    &[("indices", Rule::Index(ACCESSORS)), ("mode", Rule::Code(&[0, 1, 2, 3, 4, 5, 6]))];
const LOOKS_OF_PRIMITIVE: Rules = &[("material", Rule::Index(MATERIALS))];
const OF_NODE: Rules = &[("children", Rule::Indices(NODES)), ("mesh", Rule::Index(MESHES))];
const LOOKS_OF_NODE: Rules = &[("skin", Rule::Index(SKINS)), ("camera", Rule::Index(CAMERAS))];
const OF_SCENE: Rules = &[("nodes", Rule::Indices(NODES))];

const NEEDED: &str = "an object as glTF 2.0 describes it";

/// A checked document.
pub(super) struct Parsed {
    pub root: Root,
    /// The transform of each node.
    pub transforms: Vec<Transform>,
    /// The animations, unchecked, since a skin does without them.
    pub animations: Value,
    /// The skins, unchecked.
    pub skins: Value,
    /// The names of the materials; one without a name is called `material` and its number.
    pub materials: Vec<String>,
}

/// Checks a document and hands it to the types of the crate.
pub(super) fn parse(source: &Source, text: &[u8], notes: &Notes) -> Result<Parsed> {
    let mut document: Value =
        serde_json::from_slice(text).map_err(|e| source.invalid("JSON", e.to_string(), NEEDED))?;
    rewrite_whole_numbers(&mut document);
    let guard = Guard::new(source, &mut document, notes)?;
    guard.pass_over("the file", &mut document, OF_DOCUMENT)?;
    guard.drop_second_parents(&mut document)?;
    let Value::Object(mut document) = document else {
        return Err(source.invalid("JSON", "no object", NEEDED));
    };
    let animations = document.remove("animations").unwrap_or_default();
    let skins = document.remove(SKINS.0).unwrap_or_default();
    let name = |(i, material): (usize, &Value)| {
        material.get("name").and_then(Value::as_str).map_or_else(|| format!("material {i}"), str::to_owned)
    };
    let materials = document.get(MATERIALS.0).and_then(Value::as_array);
    let materials = materials.map(|all| all.iter().enumerate().map(name).collect()).unwrap_or_default();
    let asset: Asset = guard.typed("asset", document.remove("asset").unwrap_or_default())?;
    let scene: Option<Index<_>> = guard.typed("scene", document.remove("scene").unwrap_or_default())?;
    let mut names =
        |key: &str| document.remove(key).map_or_else(|| Ok(Vec::new()), |list| guard.typed(key, list));
    let (extensions_used, extensions_required) = (names("extensionsUsed")?, names("extensionsRequired")?);
    let mut transforms = Vec::new();
    let mut root = Root {
        asset,
        scene,
        extensions_used,
        extensions_required,
        buffers: guard.parts(&mut document, BUFFERS, json!({"byteLength": 0}), |_, _| Ok(()))?,
        buffer_views: guard.parts(
            &mut document,
            VIEWS,
            json!({"buffer": 0, "byteLength": 0}),
            |name, json| guard.check(name, json, OF_VIEW),
        )?,
        accessors: guard.parts(
            &mut document,
            ACCESSORS,
            json!({"componentType": 5126, "count": 0, "type": "SCALAR"}),
            |name, json| guard.check_accessor(name, json),
        )?,
        meshes: guard.parts(&mut document, MESHES, json!({"primitives": []}), |name, json| {
            guard.check_mesh(name, json)
        })?,
        nodes: guard.elements(&mut document, NODES, |name, json| {
            guard.pass_over(name, json, LOOKS_OF_NODE)?;
            guard.check(name, json, OF_NODE)?;
            let transform = Transform::deserialize(&*json);
            transforms.push(transform.map_err(|e| source.invalid(name, e.to_string(), NEEDED))?);
            Ok(())
        })?,
        scenes: guard.elements(&mut document, SCENES, |name, json| {
            guard.drop_empty(name, json, "nodes")?;
            guard.check(name, json, OF_SCENE)?;
            if let Value::Object(scene) = json {
                scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
            }
            Ok(())
        })?,
        ..Root::default()
    };
    // The crate looks a view's buffer up before anyone can ask whether the view is broken.
    if root.buffers.is_empty() && !root.buffer_views.is_empty() {
        root.buffers.push(guard.typed("buffers", json!({"byteLength": 0}))?);
    }
    Ok(Parsed { root, transforms, animations, skins, materials })
}

/// Rewrites whole numbers that are not negative as integers, also those written `1.0` or `10e-1`.
fn rewrite_whole_numbers(value: &mut Value) {
    /// Beyond 2^53 a float cannot tell neighbouring integers apart.
    const EXACT: f64 = 9_007_199_254_740_992.0;
    match value {
        Value::Array(all) => all.iter_mut().for_each(rewrite_whole_numbers),
        Value::Object(all) => all.values_mut().for_each(rewrite_whole_numbers),
        Value::Number(number) if number.is_f64() => {
            let whole = number.as_f64().filter(|x| x.fract() == 0.0 && (0.0..=EXACT).contains(x));
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "whole and in range, as just checked"
            )]
            if let Some(whole) = whole.filter(|x| x.is_sign_positive()) {
                *value = (whole as u64).into();
            }
        }
        _ => {}
    }
}

/// The lengths of the arrays that indices point into.
struct Guard<'a> {
    source: &'a Source,
    notes: &'a Notes,
    lengths: BTreeMap<&'static str, usize>,
}

impl<'a> Guard<'a> {
    fn new(source: &'a Source, document: &mut Value, notes: &'a Notes) -> Result<Self> {
        let mut lengths = BTreeMap::new();
        for (key, name) in [BUFFERS, VIEWS, ACCESSORS, MESHES, NODES, SCENES, MATERIALS, SKINS, CAMERAS] {
            let Some(value) = document.get(key) else { continue };
            let Some(elements) = value.as_array() else {
                let fault = source.invalid(key, "no array", format!("an array of {name} objects"));
                if ![MATERIALS, SKINS, CAMERAS].contains(&(key, name)) {
                    return Err(fault);
                }
                notes.pass(fault)?;
                continue;
            };
            lengths.insert(key, elements.len());
        }
        Ok(Self { source, notes, lengths })
    }

    /// Notes the properties that break their rule, and removes them.
    fn pass_over(&self, element: &str, object: &mut Value, rules: Rules) -> Result<()> {
        for rule in rules {
            if let Err(fault) = self.check(element, object, std::slice::from_ref(rule)) {
                self.notes.pass(fault)?;
                if let Value::Object(object) = object {
                    object.remove(rule.0);
                }
            }
        }
        Ok(())
    }

    /// Notes a list without elements, and removes it.
    fn drop_empty(&self, element: &str, object: &mut Value, key: &str) -> Result<()> {
        if object.get(key).and_then(Value::as_array).is_some_and(Vec::is_empty) {
            let needed = "an element: an empty list must be left out";
            self.notes.pass(self.source.invalid(element, format!("{key} []"), needed))?;
            if let Value::Object(object) = object {
                object.remove(key);
            }
        }
        Ok(())
    }

    /// Leaves every node to the first node that lists it as a child; a scene lists a node once.
    fn drop_second_parents(&self, document: &mut Value) -> Result<()> {
        let mut parents: BTreeMap<u64, usize> = BTreeMap::new();
        for (i, node) in elements_of(document, NODES.0).iter_mut().enumerate() {
            self.drop_empty(&format!("node {i}"), node, "children")?;
            let Some(Value::Array(children)) = node.get_mut("children") else { continue };
            let mut faults = Vec::new();
            children.retain(|child| {
                let Some(index) = child.as_u64() else { return true };
                match parents.get(&index) {
                    None => {
                        parents.insert(index, i);
                        true
                    }
                    Some(first) => {
                        let found = format!("a child of node {first} and again of node {i}");
                        faults.push(self.source.invalid(format!("node {index}"), found, "one parent"));
                        false
                    }
                }
            });
            let is_empty = children.is_empty();
            faults.into_iter().try_for_each(|fault| self.notes.pass(fault))?;
            if is_empty && let Value::Object(node) = node {
                node.remove("children");
            }
        }
        for (s, scene) in elements_of(document, SCENES.0).iter_mut().enumerate() {
            let Some(Value::Array(nodes)) = scene.get_mut("nodes") else { continue };
            let mut seen = BTreeSet::new();
            let before = nodes.len();
            nodes.retain(|node| node.as_u64().is_none_or(|index| seen.insert(index)));
            if nodes.len() < before {
                let found = "a node that is listed twice";
                self.notes.pass(self.source.invalid(format!("scene {s}"), found, "every node once"))?;
            }
        }
        Ok(())
    }

    /// The elements of a top-level array whose faults count when they are used; `empty` stands for
    /// those that have one.
    fn parts<T: DeserializeOwned>(
        &self,
        document: &mut Map<String, Value>,
        (key, name): Array,
        empty: Value,
        check: impl Fn(&str, &mut Value) -> Result<()>,
    ) -> Result<Vec<T>> {
        let mut index = 0;
        self.elements(document, (key, name), |name, json| {
            let sound = check(name, json).and_then(|()| self.typed::<T>(name, json.clone()));
            if let Err(fault) = sound {
                self.notes.hold(key, index, fault)?;
                json.clone_from(&empty);
            }
            index += 1;
            Ok(())
        })
    }

    /// The elements of a top-level array, each checked, then read. An array that is there has some.
    fn elements<T: DeserializeOwned>(
        &self,
        document: &mut Map<String, Value>,
        (key, name): Array,
        mut check: impl FnMut(&str, &mut Value) -> Result<()>,
    ) -> Result<Vec<T>> {
        let Some(Value::Array(elements)) = document.remove(key) else { return Ok(Vec::new()) };
        if elements.is_empty() {
            self.notes.pass(self.source.invalid(key, "an empty list", format!("a {name}, or no list")))?;
        }
        let read = |(i, mut json)| {
            let name = format!("{name} {i}");
            check(&name, &mut json)?;
            self.typed(&name, json)
        };
        elements.into_iter().enumerate().map(read).collect()
    }

    fn typed<T: DeserializeOwned>(&self, element: &str, json: Value) -> Result<T> {
        serde_json::from_value(json).map_err(|e| self.source.invalid(element, e.to_string(), NEEDED))
    }

    fn check(&self, element: &str, object: &Value, rules: Rules) -> Result<()> {
        for (key, rule) in rules {
            let Some(value) = object.get(key).filter(|value| !value.is_null()) else { continue };
            let needed = match rule {
                Rule::Index(array) => {
                    self.check_index(&format!("{element} {key}"), value, *array)?;
                    continue;
                }
                Rule::Indices(array) => match value.as_array() {
                    Some(all) if !all.is_empty() => {
                        let element = format!("{element} {key}");
                        all.iter().try_for_each(|value| self.check_index(&element, value, *array))?;
                        continue;
                    }
                    Some(_) => "an element: an empty list must be left out".into(),
                    None => format!("a list of {}", array.0),
                },
                Rule::Code(codes) if value.as_u64().is_some_and(|code| codes.contains(&code)) => continue,
                Rule::Code(codes) => format!("one of {codes:?}"),
                Rule::Word(words) if value.as_str().is_some_and(|word| words.contains(&word)) => continue,
                Rule::Word(words) => format!("one of {}", words.join(", ")),
            };
            let found = format!("{key} {}", excerpt(&value.to_string()).trim_matches('"'));
            return Err(self.source.invalid(element, found, needed));
        }
        Ok(())
    }

    fn check_index(&self, element: &str, value: &Value, (key, name): Array) -> Result<()> {
        let length = self.lengths.get(key).copied().unwrap_or_default();
        if value.as_u64().is_some_and(|index| index < length as u64) {
            return Ok(());
        }
        let found = format!("{name} {}", excerpt(&value.to_string()).trim_matches('"'));
        Err(self.source.invalid(element, found, format!("one of the file's {length}, counted from 0")))
    }

    fn check_accessor(&self, element: &str, json: &Value) -> Result<()> {
        self.check(element, json, OF_ACCESSOR)?;
        if json.get("byteOffset").is_some() && json.get("bufferView").is_none() {
            return Err(self.source.invalid(element, "byteOffset without bufferView", "both or neither"));
        }
        let sparse = |key| json.get("sparse").and_then(|sparse| sparse.get(key)).unwrap_or(&Value::Null);
        self.check(&format!("{element} sparse indices"), sparse("indices"), OF_SPARSE_INDICES)?;
        self.check(&format!("{element} sparse values"), sparse("values"), OF_SPARSE_VALUES)
    }

    fn check_mesh(&self, element: &str, json: &mut Value) -> Result<()> {
        let Some(Value::Array(primitives)) = json.get_mut("primitives").filter(|p| **p != json!([])) else {
            return Err(self.source.invalid(element, "no primitives", "at least one"));
        };
        for (p, primitive) in primitives.iter_mut().enumerate() {
            let element = format!("{element} primitive {p}");
            self.check(&element, primitive, OF_PRIMITIVE)?;
            self.pass_over(&element, primitive, LOOKS_OF_PRIMITIVE)?;
            if let Some(attributes) = primitive.get_mut("attributes") {
                self.check_attributes(&element, attributes)?;
            }
            let mut faults = Vec::new();
            for (t, target) in elements_of(primitive, "targets").iter_mut().enumerate() {
                faults.extend(self.check_attributes(&format!("{element} target {t}"), target).err());
            }
            for fault in faults {
                self.notes.pass(fault)?;
                if let Value::Object(primitive) = primitive {
                    primitive.remove("targets");
                }
            }
        }
        Ok(())
    }

    /// Removes attributes that nothing needs and that do not exist; those that are needed have to.
    fn check_attributes(&self, element: &str, attributes: &mut Value) -> Result<()> {
        let Value::Object(attributes) = attributes else {
            return Err(self.source.invalid(element, "attributes that are not an object", NEEDED));
        };
        let mut faults = Vec::new();
        attributes.retain(|name, accessor| {
            let element = format!("{element} {}", excerpt(name).trim_matches('"'));
            let is_own = matches!(name.as_str(), "POSITION" | "NORMAL" | "TANGENT") || name.starts_with('_');
            let fault = if !is_own && numbered(name).is_none() {
                let needed = "a name of glTF 2.0, or one that starts with _";
                Err(self.source.invalid(element, "an unknown attribute", needed))
            } else {
                self.check_index(&element, accessor, ACCESSORS)
            };
            let is_sound = fault.is_ok();
            faults.extend(fault.err().map(|fault| (is_needed(name), fault)));
            is_sound
        });
        faults.into_iter().try_for_each(
            |(is_needed, fault)| {
                if is_needed { Err(fault) } else { self.notes.pass(fault) }
            },
        )
    }
}

fn elements_of<'a>(json: &'a mut Value, key: &str) -> &'a mut [Value] {
    json.get_mut(key).and_then(Value::as_array_mut).map_or(&mut [], Vec::as_mut_slice)
}

/// Whether a skin needs an attribute: the others are looks, or are computed where they are wrong.
pub(super) fn is_needed(attribute: &str) -> bool {
    const OF_TAXELS: [&str; 10] = [
        "_TAXEL_ID",
        "_AREA",
        "_DENSITY",
        "_WEIGHT",
        "_ACUITY",
        "_PRESENT",
        "_COVARIANCE_0",
        "_COVARIANCE_1",
        "_JOINTS",
        "_JOINT_WEIGHTS",
    ];
    attribute == "POSITION" || OF_TAXELS.contains(&attribute)
}

/// Splits `JOINTS_0`; the number is written without leading zeros.
pub(super) fn numbered(name: &str) -> Option<(&str, u32)> {
    let (base, digits) = name.rsplit_once('_')?;
    let known = ["TEXCOORD", "COLOR", "JOINTS", "WEIGHTS"].contains(&base);
    let set = digits.parse::<u32>().ok().filter(|n| n.to_string() == digits)?;
    known.then_some((base, set))
}
