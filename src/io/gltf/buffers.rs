//! Buffers: the binary chunk, data URIs, and files next to the document.
//!
//! The import of the `gltf` crate is not used: it follows URIs out of the folder, and decodes
//! images.

use std::{
    path::{Component, Path, PathBuf},
    rc::Rc,
};

use base64::{Engine as _, engine::general_purpose::STANDARD};

use crate::io::{
    IoError,
    file::Source,
    gltf::document::{Document, MAGIC},
};

impl Document {
    /// The bytes of a buffer, exactly as many as it declares; loaded when first asked for.
    pub(super) fn buffer(&self, index: usize) -> Result<&[u8], IoError> {
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

    fn load(&self, element: &str, uri: &str, length: usize) -> Result<Rc<Vec<u8>>, IoError> {
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

    fn decode_data(&self, element: &str, data: &str, length: usize) -> Result<Vec<u8>, IoError> {
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

    /// The file a relative URI names: in the folder of the document or below, never elsewhere.
    fn resolve(&self, element: &str, uri: &str) -> Result<PathBuf, IoError> {
        let needed = "a file in the folder of the document";
        let refuse = |found: &str| Err(self.invalid(element, format!("{found}: {uri:?}"), needed));
        let scheme = uri.split(['/', '?', '#']).next().is_some_and(|first| first.contains(':'));
        if scheme {
            return refuse("a uri with a scheme");
        }
        let Some(bytes) = percent_decode(uri) else { return refuse("a broken % escape") };
        let Ok(name) = String::from_utf8(bytes) else { return refuse("a uri that is not UTF-8") };
        if name.contains(['\\', '\0']) {
            return refuse("a character no file name may have");
        }
        let relative = Path::new(&name);
        let stays = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
        if name.is_empty() || !relative.components().all(stays) {
            return refuse("a uri that leaves the folder");
        }
        let folder = match self.path().parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let fail = |source, path: &Path| IoError::Read { path: path.into(), source };
        let target = folder.join(relative);
        let inside = folder.canonicalize().map_err(|e| fail(e, folder))?;
        let target = target.canonicalize().map_err(|e| fail(e, &target))?;
        if !target.starts_with(&inside) {
            return refuse("a link that leaves the folder");
        }
        Ok(target)
    }
}

/// Replaces `%41` by the byte 0x41; `None` if two hexadecimal digits do not follow a `%`.
fn percent_decode(uri: &str) -> Option<Vec<u8>> {
    let mut bytes = uri.bytes();
    let mut out = Vec::with_capacity(uri.len());
    while let Some(byte) = bytes.next() {
        if byte != b'%' {
            out.push(byte);
            continue;
        }
        let mut digit = || char::from(bytes.next()?).to_digit(16).and_then(|d| u8::try_from(d).ok());
        out.push(digit()? << 4 | digit()?);
    }
    Some(out)
}
