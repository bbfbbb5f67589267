//! MSH, the binary meshes of MuJoCo's models: four counts, vertices, normals, texture coordinates and triangles.

use glam::DVec3;

use crate::io::error::Result;
use crate::io::file::Source;
use crate::skin::{Draft, Sheet};

/// Bytes before the vertices: the numbers of vertices, normals, texture coordinates and triangles, as `i32`.
const HEADER: usize = 16;

/// Numbers of four bytes of a vertex, a normal, a texture coordinate and a triangle.
const NUMBERS: [u64; 4] = [3, 3, 2, 3];

/// Reads an MSH file as one sheet: vertices and triangles, all numbers little-endian and of four bytes.
///
/// Normals are left out: MuJoCo draws with them, and models have one for each corner of a triangle.
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let bytes = source.bytes();
    if bytes.starts_with(b"$MeshFormat") {
        let needed = "a binary mesh of MuJoCo; save it as .stl or .obj";
        return Err(source.invalid("header", "a mesh of Gmsh", needed));
    }
    let (words, rest) = bytes.as_chunks::<4>();
    let count = |k: usize| words.get(k).and_then(|word| usize::try_from(i32::from_le_bytes(*word)).ok());
    let [Some(vertices), Some(normals), Some(coordinates), Some(triangles)] = [0, 1, 2, 3].map(count) else {
        let needed = "four counts of 0 or more, each of 4 bytes";
        return Err(source.invalid("header", format!("{:?}", &bytes[..bytes.len().min(HEADER)]), needed));
    };
    let counts = [vertices, normals, coordinates, triangles];
    let numbers: u64 = counts.iter().zip(NUMBERS).map(|(&count, numbers)| numbers * count as u64).sum();
    let length = HEADER as u64 + 4 * numbers;
    if bytes.len() as u64 != length || !rest.is_empty() {
        let needed = format!(
            "{length}, for {vertices} vertices, {normals} normals, {coordinates} texture coordinates and {triangles} triangles"
        );
        return Err(source.invalid("length", format!("{} bytes", bytes.len()), needed));
    }
    let mut sheet = Sheet { name: source.stem(), ..Sheet::default() };
    for (k, position) in words[4..].as_chunks::<3>().0.iter().take(vertices).enumerate() {
        let position = position.map(f32::from_le_bytes);
        if !position.iter().all(|x| x.is_finite()) {
            return Err(source.invalid(format!("vertex {k}"), format!("{position:?}"), "finite coordinates"));
        }
        sheet.positions.push(DVec3::from(position.map(f64::from)));
    }
    for (k, corners) in words[words.len() - 3 * triangles..].as_chunks::<3>().0.iter().enumerate() {
        let corners = corners.map(u32::from_le_bytes);
        if corners.iter().any(|&v| v as usize >= vertices) {
            let needed = format!("vertices from 0 to {}", vertices.saturating_sub(1));
            return Err(source.invalid(format!("triangle {k}"), format!("{corners:?}"), needed));
        }
        sheet.triangles.push(corners);
    }
    Ok(Draft { sheets: vec![sheet], ..Draft::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn file(counts: [i32; 4], vertices: &[f32], rest: usize, corners: &[u32]) -> Vec<u8> {
        let mut bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_le_bytes()).collect();
        bytes.extend(vertices.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(std::iter::repeat_n(0, 4 * rest));
        bytes.extend(corners.iter().flat_map(|v| v.to_le_bytes()));
        bytes
    }

    fn read_bytes(bytes: Vec<u8>) -> Result<Draft> {
        read(&Source::from_bytes(Path::new("part.msh"), bytes)?)
    }

    #[test]
    fn vertices_and_triangles_are_read_and_what_lies_between_is_passed() {
        let corner = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0];
        let sheet = read_bytes(file([3, 2, 1, 1], &corner, 8, &[0, 1, 2])).unwrap().sheets.remove(0);
        assert_eq!(sheet.positions, [DVec3::ZERO, DVec3::X, DVec3::new(0.0, 2.0, 0.0)]);
        assert_eq!((sheet.triangles, sheet.name), (vec![[0, 1, 2]], "part".to_owned()));
    }

    #[test]
    fn wrong_counts_lengths_corners_and_kinds_are_refused() {
        let corner = [0.0; 9];
        let refused = [
            (b"$MeshFormat\n4.1 0 8\n$EndMeshFormat".to_vec(), "Gmsh"),
            (vec![1, 0, 0], "four counts"),
            (file([-1, 0, 0, 1], &corner, 0, &[0, 1, 2]), "four counts"),
            (file([i32::MAX; 4], &corner, 0, &[0, 1, 2]), "bytes"),
            (file([3, 0, 0, 1], &corner, 1, &[0, 1, 2]), "64, for 3 vertices"),
            (file([3, 0, 0, 1], &corner, 0, &[0, 1, 3]), "vertices from 0 to 2"),
            (file([3, 0, 0, 1], &[f32::NAN; 9], 0, &[0, 1, 2]), "finite"),
        ];
        for (bytes, said) in refused {
            let error = read_bytes(bytes).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
