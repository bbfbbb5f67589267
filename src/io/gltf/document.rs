use std::{
    cell::{Cell, OnceCell, RefCell},
    collections::{BTreeMap, BTreeSet},
    fs, io,
    ops::Range,
    path::{Path, PathBuf},
    rc::Rc,
};

use crate::io::{
    IoError,
    file::source::invalid,
    gltf::{
        accessor::ViewUse,
        schema::{Json, Whole},
    },
};

/// Most marks of structure (braces, brackets, commas, colons) of a JSON text: some hundred bytes of memory may stand
/// behind each, so a file of ten megabytes could otherwise ask for gigabytes. A robot has some hundred nodes.
const MAX_JSON_MARKS: usize = 1 << 21;

/// How a GLB begins.
const MAGIC: &[u8] = b"glTF";

/// Bytes that decoding may take whatever the size of the file: one mesh may honestly be used by many nodes.
const FREE_BYTES: u64 = 256 << 20;

/// Decoded bytes over bytes in the file: bytes that become `f64` grow by eight, and nothing grows more.
const GROWTH: u64 = 8;

/// An opened file: its JSON, its bytes, and what has been loaded and decoded so far.
///
/// Nothing in it is believed: the functions that hand out objects check what they hand out.
pub(super) struct Document {
    path: PathBuf,
    pub(super) json: Json,
    /// Whether it is a GLB.
    is_binary: bool,
    /// The file, if it has a binary chunk.
    bytes: Vec<u8>,
    /// Its binary chunk.
    chunk: Option<Range<usize>>,
    /// Buffers from elsewhere, by number, and the files they come from.
    pub(super) loaded: Vec<OnceCell<Rc<Vec<u8>>>>,
    pub(super) files: RefCell<BTreeMap<PathBuf, Rc<Vec<u8>>>>,
    /// What each view has been used for.
    pub(super) views: RefCell<BTreeMap<usize, ViewUse>>,
    /// Whether it declares [`QUANTIZATION`].
    is_quantized: bool,
    /// Bytes that may still be decoded.
    budget: Cell<u64>,
}

