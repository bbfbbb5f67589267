//! Meshes and contacts: read, made and written.

use std::{fs, path::Path};

use dermatome::{contact::{ContactIndex, IndexOptions}, map::SkinMap, mesh::TriMesh};
use glam::DVec3;

use crate::{Error, numbers::numbers};

pub struct Mesh {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Vertices and triangles of an OBJ file.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for line in fs::read_to_string(path)?.lines() {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    let p = words.map(str::parse).collect::<Result<Vec<f64>, _>>()?;
                    positions.push(DVec3::from_slice(&p));
                }
                Some("f") => {
                    let corner = |word: &str| word.split('/').next().unwrap_or("").parse::<u32>();
                    let ids = words.map(corner).collect::<Result<Vec<_>, _>>()?;
                    triangles.push([ids[0] - 1, ids[1] - 1, ids[2] - 1]);
                }
                _ => {}
            }
        }
        Ok(Self { positions, triangles })
    }

    pub fn index(&self, options: &IndexOptions) -> Result<ContactIndex, Error> {
        let mesh = TriMesh::from_arrays(self.positions.clone(), &self.triangles);
        Ok(ContactIndex::with_options(&SkinMap::flat(mesh, 0.001), options)?)
    }

    fn corners(&self, face: usize) -> [DVec3; 3] {
        self.triangles[face].map(|v| self.positions[v as usize])
    }

    /// Contacts 0 to 3 mm off the skin, on faces drawn evenly.
    pub fn scattered(&self, count: usize) -> Vec<[f32; 3]> {
        let mut number = numbers();
        let contact = |_| {
            let [a, b, c] = self.corners((number() * self.triangles.len() as f64) as usize);
            let (mut u, mut v) = (number(), number());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let normal = (b - a).cross(c - a).normalize_or_zero();
            (a + (b - a) * u + (c - a) * v + normal * (0.003 * number())).as_vec3().to_array()
        };
        (0..count).map(contact).collect()
    }

    /// A walk over the skin in steps of half a millimetre, turning slowly and turning back at borders.
    pub fn walk(&self, count: usize) -> Result<Vec<[f32; 3]>, Error> {
        let (index, mut number) = (self.index(&IndexOptions::default())?, numbers());
        let mut contacts = Vec::with_capacity(count);
        let mut at = self.corners(self.triangles.len() / 2)[0];
        let mut heading = DVec3::new(0.3, 0.8, 0.5).normalize();
        while contacts.len() < count {
            let next = at + heading * 0.0005;
            let hit = index.locate(next)?;
            let [a, b, c] = self.corners(hit.point.face.index());
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let moved = hit.position.distance(at);
            at = hit.position;
            let turn = if moved < 0.0002 { 2.0 + number() } else { 0.2 * (number() - 0.5) };
            let along = heading.reject_from(normal).normalize_or(normal.any_orthonormal_vector());
            heading = along * turn.cos() + normal.cross(along) * turn.sin();
            contacts.push((at + normal * (0.001 + 0.0001 * number())).as_vec3().to_array());
        }
        Ok(contacts)
    }
}

pub fn write_contacts(path: &Path, contacts: &[[f32; 3]]) -> Result<(), Error> {
    Ok(fs::write(path, contacts.iter().flatten().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?)
}

pub fn read_contacts(path: &Path) -> Result<Vec<[f32; 3]>, Error> {
    let bytes = fs::read(path)?;
    let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    Ok(bytes.chunks_exact(12).map(|p| [number(p), number(&p[4..]), number(&p[8..])]).collect())
}
