//! What every reader and writer needs of a file, whatever its format: [`Source`] is a file that is read
//! whole, [`lines`] reads line by line, [`times`] are in all tables, [`outputs`] writes files whole or not at all,
//! [`xml`] has the elements of a file.

pub(super) mod lines;
pub(super) mod outputs;
pub(super) mod times;
#[cfg(feature = "robots")]
pub(super) mod xml;

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::io::{Feature, FileElement, IoError};

pub(super) use lines::{LONGEST, LineLocation, Lines, finite};
pub(super) use outputs::{OutPath, cannot_write, replace_file, write_file, write_to};

/// Largest file that is read whole, in bytes. Every element of a file takes at least one byte, so
/// below this size no count of elements passes the 32 bits of an id.
const MAX_BYTES: u64 = u32::MAX as u64;

/// Longest piece of a file that an error repeats, in characters.
const MAX_EXCERPT: usize = 60;

/// The content of a file, under the name that errors call it by.
pub(crate) struct Source {
    path: PathBuf,
    bytes: Vec<u8>,
    is_file: bool,
    /// The text, if the bytes are not UTF-8; the text of XML, if its declaration comes late.
    decoded: [OnceLock<String>; 2],
}

impl Source {
    /// Reads a regular file whole, after a look at its length.
    pub(crate) fn open(path: &Path) -> Result<Self, IoError> {
        let fail = cannot_read(path);
        let about = fs::metadata(path).map_err(fail)?;
        if about.is_dir() {
            return Err(fail(io::ErrorKind::IsADirectory.into()));
        }
        // A device or a pipe has no length, and need not have an end.
        if !about.is_file() {
            return Err(fail(io::Error::other("it is not a regular file")));
        }
        check_length(path, about.len())?;
        let mut bytes = Vec::with_capacity(usize::try_from(about.len()).unwrap_or(0));
        // The limit also applies to a file that grows meanwhile.
        File::open(path).and_then(|f| f.take(MAX_BYTES).read_to_end(&mut bytes)).map_err(fail)?;
        Ok(Self { path: path.into(), bytes, is_file: true, decoded: Default::default() })
    }

    /// Bytes of memory, whose kind follows from the extension of `name`.
    pub(crate) fn from_bytes(name: &Path, bytes: Vec<u8>) -> Result<Self, IoError> {
        check_length(name, bytes.len() as u64)?;
        Ok(Self { path: name.into(), bytes, is_file: false, decoded: Default::default() })
    }

    /// Whether it lies in a folder, where it may name other files.
    pub(crate) fn is_file(&self) -> bool {
        self.is_file
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// The content as text, without a byte order mark. Text that is not UTF-8 is decoded: UTF-16 by its byte order
    /// mark, XML that declares ISO-8859-1, else with U+FFFD for what is not known.
    ///
    /// # Errors
    /// If it is neither, and has bytes that no text has.
    pub(crate) fn text(&self) -> Result<&str, IoError> {
        let text = match std::str::from_utf8(&self.bytes) {
            Ok(text) => text,
            Err(e) => {
                let at = e.valid_up_to();
                let refuse = || {
                    let line = 1 + self.bytes[..at].iter().filter(|&&b| b == b'\n').count();
                    let found = format!("byte 0x{:02x}", self.bytes[at]);
                    self.invalid((line, format!("byte {at} of the file")), found, "text in UTF-8")
                };
                let text = decoded(&self.bytes).ok_or_else(refuse)?;
                self.decoded[0].get_or_init(|| text)
            }
        };
        Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
    }

    /// The content as XML: a declaration after comments is left out, as other readers do.
    #[cfg(feature = "robots")]
    pub(crate) fn xml_text(&self) -> Result<&str, IoError> {
        // Readers in C end at the first zero byte, and some programs write it.
        let text = self.text()?.trim_end_matches('\0');
        let mut rest = text.trim_start();
        while let Some((_, after)) = rest.strip_prefix("<!--").and_then(|inner| inner.split_once("-->")) {
            rest = after.trim_start();
        }
        let declaration = rest.starts_with("<?xml ").then(|| rest.find("?>")).flatten();
        Ok(match declaration {
            Some(length) if rest.len() < text.len() => self.decoded[1].get_or_init(|| {
                let (before, after) = text.split_at(text.len() - rest.len());
                let is_break = |c: &char| *c == '\n';
                let breaks: String = after[..length].chars().filter(is_break).collect();
                [before, &breaks, &after[length + 2..]].concat()
            }),
            _ => text,
        })
    }

    /// The name of the file without folder and extension: what a sheet without a name is called.
    pub(crate) fn stem(&self) -> String {
        stem(&self.path)
    }

    pub(crate) fn invalid(
        &self,
        element: impl Into<FileElement>,
        found: impl Into<String>,
        needed: impl Into<String>,
    ) -> IoError {
        invalid(&self.path, element, found, needed)
    }

    pub(crate) fn unsupported(
        &self,
        element: impl Into<FileElement>,
        feature: impl Into<Feature>,
    ) -> IoError {
        IoError::Unsupported { path: self.path.clone(), element: element.into(), feature: feature.into() }
    }
}

/// The text of bytes that are not UTF-8, if they can be text.
fn decoded(bytes: &[u8]) -> Option<String> {
    let wide = match bytes {
        [0xff, 0xfe, rest @ ..] => Some((rest, u16::from_le_bytes as fn([u8; 2]) -> u16)),
        [0xfe, 0xff, rest @ ..] => Some((rest, u16::from_be_bytes as fn([u8; 2]) -> u16)),
        _ => None,
    };
    if let Some((rest, unit)) = wide {
        let units: Vec<u16> = rest.chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
        return String::from_utf16(&units).ok();
    }
    if bytes.contains(&0) {
        return None;
    }
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(100)]).to_ascii_lowercase();
    let is_latin = head.starts_with("<?xml") && head.contains("iso-8859-1\"");
    let latin = || bytes.iter().map(|&byte| char::from(byte)).collect();
    Some(if is_latin { latin() } else { String::from_utf8_lossy(bytes).into_owned() })
}

