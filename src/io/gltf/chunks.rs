//! The chunks of a GLB: its JSON, and the bytes of its buffers.

use std::ops::Range;

use crate::io::{error::Result, file::Source, gltf::notes::Notes};

/// How a GLB begins.
pub(super) const MAGIC: &[u8] = b"glTF";

/// The types of chunks.
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

/// The bytes of a GLB as long as its header says: more may follow, but none may be missing.
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
