//! The displacement of some vertices of a map, continued over all of it.

use glam::DVec2;

use crate::id::{FaceId, IdVec, VertexId};
use crate::sparse::{Cholesky, Matrix, Pattern, SparseError};

/// Continues displacements over maps of one mesh: the biharmonic field.
///
/// Of all fields `d` that have the given values at the held vertices it is the one with the least sum of `|L d|^2 / m`
/// over the vertices, where `L` is the cotangent Laplacian of the map, with its natural rim, and `m` the area of a
/// vertex `(botsch2004intuitive)`. A constant displacement costs nothing.
pub(super) struct Bending<'m> {
    triangles: &'m IdVec<FaceId, [VertexId; 3]>,
    /// The number of each vertex among the free or the held ones.
    numbers: IdVec<VertexId, Number>,
    held: Vec<VertexId>,
    /// Entries of the Laplacian, and of its square over the free vertices.
    edges: Pattern,
    square: Pattern,
    cholesky: Cholesky,
}

#[derive(Debug, Clone, Copy)]
enum Number {
    Free(usize),
    Held(usize),
}

/// The energy of displacements of a map: a quadratic form.
struct Energy<'p> {
    of_free: Matrix<'p, f64>,
    /// Between a free vertex and a held one.
    across: Vec<(usize, usize, f64)>,
    /// Between held vertices, row by row.
    of_held: Vec<f64>,
}

impl<'m> Bending<'m> {
    /// Prepares maps of the mesh with these triangles, of which `uv` is one, with `held` vertices.
    pub(super) fn new(
        triangles: &'m IdVec<FaceId, [VertexId; 3]>,
        uv: &IdVec<VertexId, DVec2>,
        held: &[VertexId],
    ) -> Result<Self, SparseError> {
        let mut numbers = IdVec::filled(Number::Free(0), uv.len());
        held.iter().enumerate().for_each(|(k, &v)| numbers[v] = Number::Held(k));
        let is_free = |number: &&mut Number| matches!(number, Number::Free(_));
        numbers.iter_mut().filter(is_free).enumerate().for_each(|(k, number)| *number = Number::Free(k));
        let free = |v: VertexId| match numbers[v] {
            Number::Free(k) => Some(k),
            Number::Held(_) => None,
        };
        let sides = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let edges = Pattern::new(uv.len(), sides.map(|(a, b)| (a.index(), b.index())));
        let number = |v: u32| free(VertexId::from(v));
        let pairs = (0..uv.len()).flat_map(|v| {
            let row = edges.columns(v);
            let below = move |(k, &i): (usize, &u32)| row[..k].iter().map(move |&j| (i, j));
            row.iter().enumerate().flat_map(below)
        });
        let coordinates: Vec<_> =
            uv.enumerate().filter(|(v, _)| free(*v).is_some()).map(|(_, at)| at.extend(0.0)).collect();
        let square =
            Pattern::new(coordinates.len(), pairs.filter_map(|(i, j)| Some((number(i)?, number(j)?))));
        let cholesky = Cholesky::new(&square, &coordinates)?;
        Ok(Self { triangles, numbers, held: held.to_vec(), edges, square, cholesky })
    }

    /// The displacement of every vertex of the map `uv`, from that of each held one.
    pub(super) fn displacement(
        &self,
        uv: &IdVec<VertexId, DVec2>,
        held: &[(VertexId, DVec2)],
    ) -> Result<IdVec<VertexId, DVec2>, SparseError> {
        let mut displacement = IdVec::filled(DVec2::ZERO, uv.len());
        held.iter().for_each(|&(v, by)| displacement[v] = by);
        let energy = self.energy_of(uv);
        let [mut x, mut y] = [vec![0.0; self.square.rows()], vec![0.0; self.square.rows()]];
        for &(free, held, entry) in &energy.across {
            let by = displacement[self.held[held]];
            x[free] -= entry * by.x;
            y[free] -= entry * by.y;
        }
        let factor = self.cholesky.factor(&energy.of_free)?;
        factor.solve(&mut x)?;
        factor.solve(&mut y)?;
        for (v, number) in self.numbers.enumerate() {
            if let Number::Free(k) = *number {
                displacement[v] = DVec2::new(x[k], y[k]);
            }
        }
        Ok(displacement)
    }

    /// The energy of the field as a quadratic form of the displacements of the held vertices, row by row.
    pub(super) fn energy(&self, uv: &IdVec<VertexId, DVec2>) -> Result<Vec<f64>, SparseError> {
        let Energy { of_free, across, of_held: mut form } = self.energy_of(uv);
        let (factor, count) = (self.cholesky.factor(&of_free)?, self.held.len());
        let mut column = vec![0.0; self.square.rows()];
        for k in 0..count {
            column.fill(0.0);
            across.iter().filter(|(_, held, _)| *held == k).for_each(|&(free, _, x)| column[free] += x);
            factor.solve(&mut column)?;
            across.iter().for_each(|&(free, held, x)| form[held * count + k] -= x * column[free]);
        }
        Ok(form)
    }

