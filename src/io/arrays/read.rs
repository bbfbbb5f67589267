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
    if file.order() != Order::C {
        return Err(source.invalid("the array", "Fortran order", "C order"));
    }
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
    Ok((shape, elements))
}
