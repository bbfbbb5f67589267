//! Headers and elements of `.npy` files: the format of numpy's `lib.format`, version 1.0.
//!
//! Written here because the arrays of a recording grow: their header is as long as its longest form
//! before their length is known, and their bytes come from a file.

use crate::{io::IoError, numeric::narrow};

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

/// What the elements of an array are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ElementType {
    U8,
    U32,
    I64,
    F32,
    F64,
    /// Strings of at most this many characters.
    Text(usize),
}

impl ElementType {
    /// Bytes of an element.
    pub(crate) const fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U32 | Self::F32 => 4,
            Self::I64 | Self::F64 => 8,
            Self::Text(characters) => 4 * characters,
        }
    }

    fn descriptor(self) -> String {
        match self {
            Self::U8 => "|u1".into(),
            Self::U32 => "<u4".into(),
            Self::I64 => "<i8".into(),
            Self::F32 => "<f4".into(),
            Self::F64 => "<f8".into(),
            Self::Text(characters) => format!("<U{characters}"),
        }
    }
}

impl Elements<'_> {
    /// The type that holds them.
    pub(crate) fn element_type(&self) -> ElementType {
        match self {
            Self::U8(_) => ElementType::U8,
            Self::U32(_) => ElementType::U32,
            Self::I64(_) => ElementType::I64,
            Self::F32(_) => ElementType::F32,
            Self::F64(_) => ElementType::F64,
            Self::Text(texts) => {
                ElementType::Text(texts.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1))
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

    /// Appends the elements as an array of `to` holds them, little-endian. `f64` go into arrays of
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
            (Self::Text(texts), ElementType::Text(characters)) => {
                for text in texts {
                    let letters = text.chars().map(u32::from).chain(std::iter::repeat(0));
                    bytes.extend(letters.take(characters).flat_map(u32::to_le_bytes));
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
/// so that it can take the place of an earlier one.
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

/// Number of elements of a shape.
pub(crate) fn count(path: &std::path::Path, name: &str, shape: &[usize]) -> Result<usize, IoError> {
    let count = shape.iter().try_fold(1_usize, |count, &n| count.checked_mul(n));
    count.filter(|&n| n < 1 << 40).ok_or_else(|| {
        let found = format!("the shape {shape:?}");
        crate::io::file::source::unfit(
            path,
            format!("array {name:?}"),
            found,
            "fewer than 2^40 elements a row",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_those_of_numpy() {
        let bytes = header(ElementType::F32, &[3], 0);
        assert_eq!(bytes.len(), 128);
        let text = String::from_utf8_lossy(&bytes[10..]);
        assert!(text.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }"), "{text}");
        let text = String::from_utf8(header(ElementType::Text(4), &[3, 5], 0)[10..].to_vec()).unwrap();
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
        assert_eq!(elements.element_type(), ElementType::Text(2));
        assert!(elements.append(ElementType::Text(2), &mut bytes));
        assert_eq!(bytes, [97, 0, 0, 0, 98, 0, 0, 0, 0xe9, 0, 0, 0, 0, 0, 0, 0]);
        assert!(!elements.append(ElementType::F32, &mut bytes), "a text is not a number");
    }
}
