//! Arrays that grow frame by frame, in memory that does not depend on the number of frames.
//!
//! A frame is one row of every growing array. Rows are collected into blocks of a few megabytes; a
//! full block is written out array by array. A `.npy` has one array, whose blocks go to where they
//! stay; its header is written anew at the end. The blocks of an `.npz`, a zip archive, go to one file without a
//! name on the same disk, from which the arrays are gathered when the recording ends. An array whose beginning
//! shrinks to half is deflated, at the fastest level. *Measured*: images of simulated touches shrink to 3 to 17 % at 460 MB/s, ids
//! to 4 to 10 %; with noise images shrink to 70 % only, and take eight times as long as to write them.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};

use flate2::{Compression, write::DeflateEncoder};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

use crate::io::IoError;
use crate::io::arrays::npy::{ElementType, Elements, count, header};
use crate::io::file::outputs::{Replacement, replace_file, spool_for};
use crate::io::file::{OutPath, cannot_write, file_kind, percent_coded, unfit};

/// Bytes of a block: enough that a disk writes and reads in long runs.
const BLOCK_BYTES: usize = 8 << 20;

/// Bytes that are copied at a time.
const COPY_BYTES: usize = 1 << 20;

/// Writes growing arrays, and in an `.npz` others that do not grow.
pub(crate) struct ArrayWriter {
    path: OutPath,
    target: Sink,
    arrays: Vec<Array>,
    frames: u64,
    /// Frames of a full block, known after the first one.
    block_frames: Option<usize>,
    frames_in_block: usize,
    blocks: u64,
}

enum Sink {
    Npy { file: Replacement, header_bytes: usize },
    Npz { spool: Option<File> },
}

struct Array {
    name: String,
    elements: ElementType,
    /// The shape of a row, or of the whole array if it does not grow.
    shape: Vec<usize>,
    /// The rows of the block, or all elements.
    bytes: Vec<u8>,
    /// Bytes of a row; `None` for an array that does not grow.
    row_bytes: Option<usize>,
}

/// A growing array of an [`ArrayWriter`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct ArrayId(usize);

impl ArrayWriter {
    /// Starts a `.npy` or an `.npz`.
    pub(crate) fn create(path: &OutPath) -> Result<Self, IoError> {
        let target = match file_kind(path).as_str() {
            "npy" => Sink::Npy { file: Replacement::open(path)?, header_bytes: 0 },
            "npz" => Sink::Npz { spool: None },
            _ => return Err(IoError::UnknownKind { path: path.into(), known: ".npy, .npz" }),
        };
        Ok(Self {
            path: path.clone(),
            target,
            arrays: Vec::new(),
            frames: 0,
            block_frames: None,
            frames_in_block: 0,
            blocks: 0,
        })
    }

    /// Declares an array that gets a row of this shape with each frame. A `.npy` has one.
    pub(crate) fn growing(
        &mut self,
        name: &str,
        elements: ElementType,
        row: &[usize],
    ) -> Result<ArrayId, IoError> {
        let row_bytes = count(&self.path, name, row)? * elements.size();
        if let Sink::Npy { file, header_bytes } = &mut self.target {
            // The longest that the header can become.
            let blank = header(elements, &shape_of(u64::MAX, row), 0);
            *header_bytes = blank.len();
            file.file().write_all(&blank).map_err(cannot_write(&self.path))?;
        }
        Ok(self.add(name, elements, row, Vec::new(), Some(row_bytes)))
    }

    /// Adds an array of this shape to an `.npz`.
    pub(crate) fn constant(
        &mut self,
        name: &str,
        shape: &[usize],
        elements: Elements<'_>,
    ) -> Result<(), IoError> {
        let needed = count(&self.path, name, shape)?;
        if elements.len() != needed {
            return Err(self.unfit(
                name,
                elements.len(),
                format!("{needed} elements for the shape {shape:?}"),
            ));
        }
        let element_type = elements.element_type();
        let mut bytes = Vec::with_capacity(needed * element_type.size());
        let fits = elements.append(element_type, &mut bytes);
        debug_assert!(fits, "elements fit their own type");
        self.add(name, element_type, shape, bytes, None);
        Ok(())
    }

