//! The arrays of a file: the one of a `.npy`, or those of an `.npz`, a zip archive whose entries are
//! stored or deflated. Those of meshes are read whole.

use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use flate2::{Crc, bufread::DeflateDecoder};
use zip::{CompressionMethod, ZipArchive};

use crate::io::IoError;
use crate::io::arrays::npy::NpyHeader;
use crate::io::file::{Source, cannot_read, invalid};

/// Where the bytes of a file are; errors call it `path`.
#[derive(Clone, Copy)]
pub(in crate::io) struct Storage<'a> {
    pub(in crate::io) path: &'a Path,
    /// The content, if it is in memory.
    pub(in crate::io) bytes: Option<&'a Arc<[u8]>>,
}

trait ReadSeek: Read + Seek + Send {}

impl<T: Read + Seek + Send> ReadSeek for T {}

impl<'a> Storage<'a> {
    pub(in crate::io) const fn disk(path: &'a Path) -> Self {
        Self { path, bytes: None }
    }

    /// The bytes of a regular file, and their number.
    fn open(self) -> Result<(Box<dyn ReadSeek>, u64), IoError> {
        if let Some(bytes) = self.bytes {
            return Ok((Box::new(Cursor::new(Arc::clone(bytes))), bytes.len() as u64));
        }
        let fail = cannot_read(self.path);
        let file = File::open(self.path).map_err(fail)?;
        let about = file.metadata().map_err(fail)?;
        if !about.is_file() {
            return Err(fail(io::Error::other("it is not a regular file")));
        }
        Ok((Box::new(file), about.len()))
    }
}

pub(in crate::io) struct StoredArray {
    /// Its name; empty in a `.npy`.
    pub(in crate::io) name: String,
    pub(in crate::io) header: NpyHeader,
    range: ByteRange,
}

#[derive(Debug, Clone, Copy)]
struct ByteRange {
    /// The first of them in the file.
    start: u64,
    /// Bytes in the file.
    stored: u64,
    /// Bytes of header and elements.
    size: u64,
    packing: Packing,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    /// Not in an archive: without a checksum.
    Alone,
    Stored {
        crc: u32,
    },
    Deflated {
        crc: u32,
    },
}

impl StoredArray {
    /// What errors call it.
    pub(in crate::io) fn element(&self) -> String {
        element(&self.name)
    }

    /// Its elements, from the first on.
    pub(in crate::io) fn open(&self, storage: Storage<'_>) -> Result<Box<dyn Read + Send>, IoError> {
        let mut input = self.range.open(storage)?;
        NpyHeader::read(storage.path, &self.element(), &mut input)?;
        Ok(input)
    }
}

/// What errors call an array.
fn element(name: &str) -> String {
    if name.is_empty() { "the array".into() } else { format!("array `{name}`") }
}

impl ByteRange {
    fn open(&self, storage: Storage<'_>) -> Result<Box<dyn Read + Send>, IoError> {
        let (mut file, _) = storage.open()?;
        file.seek(SeekFrom::Start(self.start)).map_err(cannot_read(storage.path))?;
        let file = BufReader::with_capacity(1 << 18, file.take(self.stored));
        let (left, sum) = (self.size, Crc::new());
        Ok(match self.packing {
            Packing::Alone => Box::new(file),
            Packing::Stored { crc } => Box::new(Checked { input: file, left, sum, crc }),
            Packing::Deflated { crc } => {
                let input = BufReader::new(DeflateDecoder::new(file));
                Box::new(Checked { input, left, sum, crc })
            }
        })
    }
}

/// The array of a `.npy`, which has no more and no fewer elements than its shape.
pub(in crate::io) fn find_array(storage: Storage<'_>) -> Result<StoredArray, IoError> {
    let (_, length) = storage.open()?;
    let range = ByteRange { start: 0, stored: length, size: length, packing: Packing::Alone };
    array_at(storage, String::new(), range)
}

