//! `.npz`: a zip archive of `.npy` arrays, stored without compression, the same bytes every time.

use std::{
    fmt::Write as _,
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
        self.0.start_file(format!("{}.npy", entry_name(name)), options)?;
        write(&mut self.0)
    }
}

/// The name of an array as that of a file: control characters and backslashes, and slashes that lead out
/// of the folder where the archive is unpacked, as `%2F`.
fn entry_name(name: &str) -> String {
    let leaves = name.starts_with('/') || name.split('/').any(|part| part == "..");
    let is_odd = |c: char| c.is_control() || c == '\\' || leaves && c == '/';
    let mut encoded = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            c if is_odd(c) => {
                for byte in c.encode_utf8(&mut [0; 4]).bytes() {
                    let _ = write!(encoded, "%{byte:02X}");
                }
            }
            c => encoded.push(c),
        }
    }
    encoded
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

#[cfg(test)]
mod tests {
    use super::entry_name;

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