    fn add(
        &mut self,
        name: &str,
        elements: ElementType,
        shape: &[usize],
        bytes: Vec<u8>,
        row_bytes: Option<usize>,
    ) -> ArrayId {
        self.arrays.push(Array { name: name.into(), elements, shape: shape.into(), bytes, row_bytes });
        ArrayId(self.arrays.len() - 1)
    }

    /// Appends elements to the array's row of the current frame. `f64` are narrowed for an array of
    /// `f32`.
    pub(crate) fn push(&mut self, array: ArrayId, elements: Elements<'_>) -> Result<(), IoError> {
        let Array { name, elements: kind, bytes, .. } = &mut self.arrays[array.0];
        if elements.append(*kind, bytes) {
            return Ok(());
        }
        let (found, needed) =
            (elements.element_type().describe(), format!("elements of {}", kind.describe()));
        Err(unfit(&self.path, format!("array {name:?}"), found, needed))
    }

    /// Ends a frame: every growing array has a row more.
    pub(crate) fn end_frame(&mut self) -> Result<(), IoError> {
        let in_block = self.frames_in_block + 1;
        for Array { name, bytes, row_bytes, .. } in &self.arrays {
            if let Some(row) = row_bytes.filter(|row| bytes.len() != row * in_block) {
                let found = bytes.len() as i128 - (row * self.frames_in_block) as i128;
                return Err(self.unfit(
                    name,
                    found,
                    format!("a row of {row} bytes for frame {}", self.frames),
                ));
            }
        }
        self.frames += 1;
        self.frames_in_block = in_block;
        let frame_bytes: usize = self.arrays.iter().filter_map(|a| a.row_bytes).sum();
        let full = *self.block_frames.get_or_insert((BLOCK_BYTES / frame_bytes.max(1)).max(1));
        if in_block == full { self.write_block() } else { Ok(()) }
    }

    fn write_block(&mut self) -> Result<(), IoError> {
        let fail = cannot_write(&self.path);
        let mut out = match &mut self.target {
            Sink::Npy { file, .. } => file.file(),
            Sink::Npz { spool: Some(spool) } => spool,
            Sink::Npz { spool } => spool.insert(spool_for(&self.path).map_err(|e| fail(e.kind().into()))?),
        };
        for array in self.arrays.iter_mut().filter(|a| a.row_bytes.is_some()) {
            out.write_all(&array.bytes).map_err(&fail)?;
            array.bytes.clear();
        }
        self.frames_in_block = 0;
        self.blocks += 1;
        Ok(())
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> Result<(), IoError> {
        let path = self.path.clone();
        self.finish_at(&path)
    }

    /// As [`Self::finish`]; an `.npz` goes to `path`.
    pub(crate) fn finish_at(mut self, path: &OutPath) -> Result<(), IoError> {
        if matches!(self.target, Sink::Npy { .. }) {
            self.write_block()?;
        }
        let Self { target, arrays, frames, blocks, block_frames, .. } = self;
        let fail = cannot_write(path);
        match target {
            Sink::Npy { file, header_bytes } => {
                let Some(Array { elements, shape, .. }) = arrays.first() else {
                    return Err(unfit(path, "the file", "no array", "one array"));
                };
                let final_header = header(*elements, &shape_of(frames, shape), header_bytes);
                let mut out = file.file();
                out.seek(SeekFrom::Start(0)).and_then(|_| out.write_all(&final_header)).map_err(&fail)?;
                file.finish()
            }
            Sink::Npz { spool } => {
                let gather =
                    Gather { arrays: &arrays, frames, blocks, block_frames: block_frames.unwrap_or(1) };
                write_archive(path, |archive| gather.write(archive, spool.as_ref()))
            }
        }
    }

    fn unfit(&self, name: &str, found: impl ToString, needed: String) -> IoError {
        unfit(&self.path, format!("array {name:?}"), found.to_string(), needed)
    }
}

fn shape_of(rows: u64, row: &[usize]) -> Vec<u64> {
    std::iter::once(rows).chain(row.iter().map(|&n| n as u64)).collect()
}

/// Gathers the arrays of an `.npz` from their blocks.
struct Gather<'a> {
    arrays: &'a [Array],
    frames: u64,
    blocks: u64,
    block_frames: usize,
}

