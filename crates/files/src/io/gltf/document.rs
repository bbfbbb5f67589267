//! A document: the chunks of its file, its JSON, version and extensions, the budget of memory, and its
//! buffers: the binary chunk, data URIs, and files next to the document.
//!
//! The GLB reader of the `gltf` crate is not used: it accepts a header whose length is too
//! small, passes over bytes after the end, and does not report which chunk is broken. Neither is its
//! import, which follows URIs out of the folder, and decodes images.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::BTreeMap;
use std::ops::{Deref, Range};
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use gltf::json::Root;

use crate::io::Feature;
use crate::io::error::Result;
use crate::io::file::{Source, cannot_read, percent_decoded};
use crate::io::gltf::Notes;
use crate::io::gltf::json::{self, Parsed, Transform};

/// Bytes that decoding may take whatever the size of the file: many nodes may use one mesh.
const FREE_BYTES: u64 = 256 << 20;

/// Decoded bytes over bytes in the file: bytes that become `f64` grow by eight, nothing grows more.
const GROWTH: u64 = 8;

/// Most marks of structure (braces, brackets, commas, colons) of a JSON text: some hundred bytes of
/// memory may stand behind each, so a file of ten megabytes could otherwise need gigabytes. A
/// robot has some hundred nodes.
const MAX_JSON_MARKS: usize = 1 << 21;

/// An opened file: its JSON, its bytes, and what has been loaded and decoded so far.
///
/// Nothing in it is trusted: the functions that hand out objects check what they hand out.
pub(super) struct Document {
    source: Source,
    pub(super) gltf: gltf::Document,
    pub(super) transforms: Vec<Transform>,
    /// The animations as the file states them, unchecked.
    pub(super) animations: serde_json::Value,
    chunk: Option<Range<usize>>,
    pub(super) materials: Vec<String>,
    /// Faults that touch no triangle.
    pub(super) notes: Notes,
    /// Buffers from elsewhere, by number, and the files they come from.
    loaded: Vec<OnceCell<Rc<Vec<u8>>>>,
    files: RefCell<BTreeMap<PathBuf, Rc<Vec<u8>>>>,
    /// Bytes that may still be decoded.
    budget: Cell<u64>,
}

/// For the errors about its elements.
impl Deref for Document {
    type Target = Source;

    fn deref(&self) -> &Source {
        &self.source
    }
}

impl Document {
    /// Reads the JSON of a file; buffers are loaded when they are first used.
    pub(super) fn new(source: Source, notes: Notes) -> Result<Self> {
        let (text, chunk) = split_chunks(&source, &notes)?;
        let text = &source.bytes()[text];
        check_marks(&source, text)?;
        let Parsed { root, transforms, animations, materials } = json::parse(&source, text)?;
        check_extensions(&source, &root)?;
        if root.extensions_used.iter().any(|name| name == INSTANCING) {
            notes.add(format!("{INSTANCING}: its copies of meshes are not read, each mesh is read once"));
        }
        Ok(Self {
            notes,
            materials,
            loaded: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            gltf: gltf::Document::from_json_without_validation(root),
            transforms,
            animations,
            chunk,
            files: RefCell::default(),
            budget: Cell::new(FREE_BYTES + GROWTH * source.bytes().len() as u64),
            source,
        })
    }

    /// The JSON, which has types that the crate lacks.
    pub(super) fn root(&self) -> &Root {
        self.gltf.as_json()
    }

    fn chunk(&self) -> Option<&[u8]> {
        self.chunk.clone().map(|range| &self.bytes()[range])
    }

    /// Adds the size of a buffer that is really there to what may be decoded.
    fn allow(&self, bytes: usize) {
        self.budget.set(self.budget.get().saturating_add(GROWTH * bytes as u64));
    }

    /// Takes memory for `count` rows of `size` bytes from the budget, before it is allocated.
    pub(super) fn reserve(&self, element: &str, count: usize, size: usize) -> Result<()> {
        let wanted = (count as u64).saturating_mul(size as u64);
        let left = self.budget.get().checked_sub(wanted).ok_or_else(|| {
            self.invalid(element, format!("{count} rows"), "no more than the bytes of the file explain")
        })?;
        self.budget.set(left);
        Ok(())
    }