    fn energy_of(&self, uv: &IdVec<VertexId, DVec2>) -> Energy<'_> {
        let mut laplacian = Matrix::<f64>::zero(&self.edges);
        let mut areas = IdVec::<VertexId, f64>::filled(0.0, uv.len());
        for corners in self.triangles {
            let at = corners.map(|v| uv[v]);
            let cross = (at[1] - at[0]).perp_dot(at[2] - at[0]);
            for k in 0..3 {
                areas[corners[k]] += cross / 6.0;
                let [i, j] = [(k + 1) % 3, (k + 2) % 3];
                let weight = 0.5 * (at[i] - at[k]).dot(at[j] - at[k]) / cross;
                let [v, w] = [corners[i].index(), corners[j].index()];
                *laplacian.at(v, v) += weight;
                *laplacian.at(w, w) += weight;
                *laplacian.at(v, w) -= weight;
                *laplacian.at(w, v) -= weight;
            }
        }
        let count = self.held.len();
        let mut energy = Energy {
            of_free: Matrix::zero(&self.square),
            across: Vec::new(),
            of_held: vec![0.0; count * count],
        };
        for (v, area) in areas.enumerate() {
            let columns = self.edges.columns(v.index()).iter().map(|&i| self.numbers[VertexId::from(i)]);
            let row = columns.zip(&laplacian.values()[self.edges.slots(v.index())]);
            for (i, &of_i) in row.clone() {
                for (j, &of_j) in row.clone() {
                    let entry = of_i * of_j / area;
                    match (i, j) {
                        (Number::Free(i), Number::Free(j)) => *energy.of_free.at(i, j) += entry,
                        (Number::Free(i), Number::Held(j)) => energy.across.push((i, j, entry)),
                        (Number::Held(_), Number::Free(_)) => {}
                        (Number::Held(i), Number::Held(j)) => energy.of_held[i * count + j] += entry,
                    }
                }
            }
        }
        energy
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// A field that is constant at the held vertices is constant, on any mesh.
    #[test]
    fn a_move_of_all_held_vertices_moves_all_alike() {
        let mesh = shapes::lattice(21, 13, 0.004);
        let uv = mesh.positions.map(|p| p.truncate());
        let held = [3, 40, 120].map(VertexId::new);
        let by = DVec2::new(0.01, -0.02);
        let bending = Bending::new(&mesh.triangles, &uv, &held).unwrap();
        let field = bending.displacement(&uv, &held.map(|v| (v, by))).unwrap();
        assert!(field.iter().all(|d| d.distance(by) < 1e-9));
    }

    /// A smooth displacement is found again from few of its values, and a field does not depend on the unit.
    #[test]
    fn a_smooth_displacement_is_found_from_few_of_its_values() {
        let mesh = shapes::lattice(31, 21, 0.004);
        let uv = mesh.positions.map(|p| p.truncate());
        let truth = |p: DVec2| 0.02 * DVec2::new((p.x * 12.0).sin(), 0.3 * (p.y * 15.0).cos());
        let held: Vec<VertexId> = (0..uv.len()).step_by(37).map(VertexId::new).collect();
        let of = |scale: f64| {
            let uv = uv.map(|p| *p * scale);
            let bending = Bending::new(&mesh.triangles, &uv, &held).unwrap();
            let given: Vec<_> = held.iter().map(|&v| (v, truth(uv[v] / scale) * scale)).collect();
            bending.displacement(&uv, &given).unwrap().map(|d| *d / scale)
        };
        let field = of(1.0);
        let worst = field.enumerate().map(|(v, d)| d.distance(truth(uv[v]))).fold(0.0, f64::max);
        assert!(worst < 3e-3, "{worst}");
        assert!(field.iter().zip(&of(1000.0)).all(|(a, b)| a.distance(*b) < 1e-9));
    }

    /// The energy of the held displacements is that of the field: zero for a constant one, and least among fields.
    #[test]
    fn the_energy_is_that_of_the_field() {
        let mesh = shapes::lattice(9, 7, 0.004);
        let uv = mesh.positions.map(|p| p.truncate());
        let held = [0, 8, 30, 33, 62].map(VertexId::new);
        let of = |held: &[VertexId], by: &dyn Fn(VertexId) -> f64| {
            let form = Bending::new(&mesh.triangles, &uv, held).unwrap().energy(&uv).unwrap();
            let rows = form.chunks_exact(held.len()).zip(held);
            let row = |(row, v): (&[f64], &VertexId)| {
                by(*v) * row.iter().zip(held).map(|(x, w)| x * by(*w)).sum::<f64>()
            };
            rows.map(row).sum::<f64>()
        };
        assert!(of(&held, &|_| 1.0).abs() < 1e-9);
        let by = |v: VertexId| f64::from(v.raw() % 5);
        let bending = Bending::new(&mesh.triangles, &uv, &held).unwrap();
        let given = held.map(|v| (v, DVec2::new(by(v), 0.0)));
        let field = bending.displacement(&uv, &given).unwrap();
        let all: Vec<VertexId> = uv.ids().skip(1).step_by(2).chain(held).collect();
        let (least, same) = (of(&held, &by), of(&all, &|v| field[v].x));
        assert!((same / least - 1.0).abs() < 1e-6, "more vertices held where they are: {same} and {least}");
    }
}