impl Gather<'_> {
    fn write(&self, archive: &mut Archive<'_, '_>, spool: Option<&File>) -> io::Result<()> {
        let block_bytes = |array: &Array| array.row_bytes.map_or(0, |row| row * self.block_frames) as u64;
        let stride: u64 = self.arrays.iter().map(block_bytes).sum();
        let mut start = 0;
        let mut buffer = vec![0; COPY_BYTES];
        for array in self.arrays {
            let shape = match array.row_bytes {
                Some(_) => shape_of(self.frames, &array.shape),
                None => array.shape.iter().map(|&n| n as u64).collect(),
            };
            let header = header(array.elements, &shape, 0);
            let spooled = block_bytes(array);
            let total = (header.len() + array.bytes.len()) as u64 + spooled * self.blocks;
            let sample = match spool.filter(|_| self.blocks > 0) {
                Some(spool) => {
                    let mut sample = Vec::new();
                    copy(spool, start, spooled.min(COPY_BYTES as u64), &mut buffer, &mut sample)?;
                    sample
                }
                None => array.bytes[..array.bytes.len().min(COPY_BYTES)].to_vec(),
            };
            archive.array(&array.name, total, shrinks(&sample)?, |out| {
                out.write_all(&header)?;
                for block in 0..self.blocks {
                    if let Some(spool) = spool {
                        copy(spool, block * stride + start, spooled, &mut buffer, out)?;
                    }
                }
                out.write_all(&array.bytes)
            })?;
            start += spooled;
        }
        Ok(())
    }
}

/// How an array is kept in an archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packed {
    Stored,
    Deflated,
}

/// Deflates fast: higher levels take twice the time for a tenth less.
const LEVEL: u32 = 1;

/// Whether it pays to deflate what begins like this.
fn shrinks(sample: &[u8]) -> io::Result<Packed> {
    /// Shorter arrays are not worth it.
    const LEAST: usize = 1 << 12;
    if sample.len() < LEAST {
        return Ok(Packed::Stored);
    }
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::new(LEVEL));
    encoder.write_all(sample)?;
    let shrunk = encoder.finish()?.len();
    Ok(if 2 * shrunk < sample.len() { Packed::Deflated } else { Packed::Stored })
}

/// Copies `bytes` bytes of a file from `start` on.
fn copy(mut from: &File, start: u64, bytes: u64, buffer: &mut [u8], out: &mut dyn Write) -> io::Result<()> {
    from.seek(SeekFrom::Start(start))?;
    let mut left = bytes;
    while left > 0 {
        let part = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
        from.read_exact(&mut buffer[..part])?;
        out.write_all(&buffer[..part])?;
        left -= part as u64;
    }
    Ok(())
}

/// Arrays of more bytes than this need the long form of a zip entry.
const LARGE_ENTRY: u64 = 1 << 31;

pub(crate) struct Archive<'a, 'f>(ZipWriter<Latch<&'a mut BufWriter<&'f File>>>);

impl Archive<'_, '_> {
    /// Adds an array of `bytes` bytes, header included, which `write` writes.
    pub(crate) fn array(
        &mut self,
        name: &str,
        bytes: u64,
        packed: Packed,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        let (method, level) = match packed {
            Packed::Stored => (CompressionMethod::Stored, None),
            Packed::Deflated => (CompressionMethod::DEFLATE, Some(i64::from(LEVEL))),
        };
        // Without a time of day, so that the same arrays give the same bytes.
        let options = SimpleFileOptions::default()
            .compression_method(method)
            .compression_level(level)
            .last_modified_time(zip::DateTime::default())
            .large_file(bytes >= LARGE_ENTRY);
        self.0.start_file(format!("{}.npy", entry_name(name)), options)?;
        write(&mut self.0)
    }
}

