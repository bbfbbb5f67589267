//! Dividing some faces of a sheet, and their neighbours along the edges that are divided.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use crate::mesh::parts;
use crate::numeric::bits;
use crate::skin::Sheet;

/// Vertices at one position as one: the first of them.
pub(super) struct Places {
    first: HashMap<[u64; 3], u32>,
    /// The first vertex at the position of each.
    of: Vec<u32>,
}

impl Places {
    pub(super) fn new(sheet: &Sheet) -> Self {
        let mut places = Self { first: HashMap::new(), of: Vec::new() };
        places.add(sheet);
        places
    }

    /// Adds the vertices that were appended to a sheet.
    fn add(&mut self, sheet: &Sheet) {
        for (k, p) in (0..).zip(&sheet.positions).skip(self.of.len()) {
            self.of.push(*self.first.entry(bits(p.to_array())).or_insert(k));
        }
    }

    /// The place of a vertex; one out of range is a place of its own.
    fn of(&self, v: u32) -> u32 {
        self.of.get(v as usize).copied().unwrap_or(v)
    }

    pub(super) fn edge(&self, a: u32, b: u32) -> (u32, u32) {
        let (a, b) = (self.of(a), self.of(b));
        (a.min(b), a.max(b))
    }
}

/// Whether new vertices can be added to a sheet: nothing is stated of its vertices that they would not have.
pub(super) fn can_divide(sheet: &Sheet) -> bool {
    let own = Sheet {
        name: sheet.name.clone(),
        link: sheet.link,
        positions: sheet.positions.clone(),
        triangles: sheet.triangles.clone(),
        texture: sheet.texture.clone(),
        materials: sheet.materials.clone(),
        numbers: sheet.numbers.clone(),
        normals: sheet.normals.clone(),
        ..Sheet::default()
    };
    *sheet == own && sheet.validate(usize::MAX).is_ok()
}

/// Divides the faces that are marked along their long edges, and those beside them along the same edges, so that the
/// sheet stays as connected as it was. Returns the face that each new face is a part of.
///
/// The sheet is one that [`can_divide`].
pub(super) fn divide(sheet: &mut Sheet, places: &mut Places, is_marked: &[bool]) -> Vec<usize> {
    let (mut edges, mut is_end) = (HashSet::new(), vec![false; sheet.positions.len()]);
    let old = std::mem::take(&mut sheet.triangles);
    for (t, _) in old.iter().zip(is_marked).filter(|(_, marked)| **marked) {
        let length = |[a, b]: [u32; 2]| sheet.positions[a as usize].distance(sheet.positions[b as usize]);
        let longest = sides(*t).map(length).into_iter().fold(0.0, f64::max);
        let long = sides(*t).into_iter().filter(|&side| length(side) > 0.5 * longest);
        for [a, b] in long {
            let (a, b) = places.edge(a, b);
            (is_end[a as usize], is_end[b as usize]) = (true, true);
            edges.insert((a, b));
        }
    }
    let (texture, materials) = (sheet.texture.take(), sheet.materials.take());
    let mut middles = HashMap::new();
    let (mut parents, mut cut_texture) = (Vec::new(), texture.as_ref().map(|_| Vec::new()));
    for (face, t) in old.iter().enumerate() {
        let is_cut = sides(*t).map(|[a, b]| {
            let (a, b) = places.edge(a, b);
            let may_be_cut = is_end[a as usize] && is_end[b as usize];
            may_be_cut && edges.contains(&(a, b))
        });
        if is_cut == [false; 3] {
            sheet.triangles.push(*t);
            cut_texture.iter_mut().zip(&texture).for_each(|(cut, all)| cut.push(all[face]));
            parents.push(face);
            continue;
        }
        for part in parts(is_cut) {
            let vertex = |k: usize| match k.checked_sub(3) {
                None => t[k],
                Some(side) => middle(sheet, &mut middles, sides(*t)[side]),
            };
            let corners = part.iter().copied().map(vertex).collect::<Vec<_>>();
            sheet.triangles.extend(<[u32; 3]>::try_from(corners));
            if let (Some(cut), Some(all)) = (&mut cut_texture, &texture) {
                let uv = all[face];
                cut.push(part.map(|k| if k < 3 { uv[k] } else { uv[k - 3].midpoint(uv[(k - 2) % 3]) }));
            }
            parents.push(face);
        }
    }
    sheet.texture = cut_texture;
    sheet.materials = materials.map(|all| parents.iter().map(|&face| all[face]).collect());
    places.add(sheet);
    parents
}

fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// The vertex in the middle of an edge; the same position for both directions of it.
fn middle(sheet: &mut Sheet, middles: &mut HashMap<(u32, u32), u32>, [a, b]: [u32; 2]) -> u32 {
    *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
        let [first, last] = [a.min(b), a.max(b)].map(|v| v as usize);
        let added = u32::try_from(sheet.positions.len()).unwrap_or(u32::MAX);
        sheet.positions.push(sheet.positions[first].midpoint(sheet.positions[last]));
        if let Some(all) = &mut sheet.numbers {
            all.push(all[first]);
        }
        if let Some(all) = &mut sheet.normals {
            all.push((all[first] + all[last]).try_normalize().unwrap_or(DVec3::ZERO));
        }
        added
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Adjacency, TriMesh, shapes};

    /// Whichever faces of a ball are divided, it stays closed, as large, and wound as it was.
    #[test]
    fn a_divided_ball_stays_a_ball() {
        let ball = shapes::ball(2, 1.0);
        for step in 1..8 {
            let mut sheet = Sheet {
                positions: ball.positions.as_slice().to_vec(),
                triangles: ball.triangles.iter().map(|t| t.map(|v| v.raw())).collect(),
                ..Sheet::default()
            };
            assert!(can_divide(&sheet));
            let mut places = Places::new(&sheet);
            for _ in 0..2 {
                let marked: Vec<bool> = (0..sheet.triangles.len()).map(|k| k % step == 0).collect();
                let parents = divide(&mut sheet, &mut places, &marked);
                assert_eq!(parents.len(), sheet.triangles.len());
            }
            let mesh = TriMesh::from_arrays(sheet.positions.clone(), &sheet.triangles);
            let adjacency = Adjacency::new(&mesh).unwrap();
            assert_eq!(adjacency.boundary_loops().len(), 0, "every {step}. face");
            assert!((mesh.enclosed_volume() / ball.enclosed_volume() - 1.0).abs() < 1e-12);
        }
    }
}
