//! Reads an array of numbers from a `.npy`.

use npyz::{DType, NpyFile, Order, TypeChar};

use crate::io::{IoError, file::source::Source};

/// The shape of an array of `f32` or `f64`, and its elements as `f32`, the last index fastest.
///
/// # Errors
/// If the file is not such an array, or has another number of bytes than its shape asks for.
pub(crate) fn read_array(source: &Source) -> Result<(Vec<u64>, Vec<f32>), IoError> {
    let fail = |e: std::io::Error| source.invalid("the file", e.to_string(), "a .npy array");
    let file = NpyFile::new(source.bytes()).map_err(fail)?;
    let shape = file.shape().to_vec();
    let order = file.order();
    let bytes = match file.dtype() {
        DType::Plain(kind) if kind.type_char() == TypeChar::Float && [4, 8].contains(&kind.size_field()) => {
            kind.size_field()
        }
        other => return Err(source.invalid("the array", format!("elements {}", other.descr()), "f4 or f8")),
    };
    // More than the file has is refused before memory is taken for it.
    let count = shape.iter().try_fold(1_u64, |n, &side| n.checked_mul(side));
    if count.and_then(|n| n.checked_mul(bytes)).is_none_or(|n| n > source.bytes().len() as u64) {
        let found = format!("the shape {shape:?} in {} bytes", source.bytes().len());
        return Err(source.invalid("the array", found, format!("{bytes} bytes for each element")));
    }
    let elements = match bytes {
        4 => file.into_vec::<f32>().map_err(fail)?,
        _ => file.into_vec::<f64>().map_err(fail)?.into_iter().map(super::npy::narrow).collect(),
    };
    match order {
        Order::C => Ok((shape, elements)),
        Order::Fortran => Ok((shape.clone(), last_index_fastest(&shape, &elements))),
    }
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
