//! A document: its JSON and its bytes, its version and extensions, and the budget of memory.

use std::{
    cell::{Cell, OnceCell, RefCell},
    collections::{BTreeMap, BTreeSet},
    ops::Range,
    path::{Path, PathBuf},
    rc::Rc,
};

use gltf::json::{Root, validation::USize64};

use crate::io::{
    IoError,
    file::source::invalid,
    gltf::{
        container::{MAGIC, check_marks, read_file, split_chunks},
        guard::{self, Transform},
    },
};

/// Bytes that decoding may take whatever the size of the file: many nodes may use one mesh.
const FREE_BYTES: u64 = 256 << 20;

/// Decoded bytes over bytes in the file: bytes that become `f64` grow by eight, and nothing grows
/// more.
const GROWTH: u64 = 8;

/// What an accessor is read for; a view may serve one role only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// One row per vertex.
    Vertex,
    /// Corners of triangles.
    Index,
    /// Anything else.
    Plain,
}

/// What a view has been used for so far.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewUse {
    pub(super) role: Role,
    pub(super) accessor: usize,
}

/// An opened file: its JSON, its bytes, and what has been loaded and decoded so far.
///
/// Nothing in it is trusted: the functions that hand out objects check what they hand out.
pub(super) struct Document {
    path: PathBuf,
    pub(super) root: Root,
    /// The transform of each node.
    pub(super) transforms: Vec<Transform>,
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
        check_marks(path, &bytes[text.clone()])?;
        let (root, transforms) = guard::parse(path, &bytes[text])?;
        let mut document = Self {
            path: path.into(),
            loaded: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            root,
            transforms,
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

    /// Takes memory for `count` rows of `size` bytes from the budget, before any of it is
    /// allocated.
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

    /// Whether positions and normals may be integers.
    pub(super) fn is_quantized(&self) -> bool {
        self.is_quantized
    }

    fn check_version(&self) -> Result<(), IoError> {
        let asset = &self.root.asset;
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
        let used = self.names("extensionsUsed", &self.root.extensions_used)?;
        let required = self.names("extensionsRequired", &self.root.extensions_required)?;
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

/// A count, size or offset as a place in memory; one beyond the address space becomes one that no
/// array has.
pub(super) fn position(size: USize64) -> usize {
    usize::try_from(size.0).unwrap_or(usize::MAX)
}
