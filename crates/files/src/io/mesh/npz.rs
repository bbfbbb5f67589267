//! Meshes of numpy: an `.npz` with the arrays `V` and `F`, as libigl and others save them.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use crate::io::IoError;
use crate::io::arrays::read::{NumberArray, only, read_number_arrays};
use crate::io::file::{Source, invalid};
use crate::io::mesh::polygon::{CROSSED, POLYGON_NEEDED, Polygons};
use crate::skin::{Draft, Presence, Sheet, TaxelId};

/// Reads `V` (n x 3), `F` (m x 3, or m x 4 for quadrangles, counted from 0), `N` (n x 3, normals) and
/// `ids` (n); `vertices`, `faces` and `normals` mean the same, and everything but `V` may be missing. An exported
/// table of taxels is read, too: `positions`, `normals`, `tangents`, `areas`, `present`, `taxel_ids`, and `patch_of`,
/// the number of the sheet of each.
pub(crate) fn read(source: &Source) -> Result<Draft, IoError> {
    let path = source.path();
    let names = ["V", "vertices", "positions", "F", "faces", "N", "normals", "ids", "taxel_ids", "tangents"];
    let names: Vec<&str> = names.into_iter().chain(["areas", "present", "patch_of"]).collect();
    let arrays = read_number_arrays(source, &names)?;
    let find = |names: &[&str]| {
        let named = arrays.iter().map(|array| (&array.name, array));
        only(path, named.filter(|(name, _)| names.contains(&name.as_str())))
    };
    let Some(vertices) = find(&["V", "vertices", "positions"])? else {
        return Err(invalid(path, "file", "no array V", "V of shape (n, 3), and F of shape (m, 3)"));
    };
    let mut sheet = Sheet { name: source.stem(), positions: vectors(path, vertices)?, ..Sheet::default() };
    let count = sheet.positions.len();
    let of_each = |names: &[&str]| {
        let array = find(names)?;
        array.map(|array| fits(path, array, count).map(|()| array)).transpose()
    };
    sheet.normals = of_each(&["N", "normals"])?.map(|array| vectors(path, array)).transpose()?;
    sheet.tangents = of_each(&["tangents"])?.map(|array| vectors(path, array)).transpose()?;
    sheet.areas = of_each(&["areas"])?.map(|array| array.numbers.clone());
    if let Some(ids) = of_each(&["ids", "taxel_ids"])? {
        sheet.ids = Some(whole(path, ids, f64::from(u32::MAX))?.into_iter().map(TaxelId).collect());
    }
    if let Some(codes) = of_each(&["present"])? {
        let presence: Option<_> = codes.numbers.iter().map(|&code| Presence::from_code(code)).collect();
        let needed = "0 absent, 1 present, 2 thermal pad or 3 another sensor";
        let refuse = || invalid(path, "array `present`", "another number", needed);
        sheet.presence = Some(presence.ok_or_else(refuse)?);
    }
    let mut polygons = Polygons::default();
    if let Some(faces) = find(&["F", "faces"])? {
        let &[_, corners @ (3 | 4)] = faces.shape.as_slice() else {
            return Err(refused(path, faces, "a shape (m, 3) or (m, 4)"));
        };
        for (row, face) in whole(path, faces, count as f64 - 1.0)?.chunks_exact(corners).enumerate() {
            let outline: Vec<DVec3> = face.iter().map(|&v| sheet.positions[v as usize]).collect();
            let crossed = || {
                let element = format!("array `{}`, row {row}", faces.name);
                invalid(path, element, CROSSED, POLYGON_NEEDED)
            };
            let triangles = polygons.cut(&outline, &[]).ok_or_else(crossed)?;
            sheet.triangles.extend(triangles.into_iter().map(|t| t.map(|k| face[k])));
        }
    }
    let sheets = match of_each(&["patch_of"])?.filter(|_| sheet.triangles.is_empty()) {
        Some(patches) => apart(&sheet, &whole(path, patches, count as f64)?),
        None => vec![sheet],
    };
    let remarks = polygons.remark(source.stem()).into_iter().collect();
    Ok(Draft { sheets, remarks, ..Draft::default() })
}

/// The taxels of a sheet as one sheet for each number.
fn apart(all: &Sheet, patch_of: &[u32]) -> Vec<Sheet> {
    fn take<T: Clone>(of: Option<&Vec<T>>, rows: &[usize]) -> Option<Vec<T>> {
        of.map(|of| rows.iter().map(|&row| of[row].clone()).collect())
    }
    let mut rows: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    patch_of.iter().enumerate().for_each(|(row, patch)| rows.entry(*patch).or_default().push(row));
    let is_one = rows.len() < 2;
    let sheet = |(patch, rows): (u32, Vec<usize>)| Sheet {
        name: if is_one { all.name.clone() } else { format!("{}.{patch}", all.name) },
        positions: rows.iter().map(|&row| all.positions[row]).collect(),
        normals: take(all.normals.as_ref(), &rows),
        tangents: take(all.tangents.as_ref(), &rows),
        areas: take(all.areas.as_ref(), &rows),
        ids: take(all.ids.as_ref(), &rows),
        presence: take(all.presence.as_ref(), &rows),
        ..Sheet::default()
    };
    rows.into_iter().map(sheet).collect()
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