/// The arrays of an `.npz`, of which none has more or fewer elements than its shape. Of those of a type that is not
/// read, only the header is looked at.
pub(in crate::io) fn list_arrays(storage: Storage<'_>) -> Result<Vec<StoredArray>, IoError> {
    let path = storage.path;
    let (mut file, length) = storage.open()?;
    let broken = |error: zip::result::ZipError| match error {
        zip::result::ZipError::Io(source) if source.kind() != io::ErrorKind::UnexpectedEof => {
            IoError::Read { path: path.into(), source }
        }
        other => invalid(path, "file", other.to_string(), "an .npz: a whole zip archive of .npy arrays"),
    };
    let listed = listed_entries(&mut file, length).map_err(cannot_read(path))?;
    let mut archive = match listed {
        Some(_) => ZipArchive::new(BufReader::new(file)).map_err(broken)?,
        None => return Err(broken(zip::result::ZipError::InvalidArchive("no end of a zip archive".into()))),
    };
    // An archive has one entry for each name; of more than 65,534 the number is elsewhere.
    if let Some(listed) = listed.map(usize::from).filter(|&n| n < 0xFFFF && n > archive.len()) {
        let found = format!("{listed} entries, of which {} have other names", archive.len());
        return Err(invalid(path, "file", found, "one entry for each name"));
    }
    let mut arrays: Vec<StoredArray> = Vec::new();
    for k in 0..archive.len() {
        let entry = archive.by_index_raw(k).map_err(broken)?;
        let Some(name) = entry.name().strip_suffix(".npy").map(str::to_owned) else { continue };
        let element = element(&name);
        let crc = entry.crc32();
        let packing = match entry.compression() {
            _ if entry.encrypted() => return Err(invalid(path, element, "encrypted", "readable bytes")),
            CompressionMethod::Stored => Packing::Stored { crc },
            CompressionMethod::DEFLATE => Packing::Deflated { crc },
            other => {
                return Err(invalid(path, element, format!("compression {other:?}"), "stored or deflated"));
            }
        };
        let (start, stored, size) = (entry.data_start(), entry.compressed_size(), entry.size());
        drop(entry);
        let is_stored = matches!(packing, Packing::Stored { .. });
        if start.checked_add(stored).is_none_or(|end| end > length) || (is_stored && stored != size) {
            let found = format!("{stored} bytes from byte {start} on, of {size}");
            return Err(invalid(path, element, found, format!("bytes of a file of {length}")));
        }
        arrays.push(array_at(storage, name, ByteRange { start, stored, size, packing })?);
    }
    Ok(arrays)
}

/// The number of entries that the end of a zip archive lists; `None` if the file has no such end. It is looked for where it
/// can be alone, before a comment of at most 65,535 bytes: a file that is no archive may be large.
fn listed_entries(file: &mut dyn ReadSeek, length: u64) -> io::Result<Option<u16>> {
    let mut end = Vec::new();
    file.seek(SeekFrom::Start(length.saturating_sub(22 + 0xFFFF)))?;
    file.take(22 + 0xFFFF).read_to_end(&mut end)?;
    let at = end.windows(22).rposition(|bytes| bytes.starts_with(b"PK\x05\x06"));
    Ok(at.map(|at| u16::from_le_bytes([end[at + 10], end[at + 11]])))
}

/// The only one of some arrays, with their names, that mean the same.
pub(in crate::io) fn only<'a, T>(
    path: &Path,
    mut arrays: impl Iterator<Item = (&'a String, T)>,
) -> Result<Option<T>, IoError> {
    match (arrays.next(), arrays.next()) {
        (Some((first, _)), Some((second, _))) => {
            Err(invalid(path, element(second), format!("{} too", element(first)), "one of the two"))
        }
        (first, _) => Ok(first.map(|(_, array)| array)),
    }
}

