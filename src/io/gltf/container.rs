//! The file as it lies on the disk: JSON, or a GLB of a JSON and a binary chunk.
//!
//! The reader of the `gltf` crate is not used: it takes a header for granted whose length is too
//! small, passes over bytes after the end, and does not say which chunk is broken.

use std::ops::Range;

use crate::io::{IoError, file::Source};

/// Most marks of structure (braces, brackets, commas, colons) of a JSON text: some hundred bytes of
/// memory may stand behind each, so a file of ten megabytes could otherwise ask for gigabytes. A
/// robot has some hundred nodes.
const MAX_JSON_MARKS: usize = 1 << 21;

/// How a GLB begins.
pub(super) const MAGIC: &[u8] = b"glTF";

/// Where the JSON and the binary chunk lie; a file without the GLB magic is all JSON.
pub(super) fn split_chunks(source: &Source) -> Result<(Range<usize>, Option<Range<usize>>), IoError> {
    const JSON: u32 = 0x4E4F_534A;
    const BIN: u32 = 0x004E_4942;
    let bytes = source.bytes();
    if !bytes.starts_with(MAGIC) {
        return Ok((0..bytes.len(), None));
    }
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let header = |found: String, needed: &str| Err(source.invalid("GLB header", found, needed));
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return header(format!("{} bytes", bytes.len()), "12 bytes");
    };
    if version != 2 {
        return header(format!("version {version}"), "version 2");
    }
    if length as usize != bytes.len() {
        let found = format!("length {length} in a file of {} bytes", bytes.len());
        return header(found, "the length of the file: it may be cut short");
    }
    let (mut at, mut text, mut bin) = (12, None, None);
    for number in 0.. {
        if at == bytes.len() {
            break;
        }
        let refuse =
            |found: String, needed: String| Err(source.invalid(format!("GLB chunk {number}"), found, needed));
        let (Some(length), Some(kind)) = (word(at), word(at + 4)) else {
            return refuse(format!("{} bytes", bytes.len() - at), "a header of 8 bytes".into());
        };
        let (start, length) = (at + 8, length as usize);
        if length % 4 != 0 || length > bytes.len() - start {
            let needed = format!("a multiple of 4, at most the {} bytes left", bytes.len() - start);
            return refuse(format!("length {length}"), needed);
        }
        at = start + length;
        match (number, kind) {
            (0, JSON) => text = Some(start..at),
            (1, BIN) => bin = Some(start..at),
            (0, _) | (_, JSON | BIN) => {
                return refuse(format!("type {kind:#x}"), "JSON first, BIN second".into());
            }
            _ => {}
        }
    }
    Ok((text.ok_or_else(|| source.invalid("GLB", "no chunk", "a JSON chunk"))?, bin))
}

/// Refuses a text with more structure than a robot needs.
pub(super) fn check_marks(source: &Source, text: &[u8]) -> Result<(), IoError> {
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
