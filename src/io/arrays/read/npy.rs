//! Headers and elements of `.npy` arrays that come from elsewhere.
//!
//! The header is read here, with a bound on its length and without recursion: a parser of Python
//! literals can be made to overflow its stack by a file.

use std::{io::Read, path::Path};

use crate::io::{
    IoError,
    file::source::{excerpt, invalid},
};

/// Longest header of an array, in bytes; numpy's own limit is 10 000.
const MAX_HEADER: usize = 1 << 16;

/// Most axes of an array, as in numpy.
const MAX_AXES: usize = 64;

/// What the elements of an array are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) struct ElementType {
    is_big_endian: bool,
    kind: Kind,
    /// Bytes of an element.
    size: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Float,
    Signed,
    /// Truth values too.
    Unsigned,
    /// Text of four bytes for each character.
    Unicode,
    /// Text of one byte for each character.
    Bytes,
}

/// The header of an array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::io) struct NpyHeader {
    pub(in crate::io) elements: ElementType,
    pub(in crate::io) shape: Vec<u64>,
    /// Whether the first index is the fastest.
    pub(in crate::io) is_fortran: bool,
    /// Its length in the file, in bytes.
    pub(in crate::io) length: u64,
}

impl NpyHeader {
    /// Reads the header of the array that errors call `element`.
    pub(in crate::io) fn read(path: &Path, element: &str, input: &mut dyn Read) -> Result<Self, IoError> {
        let mut exact = |length: usize| {
            let mut bytes = vec![0; length];
            input.read_exact(&mut bytes).map(|()| bytes).map_err(|source| match source.kind() {
                std::io::ErrorKind::UnexpectedEof => {
                    invalid(path, element, "an end within its header", "a whole .npy array")
                }
                _ => IoError::Read { path: path.into(), source },
            })
        };
        let magic = exact(8)?;
        let version = [magic[6], magic[7]];
        if !magic.starts_with(b"\x93NUMPY") || !(1..=3).contains(&version[0]) {
            let found = format!("bytes {}", excerpt(&String::from_utf8_lossy(&magic)));
            return Err(invalid(path, element, found, "a .npy array of version 1, 2 or 3"));
        }
        let size = exact(if version[0] == 1 { 2 } else { 4 })?;
        let length = size.iter().rev().fold(0_usize, |n, &byte| n << 8 | usize::from(byte));
        if length > MAX_HEADER {
            let needed = format!("at most {MAX_HEADER}");
            return Err(invalid(path, element, format!("a header of {length} bytes"), needed));
        }
        let text = exact(length)?;
        let text = String::from_utf8_lossy(&text);
        let header = Self::parse(&text, (8 + size.len() + length) as u64);
        header.map_err(|needed| invalid(path, element, format!("the header {}", excerpt(&text)), needed))
    }

    /// What the text of a header says, or what it ought to.
    fn parse(text: &str, length: u64) -> Result<Self, &'static str> {
        let field = |key: &str| {
            let at = [format!("'{key}'"), format!("\"{key}\"")].iter().find_map(|k| text.find(k.as_str()))?;
            Some(text[at + key.len() + 2..].trim_start().strip_prefix(':')?.trim_start())
        };
        let descriptor = field("descr").and_then(|t| {
            let quote = t.chars().next().filter(|c| ['\'', '"'].contains(c))?;
            t[1..].split_once(quote).map(|(descriptor, _)| descriptor)
        });
        let elements = descriptor.and_then(ElementType::parse);
        let elements = elements.ok_or("numbers (f2, f4, f8, integers, bool) or strings, not records")?;
        let order = field("fortran_order").ok_or("'fortran_order': False")?;
        let shape = field("shape").and_then(|t| t.strip_prefix('(')?.split_once(')'));
        let (shape, _) = shape.ok_or("a shape such as (100, 642)")?;
        let sides = shape.split(',').map(str::trim).filter(|side| !side.is_empty());
        let shape: Option<Vec<u64>> =
            sides.take(MAX_AXES + 1).map(|n| n.trim_end_matches('L').parse().ok()).collect();
        let shape = shape.filter(|s| s.len() <= MAX_AXES).ok_or("a shape of at most 64 whole numbers")?;
        Ok(Self { elements, shape, is_fortran: order.starts_with("True"), length })
    }

    /// Bytes of header and elements; `None` if that is more than 2^64.
    pub(in crate::io) fn total_bytes(&self) -> Option<u64> {
        let count = self.shape.iter().try_fold(1_u64, |count, &side| count.checked_mul(side))?;
        count.checked_mul(self.elements.size as u64)?.checked_add(self.length)
    }

    /// The shape as Python writes it, and the type of the elements.
    pub(in crate::io) fn describe(&self) -> String {
        let sides: Vec<String> = self.shape.iter().map(u64::to_string).collect();
        let comma = if sides.len() == 1 { "," } else { "" };
        format!("({}{comma}) {}", sides.join(", "), self.elements.describe())
    }
}

impl ElementType {
    fn parse(descriptor: &str) -> Option<Self> {
        let mut letters = descriptor.chars();
        let order = letters.next().filter(|c| "<>|=".contains(*c))?;
        let kind = letters.next()?;
        let size: usize = letters.as_str().parse().ok().filter(|n| *n <= MAX_HEADER)?;
        let (kind, bytes) = match (kind, size) {
            ('f', 2 | 4 | 8) => (Kind::Float, size),
            ('i', 1 | 2 | 4 | 8) => (Kind::Signed, size),
            ('u', 1 | 2 | 4 | 8) | ('b', 1) => (Kind::Unsigned, size),
            ('U', _) => (Kind::Unicode, 4 * size),
            ('S', _) => (Kind::Bytes, size),
            _ => return None,
        };
        Some(Self { is_big_endian: order == '>', kind, size: bytes })
    }