impl Document {
    /// Reads the file and its JSON; buffers follow when they are asked for.
    pub(super) fn open(path: &Path) -> Result<Self, IoError> {
        let bytes = read_file(path)?;
        let budget = Cell::new(FREE_BYTES + GROWTH * bytes.len() as u64);
        let (text, chunk) = split_chunks(path, &bytes)?;
        let json = parse(path, &bytes[text])?;
        let mut document = Self {
            path: path.into(),
            loaded: json.buffers.iter().map(|_| OnceCell::new()).collect(),
            json,
            is_binary: bytes.starts_with(MAGIC),
            bytes: if chunk.is_some() { bytes } else { Vec::new() },
            chunk,
            files: RefCell::default(),
            views: RefCell::default(),
            is_quantized: false,
            budget,
        };
        document.check_version()?;
        document.check_extensions()?;
        Ok(document)
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the file is a GLB.
    pub(super) fn is_binary(&self) -> bool {
        self.is_binary
    }

    /// The binary chunk of a GLB.
    pub(super) fn chunk(&self) -> Option<&[u8]> {
        self.chunk.clone().map(|range| &self.bytes[range])
    }

    /// Adds the size of a buffer that is really there to what may be decoded.
    pub(super) fn allow(&self, bytes: usize) {
        self.budget.set(self.budget.get().saturating_add(GROWTH * bytes as u64));
    }

    /// Takes memory for `count` rows of `size` bytes from the budget, before any of it is allocated.
    pub(super) fn reserve(&self, element: &str, count: usize, size: usize) -> Result<(), IoError> {
        let wanted = (count as u64).saturating_mul(size as u64);
        match self.budget.get().checked_sub(wanted) {
            Some(left) => {
                self.budget.set(left);
                Ok(())
            }
            None => Err(self.invalid(
                element,
                format!("{count} rows"),
                "no more than the bytes of the file explain",
            )),
        }
    }

    /// The error for an element that breaks a rule.
    pub(super) fn invalid(
        &self,
        element: impl Into<String>,
        found: impl Into<String>,
        needed: impl Into<String>,
    ) -> IoError {
        invalid(&self.path, element, found, needed)
    }

    /// The error for an element that is valid but not read here.
    pub(super) fn unsupported(
        &self,
        element: impl Into<String>,
        feature: impl Into<String>,
        remedy: impl Into<String>,
    ) -> IoError {
        IoError::Unsupported {
            path: self.path.clone(),
            element: element.into(),
            feature: feature.into(),
            remedy: remedy.into(),
        }
    }

    /// Element `index` of the array of `name` objects, asked for by `element`.
    pub(super) fn get<'a, T>(
        &self,
        all: &'a [T],
        index: Whole,
        name: &str,
        element: impl FnOnce() -> String,
    ) -> Result<&'a T, IoError> {
        all.get(index.index()).ok_or_else(|| {
            self.invalid(element(), format!("{name} {index}"), format!("one of the file's {}", all.len()))
        })
    }

    /// Whether positions and normals may be integers.
    pub(super) fn is_quantized(&self) -> bool {
        self.is_quantized
    }

    fn check_version(&self) -> Result<(), IoError> {
        let asset = &self.json.asset;
        let parse = |text: &String| {
            let (major, minor) = text.split_once('.')?;
            let digits =
                |s: &str| s.bytes().all(|b| b.is_ascii_digit()).then(|| s.parse::<u32>().ok()).flatten();
            Some((digits(major)?, digits(minor)?))
        };
        let bad = |what: &str, text: &str, needed: &str| Err(self.invalid(what, format!("{text:?}"), needed));
        let version = match parse(&asset.version) {
            Some(version) if version.0 == 2 => version,
            _ => return bad("asset.version", &asset.version, "2.0"),
        };
        let Some(text) = &asset.min_version else { return Ok(()) };
        match parse(text) {
            Some((2, 0)) => Ok(()),
            Some(least) if least <= version => {
                Err(self.unsupported("asset.minVersion", format!("glTF {text}"), "export it as glTF 2.0"))
            }
            _ => bad("asset.minVersion", text, "no more than asset.version"),
        }
    }

    fn check_extensions(&mut self) -> Result<(), IoError> {
        let used = self.names("extensionsUsed", &self.json.extensions_used)?;
        let required = self.names("extensionsRequired", &self.json.extensions_required)?;
        for name in &required {
            let element = "extensionsRequired";
            if !used.contains(name) {
                return Err(self.invalid(element, format!("{name:?}"), "the same name in extensionsUsed"));
            }
            if let Some(remedy) = compression_remedy(name) {
                return Err(self.unsupported(element, *name, remedy));
            }
            if !is_harmless(name) {
                return Err(self.unsupported(element, *name, "export the file without this extension"));
            }
        }
        let is_quantized = used.contains(QUANTIZATION);
        if is_quantized && !required.contains(QUANTIZATION) {
            let needed = "the same name in extensionsRequired";
            return Err(self.invalid("extensionsUsed", format!("{QUANTIZATION:?}"), needed));
        }
        self.is_quantized = is_quantized;
        Ok(())
    }

    /// The names of a list, each once.
    fn names<'a>(&self, element: &str, list: &'a [String]) -> Result<BTreeSet<&'a str>, IoError> {
        let mut names = BTreeSet::new();
        match list.iter().find(|name| !names.insert(name.as_str())) {
            None => Ok(names),
            Some(name) => Err(self.invalid(element, format!("{name:?} twice"), "each name once")),
        }
    }
}

/// Integer positions and normals.
pub(super) const QUANTIZATION: &str = "KHR_mesh_quantization";
/// Compressed primitives.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

/// How to undo a compression that is not read here.
pub(super) fn compression_remedy(extension: &str) -> Option<&'static str> {
    match extension {
        DRACO => Some("undo the compression: `npx @gltf-transform/cli cp IN.glb OUT.glb`"),
        "EXT_meshopt_compression" | "KHR_meshopt_compression" => Some(
            "undo the compression: `npx @gltf-transform/cli cp IN.glb OUT.glb`, or `gltfpack -noq -i IN.glb -o OUT.glb`",
        ),
        _ => None,
    }
}

/// Extensions that change how a surface looks, but not where it is.
fn is_harmless(extension: &str) -> bool {
    const LOOKS: &[&str] = &["KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp"];
    extension == QUANTIZATION || LOOKS.iter().any(|prefix| extension.starts_with(prefix))
}

