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
    /// The number of each vertex among those that are not held.
    free: IdVec<VertexId, Option<usize>>,
    /// Entries of the Laplacian, and of its square over the free vertices.
    edges: Pattern,
    square: Pattern,
    cholesky: Cholesky,
}

impl<'m> Bending<'m> {
    /// Prepares maps of the mesh with these triangles, of which `uv` is one, with `held` vertices.
    pub(super) fn new(
        triangles: &'m IdVec<FaceId, [VertexId; 3]>,
        uv: &IdVec<VertexId, DVec2>,
        held: &[VertexId],
    ) -> Result<Self, SparseError> {
        let mut free: IdVec<VertexId, Option<usize>> = IdVec::filled(Some(0), uv.len());
        held.iter().for_each(|&v| free[v] = None);
        for (number, free) in free.iter_mut().flatten().enumerate() {
            *free = number;
        }
        let sides = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let edges = Pattern::new(uv.len(), sides.map(|(a, b)| (a.index(), b.index())));
        let number = |v: u32| free[VertexId::from(v)];
        let pairs = (0..uv.len()).flat_map(|v| {
            let row = edges.columns(v);
            let below = move |(k, &i): (usize, &u32)| row[..k].iter().map(move |&j| (i, j));
            row.iter().enumerate().flat_map(below)
        });
        let coordinates: Vec<_> =
            free.enumerate().filter(|(_, free)| free.is_some()).map(|(v, _)| uv[v].extend(0.0)).collect();
        let square =
            Pattern::new(coordinates.len(), pairs.filter_map(|(i, j)| Some((number(i)?, number(j)?))));
        let cholesky = Cholesky::new(&square, &coordinates)?;
        Ok(Self { triangles, free, edges, square, cholesky })
    }

    /// The displacement of every vertex of the map `uv`, from that of each held one.
    pub(super) fn displacement(
        &self,
        uv: &IdVec<VertexId, DVec2>,
        held: &[(VertexId, DVec2)],
    ) -> Result<IdVec<VertexId, DVec2>, SparseError> {
        let mut displacement = IdVec::filled(DVec2::ZERO, uv.len());
        held.iter().for_each(|&(v, by)| displacement[v] = by);
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
        let mut square = Matrix::<f64>::zero(&self.square);
        let [mut x, mut y] = [vec![0.0; self.square.rows()], vec![0.0; self.square.rows()]];
        for (v, area) in areas.enumerate() {
            let columns = self.edges.columns(v.index());
            let row = &laplacian.values()[self.edges.slots(v.index())];
            for (&i, &of_i) in columns.iter().zip(row) {
                let Some(free) = self.free[VertexId::from(i)] else { continue };
                for (&j, &of_j) in columns.iter().zip(row) {
                    let entry = of_i * of_j / area;
                    match self.free[VertexId::from(j)] {
                        Some(other) => *square.at(free, other) += entry,
                        None => {
                            let by = displacement[VertexId::from(j)];
                            x[free] -= entry * by.x;
                            y[free] -= entry * by.y;
                        }
                    }
                }
            }
        }
        let factor = self.cholesky.factor(&square)?;
        factor.solve(&mut x)?;
        factor.solve(&mut y)?;
        for (v, free) in self.free.enumerate() {
            if let Some(free) = *free {
                displacement[v] = DVec2::new(x[free], y[free]);
            }
        }
        Ok(displacement)
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
}
