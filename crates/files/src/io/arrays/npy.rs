//! Arrays of numpy: the header and the values of one `.npy`, of any type that is read.

use std::{io::Read, path::Path};

use half::f16;

use crate::io::IoError;
use crate::io::file::{excerpt, invalid, unfit};
use crate::numeric::narrow;

/// Longest header of an array, in bytes; numpy's own limit is 10 000.
const MAX_HEADER: usize = 1 << 16;

/// Most axes of an array, as in numpy.
const MAX_AXES: usize = 64;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) struct ElementType {
    is_big_endian: bool,
    kind: Scalar,
    /// Bytes of an element.
    size: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    Float,
    Signed,
    /// Truth values too.
    Unsigned,
    /// Text of four bytes for each character.
    Unicode,
    /// Text of one byte for each character.
    Bytes,
    /// Dates of 64 bits: this many of their unit are a second.
    Dates {
        per_second: u32,
    },
    /// Not read: what it is called.
    Other(&'static str),
}

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

    /// The text of a header: as found, or as needed.
    fn parse(text: &str, length: u64) -> Result<Self, &'static str> {
        let field = |key: &str| {
            let at = [format!("'{key}'"), format!("\"{key}\"")].iter().find_map(|k| text.find(k.as_str()))?;
            Some(text[at + key.len() + 2..].trim_start().strip_prefix(':')?.trim_start())
        };
        let descriptor = field("descr").and_then(|t| {
            let quote = t.chars().next().filter(|c| ['\'', '"'].contains(c))?;
            t[1..].split_once(quote).map(|(descriptor, _)| descriptor)
        });
        field("descr").ok_or("a type of its elements, as 'descr': '<f4'")?;
        // Of an array that is not read the type does not matter.
        let name = match descriptor.and_then(|text| text.chars().nth(1)) {
            Some('O') => "objects",
            Some('c') => "complex numbers",
            Some('f' | 'i' | 'u') => "numbers of a size that is not read",
            None | Some('V') => "records",
            Some(_) => "elements that are no numbers",
        };
        let other = ElementType::little_endian(Scalar::Other(name), 0);
        let elements = descriptor.and_then(ElementType::parse).unwrap_or(other);
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
    pub(in crate::io) const U8: Self = Self::little_endian(Scalar::Unsigned, 1);
    pub(in crate::io) const U32: Self = Self::little_endian(Scalar::Unsigned, 4);
    pub(in crate::io) const I64: Self = Self::little_endian(Scalar::Signed, 8);
    pub(in crate::io) const F32: Self = Self::little_endian(Scalar::Float, 4);
    pub(in crate::io) const F64: Self = Self::little_endian(Scalar::Float, 8);

    const fn little_endian(kind: Scalar, size: usize) -> Self {
        Self { is_big_endian: false, kind, size }
    }

    fn parse(descriptor: &str) -> Option<Self> {
        let mut letters = descriptor.chars();
        let order = letters.next().filter(|c| "<>|=".contains(*c))?;
        let kind = letters.next()?;
        if kind == 'M' {
            let per_second = match letters.as_str() {
                "8[s]" => 1,
                "8[ms]" => 1000,
                "8[us]" => 1_000_000,
                "8[ns]" => 1_000_000_000,
                _ => return None,
            };
            return Some(Self { is_big_endian: order == '>', kind: Scalar::Dates { per_second }, size: 8 });
        }
        let size: usize = letters.as_str().parse().ok().filter(|n| *n <= MAX_HEADER)?;
        let (kind, bytes) = match (kind, size) {
            ('f', 2 | 4 | 8) => (Scalar::Float, size),
            ('i', 1 | 2 | 4 | 8) => (Scalar::Signed, size),
            ('u', 1 | 2 | 4 | 8) | ('b', 1) => (Scalar::Unsigned, size),
            ('U', _) => (Scalar::Unicode, 4 * size),
            ('S', _) => (Scalar::Bytes, size),
            _ => return None,
        };
        Some(Self { is_big_endian: order == '>', kind, size: bytes })
    }

    pub(in crate::io) const fn size(self) -> usize {
        self.size
    }

    pub(in crate::io) const fn is_number(self) -> bool {
        matches!(self.kind, Scalar::Float | Scalar::Signed | Scalar::Unsigned | Scalar::Dates { .. })
    }

    /// Whether its elements are numbers that need not be whole.
    pub(in crate::io) const fn is_real(self) -> bool {
        matches!(self.kind, Scalar::Float)
    }

    /// Whether its elements are read at all.
    pub(in crate::io) const fn is_read(self) -> bool {
        !matches!(self.kind, Scalar::Other(_))
    }

    /// What numpy calls it, but for the order of its bytes.
    pub(in crate::io) fn describe(self) -> String {
        match self.kind {
            Scalar::Float => format!("f{}", self.size),
            Scalar::Signed => format!("i{}", self.size),
            Scalar::Unsigned => format!("u{}", self.size),
            Scalar::Unicode => "str".into(),
            Scalar::Bytes => "bytes".into(),
            Scalar::Dates { .. } => "dates".into(),
            Scalar::Other(name) => name.into(),
        }
    }

    /// Its name in the header of an array that is written.
    fn descriptor(self) -> String {
        match (self.kind, self.size) {
            (Scalar::Unicode, bytes) => format!("<U{}", bytes / 4),
            (_, 1) => format!("|{}", self.describe()),
            _ => format!("<{}", self.describe()),
        }
    }

    /// The numbers in `bytes`, as `f64`; NaN if they are not numbers.
    pub(in crate::io) fn numbers(self, bytes: &[u8], out: &mut [f64]) {
        let big = self.is_big_endian;
        match (self.kind, self.size) {
            (Scalar::Float, 2) => fill(bytes, out, big, |b| f16::from_le_bytes(b).to_f64()),
            (Scalar::Float, 4) => fill(bytes, out, big, |b| f64::from(f32::from_le_bytes(b))),
            (Scalar::Float, 8) => fill(bytes, out, big, f64::from_le_bytes),
            (Scalar::Signed, 1) => fill(bytes, out, big, |b| f64::from(i8::from_le_bytes(b))),
            (Scalar::Signed, 2) => fill(bytes, out, big, |b| f64::from(i16::from_le_bytes(b))),
            (Scalar::Signed, 4) => fill(bytes, out, big, |b| f64::from(i32::from_le_bytes(b))),
            (Scalar::Signed, 8) => fill(bytes, out, big, |b| i64::from_le_bytes(b) as f64),
            (Scalar::Dates { per_second }, _) => fill(bytes, out, big, |b| match i64::from_le_bytes(b) {
                // Not a time.
                i64::MIN => f64::NAN,
                date => date as f64 / f64::from(per_second),
            }),
            (Scalar::Unsigned, 1) => fill(bytes, out, big, |[b]| f64::from(b)),
            (Scalar::Unsigned, 2) => fill(bytes, out, big, |b| f64::from(u16::from_le_bytes(b))),
            (Scalar::Unsigned, 4) => fill(bytes, out, big, |b| f64::from(u32::from_le_bytes(b))),
            (Scalar::Unsigned, 8) => fill(bytes, out, big, |b| u64::from_le_bytes(b) as f64),
            _ => out.fill(f64::NAN),
        }
    }

    /// The first number in `bytes`, if they are whole numbers or dates; one beyond 63 bits as the largest of them.
    pub(in crate::io) fn whole(self, bytes: &[u8]) -> Option<i64> {
        let is_signed = match self.kind {
            Scalar::Signed | Scalar::Dates { .. } => true,
            Scalar::Unsigned => false,
            _ => return None,
        };
        let mut number = bytes.get(..self.size)?.to_vec();
        if !self.is_big_endian {
            number.reverse();
        }
        let is_negative = is_signed && number[0] >= 0x80;
        let sign: i128 = if is_negative { -1 } else { 0 };
        let number = number.iter().fold(sign, |all, &byte| all << 8 | i128::from(byte));
        Some(i64::try_from(number).unwrap_or(i64::MAX))
    }

    /// How many of the unit of dates are a second.
    pub(in crate::io) const fn dates_per_second(self) -> Option<u32> {
        match self.kind {
            Scalar::Dates { per_second } => Some(per_second),
            _ => None,
        }
    }

    /// The texts in `bytes`, without the zeros that fill them up.
    pub(in crate::io) fn texts(self, bytes: &[u8]) -> Vec<String> {
        let text = |element: &[u8]| -> String {
            let text: String = match self.kind {
                Scalar::Unicode => {
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

/// Elements of an array, the last index fastest.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Elements<'a> {
    U8(&'a [u8]),
    U32(&'a [u32]),
    I64(&'a [i64]),
    F32(&'a [f32]),
    F64(&'a [f64]),
    /// Strings of any length; only in arrays that do not grow.
    Text(&'a [String]),
}

impl Elements<'_> {
    /// Their element type.
    pub(crate) fn element_type(&self) -> ElementType {
        match self {
            Self::U8(_) => ElementType::U8,
            Self::U32(_) => ElementType::U32,
            Self::I64(_) => ElementType::I64,
            Self::F32(_) => ElementType::F32,
            Self::F64(_) => ElementType::F64,
            Self::Text(texts) => {
                let longest = texts.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1);
                ElementType::little_endian(Scalar::Unicode, 4 * longest)
            }
        }
    }

    pub(crate) fn len(&self) -> usize {
        match self {
            Self::U8(x) => x.len(),
            Self::U32(x) => x.len(),
            Self::I64(x) => x.len(),
            Self::F32(x) => x.len(),
            Self::F64(x) => x.len(),
            Self::Text(x) => x.len(),
        }
    }

    /// Appends the elements in the type of `to`, little-endian. `f64` go into arrays of
    /// `f32` too; any other change of type is refused with `false`.
    #[must_use]
    pub(crate) fn append(&self, to: ElementType, bytes: &mut Vec<u8>) -> bool {
        match (*self, to) {
            (Self::U8(x), ElementType::U8) => bytes.extend_from_slice(x),
            (Self::U32(x), ElementType::U32) => extend(bytes, x, |x| x.to_le_bytes()),
            (Self::I64(x), ElementType::I64) => extend(bytes, x, |x| x.to_le_bytes()),
            (Self::F32(x), ElementType::F32) => extend(bytes, x, |x| x.to_le_bytes()),
            (Self::F64(x), ElementType::F64) => extend(bytes, x, |x| x.to_le_bytes()),
            (Self::F64(x), ElementType::F32) => extend(bytes, x, |&x| narrow(x).to_le_bytes()),
            (Self::Text(texts), ElementType { kind: Scalar::Unicode, size, .. }) => {
                for text in texts {
                    let letters = text.chars().map(u32::from).chain(std::iter::repeat(0));
                    bytes.extend(letters.take(size / 4).flat_map(u32::to_le_bytes));
                }
            }
            _ => return false,
        }
        true
    }
}

/// Appends `N` bytes for each element: in one piece, since an iterator of bytes takes several times
/// as long.
fn extend<T, const N: usize>(bytes: &mut Vec<u8>, elements: &[T], of: impl Fn(&T) -> [u8; N]) {
    let start = bytes.len();
    bytes.resize(start + N * elements.len(), 0);
    for (place, element) in bytes[start..].chunks_exact_mut(N).zip(elements) {
        place.copy_from_slice(&of(element));
    }
}

/// The header of an array of this shape. With a `least` length it is filled with blanks up to that,
/// so that it can overwrite an earlier one.
pub(crate) fn header(elements: ElementType, shape: &[u64], least: usize) -> Vec<u8> {
    let lengths: Vec<String> = shape.iter().map(|n| format!("{n},")).collect();
    let lengths = lengths.join(" ");
    // As Python writes tuples: `(3,)`, but `(3, 4)`.
    let lengths = if shape.len() > 1 { lengths.trim_end_matches(',') } else { &lengths };
    let descriptor = elements.descriptor();
    let dictionary = format!("{{'descr': '{descriptor}', 'fortran_order': False, 'shape': ({lengths}), }}");
    let used = MAGIC.len() + 2 + dictionary.len() + 1;
    let total = used.next_multiple_of(ALIGNMENT).max(least);
    let mut bytes = MAGIC.to_vec();
    let length = u16::try_from(total - MAGIC.len() - 2).unwrap_or(u16::MAX);
    bytes.extend(length.to_le_bytes());
    bytes.extend(dictionary.bytes());
    bytes.resize(total - 1, b' ');
    bytes.push(b'\n');
    bytes
}

/// What every file begins with, and the version of its format.
const MAGIC: [u8; 8] = *b"\x93NUMPY\x01\x00";

/// Elements begin at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

pub(crate) fn count(path: &std::path::Path, name: &str, shape: &[usize]) -> Result<usize, IoError> {
    let count = shape.iter().try_fold(1_usize, |count, &n| count.checked_mul(n));
    count.filter(|&n| n < 1 << 40).ok_or_else(|| {
        let found = format!("the shape {shape:?}");
        unfit(path, format!("array {name:?}"), found, "fewer than 2^40 elements a row")
    })
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
        for other in ["[('a', '<f4')]", "'<f16'", "'|O'", "'\u{e9}'", "'<\u{e9}4'", "'<M8[D]'"] {
            let found =
                parse(&format!("{{'descr': {other}, 'fortran_order': False, 'shape': (1,)}}")).unwrap();
            assert!(!found.elements.is_read() && !found.elements.is_number(), "{other}");
        }
        let dates = parse("{'descr': '<M8[ms]', 'fortran_order': False, 'shape': (2,)}").unwrap().elements;
        let mut seconds = [0.0; 2];
        let bytes: Vec<u8> = [1500, i64::MIN].into_iter().flat_map(i64::to_le_bytes).collect();
        dates.numbers(&bytes, &mut seconds);
        assert!(seconds[0] == 1.5 && seconds[1].is_nan());
        for broken in [
            "",
            "{'descr': '<f4', 'shape': (1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': 5}",
            "'descr'",
        ] {
            assert!(parse(broken).is_err(), "{broken}");
        }
    }

    #[test]
    fn headers_are_those_of_numpy() {
        let bytes = header(ElementType::F32, &[3], 0);
        assert_eq!(bytes.len(), 128);
        let text = String::from_utf8_lossy(&bytes[10..]);
        assert!(text.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }"), "{text}");
        let text = String::from_utf8(
            header(ElementType::little_endian(Scalar::Unicode, 16), &[3, 5], 0)[10..].to_vec(),
        )
        .unwrap();
        assert!(text.contains("'<U4'") && text.contains("(3, 5), }"), "{text}");
        assert!(String::from_utf8_lossy(&header(ElementType::F64, &[], 0)).contains("'shape': (), }"));
    }

    #[test]
    fn a_header_can_be_as_long_as_a_longer_one() {
        let long = header(ElementType::F32, &[u64::MAX, 1000, 1000, 1000], 0);
        let short = header(ElementType::F32, &[0, 1000, 1000, 1000], long.len());
        assert_eq!(short.len(), long.len());
        let stated = usize::from(u16::from_le_bytes([short[8], short[9]]));
        assert_eq!(10 + stated, short.len());
    }

    #[test]
    fn texts_are_padded_with_zeros() {
        let texts = ["ab".to_owned(), "\u{e9}".into()];
        let elements = Elements::Text(&texts);
        let mut bytes = Vec::new();
        assert_eq!(elements.element_type(), ElementType::little_endian(Scalar::Unicode, 8));
        assert!(elements.append(ElementType::little_endian(Scalar::Unicode, 8), &mut bytes));
        assert_eq!(bytes, [97, 0, 0, 0, 98, 0, 0, 0, 0xe9, 0, 0, 0, 0, 0, 0, 0]);
        assert!(!elements.append(ElementType::F32, &mut bytes), "a text is not a number");
    }
}