    /// The bytes of a buffer, exactly as many as it declares; loaded when first used.
    pub(super) fn buffer(&self, index: usize) -> Result<&[u8]> {
        let buffer = &self.root().buffers[index];
        let element = format!("buffer {index}");
        let length = usize::try_from(buffer.byte_length.0).unwrap_or(usize::MAX);
        let bytes: &[u8] = match (&buffer.uri, self.chunk()) {
            (None, Some(chunk)) if index == 0 => chunk,
            (None, None) if index == 0 && self.bytes().starts_with(MAGIC) => {
                return Err(self.invalid(element, "no uri and no binary chunk", "one of them"));
            }
            (None, _) => {
                return Err(self.unsupported(element, "bytes from elsewhere, without a uri"));
            }
            (Some(uri), _) => {
                let slot = &self.loaded[index];
                if slot.get().is_none() {
                    let bytes = self.load(&element, uri, length)?;
                    slot.get_or_init(|| bytes);
                }
                slot.get().map_or(&[], |bytes| bytes.as_slice())
            }
        };
        bytes.get(..length).ok_or_else(|| {
            let found = format!("{} bytes of data", bytes.len());
            self.invalid(element, found, format!("byteLength, {length}"))
        })
    }

    fn load(&self, element: &str, uri: &str, length: usize) -> Result<Rc<Vec<u8>>> {
        let bytes = match uri.strip_prefix("data:") {
            Some(data) => Rc::new(self.decode_data(element, data, length)?),
            None => {
                let path = self.resolve(element, uri)?;
                if let Some(bytes) = self.files.borrow().get(&path) {
                    return Ok(Rc::clone(bytes));
                }
                let bytes = Rc::new(Source::open(&path)?.into_bytes());
                self.files.borrow_mut().insert(path, Rc::clone(&bytes));
                bytes
            }
        };
        self.allow(bytes.len());
        Ok(bytes)
    }

    fn decode_data(&self, element: &str, data: &str, length: usize) -> Result<Vec<u8>> {
        const KINDS: [&str; 2] = ["application/octet-stream", "application/gltf-buffer"];
        let shown = |text: &str| format!("data:{}", text.chars().take(40).collect::<String>());
        let needed = "data:application/octet-stream;base64,...";
        let Some((head, encoded)) = data.split_once(',') else {
            return Err(self.invalid(element, shown(data), needed));
        };
        if !head.strip_suffix(";base64").is_some_and(|kind| KINDS.contains(&kind)) {
            return Err(self.invalid(element, shown(head), needed));
        }
        if encoded.len() / 4 * 3 < length {
            let found = format!("{} characters of base64", encoded.len());
            return Err(self.invalid(element, found, format!("byteLength, {length} bytes")));
        }
        STANDARD
            .decode(encoded)
            .map_err(|e| self.invalid(element, format!("base64 with {e}"), "valid base64"))
    }

    /// The files that buffers were read from.
    pub(super) fn other_files(&self) -> Vec<PathBuf> {
        self.files.borrow().keys().cloned().collect()
    }

    /// The file a relative URI names: in the folder of the document or below, never elsewhere.
    fn resolve(&self, element: &str, uri: &str) -> Result<PathBuf> {
        let needed = "a file in the folder of the document";
        let refuse = |found: &str| Err(self.invalid(element, format!("{found}: {uri:?}"), needed));
        let scheme = uri.split(['/', '?', '#']).next().is_some_and(|first| first.contains(':'));
        if scheme {
            return refuse("a uri with a scheme");
        }
        let Some(bytes) = percent_decoded(uri) else { return refuse("a broken % escape") };
        let Ok(name) = String::from_utf8(bytes) else { return refuse("a uri that is not UTF-8") };
        if name.contains(['\\', '\0']) {
            return refuse("a character no file name may have");
        }
        let relative = Path::new(&name);
        let stays = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
        if !self.is_file() {
            return refuse("the name of another file, in a glTF read from memory");
        }
        if name.is_empty() || !relative.components().all(stays) {
            return refuse("a uri that leaves the folder");
        }
        let folder = match self.path().parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let target = folder.join(relative);
        let inside = folder.canonicalize().map_err(cannot_read(folder))?;
        let target = target.canonicalize().map_err(cannot_read(&target))?;
        if !target.starts_with(&inside) {
            return refuse("a link that leaves the folder");
        }
        Ok(target)
    }
}

