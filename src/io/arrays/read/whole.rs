//! Arrays of numbers that are read whole: those of meshes and images.

use std::{fs, io::Read, path::Path};

use crate::io::{
    IoError,
    arrays::{
        read::{
            archive::{StoredArray, find_array, list_arrays},
            npy::NpyHeader,
        },
        write::npy::narrow,
    },
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

/// Most elements of an image or a recording that is read whole: 4 GiB as `f32`.
const MOST_ELEMENTS: u64 = 1 << 30;

/// The shape of the array of a `.npy`, and its elements as `f32`, the last index fastest.
///
/// # Errors
/// If the file is not an array of numbers, has another number of bytes than its shape asks for, or more
/// than 2^30 elements.
pub(in crate::io) fn read_npy(path: &Path) -> Result<(Vec<u64>, Vec<f32>), IoError> {
    /// Elements that are read at a time.
    const BLOCK: usize = 1 << 16;
    let array = find_array(path)?;
    let mut input = array.open(path)?;
    let NpyHeader { elements: kind, ref shape, is_fortran, .. } = array.header;
    if !kind.is_number() {
        return Err(invalid(path, array.element(), array.header.describe(), "numbers"));
    }
    let fail = |source| IoError::Read { path: path.into(), source };
    // Their number has been compared with the bytes of the file, but a sparse file may have any.
    let count = shape.iter().product::<u64>();
    let Some(mut left) = usize::try_from(count).ok().filter(|_| count <= MOST_ELEMENTS) else {
        let needed = format!("at most {MOST_ELEMENTS} elements");
        return Err(invalid(path, array.element(), array.header.describe(), needed));
    };
    let mut elements = Vec::with_capacity(left);
    let (mut raw, mut numbers) = (vec![0; BLOCK * kind.size()], vec![0.0; BLOCK]);
    while left > 0 {
        let count = left.min(BLOCK);
        let (raw, numbers) = (&mut raw[..count * kind.size()], &mut numbers[..count]);
        input.read_exact(raw).map_err(fail)?;
        kind.numbers(raw, numbers);
        elements.extend(numbers.iter().map(|&x| narrow(x)));
        left -= count;
    }
    let elements = if is_fortran { last_index_fastest(shape, &elements) } else { elements };
    Ok((shape.clone(), elements))
}

/// The elements of an array whose first index is the fastest, in the other order.
fn last_index_fastest(shape: &[u64], elements: &[f32]) -> Vec<f32> {
    let mut index = vec![0_u64; shape.len()];
    let mut ordered = Vec::with_capacity(elements.len());
    for _ in elements {
        let at = index.iter().zip(shape).rev().fold(0, |at, (&k, &side)| at * side + k);
        ordered.push(usize::try_from(at).ok().and_then(|at| elements.get(at)).copied().unwrap_or(f32::NAN));
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
