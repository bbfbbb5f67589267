//! Small glTF files, made in memory to be broken.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

/// A document and its binary chunk.
#[derive(Clone)]
pub(crate) struct Glb {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

/// Little-endian floats.
pub(crate) fn f32s(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Little-endian 16-bit integers.
pub(crate) fn u16s(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

impl Glb {
    /// A unit square of two triangles on node 0: POSITION is accessor 0 (view 0), indices accessor
    /// 1 (view 1).
    pub(crate) fn square() -> Self {
        let mut glb = Self {
            json: json!({
                "asset": {"version": "2.0"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": [{"name": "link", "mesh": 0}],
                "meshes": [{"name": "patch", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
                "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}],
            }),
            bin: Vec::new(),
        };
        let corners = f32s(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]);
        let position = glb.array(5126, "VEC3", 4, &corners);
        glb.json["accessors"][position]["min"] = json!([0, 0, 0]);
        glb.json["accessors"][position]["max"] = json!([1, 1, 0]);
        glb.array(5123, "SCALAR", 6, &u16s(&[0, 1, 2, 0, 2, 3]));
        glb
    }

    /// The parts of a GLB of two chunks.
    pub(crate) fn parse(bytes: &[u8]) -> Self {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap());
        let (text, rest) = bytes[20..].split_at(length.try_into().unwrap());
        Self { json: serde_json::from_slice(text).unwrap(), bin: rest[8..].to_vec() }
    }

    /// Appends an accessor with a view of its own; returns its number.
    pub(crate) fn array(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": component, "type": kind, "count": count}),
        )
    }

    /// Appends a view; returns its number.
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        let start = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": start, "byteLength": bytes.len()}))
    }

    /// Appends to a top-level array.
    pub(crate) fn push(&mut self, array: &str, element: Value) -> usize {
        let all = self.json[array].as_array_mut().unwrap();
        all.push(element);
        all.len() - 1
    }

    /// Adds an attribute of the square's vertices, four bytes a row.
    pub(crate) fn attribute(&mut self, name: &str, component: u32, kind: &str, bytes: &[u8]) {
        let accessor = self.array(component, kind, 4, bytes);
        self.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    }

    /// Replaces the value at a JSON pointer, whose parent must exist.
    pub(crate) fn with(mut self, pointer: &str, value: Value) -> Self {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let parent = self.json.pointer_mut(parent).unwrap_or_else(|| panic!("{pointer}"));
        match key.parse::<usize>() {
            Ok(index) if parent.is_array() => parent[index] = value,
            _ => parent[key] = value,
        }
        self
    }

    /// The file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        Self::container(&serde_json::to_vec(&self.json).unwrap(), &self.bin)
    }

    /// A GLB of any text and bytes.
    pub(crate) fn container(text: &[u8], bin: &[u8]) -> Vec<u8> {
        let mut text = text.to_vec();
        text.resize(text.len().next_multiple_of(4), b' ');
        let word = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend(word(12 + 8 + text.len() + if bin.is_empty() { 0 } else { 8 + bin.len() }));
        out.extend(word(text.len()));
        out.extend(b"JSON");
        out.extend(text);
        if !bin.is_empty() {
            out.extend(word(bin.len()));
            out.extend(b"BIN\0");
            out.extend(bin);
        }
        out
    }

    /// Writes the file into a folder.
    pub(crate) fn write(&self, folder: &Path) -> PathBuf {
        let path = folder.join("skin.glb");
        fs::write(&path, self.bytes()).unwrap();
        path
    }
}