/// Refuses a text with more structure than a robot needs.
fn check_marks(source: &Source, text: &[u8]) -> Result<()> {
    let (mut marks, mut in_string, mut escaped) = (0, false, false);
    for byte in text {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if in_string => escaped = true,
            b'"' => in_string = !in_string,
            b'{' | b'}' | b'[' | b']' | b',' | b':' if !in_string => marks += 1,
            _ => {}
        }
    }
    if marks > MAX_JSON_MARKS {
        let needed = format!("at most {MAX_JSON_MARKS}: numbers belong into buffers");
        return Err(source.invalid("JSON", format!("{marks} braces, brackets, commas and colons"), needed));
    }
    Ok(())
}

/// Refuses a document that requires an extension which may define its triangles.
fn check_extensions(source: &Source, root: &Root) -> Result<()> {
    match root.extensions_required.iter().find(|name| !is_harmless(name)) {
        Some(name) => Err(source.unsupported("extensionsRequired", Feature::Extension(name.clone()))),
        None => Ok(()),
    }
}

/// Compressed primitives.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

/// Copies of a mesh at many positions.
const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Extensions that change how a surface looks, but not where it is; integer positions and normals are
/// read as any numbers.
fn is_harmless(extension: &str) -> bool {
    const LOOKS: &[&str] = &[
        "_materials_",
        "_texture_",
        "_lights_",
        "_image_",
        "_techniques_",
        "_xmp",
        "_animation_pointer",
        "_audio",
        "_interactivity",
        "KHR_mesh_quantization",
    ];
    LOOKS.iter().any(|part| extension.contains(part))
}

/// How a GLB begins.
pub(super) const MAGIC: &[u8] = b"glTF";

const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// Where the JSON and the binary chunk lie; a file without the GLB magic is all JSON.
pub(super) fn split_chunks(source: &Source, notes: &Notes) -> Result<(Range<usize>, Option<Range<usize>>)> {
    if !source.bytes().starts_with(MAGIC) {
        return Ok((0..source.bytes().len(), None));
    }
    let bytes = stated_bytes(source, notes)?;
    let (mut at, mut text, mut bin) = (12, None, None);
    for number in 0.. {
        if at == bytes.len() {
            break;
        }
        let element = format!("GLB chunk {number}");
        let (Some(length), Some(kind)) = (word(bytes, at), word(bytes, at + 4)) else {
            return Err(source.invalid(
                element,
                format!("{} bytes", bytes.len() - at),
                "a header of 8 bytes",
            ));
        };
        let (start, length) = (at + 8, length as usize);
        let left = bytes.len() - start;
        if length > left {
            let needed = format!("at most the {left} bytes left");
            return Err(source.invalid(element, format!("length {length}"), needed));
        }
        at = start + length;
        if length % 4 != 0 {
            notes.pass(source.invalid(&element, format!("length {length}"), "a multiple of 4"))?;
            at = after_padding(bytes, at, start + length.next_multiple_of(4));
        }
        match (number, kind) {
            (0, JSON) => text = Some(start..start + length),
            (1, BIN) => bin = Some(start..start + length),
            (0, _) | (_, JSON | BIN) => {
                return Err(source.invalid(element, format!("type {kind:#x}"), "JSON first, BIN second"));
            }
            _ => {}
        }
    }
    Ok((text.ok_or_else(|| source.invalid("GLB", "no chunk", "a JSON chunk"))?, bin))
}

/// The bytes of a GLB, of the length in its header: more may follow, but none may be missing.
fn stated_bytes<'a>(source: &'a Source, notes: &Notes) -> Result<&'a [u8]> {
    let bytes = source.bytes();
    let invalid = |found: String, needed: &str| source.invalid("GLB header", found, needed);
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return Err(invalid(format!("{} bytes", bytes.len()), "12 bytes"));
    };
    if version != 2 {
        return Err(invalid(format!("version {version}"), "version 2"));
    }
    let length = length as usize;
    if length != bytes.len() {
        let found = format!("length {length} in a file of {} bytes", bytes.len());
        let fault = invalid(found, "the length of the file: it may be cut short");
        if length > bytes.len() || length < 12 {
            return Err(fault);
        }
        notes.pass(fault)?;
    }
    Ok(&bytes[..length])
}

/// Where the next chunk begins: at once, or after padding that the length does not count.
fn after_padding(bytes: &[u8], at: usize, padded: usize) -> usize {
    let padded = padded.min(bytes.len());
    let is_next = |at: usize| at == bytes.len() || word(bytes, at + 4) == Some(BIN);
    if !is_next(at) && is_next(padded) { padded } else { at }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}