/// The array in a part of a file, if the elements that its shape promises are there, no more and no fewer.
fn array_at(storage: Storage<'_>, name: String, range: ByteRange) -> Result<StoredArray, IoError> {
    let path = storage.path;
    let header = NpyHeader::read(path, &element(&name), &mut range.open(storage)?)?;
    let needed = header.total_bytes();
    if needed == Some(range.size) || !header.elements.is_read() {
        return Ok(StoredArray { name, header, range });
    }
    let found = format!("the shape {} in {} bytes", header.describe(), range.size);
    let needed = needed.map_or("fewer than 2^64 bytes".into(), |n| format!("{n} bytes for it"));
    Err(invalid(path, element(&name), found, needed))
}

/// An entry of an archive, whose length and checksum are compared when it has been read.
struct Checked<R> {
    input: R,
    left: u64,
    sum: Crc,
    crc: u32,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let wanted = usize::try_from(self.left).map_or(buffer.len(), |left| left.min(buffer.len()));
        if wanted == 0 {
            return Ok(0);
        }
        let count = self.input.read(&mut buffer[..wanted])?;
        self.sum.update(&buffer[..count]);
        self.left -= count as u64;
        if self.left == 0 && self.sum.sum() != self.crc {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "bytes that differ from their checksum"));
        }
        Ok(count)
    }
}

/// Bytes of elements over bytes of the file: compressed meshes shrink by less.
const GROWTH: u64 = 64;

/// An array of numbers: its shape, and its elements with the last index fastest.
pub(in crate::io) struct NumberArray {
    pub(in crate::io) name: String,
    pub(in crate::io) shape: Vec<usize>,
    pub(in crate::io) numbers: Vec<f64>,
}

/// The arrays of an `.npz` whose names `wanted` has.
/// Fails if the file is not an archive of arrays, or one of these has no numbers or is larger than the file
/// explains.
pub(in crate::io) fn read_number_arrays(
    source: &Source,
    wanted: &[&str],
) -> Result<Vec<NumberArray>, IoError> {
    let bytes: Arc<[u8]> = source.bytes().into();
    let storage = Storage { path: source.path(), bytes: Some(&bytes) };
    let arrays = list_arrays(storage)?;
    let budget = (1 << 20) + GROWTH * bytes.len() as u64;
    let wanted = arrays.iter().filter(|array| wanted.contains(&array.name.as_str()));
    wanted.map(|array| read(storage, array, budget)).collect()
}

fn read(storage: Storage<'_>, array: &StoredArray, budget: u64) -> Result<NumberArray, IoError> {
    let (path, header) = (storage.path, &array.header);
    let refuse = |found: String, needed: &str| Err(invalid(path, array.element(), found, needed));
    if !header.elements.is_number() {
        return refuse(header.describe(), "numbers");
    }
    let bytes = header.total_bytes().map(|total| total - header.length).filter(|&bytes| bytes <= budget);
    let Some(Ok(bytes)) = bytes.map(usize::try_from) else {
        return refuse(header.describe(), "no more elements than the bytes of the file explain");
    };
    let mut raw = vec![0; bytes];
    array.open(storage)?.read_exact(&mut raw).map_err(cannot_read(path))?;
    let mut numbers = vec![0.0; bytes / header.elements.size().max(1)];
    header.elements.numbers(&raw, &mut numbers);
    if header.is_fortran {
        numbers = last_index_fastest(&header.shape, &numbers);
    }
    let shape = header.shape.iter().map(|&side| usize::try_from(side).unwrap_or(usize::MAX)).collect();
    Ok(NumberArray { name: array.name.clone(), shape, numbers })
}

/// The elements of an array whose first index is the fastest, in the other order.
fn last_index_fastest(shape: &[u64], elements: &[f64]) -> Vec<f64> {
    let mut index = vec![0_u64; shape.len()];
    let mut ordered = Vec::with_capacity(elements.len());
    for _ in elements {
        let at = index.iter().zip(shape).rev().fold(0, |at, (&k, &side)| at * side + k);
        ordered.push(usize::try_from(at).ok().and_then(|at| elements.get(at)).copied().unwrap_or(f64::NAN));
        for (k, &side) in index.iter_mut().zip(shape).rev() {
            *k += 1;
            if *k < side {
                break;
            }
            *k = 0;
        }
    }
    ordered
}