/// The name of an array as that of a file: control characters and backslashes, and slashes that lead out
/// of the folder where the archive is unpacked, as `%2F`.
fn entry_name(name: &str) -> String {
    let leaves = name.starts_with('/') || name.split('/').any(|part| part == "..");
    let is_odd = |c: char| c.is_control() || c == '\\' || leaves && c == '/';
    percent_coded(name, is_odd)
}

/// Writes an archive; the file is replaced whole or not at all.
pub(crate) fn write_archive(
    path: &OutPath,
    write: impl FnOnce(&mut Archive<'_, '_>) -> io::Result<()>,
) -> Result<(), IoError> {
    let fail = |source| IoError::Write { path: path.into(), source };
    replace_file(path, |file| {
        let mut archive = Archive(ZipWriter::new(Latch { inner: file, failed: None, at: 0 }));
        write(&mut archive).map_err(fail)?;
        match archive.0.finish().map_err(io::Error::from).map_err(fail)?.failed {
            Some(source) => Err(fail(source)),
            None => Ok(()),
        }
    })
}

/// A file whose first error is kept for the end, all that follows being thrown away: an archive
/// that cannot be finished complains on standard error when it is dropped.
struct Latch<W> {
    inner: W,
    failed: Option<io::Error>,
    at: u64,
}

impl<W: Write> Write for Latch<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.failed.is_none() {
            self.failed = self.inner.write_all(bytes).err();
        }
        self.at += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.failed.is_none() {
            self.failed = self.inner.flush().err();
        }
        Ok(())
    }
}

