//! The arrays of a file: the one of a `.npy`, or those of an `.npz`, a zip archive whose entries are
//! stored or deflated.

use std::{
    fs::File,
    io::{self, BufReader, Read, Seek, SeekFrom},
    path::Path,
};

use flate2::{Crc, bufread::DeflateDecoder};
use zip::{CompressionMethod, ZipArchive};

use crate::io::{IoError, arrays::read::npy::NpyHeader, file::source::invalid};

/// An array of a file.
pub(in crate::io) struct StoredArray {
    /// Its name; empty in a `.npy`.
    pub(in crate::io) name: String,
    pub(in crate::io) header: NpyHeader,
    place: Place,
}

/// Where the bytes of an array are.
#[derive(Debug, Clone, Copy)]
struct Place {
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
    pub(in crate::io) fn open(&self, path: &Path) -> Result<Box<dyn Read + Send>, IoError> {
        let mut input = self.place.open(path)?;
        NpyHeader::read(path, &self.element(), &mut input)?;
        Ok(input)
    }
}

/// What errors call an array.
fn element(name: &str) -> String {
    if name.is_empty() { "the array".into() } else { format!("array `{name}`") }
}

impl Place {
    fn open(&self, path: &Path) -> Result<Box<dyn Read + Send>, IoError> {
        self.bytes(path).map_err(|source| IoError::Read { path: path.into(), source })
    }

    fn bytes(&self, path: &Path) -> io::Result<Box<dyn Read + Send>> {
        let mut file = File::open(path)?;
        file.seek(SeekFrom::Start(self.start))?;
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

/// The array of a `.npy`, which has no more and no fewer elements than its shape says.
pub(in crate::io) fn find_array(path: &Path) -> Result<StoredArray, IoError> {
    let (_, length) = open(path)?;
    let place = Place { start: 0, stored: length, size: length, packing: Packing::Alone };
    array_at(path, String::new(), place)
}

/// A regular file, and its length.
fn open(path: &Path) -> Result<(File, u64), IoError> {
    let fail = |source| IoError::Read { path: path.into(), source };
    let file = File::open(path).map_err(fail)?;
    let about = file.metadata().map_err(fail)?;
    if about.is_file() {
        Ok((file, about.len()))
    } else {
        Err(fail(io::Error::other("it is not a regular file")))
    }
}

/// The arrays of an `.npz`, of which none has more or fewer elements than its shape says.
pub(in crate::io) fn list_arrays(path: &Path) -> Result<Vec<StoredArray>, IoError> {
    let (file, length) = open(path)?;
    let broken = |error: zip::result::ZipError| match error {
        zip::result::ZipError::Io(source) if source.kind() != io::ErrorKind::UnexpectedEof => {
            IoError::Read { path: path.into(), source }
        }
        other => invalid(path, "file", other.to_string(), "an .npz: a whole zip archive of .npy arrays"),
    };
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(broken)?;
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
        arrays.push(array_at(path, name, Place { start, stored, size, packing })?);
    }
    Ok(arrays)
}

/// The array at a place, if the elements that its shape promises are there, no more and no fewer.
fn array_at(path: &Path, name: String, place: Place) -> Result<StoredArray, IoError> {
    let header = NpyHeader::read(path, &element(&name), &mut place.open(path)?)?;
    let needed = header.total_bytes();
    if needed == Some(place.size) {
        return Ok(StoredArray { name, header, place });
    }
    let found = format!("the shape {} in {} bytes", header.describe(), place.size);
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
