//! The file as it lies on the disk: JSON, or a GLB of a JSON and a binary chunk.
//!
//! The reader of the `gltf` crate is not used: it takes a header for granted whose length is too
//! small, passes over bytes after the end, and does not say which chunk is broken.

use std::{fs, io, ops::Range, path::Path};

use crate::io::{IoError, file::source::invalid};

/// Most marks of structure (braces, brackets, commas, colons) of a JSON text: some hundred bytes of
/// memory may stand behind each, so a file of ten megabytes could otherwise ask for gigabytes. A
/// robot has some hundred nodes.
const MAX_JSON_MARKS: usize = 1 << 21;

/// How a GLB begins.
pub(super) const MAGIC: &[u8] = b"glTF";

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
pub(super) fn split_chunks(
    path: &Path,
    bytes: &[u8],
) -> Result<(Range<usize>, Option<Range<usize>>), IoError> {
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

/// Refuses a text with more structure than a robot needs.
pub(super) fn check_marks(path: &Path, text: &[u8]) -> Result<(), IoError> {
    if text.is_empty() {
        return Err(invalid(path, "the file", "no bytes", "a GLB header or JSON"));
    }
    let marks = count_marks(text);
    if marks > MAX_JSON_MARKS {
        let needed = format!("at most {MAX_JSON_MARKS}: numbers belong into buffers");
        return Err(invalid(path, "JSON", format!("{marks} braces, brackets, commas and colons"), needed));
    }
    Ok(())
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