impl<W: Seek> Seek for Latch<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        if self.failed.is_none() {
            match self.inner.seek(to) {
                Ok(at) => self.at = at,
                Err(e) => self.failed = Some(e),
            }
        }
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use npyz::NpyFile;
    use zip::ZipArchive;

    use super::{entry_name, *};

    /// `frames` frames of `(frame, frame + 1/2, ...)`, each with a `u8` and text beside it.
    fn record(path: &Path, frames: u32, width: usize) -> Result<(), IoError> {
        let mut writer = ArrayWriter::create(&path.into())?;
        let values = writer.growing("values", ElementType::F32, &[2, width])?;
        let more = match file_kind(path).as_str() {
            "npz" => Some(writer.growing("valid", ElementType::U8, &[])?),
            _ => None,
        };
        if more.is_some() {
            writer.constant("names", &[2], Elements::Text(&["a".into(), "force.N".into()]))?;
            writer.constant("scale", &[], Elements::F64(&[0.001]))?;
        }
        for frame in 0..frames {
            let first = vec![f64::from(frame); width];
            let second: Vec<f32> = first.iter().map(|&x| narrow_for_test(x) + 0.5).collect();
            writer.push(values, Elements::F64(&first))?;
            writer.push(values, Elements::F32(&second))?;
            if let Some(more) = more {
                writer.push(more, Elements::U8(&[u8::try_from(frame % 256).unwrap()]))?;
            }
            writer.end_frame()?;
        }
        writer.finish()
    }

    #[expect(clippy::cast_possible_truncation, reason = "small whole numbers")]
    fn narrow_for_test(x: f64) -> f32 {
        x as f32
    }

    fn check(array: &[f32], frames: u32, width: usize) {
        assert_eq!(array.len(), frames as usize * 2 * width);
        for (k, row) in array.chunks(width.max(1)).enumerate() {
            let expected = narrow_for_test((k / 2) as f64) + if k % 2 == 1 { 0.5 } else { 0.0 };
            assert!(row.iter().all(|&x| x == expected), "row {k} is not all {expected}");
        }
    }

    /// More than a block, a part of one, none: what went in comes out.
    #[test]
    fn what_was_pushed_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        for (frames, width) in [(0, 3), (1, 1), (7, 300_000), (40, 70_000), (3, 0)] {
            let path = folder.path().join("a.npy");
            record(&path, frames, width).unwrap();
            let bytes = fs::read(&path).unwrap();
            let file = NpyFile::new(&bytes[..]).unwrap();
            assert_eq!(file.shape(), [u64::from(frames), 2, width as u64]);
            check(&file.into_vec::<f32>().unwrap(), frames, width);

            let path = folder.path().join("a.npz");
            record(&path, frames, width).unwrap();
            let mut archive = ZipArchive::new(File::open(&path).unwrap()).unwrap();
            let mut array = |name: &str| {
                let mut bytes = Vec::new();
                archive.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut bytes).unwrap();
                bytes
            };
            let (values, valid, scale) = (array("values"), array("valid"), array("scale"));
            let file = NpyFile::new(&values[..]).unwrap();
            assert_eq!(file.shape(), [u64::from(frames), 2, width as u64]);
            check(&file.into_vec::<f32>().unwrap(), frames, width);
            let valid = NpyFile::new(&valid[..]).unwrap().into_vec::<u8>().unwrap();
            assert!(valid.iter().zip(0_u8..).all(|(&a, b)| a == b) && valid.len() == frames as usize);
            let scale = NpyFile::new(&scale[..]).unwrap();
            assert!(scale.shape().is_empty());
            assert_eq!(scale.into_vec::<f64>().unwrap(), [0.001]);
        }
    }

    #[test]
    fn the_same_arrays_give_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.npz", "b.npz"].map(|name| folder.path().join(name));
        record(&a, 50, 60_000).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(5));
        record(&b, 50, 60_000).unwrap();
        assert!(fs::read(&a).unwrap() == fs::read(&b).unwrap());
    }

    /// A recording that is not finished leaves an older file as it was, and nothing beside it.
    #[test]
    fn half_a_recording_appears_nowhere() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.npy", "a.npz"] {
            let path = folder.path().join(name);
            fs::write(&path, "older").unwrap();
            let mut writer = ArrayWriter::create(&(&path).into()).unwrap();
            let values = writer.growing("values", ElementType::F32, &[1 << 20]).unwrap();
            for _ in 0..5 {
                writer.push(values, Elements::F32(&vec![1.0; 1 << 20])).unwrap();
                writer.end_frame().unwrap();
            }
            drop(writer);
            assert_eq!(fs::read(&path).unwrap(), b"older");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_row_of_the_wrong_length_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = ArrayWriter::create(&(&folder.path().join("a.npz")).into()).unwrap();
        let values = writer.growing("values", ElementType::F32, &[3]).unwrap();
        writer.push(values, Elements::F32(&[1.0])).unwrap();
        let message = writer.end_frame().unwrap_err().to_string();
        assert!(message.contains("values") && message.contains("12 bytes"), "{message}");
        assert!(writer.push(values, Elements::U8(&[1])).is_err());
        assert!(writer.constant("c", &[2], Elements::U8(&[1])).is_err());
        assert!(ArrayWriter::create(&"a.csv".into()).is_err());
    }

    /// A full disk is an error, and the archive that cannot be finished is silent.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_an_error() {
        let full = Path::new("/dev/full");
        if !full.exists() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.npy", "a.npz"] {
            let path = folder.path().join(name);
            std::os::unix::fs::symlink(full, &path).unwrap();
            let error = record(&path, 3, 1000).unwrap_err();
            assert!(matches!(error, IoError::Write { .. }), "{error}");
        }
    }

    #[test]
    fn names_stay_in_the_folder() {
        for (name, entry) in [
            ("left/palm.L0.values", "left/palm.L0.values"),
            ("/etc/x", "%2Fetc%2Fx"),
            ("../x\0", "..%2Fx%00"),
            ("a\\b", "a%5Cb"),
        ] {
            assert_eq!(entry_name(name), entry);
        }
    }
}
