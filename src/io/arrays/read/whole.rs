//! Arrays of numbers that are read whole: those of meshes.

use std::{fs, io::Read, path::Path};

use crate::io::{
    IoError,
    arrays::read::archive::{StoredArray, list_arrays},
    file::source::invalid,
};

/// Bytes of elements over bytes of the file: compressed meshes shrink by less.
const GROWTH: u64 = 64;

/// An array of numbers: its shape, and its elements with the last index fastest.
pub(in crate::io) struct NumberArray {
    pub(in crate::io) name: String,
    pub(in crate::io) shape: Vec<usize>,
    pub(in crate::io) numbers: Vec<f64>,
}

/// The arrays of an `.npz` whose names `wanted` has.
///
/// # Errors
/// If the file is not an archive of arrays, or one of these holds no numbers, is in Fortran order or
/// larger than the file explains.
pub(in crate::io) fn read_number_arrays(path: &Path, wanted: &[&str]) -> Result<Vec<NumberArray>, IoError> {
    let arrays = list_arrays(path)?;
    let length = fs::metadata(path).map_err(|source| IoError::Read { path: path.into(), source })?.len();
    let budget = (1 << 20) + GROWTH * length;
    let wanted = arrays.iter().filter(|array| wanted.contains(&array.name.as_str()));
    wanted.map(|array| read(path, array, budget)).collect()
}

fn read(path: &Path, array: &StoredArray, budget: u64) -> Result<NumberArray, IoError> {
    let header = &array.header;
    let refuse = |found: String, needed: &str| Err(invalid(path, array.element(), found, needed));
    if !header.elements.is_number() || header.is_fortran && header.shape.len() > 1 {
        return refuse(header.describe(), "numbers in C order");
    }
    let bytes = header.total_bytes().map(|total| total - header.length).filter(|&bytes| bytes <= budget);
    let Some(Ok(bytes)) = bytes.map(usize::try_from) else {
        return refuse(header.describe(), "no more elements than the bytes of the file explain");
    };
    let fail = |source| IoError::Read { path: path.into(), source };
    let mut raw = vec![0; bytes];
    array.open(path)?.read_exact(&mut raw).map_err(fail)?;
    let mut numbers = vec![0.0; bytes / header.elements.size().max(1)];
    header.elements.numbers(&raw, &mut numbers);
    let shape = header.shape.iter().map(|&side| usize::try_from(side).unwrap_or(usize::MAX)).collect();
    Ok(NumberArray { name: array.name.clone(), shape, numbers })
}