/// The bytes of a plain file; a folder, pipe or device could not be read to an end.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, IoError> {
    let fail = |source| IoError::Read { path: path.into(), source };
    let metadata = fs::metadata(path).map_err(fail)?;
    if metadata.is_dir() {
        return Err(fail(io::Error::from(io::ErrorKind::IsADirectory)));
    }
    if !metadata.is_file() {
        return Err(fail(io::Error::new(io::ErrorKind::InvalidInput, "not a plain file")));
    }
    fs::read(path).map_err(fail)
}

/// Where the JSON and the binary chunk lie; a file without the GLB magic is all JSON.
fn split_chunks(path: &Path, bytes: &[u8]) -> Result<(Range<usize>, Option<Range<usize>>), IoError> {
    const JSON: u32 = 0x4E4F_534A;
    const BIN: u32 = 0x004E_4942;
    if !bytes.starts_with(MAGIC) {
        return Ok((0..bytes.len(), None));
    }
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(invalid(path, "GLB header", format!("{} bytes", bytes.len()), "12 bytes"));
    };
    if version != 2 {
        return Err(invalid(path, "GLB header", format!("version {version}"), "version 2"));
    }
    if length as usize != bytes.len() {
        let found = format!("length {length} in a file of {} bytes", bytes.len());
        return Err(invalid(path, "GLB header", found, "the length of the file: it may be cut short"));
    }
    let (mut at, mut number, mut text, mut bin) = (12, 0, None, None);
    while at < bytes.len() {
        let element = format!("GLB chunk {number}");
        let (Some(length), Some(kind)) = (word(at), word(at + 4)) else {
            return Err(invalid(path, element, format!("{} bytes", bytes.len() - at), "a header of 8 bytes"));
        };
        let (start, length) = (at + 8, length as usize);
        if length % 4 != 0 || length > bytes.len() - start {
            let needed = format!("a multiple of 4, at most the {} bytes left", bytes.len() - start);
            return Err(invalid(path, element, format!("length {length}"), needed));
        }
        match kind {
            JSON if number == 0 => text = Some(start..start + length),
            BIN if number == 1 => bin = Some(start..start + length),
            JSON | BIN => {
                return Err(invalid(path, element, "a JSON or BIN chunk", "JSON first, BIN second"));
            }
            _ if number == 0 => return Err(invalid(path, element, format!("type {kind:#x}"), "JSON")),
            _ => {}
        }
        (at, number) = (start + length, number + 1);
    }
    let text = text.ok_or_else(|| invalid(path, "GLB", "no chunk", "a JSON chunk"))?;
    Ok((text, bin))
}

/// Parses the JSON, after a look at how much there is of it.
fn parse(path: &Path, text: &[u8]) -> Result<Json, IoError> {
    if text.is_empty() {
        return Err(invalid(path, "the file", "no bytes", "a GLB header or JSON"));
    }
    let marks = count_marks(text);
    if marks > MAX_JSON_MARKS {
        let needed = format!("at most {MAX_JSON_MARKS}: numbers belong into buffers");
        return Err(invalid(path, "JSON", format!("{marks} braces, brackets, commas and colons"), needed));
    }
    serde_json::from_slice(text)
        .map_err(|e| invalid(path, "JSON", e.to_string(), "an object as glTF 2.0 describes it"))
}

/// Braces, brackets, commas and colons outside strings.
fn count_marks(text: &[u8]) -> usize {
    let (mut marks, mut at) = (0, 0);
    while let Some(&byte) = text.get(at) {
        at += 1;
        match byte {
            b'{' | b'}' | b'[' | b']' | b',' | b':' => marks += 1,
            b'"' => at += string_length(&text[at..]),
            _ => {}
        }
    }
    marks
}

/// Bytes of a JSON string with its closing quote.
fn string_length(text: &[u8]) -> usize {
    let mut at = 0;
    while let Some(step) = text[at..].iter().position(|&b| b == b'"' || b == b'\\') {
        at += step + 1;
        if text[at - 1] == b'"' {
            return at;
        }
        // The byte after a backslash is never the end, even if it is a quote.
        at = (at + 1).min(text.len());
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_inside_strings_do_not_count() {
        assert_eq!(count_marks(br#"{"a,{\"b":[1,2]}"#), 6, "two braces, a colon, two brackets, a comma");
        assert_eq!(count_marks(br#"{"never closed \"#), 1, "a text that ends inside a string");
    }
}
