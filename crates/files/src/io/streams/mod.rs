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

pub(in crate::io) use frames::{FileTime, Frames, OpenStream, Sheet, Wanted};

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

/// The first bytes of a regular file; none of another.
fn head_of(path: &Path) -> Result<Vec<u8>, IoError> {
    let fail = cannot_read(path);
    let mut head = Vec::new();
    if std::fs::metadata(path).map_err(fail)?.is_file() {
        File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head)).map_err(fail)?;
    }
    Ok(head)
}

fn kind_of(path: &Path) -> Result<Option<&'static Format>, IoError> {
    let head = head_of(path)?;
    let head = head.strip_prefix("\u{feff}".as_bytes()).unwrap_or(&head);
    let head = head.trim_ascii_start();
    Ok(KINDS.iter().find(|kind| (kind.is)(head)))
}

/// Refuses what takes the place of a recording: the pointer of another file, text of another encoding, messages in one array.
pub(in crate::io) fn refuse_stand_in(path: &Path) -> Result<(), IoError> {
    let head = head_of(path)?;
    let is_wide = head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff");
    // Letters of UTF-16 without a mark have a zero at each second byte.
    let zeros =
        |odd: usize| head.len() > 8 && head[..8].iter().enumerate().all(|(k, b)| (*b == 0) == (k % 2 == odd));
    let is_array = head.trim_ascii_start().starts_with(b"[") && has(&head, "\"message\"");
    let (found, needed) = match () {
        () if head.starts_with(b"version https://git-lfs.github.com/") => {
            ("a pointer of Git LFS", "the file that it stands for: git lfs pull")
        }
        () if is_wide || zeros(0) || zeros(1) => ("text in UTF-16", "text in UTF-8: save it so"),
        () if is_array => ("messages in one JSON array", "a message a line, as `jq -c '.[]'` writes them"),
        () => return Ok(()),
    };
    Err(invalid(path, "file", found, needed))
}

/// Whether a file is a recording of another program, which states what it has: all kinds but arrays.
pub(in crate::io) fn is_vendor(path: &Path) -> bool {
    kind_of(path).is_ok_and(|kind| kind.is_some_and(|kind| kind.name != "numpy"))
}

/// Whether a file has arrays of numpy.
pub(in crate::io) fn is_arrays(path: &Path) -> bool {
    kind_of(path).is_ok_and(|kind| kind.is_some_and(|kind| kind.name == "numpy"))
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
