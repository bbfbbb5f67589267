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

use gltf::json::Root;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::io::{
    error::{IoError, Result},
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

const ARRAYS: [Array; 9] = [BUFFERS, VIEWS, ACCESSORS, MESHES, NODES, SCENES, MATERIALS, SKINS, CAMERAS];

/// What the types of the crate are read for.
const READ: [&str; 10] = [
    "asset",
    "extensionsUsed",
    "extensionsRequired",
    "buffers",
    "bufferViews",
    "accessors",
    "meshes",
    "nodes",
    "scene",
    "scenes",
];

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
    let mut transforms = Vec::new();
    guard.parts(&mut document, BUFFERS, |_, _| Ok(()))?;
    guard.parts(&mut document, VIEWS, |name, json| guard.check(name, json, OF_VIEW))?;
    guard.parts(&mut document, ACCESSORS, |name, json| guard.check_accessor(name, json))?;
    guard.parts(&mut document, MESHES, |name, json| guard.check_mesh(name, json))?;
    guard.elements(&mut document, NODES, |name, json| {
        guard.pass_over(name, json, LOOKS_OF_NODE)?;
        guard.check(name, json, OF_NODE)?;
        let transform = Transform::deserialize(&*json);
        transforms.push(transform.map_err(|e| source.invalid(name, e.to_string(), NEEDED))?);
        Ok(())
    })?;
    guard.elements(&mut document, SCENES, |name, json| {
        guard.drop_empty(name, json, "nodes")?;
        guard.check(name, json, OF_SCENE)?;
        if let Value::Object(scene) = json {
            scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
        }
        Ok(())
    })?;
    // The crate looks a view's buffer up before anyone can ask whether the view is broken.
    if !document.contains_key(BUFFERS.0) && document.contains_key(VIEWS.0) {
        document.insert(BUFFERS.0.into(), json!([empty_part(BUFFERS)]));
    }
    let root = guard.read(document)?;
    Ok(Parsed { root, transforms, animations, skins, materials })
}

/// Stands for an element whose fault counts when it is used.
fn empty_part((key, _): Array) -> Value {
    match key {
        "buffers" => json!({"byteLength": 0}),
        "bufferViews" => json!({"buffer": 0, "byteLength": 0}),
        "accessors" => json!({"componentType": 5126, "count": 0, "type": "SCALAR"}),
        _ => json!({"primitives": []}),
    }
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
        for (key, name) in ARRAYS {
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

    /// Checks the elements of a top-level array whose faults count when they are used.
    fn parts(
        &self,
        document: &mut Map<String, Value>,
        array: Array,
        check: impl Fn(&str, &mut Value) -> Result<()>,
    ) -> Result<()> {
        let mut index = 0;
        self.elements(document, array, |name, json| {
            if let Err(fault) = check(name, json) {
                self.hold(array, index, fault, json)?;
            }
            index += 1;
            Ok(())
        })
    }

    fn hold(&self, array: Array, index: usize, fault: IoError, json: &mut Value) -> Result<()> {
        self.notes.hold(array.0, index, fault)?;
        *json = empty_part(array);
        Ok(())
    }

    /// Checks the elements of a top-level array. An array that is there has some.
    fn elements(
        &self,
        document: &mut Map<String, Value>,
        (key, name): Array,
        mut check: impl FnMut(&str, &mut Value) -> Result<()>,
    ) -> Result<()> {
        let Some(Value::Array(elements)) = document.get_mut(key) else { return Ok(()) };
        if elements.is_empty() {
            self.notes.pass(self.source.invalid(key, "an empty list", format!("a {name}, or no list")))?;
            document.remove(key);
            return Ok(());
        }
        let mut elements = elements.iter_mut().enumerate();
        elements.try_for_each(|(i, json)| check(&format!("{name} {i}"), json))
    }

    /// Hands a checked document to the crate. What it refuses is then looked for in the elements,
    /// one by one.
    fn read(&self, mut document: Map<String, Value>) -> Result<Root> {
        document.entry("asset").or_insert_with(|| Value::Null);
        document.retain(|key, _| READ.contains(&key.as_str()));
        if let Ok(root) = root_of(&document) {
            return Ok(root);
        }
        for (key, value) in &mut document {
            let read = |value: &Value| {
                let alone = [("asset", json!({"version": "2.0"})), (key, value.clone())];
                root_of(&alone.map(|(key, value)| (key.to_owned(), value)).into_iter().collect())
            };
            let array = ARRAYS.into_iter().find(|array| array.0 == key);
            let Some((array, elements)) = array.zip(value.as_array_mut()) else {
                read(value).map_err(|found| self.source.invalid(key, found, NEEDED))?;
                continue;
            };
            for (i, json) in elements.iter_mut().enumerate() {
                let Err(found) = read(&json!([json])) else { continue };
                let fault = self.source.invalid(format!("{} {i}", array.1), found, NEEDED);
                if [NODES, SCENES].contains(&array) {
                    return Err(fault);
                }
                self.hold(array, i, fault, json)?;
            }
        }
        root_of(&document).map_err(|found| self.source.invalid("JSON", found, NEEDED))
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

/// A document as the crate's own function reads it: what reads any type is compiled once a type.
fn root_of(document: &Map<String, Value>) -> std::result::Result<Root, String> {
    let found = |e: serde_json::Error| {
        let text = e.to_string();
        text.rsplit_once(" at line ").map_or(text.as_str(), |(found, _)| found).to_owned()
    };
    let text = serde_json::to_vec(document).map_err(found)?;
    Root::from_slice(&text).map_err(found)
}

fn elements_of<'a>(json: &'a mut Value, key: &str) -> &'a mut [Value] {
    json.get_mut(key).and_then(Value::as_array_mut).map_or(&mut [], Vec::as_mut_slice)
}

/// Whether a skin needs an attribute: the others are looks, or are computed where they are wrong.
pub(super) fn is_needed(attribute: &str) -> bool {
    const OF_TAXELS: [&str; 8] = [
        "_TAXEL_ID",
        "_AREA",
        "_DENSITY",
        "_WEIGHT",
        "_ACUITY",
        "_PRESENT",
        "_COVARIANCE_0",
        "_COVARIANCE_1",
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