pub(crate) fn cannot_read(path: &Path) -> impl Fn(io::Error) -> IoError + Copy + '_ {
    |source| IoError::Read { path: path.into(), source }
}

/// Refuses a path where nothing is, before its kind is judged: some kinds follow from the content.
pub(crate) fn exists(path: &Path) -> Result<(), IoError> {
    std::fs::metadata(path).map(drop).map_err(cannot_read(path))
}

/// Refuses what is empty, or too long to count its elements with 32 bits.
fn check_length(path: &Path, length: u64) -> Result<(), IoError> {
    let found = format!("{length} bytes");
    match length {
        0 => Err(invalid(path, "file", found, "some content")),
        1..=MAX_BYTES => Ok(()),
        _ => Err(invalid(path, "file", found, format!("at most {MAX_BYTES} bytes"))),
    }
}

/// The kind of a file: its extension in lower case, empty without one.
pub fn file_kind(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

pub(crate) fn invalid(
    path: &Path,
    element: impl Into<FileElement>,
    found: impl Into<String>,
    needed: impl Into<String>,
) -> IoError {
    IoError::Invalid {
        path: path.into(),
        element: element.into(),
        found: found.into(),
        needed: needed.into(),
    }
}

/// An error about something that does not fit into the file `path`, which is about to be written.
pub(crate) fn unfit(
    path: &Path,
    element: impl Into<String>,
    found: impl Into<String>,
    needed: impl Into<String>,
) -> IoError {
    IoError::Unfit { path: path.into(), element: element.into(), found: found.into(), needed: needed.into() }
}

/// A name whose odd characters are `%` and two hexadecimal digits for each byte.
pub(crate) fn percent_coded(name: &str, is_odd: impl Fn(char) -> bool) -> String {
    let coded = |c: char| match is_odd(c) {
        true => c.encode_utf8(&mut [0; 4]).bytes().map(|byte| format!("%{byte:02X}")).collect(),
        false => String::from(c),
    };
    name.chars().map(coded).collect()
}

/// The bytes of a URL, in which `%41` is the byte 0x41; `None` if two hexadecimal digits do not follow a `%`.
pub(crate) fn percent_decoded(url: &str) -> Option<Vec<u8>> {
    let mut bytes = url.bytes();
    let mut out = Vec::with_capacity(url.len());
    while let Some(byte) = bytes.next() {
        if byte != b'%' {
            out.push(byte);
            continue;
        }
        let mut digit = || char::from(bytes.next()?).to_digit(16).and_then(|d| u8::try_from(d).ok());
        out.push(digit()? << 4 | digit()?);
    }
    Some(out)
}

/// A text as the value of an attribute, between double quotes, in a file that is about to be written.
///
/// # Errors
/// If it has a character that XML cannot contain.
pub(crate) fn xml_attribute(path: &Path, text: &str) -> Result<String, IoError> {
    let mut value = String::new();
    for c in text.chars() {
        match c {
            '&' | '<' | '"' | '\t' | '\n' | '\r' => value.push_str(&format!("&#{};", u32::from(c))),
            '\0'..' ' | '\u{fffe}' | '\u{ffff}' => {
                let element = format!("the name {}", excerpt(text));
                return Err(unfit(path, element, "a control character", "a name that XML can contain"));
            }
            c => value.push(c),
        }
    }
    Ok(value)
}

/// A piece of a file as an error repeats it: on one line, and not too long.
pub(crate) fn excerpt(text: &str) -> String {
    let mut short: String = text.chars().take(MAX_EXCERPT).flat_map(char::escape_debug).collect();
    if text.chars().nth(MAX_EXCERPT).is_some() {
        short.push_str("...");
    }
    format!("\"{short}\"")
}
