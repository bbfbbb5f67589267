//! Meshes of numpy: an `.npz` with the arrays `V` and `F`, as libigl and others save them.

use std::path::Path;

use glam::DVec3;

use crate::io::IoError;
use crate::io::arrays::read::{NumberArray, read_number_arrays};
use crate::io::file::{Source, invalid};
use crate::skin::{Draft, Sheet, TaxelId};

/// Reads `V` (n x 3), `F` (m x 3, or m x 4 for quadrangles, counted from 0), `N` (n x 3, normals) and
/// `ids` (n); `vertices`, `faces` and `normals` mean the same, and everything but `V` may be missing.
pub(crate) fn read(source: &Source) -> Result<Draft, IoError> {
    let path = source.path();
    let names = ["V", "vertices", "F", "faces", "N", "normals", "ids"];
    let mut arrays = read_number_arrays(source, &names)?;
    let mut take = |names: [&str; 2]| {
        let place = arrays.iter().position(|array| names.contains(&array.name.as_str()));
        place.map(|place| arrays.swap_remove(place))
    };
    let Some(vertices) = take(["V", "vertices"]) else {
        return Err(invalid(path, "file", "no array V", "V of shape (n, 3), and F of shape (m, 3)"));
    };
    let mut sheet = Sheet { name: source.stem(), positions: vectors(path, &vertices)?, ..Sheet::default() };
    let count = sheet.positions.len();
    if let Some(normals) = take(["N", "normals"]) {
        sheet.normals = Some(vectors(path, &normals)?);
        fits(path, &normals, count)?;
    }
    if let Some(ids) = take(["ids", "ids"]) {
        fits(path, &ids, count)?;
        sheet.ids = Some(whole(path, &ids, f64::from(u32::MAX))?.into_iter().map(TaxelId).collect());
    }
    if let Some(faces) = take(["F", "faces"]) {
        let &[_, corners @ (3 | 4)] = faces.shape.as_slice() else {
            return Err(refused(path, &faces, "a shape (m, 3) or (m, 4)"));
        };
        for face in whole(path, &faces, count as f64 - 1.0)?.chunks_exact(corners) {
            sheet.triangles.extend(face[1..].windows(2).map(|pair| [face[0], pair[0], pair[1]]));
        }
    }
    Ok(Draft { sheets: vec![sheet], ..Draft::default() })
}

fn refused(path: &Path, array: &NumberArray, needed: &str) -> IoError {
    invalid(path, format!("array `{}`", array.name), format!("the shape {:?}", array.shape), needed)
}

/// Refuses an array without one row per vertex.
fn fits(path: &Path, array: &NumberArray, count: usize) -> Result<(), IoError> {
    match array.shape.first() {
        Some(&rows) if rows == count => Ok(()),
        _ => Err(refused(path, array, &format!("{count} rows, one per vertex"))),
    }
}

fn vectors(path: &Path, array: &NumberArray) -> Result<Vec<DVec3>, IoError> {
    if !matches!(array.shape.as_slice(), [_, 3]) {
        return Err(refused(path, array, "a shape (n, 3)"));
    }
    let rows = array.numbers.as_chunks::<3>().0;
    match rows.iter().position(|row| !row.iter().all(|x| x.is_finite())) {
        None => Ok(rows.iter().map(|&row| DVec3::from_array(row)).collect()),
        Some(k) => {
            let element = format!("array `{}`, row {k}", array.name);
            Err(invalid(path, element, format!("{:?}", rows[k]), "finite numbers"))
        }
    }
}

/// Whole numbers from 0 to `most`.
fn whole(path: &Path, array: &NumberArray, most: f64) -> Result<Vec<u32>, IoError> {
    let is_wrong = |&x: &f64| x.fract() != 0.0 || !(0.0..=most).contains(&x);
    if let Some(k) = array.numbers.iter().position(is_wrong) {
        let element = format!("array `{}`, element {k}", array.name);
        let needed = format!("a whole number from 0 to {most}");
        return Err(invalid(path, element, array.numbers[k].to_string(), needed));
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole and below 2^32, as just checked: vertices take at least a byte of the file each"
    )]
    let numbers = array.numbers.iter().map(|&x| x as u32).collect();
    Ok(numbers)
}
