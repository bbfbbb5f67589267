//! Recordings of other programs: streams of frames whose cells are as their file has them. A [`Layout`] or what the file
//! states itself makes readings of them.
//!
//! The kind of a file follows from its first bytes ([`KINDS`], the one list). Where a file has sums of its own (force, raw
//! sum, load), they prove unit and parsing: a mismatch is an error with both numbers.
//!
//! [`Layout`]: crate::io::layout::Layout

mod arrays;
mod emed;
mod frames;
mod lines;
mod novel;
mod numbers;
mod stappone;
mod tekscan;
mod xela;
mod xsensor;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::io::IoError;
use crate::io::file::{cannot_read, invalid};
use crate::io::layout::Layout;

pub(in crate::io) use frames::{Frames, OpenStream, Sheet, Tick, Wanted};

/// Bytes from which the kind of a file is known.
const HEAD: u64 = 4096;

/// A kind of file that is read here.
struct Format {
    name: &'static str,
    /// Whether the first bytes of a file, without a byte order mark, are of this kind.
    is: fn(&[u8]) -> bool,
    open: fn(&Path, Wanted<'_>) -> Result<OpenStream, IoError>,
}

/// All kinds, each recognised by its content.
const KINDS: [Format; 7] = [
    Format { name: "Tekscan", is: |head| head.starts_with(b"DATA_TYPE"), open: tekscan::open },
    Format {
        name: "novel emed",
        is: |head| has(head, "Sensor area") && has(head, "Page 1"),
        open: emed::open,
    },
    Format {
        name: "novel",
        is: |head| head.starts_with(b"file name") && has(head, "[secs]"),
        open: novel::open,
    },
    Format {
        name: "XSENSOR",
        is: |head| head.starts_with(b"File:") && has(head, "Units:"),
        open: xsensor::open,
    },
    Format { name: "Stappone", is: |head| head.starts_with(b"sole_id,timestamp"), open: stappone::open },
    Format {
        name: "XELA",
        is: |head| head.starts_with(b"{") && has(head, "\"message\"") && has(head, "\"taxels\""),
        open: xela::open,
    },
    Format {
        name: "numpy",
        is: |head| head.starts_with(b"\x93NUMPY") || head.starts_with(b"PK\x03\x04"),
        open: arrays::open,
    },
];

fn has(head: &[u8], word: &str) -> bool {
    head.windows(word.len()).any(|part| part == word.as_bytes())
}

fn kind_of(path: &Path) -> Result<Option<&'static Format>, IoError> {
    let fail = cannot_read(path);
    let about = std::fs::metadata(path).map_err(fail)?;
    if !about.is_file() {
        return Ok(None);
    }
    let mut head = Vec::new();
    File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head)).map_err(fail)?;
    let head = head.strip_prefix("\u{feff}".as_bytes()).unwrap_or(&head);
    let head = head.trim_ascii_start();
    Ok(KINDS.iter().find(|kind| (kind.is)(head)))
}

/// Whether a file is a recording of another program, which states what it has: all kinds but arrays.
pub(in crate::io) fn is_vendor(path: &Path) -> bool {
    kind_of(path).is_ok_and(|kind| kind.is_some_and(|kind| kind.name != "numpy"))
}

/// Opens the stream that is wanted; `None` if the file is of no kind that is read here.
///
/// # Errors
/// If the file has several streams and none of them is chosen, or breaks the rules of its kind.
pub(in crate::io) fn open(path: &Path, wanted: Wanted<'_>) -> Result<Option<OpenStream>, IoError> {
    let Some(kind) = kind_of(path)? else { return Ok(None) };
    let stream = (kind.open)(path, wanted)?;
    Ok(Some(stream))
}

/// The layout of a stream: the one that is given, or what the file states.
pub(in crate::io) fn layout_of(
    path: &Path,
    stream: &OpenStream,
    given: Option<&Layout>,
) -> Result<Layout, IoError> {
    match given {
        Some(layout) => Ok(layout.clone()),
        None => Layout::of_file(path, &stream.facts),
    }
}

/// The cells of a file as a flat sheet of taxels, if it states where they are.
pub(in crate::io) fn read_sheet(path: &Path, wanted: Wanted<'_>) -> Result<Sheet, IoError> {
    let stream = open(path, wanted)?;
    let no = "no pitch and no positions of its sensors";
    let needed = "a file that states them, as those of Tekscan, XSENSOR, emed and pliance";
    stream.and_then(|stream| stream.sheet).ok_or_else(|| invalid(path, "file", no, needed))
}