    /// Bytes of an element.
    pub(in crate::io) const fn size(self) -> usize {
        self.size
    }

    pub(in crate::io) const fn is_number(self) -> bool {
        matches!(self.kind, Kind::Float | Kind::Signed | Kind::Unsigned)
    }

    fn describe(self) -> String {
        let letter = match self.kind {
            Kind::Float => "f",
            Kind::Signed => "i",
            Kind::Unsigned => "u",
            Kind::Unicode => return "str".into(),
            Kind::Bytes => return "bytes".into(),
        };
        format!("{letter}{}", self.size)
    }

    /// The numbers that `bytes` hold, as `f64`; NaN if they are not numbers.
    pub(in crate::io) fn numbers(self, bytes: &[u8], out: &mut [f64]) {
        let big = self.is_big_endian;
        match (self.kind, self.size) {
            (Kind::Float, 2) => fill(bytes, out, big, |b| half(u16::from_le_bytes(b))),
            (Kind::Float, 4) => fill(bytes, out, big, |b| f64::from(f32::from_le_bytes(b))),
            (Kind::Float, 8) => fill(bytes, out, big, f64::from_le_bytes),
            (Kind::Signed, 1) => fill(bytes, out, big, |b| f64::from(i8::from_le_bytes(b))),
            (Kind::Signed, 2) => fill(bytes, out, big, |b| f64::from(i16::from_le_bytes(b))),
            (Kind::Signed, 4) => fill(bytes, out, big, |b| f64::from(i32::from_le_bytes(b))),
            (Kind::Signed, 8) => fill(bytes, out, big, |b| i64::from_le_bytes(b) as f64),
            (Kind::Unsigned, 1) => fill(bytes, out, big, |[b]| f64::from(b)),
            (Kind::Unsigned, 2) => fill(bytes, out, big, |b| f64::from(u16::from_le_bytes(b))),
            (Kind::Unsigned, 4) => fill(bytes, out, big, |b| f64::from(u32::from_le_bytes(b))),
            (Kind::Unsigned, 8) => fill(bytes, out, big, |b| u64::from_le_bytes(b) as f64),
            _ => out.fill(f64::NAN),
        }
    }

    /// The texts that `bytes` hold, without the zeros that fill them up.
    pub(in crate::io) fn texts(self, bytes: &[u8]) -> Vec<String> {
        let text = |element: &[u8]| -> String {
            let text: String = match self.kind {
                Kind::Unicode => {
                    let code = |b: &[u8; 4]| match self.is_big_endian {
                        true => u32::from_be_bytes(*b),
                        false => u32::from_le_bytes(*b),
                    };
                    let letters = element.as_chunks().0.iter().map(code);
                    letters.map(|c| char::from_u32(c).unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
                }
                _ => String::from_utf8_lossy(element).into_owned(),
            };
            text.trim_end_matches('\0').to_owned()
        };
        bytes.chunks_exact(self.size.max(1)).map(text).collect()
    }
}

fn fill<const N: usize>(bytes: &[u8], out: &mut [f64], is_big_endian: bool, of: impl Fn([u8; N]) -> f64) {
    for (x, &element) in out.iter_mut().zip(bytes.as_chunks::<N>().0) {
        let mut element = element;
        if is_big_endian {
            element.reverse();
        }
        *x = of(element);
    }
}

/// The number that the 16 bits of IEEE 754 stand for.
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2_f64.powi(exponent - 25),
    };
    if bits >> 15 == 1 { -size } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_say_type_shape_and_order() {
        let parse = |text: &str| NpyHeader::parse(text, 10);
        let found = parse("{'descr': '>f8', 'fortran_order': False, 'shape': (3, 20L), }").unwrap();
        assert_eq!((found.shape.as_slice(), found.describe().as_str()), (&[3, 20][..], "(3, 20) f8"));
        assert_eq!(found.total_bytes(), Some(490));
        let found = parse("{\"shape\": (7,), \"fortran_order\": True, \"descr\": \"<U3\"}").unwrap();
        assert!(found.is_fortran && !found.elements.is_number());
        assert_eq!(found.total_bytes(), Some(94));
        let huge = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({}, 2)}}", u64::MAX);
        assert_eq!(parse(&huge).unwrap().total_bytes(), None);
        for broken in [
            "",
            "{'descr': '<f4', 'shape': (1,)}",
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f16', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '|O', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': 5}",
            "{'descr': '\u{e9}', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<\u{e9}4', 'fortran_order': False, 'shape': (1,)}",
            "'descr'",
        ] {
            assert!(parse(broken).is_err(), "{broken}");
        }
    }

    #[test]
    fn halves_are_those_of_ieee_754() {
        for (bits, x) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 2_f64.powi(-24)),
            (0x0400, 2_f64.powi(-14)),
            (0xfc00, f64::NEG_INFINITY),
        ] {
            assert_eq!(half(bits), x, "{bits:x}");
        }
        assert!(half(0x7e00).is_nan());
    }
}
