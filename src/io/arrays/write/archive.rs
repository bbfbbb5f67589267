//! `.npz`: a zip archive of `.npy` arrays, stored without compression, the same bytes every time.

use std::{
    fs::File,
    io::{self, BufWriter, Seek, SeekFrom, Write},
    path::Path,
};

use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

use crate::io::{IoError, file::replace::replace_file};

/// Arrays of more bytes than this need the long form of a zip entry.
const LARGE_ENTRY: u64 = 1 << 31;

/// An archive that is being written.
pub(crate) struct Archive<'a, 'f>(ZipWriter<Latch<&'a mut BufWriter<&'f File>>>);

impl Archive<'_, '_> {
    /// Adds an array of `bytes` bytes, header included, which `write` writes.
    pub(crate) fn array(
        &mut self,
        name: &str,
        bytes: u64,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        // Without a time of day, so that the same arrays give the same bytes.
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default())
            .large_file(bytes >= LARGE_ENTRY);
        self.0.start_file(format!("{name}.npy"), options)?;
        write(&mut self.0)
    }
}

/// Writes an archive; the file is replaced whole or not at all.
pub(crate) fn write_archive(
    path: &Path,
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
