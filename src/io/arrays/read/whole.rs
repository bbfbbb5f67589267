//! Arrays of numbers that are read whole: those of meshes.

use std::{io::Read, sync::Arc};

use crate::io::{
    IoError,
    arrays::read::archive::{Storage, StoredArray, list_arrays},
    file::source::{Source, invalid},
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
/// If the file is not an archive of arrays, or one of these holds no numbers or is larger than the file
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
    let fail = |source| IoError::Read { path: path.into(), source };
    let mut raw = vec![0; bytes];
    array.open(storage)?.read_exact(&mut raw).map_err(fail)?;
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
