//! The JSON of a document, read by the types of the `gltf` crate.
//!
//! The crate believes what it reads, so these things stay ours (`gltf` 1.4):
//! - It takes indices and codes modulo 2^32: larger numbers become 2^32 - 1, which no file has.
//! - `1.0` is a whole number in JSON, but not to the crate: it is rewritten.
//! - A scene needs no list of nodes: it gets an empty one.
//! - Transforms of nodes are `f32` there, which would move links given in decimals: [`Transform`]
//!   keeps `f64`.
//! - A fault in a material, a texture or an animation would refuse the file: what is not read is
//!   left out. Its validation runs on each element when that is used ([`check`]), for the same reason.

use gltf::json::validation::{self, Validate};
use gltf::json::{Path, Root};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::io::error::Result;
use crate::io::file::{Source, excerpt};

/// The transform of a node as the file states it.
#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct Transform {
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
}

/// What the types of the crate are read for.
const READ: [&str; 12] = [
    "extras",
    "asset",
    "extensionsUsed",
    "extensionsRequired",
    "buffers",
    "bufferViews",
    "accessors",
    "meshes",
    "nodes",
    "skins",
    "scene",
    "scenes",
];

const NEEDED: &str = "a value as glTF 2.0 describes it";

pub(super) struct Parsed {
    pub root: Root,
    /// The transform of each node.
    pub transforms: Vec<Transform>,
    /// The animations, unchecked, since a skin does without them.
    pub animations: Value,
    /// The names of the materials; one without a name is called `material` and its number.
    pub materials: Vec<String>,
}

/// Reads a document, whose nodes and scenes are checked.
pub(super) fn parse(source: &Source, text: &[u8]) -> Result<Parsed> {
    let mut document: Map<String, Value> =
        serde_json::from_slice(text).map_err(|e| source.invalid("JSON", e.to_string(), NEEDED))?;
    check_version(source, &document)?;
    let transform = |(i, node): (usize, &Value)| {
        Transform::deserialize(node).map_err(|e| source.invalid(format!("node {i}"), e.to_string(), NEEDED))
    };
    let transforms = elements(&document, "nodes").iter().enumerate().map(transform).collect::<Result<_>>()?;
    document.values_mut().for_each(rewrite_numbers);
    let animations = document.remove("animations").unwrap_or_default();
    let name = |(i, material): (usize, &Value)| {
        material.get("name").and_then(Value::as_str).map_or_else(|| format!("material {i}"), str::to_owned)
    };
    let materials = elements(&document, "materials").iter().enumerate().map(name).collect();
    document.retain(|key, _| READ.contains(&key.as_str()));
    document.entry("asset").or_insert_with(|| json!({"version": "2.0"}));
    let scenes = document.get_mut("scenes").and_then(Value::as_array_mut);
    for scene in scenes.into_iter().flatten().filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| json!([]));
    }
    let root = read(source, &document)?;
    for (i, node) in root.nodes.iter().enumerate() {
        check(source, &root, ("nodes", i), node)?;
    }
    for (i, scene) in root.scenes.iter().enumerate() {
        check(source, &root, ("scenes", i), scene)?;
    }
    Ok(Parsed { root, transforms, animations, materials })
}

/// Checks element `i` of the list `key` by the crate's validation, but for what is not read.
pub(super) fn check<T: Validate>(
    source: &Source,
    root: &Root,
    (key, i): (&str, usize),
    element: &T,
) -> Result<()> {
    let mut fault = None;
    element.validate(root, || Path::new().field(key).index(i), &mut |path, found| {
        let path = path().to_string();
        let is_unread = [".camera", ".skin", ".byteStride", ".target"].iter().any(|end| path.ends_with(end));
        // An accessor without a view stands for zeros.
        let is_zeros = found == validation::Error::Missing && path.ends_with(".bufferView");
        if fault.is_none() && !is_unread && !is_zeros {
            fault = Some(source.invalid(path, found.to_string().to_lowercase(), NEEDED));
        }
    });
    fault.map_or(Ok(()), Err)
}

/// Reads a document by the crate; an error names the element.
fn read(source: &Source, document: &Map<String, Value>) -> Result<Root> {
    let read = |document: &Map<String, Value>| Root::from_slice(&serde_json::to_vec(document)?);
    let fault = match read(document) {
        Ok(root) => return Ok(root),
        Err(fault) => fault,
    };
    // Lines and columns are those of the text that the crate read, not those of the file.
    let found = |fault: serde_json::Error| {
        let text = fault.to_string();
        text.rsplit_once(" at line ").map_or(text.as_str(), |(found, _)| found).to_owned()
    };
    for key in document.keys() {
        for (i, element) in elements(document, key).iter().enumerate() {
            let alone = [("asset", json!({"version": "2.0"})), (key, json!([element]))];
            let alone = alone.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
            read(&alone).map_err(|fault| source.invalid(format!("{key}[{i}]"), found(fault), NEEDED))?;
        }
    }
    Err(source.invalid("JSON", found(fault), NEEDED))
}

/// Rewrites whole numbers that are written `1.0` or `10e-1` as integers, of 32 bits.
fn rewrite_numbers(value: &mut Value) {
    match value {
        Value::Array(all) => all.iter_mut().for_each(rewrite_numbers),
        Value::Object(all) => {
            all.iter_mut().filter(|(key, _)| *key != "extras").for_each(|(_, value)| rewrite_numbers(value));
        }
        Value::Number(number) => {
            let whole = number.as_f64().filter(|x| x.fract() == 0.0 && x.is_sign_positive());
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
            if let Some(whole) = whole {
                *value = (whole as u32).into();
            }
        }
        _ => {}
    }
}

fn elements<'a>(document: &'a Map<String, Value>, key: &str) -> &'a [Value] {
    document.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// glTF 1.0 has other keys and objects for lists.
fn check_version(source: &Source, document: &Map<String, Value>) -> Result<()> {
    let version = document.get("asset").and_then(|asset| asset.get("version"));
    let version = version.map(|v| v.as_str().map_or_else(|| v.to_string(), str::to_owned));
    let is_first = document.get("buffers").or(document.get("meshes")).is_some_and(Value::is_object);
    match version.as_deref() {
        Some(version) if version.starts_with("2.") => Ok(()),
        Some("1" | "1.0" | "1.0.1" | "1.1") => Err(source.unsupported("the file", "glTF 1.0")),
        _ if is_first => Err(source.unsupported("the file", "glTF 1.0")),
        version => Err(source.invalid("asset.version", version.map_or("nothing".into(), excerpt), "2.0")),
    }
}
